"""Calls whose keywords are held in a dataclass: every keyword is shown with its default, and no other is taken."""

import inspect
from dataclasses import fields
from typing import get_type_hints

import pytest

import errors
import ga
import planner
from errors.referee.montecarlo import SuccessKeywords, SuccessOptions
from errors.referee.twin import MeasurementKeywords, MeasurementOptions
from ga.operators import Keywords, Operators
from planner.inspection_options import InspectionKeywords, InspectionOptions
from planner.setting.setting_options import SettingKeywords, SettingOptions
from planner.verify.simulate_setting import SimulationKeywords, SimulationOptions

CALLS = [
    (ga.maximize, Operators, Keywords, 21),
    (errors.simulate_success, SuccessOptions, SuccessKeywords, 9),
    (errors.simulate_measurement, MeasurementOptions, MeasurementKeywords, 10),
    (planner.plan_setting, SettingOptions, SettingKeywords, 19),
    (planner.plan_inspection, InspectionOptions, InspectionKeywords, 25),
    (planner.simulate_setting, SimulationOptions, SimulationKeywords, 10),
]


@pytest.mark.parametrize(("call", "kind", "_", "n"), CALLS)
def test_every_keyword_is_shown_with_its_default(call, kind, _, n):
    """The numbers of parameters are those of the calls when each keyword was written out."""
    shown = inspect.signature(call).parameters
    assert len(shown) == n
    assert {one.name: one.default for one in fields(kind)}.items() <= {
        k: p.default for k, p in shown.items()
    }.items()
    assert not [p for p in shown.values() if p.kind is p.VAR_KEYWORD]


@pytest.mark.parametrize(("_", "kind", "typed", "__"), CALLS)
def test_type_checkers_are_told_of_the_same_keywords(_, kind, typed, __):
    assert list(typed.__annotations__) == [one.name for one in fields(kind)]
    assert get_type_hints(typed) == get_type_hints(kind)


@pytest.mark.parametrize(("call", "kind", "_", "__"), CALLS)
def test_an_unknown_keyword_is_refused_as_python_would(call, kind, _, __):
    needed = [n for n, p in inspect.signature(call).parameters.items() if p.default is p.empty]
    message = rf"^{call.__name__}\(\) got an unexpected keyword argument 'colour'\..* {fields(kind)[-1].name}\.$"
    with pytest.raises(TypeError, match=message):
        call(**dict.fromkeys(needed), colour="red")


@pytest.mark.parametrize("call", [planner.predict, planner.propose_optics])
def test_options_that_a_call_takes_as_one_value_are_public(call):
    """A user must be able to make them: by their public name, which is documented like the others."""
    assert "InspectionOptions" in inspect.signature(call).parameters["options"].annotation
    assert "InspectionOptions" in planner.__all__
    assert planner.InspectionOptions is InspectionOptions

"""Public calls with many options take them by keyword, each shown with its default, and no other."""

import inspect
from dataclasses import MISSING, fields

import pytest

import errors
import ga
import planner

CALLS = [
    (ga.maximize, 21),
    (errors.simulate_success, 9),
    (errors.simulate_measurement, 10),
    (planner.plan_setting, 19),
    (planner.plan_inspection, 28),
    (planner.simulate_setting, 9),
]


@pytest.mark.parametrize(("call", "n"), CALLS)
def test_every_keyword_is_shown_and_none_is_taken_unseen(call, n):
    shown = inspect.signature(call).parameters
    assert len(shown) == n
    assert not [p for p in shown.values() if p.kind is p.VAR_KEYWORD]


@pytest.mark.parametrize(("call", "_"), CALLS)
def test_an_unknown_keyword_is_refused_by_name(call, _):
    needed = [n for n, p in inspect.signature(call).parameters.items() if p.default is p.empty]
    message = rf"{call.__name__}\(\) got an unexpected keyword argument 'colour'"
    with pytest.raises(TypeError, match=message):
        call(**dict.fromkeys(needed), colour="red")


def test_options_of_a_plan_are_the_keywords_of_the_call_with_the_same_defaults():
    shown = inspect.signature(planner.plan_inspection).parameters
    own = fields(planner.InspectionOptions)
    assert [one.name for one in own] == list(shown)[-len(own) :]
    for one in own:
        assert one.default is not MISSING
        assert shown[one.name].default == one.default
        assert shown[one.name].kind is inspect.Parameter.KEYWORD_ONLY
        assert shown[one.name].annotation == one.type


def test_every_option_of_a_plan_reaches_it(monkeypatch):
    """Each keyword becomes the field of its name."""
    seen = []
    monkeypatch.setattr("planner.inspection.plan_by_options", lambda *given: seen.append(given))
    # what is passed on is no part and no camera
    monkeypatch.setattr("planner.inspection.check_kinds", lambda **given: None)
    values = {one.name: object() for one in fields(planner.InspectionOptions)}
    planner.plan_inspection(1, 2, 3, 4, accuracy=5, probability=6, rng=7, **values)
    ((*others, promise, options),) = seen
    assert (others, tuple(promise)) == ([1, 2, 3, 4], (5, 6, 7))
    assert {name: getattr(options, name) for name in values} == values


@pytest.mark.parametrize("call", [planner.predict, planner.propose_optics])
def test_options_that_a_call_takes_as_one_value_are_public(call):
    """A user must be able to make them: by their public name, which is documented like the others."""
    assert "InspectionOptions" in inspect.signature(call).parameters["options"].annotation
    assert "InspectionOptions" in planner.__all__

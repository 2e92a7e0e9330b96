"""Public calls with many options take them by keyword, each shown with its default, and no other."""

import inspect
from dataclasses import MISSING, fields
from types import SimpleNamespace

import pytest

import errors
import ga
import planner

CALLS = [
    (ga.maximize, 21),
    (errors.simulate_success, 9),
    (errors.simulate_measurement, 10),
    (planner.plan_setting, 19),
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


def test_the_options_of_a_plan_are_one_value_with_defaults():
    (options,) = list(inspect.signature(planner.plan_inspection).parameters.values())[4:5]
    assert (options.name, options.default) == ("options", None)
    assert all(field.default is not MISSING for field in fields(planner.InspectionOptions))


def test_every_option_of_a_plan_reaches_it(monkeypatch):
    """Each keyword becomes the field of its name."""
    seen = []
    monkeypatch.setattr("planner.inspection.resolve_request", lambda *given: seen.append(given))
    monkeypatch.setattr(
        "planner.inspection.plan_request", lambda *given, **named: seen.append(given)
    )
    monkeypatch.setattr("planner.inspection.foreseen_in_time", lambda plan, *_: (plan, []))
    # what is passed on is no part, no camera and no limit
    monkeypatch.setattr("planner.inspection.check_kinds", lambda **given: None)
    never = SimpleNamespace(at=lambda share: None)
    monkeypatch.setattr("planner.inspection.Deadline", lambda *given: never)
    monkeypatch.setattr("planner.options.check_kinds", lambda **given: None)
    monkeypatch.setattr("planner.options.RunOptions.__post_init__", lambda options: None)
    monkeypatch.setattr(planner.InspectionOptions, "lighting", None)
    values = {field.name: object() for field in fields(planner.InspectionOptions)}
    planner.plan_inspection(1, 2, 3, 4, **values)
    planner.plan_inspection(1, 2, 3, 4, planner.InspectionOptions(**values))
    for *others, options in (seen[0], seen[2]):
        assert others == [1, 2, 3, 4]
        assert {name: getattr(options, name) for name in values} == values
    assert seen[1] == (1, None, seen[0][-1])


@pytest.mark.parametrize("call", [planner.predict, planner.propose_optics])
def test_options_that_a_call_takes_as_one_value_are_public(call):
    """A user must be able to make them: by their public name, which is documented like the others."""
    assert "InspectionOptions" in inspect.signature(call).parameters["options"].annotation
    assert "InspectionOptions" in planner.__all__

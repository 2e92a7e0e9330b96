"""Reasons why an entity is not inspected: what they say is so, and no more than is known."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from plan_examples import CAMERA, setting

from planner.columns.outcome import Outcome
from planner.columns.realise_column import meaning
from planner.exceptions import InfeasibleError
from planner.setting.infeasible import check_extent


@pytest.mark.parametrize(
    ("best", "reason"),
    [
        (
            0.5,
            "probability too low: the best pose found reaches P = 0.5000, below the required 0.9.",
        ),
        (
            0.89996,
            "probability too low: the best pose found reaches P = 0.89996, below the required 0.9.",
        ),
        (
            0.95,
            "no feasible view: the best pose found reaches P = 0.9500, but breaks a constraint when judged anew.",
        ),
    ],
)
def test_reason_does_not_contradict_itself(best, reason):
    assert Outcome(setting((0.0, 0.0, 600.0), ["rim"], probability=best)).reason_at(0.9) == reason


def test_reason_of_a_run_without_a_setting_is_its_own():
    assert (
        Outcome(reason="unobservable: no viewpoint").reason_at(0.9) == "unobservable: no viewpoint"
    )


@pytest.mark.parametrize(
    ("ends", "who"),
    [
        ({"rim": ((0, 0, 0), (9000, 0, 0))}, "entity 'rim': its ends are 9000 mm apart"),
        (
            {"rim": ((0, 0, 0), (9, 0, 0)), "slot": ((9000, 0, 0), (8999, 0, 0))},
            "entities 'rim' and 'slot': their ends are 9000 mm apart",
        ),
    ],
)
def test_too_far_apart_names_one_entity_once(ends, who):
    segments = np.array(list(ends.values()), dtype=float)
    owner = np.arange(len(ends))
    constraints = SimpleNamespace(camera=CAMERA, names=tuple(ends), segments=segments, owner=owner)
    with pytest.raises(InfeasibleError, match=f"^field_of_view_px cannot be met for {who}") as told:
        check_extent(constraints)
    assert told.value.proven


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"constraint": "visibility", "proven": True}, "unobservable"),
        ({"constraint": "visibility"}, "in view from no pose tried"),
        ({"constraint": "focus_mm", "together": True}, "no feasible view"),
        ({}, "no feasible view"),
        ({"constraint": "field_of_view_mm"}, "larger than the field of view"),
        ({"constraint": "clearance_mm"}, "in view only too near the part"),
    ],
)
def test_words_before_a_reason_claim_no_more_than_is_known(facts, words):
    """They rest on what the error says as data; its sentence may be reworded."""
    assert meaning(InfeasibleError("any sentence at all", **facts)) == words


def test_what_is_known_crosses_a_process_boundary():
    error = InfeasibleError("no", constraint="visibility", entity="e", margin=-1.0, proven=True)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == "no"
    assert vars(again) == vars(error)

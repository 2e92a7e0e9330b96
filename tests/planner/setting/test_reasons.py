"""Reasons why an entity is not inspected: what they say is so, and no more than is known."""

import copy
import json
import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from plan_examples import CAMERA, plan, setting

from planner.exceptions import InfeasibleError
from planner.plan import InspectionPlan, read_plan
from planner.plan_file import read_schema
from planner.resume import PlanningState
from planner.search.plan_setting import check_extent
from planner.search.realise_column import meaning
from planner.sensor_setting import Outcome, Reason, ReasonKind


@pytest.mark.parametrize(
    ("best", "reason", "kind"),
    [
        (
            0.5,
            "probability too low: the best pose found reaches P = 0.5000, below the required 0.9.",
            ReasonKind.PROBABILITY_TOO_LOW,
        ),
        (
            0.89996,
            "probability too low: the best pose found reaches P = 0.89996, below the required 0.9.",
            ReasonKind.PROBABILITY_TOO_LOW,
        ),
        (
            0.95,
            "no feasible view: the best pose found reaches P = 0.9500, but violates a constraint when checked again.",
            ReasonKind.NO_FEASIBLE_VIEW,
        ),
    ],
)
def test_reason_does_not_contradict_itself(best, reason, kind):
    outcome = Outcome(setting((0.0, 0.0, 600.0), ["rim"], probability=best))
    assert outcome.reason_at(0.9) == reason
    assert outcome.reason_at(0.9).kind is kind


def test_reason_of_a_run_without_a_setting_is_its_own():
    reason = Reason.of(ReasonKind.UNOBSERVABLE, "no viewpoint")
    assert Outcome(reason=reason).reason_at(0.9) is reason
    assert reason == "unobservable: no viewpoint"


def test_a_reason_is_text_whose_kind_crosses_files_and_processes(tmp_path):
    reason = Reason.of(ReasonKind.TOO_SHORT, "1 px.")
    for again in (pickle.loads(pickle.dumps(reason)), copy.deepcopy(reason)):
        assert (again, again.kind) == (reason, ReasonKind.TOO_SHORT)
    assert json.dumps({"e1": reason}) == '{"e1": "too short for the resolution: 1 px."}'
    state = PlanningState({}, tmp_path / "state.json")
    state.put(["a"], Outcome(reason=reason))
    state.save()
    again = PlanningState({}, tmp_path / "state.json").get(["a"]).reason
    assert (again, again.kind) == (reason, ReasonKind.TOO_SHORT)
    name = next(iter(plan().uninspectable))
    written = plan(uninspectable={name: reason})
    written.write(tmp_path / "plan.json")
    read = read_plan(tmp_path / "plan.json")
    assert read == written
    assert read.uninspectable == {name: "too short for the resolution: 1 px."}
    assert read.uninspectable[name].kind is ReasonKind.TOO_SHORT


def test_the_plan_of_an_earlier_program_states_no_kinds(tmp_path):
    reason = Reason.of(ReasonKind.TOO_SHORT, "1 px.")
    name = next(iter(plan().uninspectable))
    record = plan(uninspectable={name: reason}).to_dict()
    assert record["uninspectable_kinds"] == {name: "too short"}
    del record["uninspectable_kinds"]
    read = InspectionPlan.from_dict(record)
    assert read.uninspectable[name] == reason
    assert read.uninspectable[name].kind is ReasonKind.NOT_STATED
    assert "uninspectable_kinds" not in read.to_dict()


def test_the_schema_knows_every_kind():
    kinds = [kind.value for kind in ReasonKind]
    assert read_schema()["$defs"]["reason_kind"]["enum"] == kinds


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
        ({"constraint": "visibility"}, "not in view from any tried pose"),
        ({"constraint": "focus_mm", "together": True}, "no feasible view"),
        ({}, "no feasible view"),
        ({"constraint": "field_of_view_mm"}, "larger than the field of view"),
        ({"constraint": "clearance_mm"}, "in view only from too close to the part"),
    ],
)
def test_words_before_a_reason_claim_no_more_than_is_known(facts, words):
    """They rest on what the error says as data; its sentence may be reworded."""
    assert meaning(InfeasibleError("any sentence at all", **facts)).words == words


def test_what_is_known_crosses_a_process_boundary():
    error = InfeasibleError("no", constraint="visibility", entity="e", margin=-1.0, proven=True)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == "no"
    assert vars(again) == vars(error)

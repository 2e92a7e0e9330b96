"""An output folder belongs to one request; what is unfinished in it is never deleted in silence."""

from __future__ import annotations

import json
from dataclasses import fields

import numpy as np
import pytest
from plan_examples import CAMERA, ENTITIES, UNCERTAINTY, plan

from errors.measurands import Localisation
from planner.app.checks import option
from planner.app.options import Plan
from planner.app.parsing import arguments_of
from planner.app.plan_commands import REGIONS_FOLDER, STATE_FILE, Leftovers, check_owner
from planner.camera.camera import Camera
from planner.effort.effort import Effort
from planner.exceptions import OutputError, PlanFileError
from planner.identity import InspectionRequest, PartRecord, keyword
from planner.light.lighting import Lighting
from planner.request.constraints import Requirements
from planner.request.targets import EntityRecord, edge_target
from planner.resume import PlanningState
from planner.sensor_setting import Outcome

LIMITS = dict.fromkeys(
    ("min_length_px", "field_margin_px", "focus_margin_mm", "stand_off_mm", "visibility_radius_mm"),
    1.0,
)


def targets(**changes):
    """Records of the edges of the hand-made plan; a change is another edge, with other ends."""
    edges = {name: (k, np.array(ends)) for k, (name, ends) in enumerate(ENTITIES.items())}
    edges |= changes
    return tuple(
        edge_target(name, ends, EntityRecord(name, "edge", (edge,)))
        for name, (edge, ends) in edges.items()
    )


def request_(**changes):
    """The request of the hand-made plan."""
    return InspectionRequest(
        **{
            "part": PartRecord("block", "0" * 64),
            "targets": targets(),
            "camera": CAMERA,
            "pose_uncertainty": UNCERTAINTY,
            "localisation": Localisation.rounding(),
            "accuracy": 0.98,
            "probability": 0.9,
            "requirements": Requirements(**LIMITS),
            "workspace": np.array([[-900.0] * 3, [900.0] * 3]),
            "lighting": None,
            "ring": None,
            "seed": 5,
            "effort": Effort(),
            **changes,
        }
    )


OTHERS = {
    "part": ({"part": PartRecord("bracket", "0" * 64)}, "part was 'block' and is now 'bracket'"),
    "seed": ({"seed": 6}, "--seed was 5 and is now 6"),
    "accuracy": ({"accuracy": 0.97}, "--accuracy was 0.98 and is now 0.97"),
    "workspace": ({"workspace": np.array([[-1.0] * 3, [900.0] * 3])}, "--workspace changed"),
    "limits": (
        {"requirements": Requirements(**{**LIMITS, "stand_off_mm": 60.0})},
        "--stand-off was 1 and is now 60",
    ),
    "camera": ({"camera": Camera.named("basler-acA2440-20gm-8mm")}, "--camera changed"),
    "new entity": (
        {"targets": targets(more=(9, [[0.0, 0, 0], [0, 50, 0]]))},
        "target 'more' is new",
    ),
    "another edge": (
        {"targets": targets(bottom=(17, [[0.0, 0, 0], [0, 50, 0]]))},
        "target 'bottom'",
    ),
    "lighting": ({"lighting": Lighting("ring")}, "--light"),
    "effort": ({"effort": Effort.named("quick")}, "--effort changed: pricing rounds was 50"),
    "gap": ({"gap": 0.2}, "--gap was 0 and is now 0.2"),
    "localisation": (
        {"localisation": Localisation.gaussian(0.1, floor_px=0.0)},
        "--localisation changed: model",
    ),
    "surfaces": ({"surfaces_mm": 0.01}, "--surfaces-mm was 0 and is now 0.01"),
    "shape": ({"part": PartRecord("block", "1" * 64)}, "the shape of the part changed"),
}


def write_plan(folder, request, **changes):
    plan(request, **changes).write(folder / "plan.json")


def test_the_same_request_and_an_empty_folder_are_welcome(tmp_path):
    write_plan(tmp_path, request_())
    before = (tmp_path / "plan.json").read_bytes()
    check_owner(tmp_path, request_(), force=False)
    check_owner(tmp_path / "new", request_(), force=False)
    # asking replaces and makes nothing
    assert (tmp_path / "plan.json").read_bytes() == before
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("case", OTHERS)
def test_another_request_needs_force_and_the_option_is_named(tmp_path, case):
    changes, message = OTHERS[case]
    write_plan(tmp_path, request_())
    with pytest.raises(
        OutputError, match="--out must be a folder without another plan; --force replaces it"
    ) as caught:
        check_owner(tmp_path, request_(**changes), force=False)
    assert message in str(caught.value)
    check_owner(tmp_path, request_(**changes), force=True)


def test_a_file_that_is_no_plan_is_not_replaced_either(tmp_path):
    (tmp_path / "plan.json").write_text(json.dumps({"mine": 1}))
    with pytest.raises(OutputError, match=r"Got .*plan\.json: format must be"):
        check_owner(tmp_path, request_(), force=False)


def test_every_field_of_a_request_is_named_as_an_option_that_there_is():
    """So is one that is added, if its option has its name."""
    options = {argument.name for argument in arguments_of(Plan)}
    names = [one.name for kind in (InspectionRequest, Lighting) for one in fields(kind)]
    names += [one.name for one in fields(Requirements)]
    # what the command line cannot ask for, and what is no word of an error
    names = set(names) - {
        *("part", "targets", "requirements", "reach", "field_of_view", "showing"),
        *("tolerance_mm", "pose_uncertainty"),
        # a ring light is of the lighting, too, which is compared first
        "ring",
    }
    for name in map(keyword, names):
        assert option(name) in options, name


# --- what an interrupted planning left ------------------------------------------------------------------------------


def unfinished(folder, request, kind):
    """Leave what a killed planning leaves: its state, or regions only."""
    if kind == "state":
        state = PlanningState(request.identity(), folder / STATE_FILE)
        state.put(["top front"], Outcome(reason="hidden"))
        state.save()
    else:
        (folder / REGIONS_FOLDER).mkdir()
        (folder / REGIONS_FOLDER / "request.json").write_text(json.dumps(request.identity()))
        (folder / REGIONS_FOLDER / "abc.npz").write_text("hours of work")
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def prepare(folder, request, *, resume=False, force=False):
    leftovers = Leftovers(folder)
    leftovers.prepare(request, resume=resume, force=force, quiet=True)
    return leftovers


@pytest.mark.parametrize("kind", ["state", "regions"])
def test_unfinished_work_of_another_request_is_refused_and_stays(tmp_path, kind):
    left = unfinished(tmp_path, request_(), kind)
    place = tmp_path / (STATE_FILE if kind == "state" else REGIONS_FOLDER)
    with pytest.raises(OutputError) as caught:
        prepare(tmp_path, request_(seed=6))
    assert str(caught.value) == (
        f"--out must be a folder without an unfinished plan. Got {place} of another request: "
        "--seed was 5 and is now 6; that request with --resume continues it, --force discards it."
    )
    with pytest.raises(PlanFileError, match="--seed was 5 and is now 6; --force without --resume"):
        prepare(tmp_path, request_(seed=6), resume=True)
    # with both, only a plan may be replaced
    with pytest.raises(PlanFileError, match="--resume must be of the same request"):
        prepare(tmp_path, request_(seed=6), resume=True, force=True)
    assert {path: path.read_bytes() for path in left} == left
    prepare(tmp_path, request_(seed=6), force=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["state", "regions"])
def test_unfinished_work_of_the_same_request_is_continued_or_discarded_as_the_user_says(
    tmp_path, kind
):
    left = unfinished(tmp_path, request_(), kind)
    with pytest.raises(
        OutputError, match="of this request: --resume continues it, --force starts again"
    ):
        prepare(tmp_path, request_())
    prepare(tmp_path, request_(), resume=True)
    assert {path: path.read_bytes() for path in left} == left
    prepare(tmp_path, request_(), force=True)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_state_is_refused_and_stays(tmp_path):
    (tmp_path / STATE_FILE).write_text("{")
    with pytest.raises(OutputError, match=r"must be JSON\. Got.*; --force discards it\.$"):
        prepare(tmp_path, request_())
    assert (tmp_path / STATE_FILE).read_text() == "{"
    with pytest.raises(PlanFileError, match="must be JSON"):
        prepare(tmp_path, request_(), resume=True)
    prepare(tmp_path, request_(), force=True)
    assert not (tmp_path / STATE_FILE).exists()


def test_regions_of_an_earlier_program_are_of_nobody_known(tmp_path):
    (tmp_path / REGIONS_FOLDER).mkdir()
    (tmp_path / REGIONS_FOLDER / "abc.npz").write_text("hours of work")
    with pytest.raises(OutputError, match="--resume continues it, --force starts again"):
        prepare(tmp_path, request_())
    assert prepare(tmp_path, request_(), resume=True)


@pytest.mark.parametrize("given", [{}, {"resume": True}, {"force": True}])
def test_regions_are_not_kept_through_a_link(tmp_path, given):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / REGIONS_FOLDER).symlink_to(elsewhere)
    with pytest.raises(OutputError, match="in which planning-regions is no link"):
        prepare(tmp_path / "out", request_(), **given)
    assert [path.name for path in elsewhere.iterdir()] == ["mine"]

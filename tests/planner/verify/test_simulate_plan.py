"""A simulation that ends in time."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from holed_plate import CAMERA as WIDE
from holed_plate import HOLES, holed_plate, upper_rims
from lit_parts import block
from plan_examples import UNCERTAINTY, changed, plan, setting
from shapely import LineString

from aspectgraph import read_solid
from planner import (
    Detectability,
    InspectionPlan,
    PlanFileError,
    PoseUncertainty,
    RequestError,
    Requirements,
    read_plan,
    simulate_plan,
)
from planner.camera.pose import world_to_cam
from planner.progress import TimeLeft
from planner.report.wording import shown_sentence, unshown_texts
from planner.request.resolve import resolve_wanted
from planner.rows import WarningKind, measured_rows
from planner.verify.simulate_plan import (
    MOST_POSES,
    NOT_COUNTED,
    NOT_SIMULATED,
    ShownImages,
    count_shown,
    simulate_in_time,
)
from planner.verify.simulate_setting import displaced_poses

# the face has a function of the same name
in_time = import_module("planner.verify.simulate_plan")


@pytest.fixture(scope="module")
def block_in_time():
    return read_solid("examples/two_pocket_block.off")


@pytest.fixture(scope="module")
def plan_in_time():
    return read_plan("examples/two_pocket_block_plan.json")


@pytest.mark.parametrize("until", [math.inf, time.time() + 1e6], ids=["never", "late"])
def test_time_enough_changes_nothing(plan_in_time, block_in_time, until):
    found, notes = simulate_in_time(plan_in_time, 500, 3, None, block_in_time, TimeLeft(until))
    assert found == simulate_plan(plan_in_time, 500, 3, solid=block_in_time)
    assert notes == []


def test_without_time_there_is_no_simulation_and_the_reason_is_said(plan_in_time, block_in_time):
    found, notes = simulate_in_time(
        plan_in_time, 500, 3, None, block_in_time, TimeLeft(time.time() - 1.0)
    )
    assert found is None
    assert notes == [NOT_SIMULATED]


def test_less_time_means_fewer_poses(plan_in_time, block_in_time, monkeypatch):
    monkeypatch.setattr(in_time, "_fitting", lambda *_: 300)
    found, notes = simulate_in_time(
        plan_in_time, 500, 3, None, block_in_time, TimeLeft(time.time() + 1e6)
    )
    assert found.n == 300
    assert found == simulate_plan(plan_in_time, 300, 3, solid=block_in_time)
    (note,) = notes
    assert "used 300 instead of 500 displaced poses" in note
    assert "--time-limit" in note


def test_the_number_of_poses_follows_the_time(plan_in_time):
    """As many as fit, none where fewer than 200 would."""
    assert in_time._fitting(plan_in_time, 5000, 3, 1e6) == 5000
    assert in_time._fitting(plan_in_time, 5000, 3, 1e-9) == 0
    some = in_time._fitting(plan_in_time, 10**9, 3, 1.0)
    assert 200 <= some < 10**9
    assert some % 100 == 0


def test_what_the_images_have_no_time_for_is_said(plan_in_time, block_in_time, monkeypatch):
    """The clock passes the deadline while the settings are simulated."""
    monkeypatch.setattr(in_time, "_fitting", lambda *_: 500)
    ticks = iter([0.0, 0.0, 2.0])
    found, notes = simulate_in_time(
        plan_in_time, 500, 3, None, block_in_time, TimeLeft(1.0, lambda: next(ticks))
    )
    assert found == simulate_plan(plan_in_time, 500, 3)
    assert notes == [NOT_COUNTED]


def test_images_of_one_setting_end_with_the_time(plan_in_time, block_in_time, monkeypatch):
    """A setting with many rims takes seconds: the check of its images looks at the clock on the way."""
    clock = SimpleNamespace(now=0.0)
    true_count = in_time.count_shown

    def late(*arguments):
        clock.now = 2.0
        return true_count(*arguments)

    monkeypatch.setattr(in_time, "_fitting", lambda *_: 500)
    monkeypatch.setattr(in_time, "count_shown", late)
    time_left = TimeLeft(1.0, lambda: clock.now)
    found, notes = simulate_in_time(plan_in_time, 500, 3, None, block_in_time, time_left)
    assert found.shown is None
    assert notes == [NOT_COUNTED]


def test_what_is_no_plan(block_in_time, plan_in_time):
    with pytest.raises(RequestError, match="plan must be an InspectionPlan"):
        simulate_plan(block_in_time, plan_in_time)


# How often edges can be found from displaced cameras: counts of a block whose lines are at known
# distances.


def frontal(separation_px, uncertainty=UNCERTAINTY):
    """The top front edge seen frontally from 575 mm: the front's lower edge is 60 mm below."""
    return plan(
        settings=(setting((40.0, -575.0, 30.0), ["top front"], (40.0, 0.0, 30.0), roll=0.0),),
        uninspectable={"top right": "hidden", "bottom": "hidden"},
        requirements=Requirements(showing=Detectability(separation_px, 0.0, 0.0)).to_dict(),
        pose_uncertainty=uncertainty,
    )


def image_px():
    """The distance of the two edges in the planned image, by the camera's matrix."""
    camera = plan().camera
    distance = camera.matrix[1, 1] if abs(setting_up()[1]) > 0.5 else camera.matrix[0, 0]
    return 60.0 * float(distance) / 575.0


def setting_up():
    """Where the part's z is in the image."""
    one = frontal(5.0).settings[0]
    return np.asarray(one.cam2world)[:3, :3].T @ [0.0, 0.0, 1.0]


def test_all_or_none_far_from_the_limit():
    for px, found in ((image_px() - 30, 100), (image_px() + 30, 0)):
        images = count_shown(frontal(px), block(), 100, 0)
        assert images == ShownImages(({"top front": found},), 100)


def test_at_the_limit_by_shapely():
    """The same poses, projected by the matrix alone: the distance of both segments in the image."""
    one = frontal(image_px())
    px = image_px()
    rng = np.random.default_rng([0, 0, 1])
    edges = np.array([[[0.0, 0, 60], [80, 0, 60]], [[0, 0, 0], [80, 0, 0]]])
    found = 0
    for pose in displaced_poses(one.settings[0].cam2world, UNCERTAINTY, MOST_POSES, rng):
        local = world_to_cam(edges.reshape(-1, 3), pose)
        image = (local / local[:, 2:] @ one.camera.matrix.T)[:, :2].reshape(2, 2, 2)
        found += LineString(image[0]).distance(LineString(image[1])) >= px
    assert 20 < found < 120
    assert count_shown(one, block(), 1000, 0) == ShownImages(({"top front": found},), MOST_POSES)
    assert count_shown(one, block(), 1000, 1) != ShownImages(({"top front": found},), MOST_POSES)


def test_a_camera_that_is_sure_of_its_pose():
    sure = PoseUncertainty.isotropic(translation_mm=0.0, rotation_rad=0.0)
    assert (
        count_shown(frontal(image_px() - 0.01, sure), block(), 20, 0).counts[0]["top front"] == 20
    )
    assert count_shown(frontal(image_px() + 0.01, sure), block(), 20, 0).counts[0]["top front"] == 0


def test_who_asks_for_nothing_gets_nothing():
    assert count_shown(frontal(0.0), block(), 100, 0) is None
    empty = replace(
        frontal(5.0),
        settings=(),
        lower_bound=0,
        uninspectable=dict.fromkeys(plan().entities, "hidden"),
    )
    assert empty.simulate(100, solid=block()).shown is None


@pytest.mark.parametrize("name", ["left", "right", "bore"])
def test_a_name_says_nothing_about_the_id_of_a_rim(name):
    """As a file names the left rim: by its id, by that of the other one, or by a word. The images are the same."""
    plate = holed_plate()
    left, right = upper_rims(plate)
    name = {"left": left, "right": right}.get(name, name)
    _, targets = resolve_wanted(plate, {name: left}, 0.98)
    ((x, y), _) = HOLES["left"]
    above = setting((x, y, 410.0), [name], (x, y, 10.0))
    seen = changed(frontal(1.0), targets=targets, settings=(above,), uninspectable={}, camera=WIDE)
    # the lower rim is 8 mm - 8 mm · 400 / 410 inside, 1.1 px
    assert count_shown(seen, plate, 50, 0).counts == ({name: 50},)


def test_another_part():
    from lit_parts import step

    with pytest.raises(RequestError, match="solid must be the plan's part"):
        frontal(5.0).simulate(10, solid=step())


def test_the_plan_keeps_and_tells_it():
    found = frontal(image_px()).simulated(500, solid=block())
    n = found.simulation.shown.counts[0]["top front"]
    told = f"meets the image conditions from only {n} of 200 displaced poses"
    assert (
        InspectionPlan.from_dict(json.loads(json.dumps(found.to_dict()))).simulation
        == found.simulation
    )
    (row,) = measured_rows(found)[0]
    assert (WarningKind.UNSHOWN, told) in row.warnings
    assert unshown_texts(found.simulation.shown, 0) == [f"top front: {told}"]
    assert shown_sentence(found.simulation.shown).endswith(
        f"The target meets the image conditions from {n} of the 200 displaced poses per setting."
    )
    assert shown_sentence(ShownImages(({"a": 200}, {"b": 200}), 200)).endswith(
        "All 2 targets meet the image conditions from each of the 200 displaced poses per setting."
    )
    assert shown_sentence(None) == ""


@pytest.mark.parametrize(
    ("counts", "told"),
    [
        ([], "must hold one object per setting, 1"),
        ([{"top front": 201}], "must be at most 200, the number of images"),
        ([{"nobody": 1}], "must be of a name that the setting measures"),
        ([{"top front": -1}], "must be"),
    ],
)
def test_counts_that_cannot_be(counts, told):
    data = frontal(5.0).simulated(500, solid=block()).to_dict()
    data["simulation"]["shown"]["counts"] = counts
    with pytest.raises(PlanFileError, match=told):
        InspectionPlan.from_dict(data)

"""Other lines in search windows: of the front of a block by similar triangles."""

import numpy as np
import pytest
from lit_parts import block
from plan_examples import CAMERA, ENTITIES, plan, setting

from aspectgraph import compute_regions
from planner import Detectability, PoseUncertainty, Requirements
from planner.detectability.conditions import NOT_ASKED
from planner.plan import InspectionPlan
from planner.request.problem import Problem
from planner.rows import measured_rows
from planner.search.incumbents import with_lines_in_windows

NAME = "top front"
SPACE = compute_regions(block(), {NAME: ENTITIES[NAME]}, workspace=[[-900.0] * 3, [900.0] * 3])
DEPTH_MM = 600.0
HEIGHT_MM = 60.0
# the front face's other long edge is its height away; its short ones leave the edge's ends
APART_PX = CAMERA.matrix[1, 1] * HEIGHT_MM / DEPTH_MM


def planned(sigma_rad, showing):
    """Plan the front's upper edge, seen squarely by a camera that only turns."""
    uncertainty = PoseUncertainty(np.diag([0.0, 0, 0, sigma_rad**2, 0, 0]))
    need = Requirements(showing=showing)
    made = plan(
        settings=(setting((40.0, -DEPTH_MM, 60.0), [NAME], target=(40.0, 0.0, 60.0), roll=0.0),),
        entities={NAME: ENTITIES[NAME]},
        uninspectable={},
        pose_uncertainty=uncertainty,
        requirements=need.to_dict(),
    )
    request = Problem(SPACE, (NAME,), CAMERA, uncertainty, requirements=need)
    return with_lines_in_windows(made, request)


def turn_for(window_px):
    """Return the turn about the image's x axis whose three standard deviations move the axis so far."""
    return window_px / 3.0 / CAMERA.matrix[1, 1]


def test_a_line_inside_the_window_is_kept_and_warned_of():
    found = planned(turn_for(1.1 * APART_PX), Detectability())
    assert found.settings[0].lines_in_window_px[NAME] == pytest.approx(APART_PX, rel=1e-6)
    (row,) = measured_rows(found)[0]
    # the ends lie beside the axis, where a turn about x moves them no less
    assert 1.1 * APART_PX <= row.search_window_px < 1.2 * APART_PX
    assert "another visible line comes within" in row.warnings[-1].text
    assert InspectionPlan.from_dict(found.to_dict()) == found


def test_a_line_outside_the_window_is_not():
    found = planned(turn_for(0.8 * APART_PX), Detectability())
    assert found.settings[0].lines_in_window_px == {}
    assert not any(
        "another visible line" in one.text for one in measured_rows(found)[0][0].warnings
    )
    assert "lines_in_window_px" not in found.to_dict()["settings"][0]
    assert set(found.to_dict()["settings"][0]["search_window_px"]) == {NAME}


def test_plans_that_ask_nothing_of_images_keep_their_file():
    found = planned(turn_for(1.1 * APART_PX), NOT_ASKED)
    assert not {"search_window_px", "lines_in_window_px"} & set(found.to_dict()["settings"][0])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"search_window_px": {NAME: 5000.0}}, r"search_window_px.*must be that of the pose"),
        ({"search_window_px": {}}, r"search_window_px.*must be given"),
        (
            {"lines_in_window_px": {"bottom": 1.0}},
            r"lines_in_window_px.*must be of an entity with a search window",
        ),
        (
            {"lines_in_window_px": {NAME: 1e6}},
            r"lines_in_window_px.*must be at most the search window",
        ),
    ],
)
def test_a_file_that_says_otherwise_is_refused(change, told):
    from planner.exceptions import PlanFileError

    data = planned(turn_for(1.1 * APART_PX), Detectability()).to_dict()
    data["settings"][0].update(change)
    with pytest.raises(PlanFileError, match=told):
        InspectionPlan.from_dict(data)

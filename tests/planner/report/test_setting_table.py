"""What is said below a setting's pictures: numbers of hand-made margins."""

from dataclasses import replace

import numpy as np
import pytest
from plan_examples import CAMERA, plan, setting

from planner.report.tables import binding_sentence, focus_note


def with_margins(margins, requirements=None):
    one = setting((40.0, -180.0, 620.0), ["top front"])
    one = type(one)(**{**vars(one), "margins": margins})
    found = plan(
        settings=(one,),
        entities={"top front": [[0, 0, 60], [80, 0, 60]]},
        uninspectable={},
        requirements=requirements or {},
    )
    return found, one


def test_the_nearest_limit_comes_first():
    told = binding_sentence(*with_margins({"field_of_view_px": 10.24, "workspace_mm": 90.0}))
    # 10.24 px of half of 2048, 90 mm of a tenth of 1800
    assert told.startswith(
        "Tightest constraint: field of view, with 1 % of its margin left: a target is close to"
    )
    assert told.endswith("Next: probability 50 %, workspace 50 %.")
    told = binding_sentence(*with_margins({"field_of_view_px": 0.0003}))
    assert told.startswith(
        "Tightest constraint: field of view, with less than 0.01 % of its margin left:"
    )


@pytest.mark.parametrize(
    ("across_mm", "above_mm", "sigmas"),
    [
        # the camera's place has a standard deviation of 0.05 mm
        (0.0, 0.1, "2"),
        (0.0, 0.16, None),
        # 40 mm off the axis a turn of 1 mrad moves the edge by 0.04 mm, as well: hypot(0.05, 0.04) = 0.064 mm
        (40.0, 0.16, "2.5"),
        (40.0, 0.2, None),
    ],
)
def test_a_point_that_displaced_poses_may_not_have_in_focus_is_told(across_mm, above_mm, sigmas):
    near = CAMERA.depth_of_field_mm[0]
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = [across_mm, 0.0, near + above_mm]
    one = replace(setting((0.0, 0.0, 600.0), ["short"]), cam2world=pose)
    ends = {"short": [[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]}
    note = focus_note(plan(settings=(one,), entities=ends, uninspectable={}), one)
    if sigmas is None:
        assert note == ""
    else:
        assert f" only {sigmas} standard deviations of its depth from a limit" in note

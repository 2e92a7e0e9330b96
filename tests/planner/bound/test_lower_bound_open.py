"""What the lower bound's document called open, and is closed: docs/mathematics/lower-bound.md, section 9."""

from __future__ import annotations

import numpy as np
import pytest
from grid_box import BoxCell, BoxCells, BoxSpace

from planner import Camera, PoseUncertainty
from planner.bound.lower_bound import lower_bound
from planner.camera.pose import look_at
from planner.effort import Effort
from planner.request.problem import Problem
from planner.search.columns import Judge

PAIR = ("+z+y", "+z-y")
WORKSPACE = np.array([[-900.0] * 3, [1100.0] * 3])
CERTAIN = PoseUncertainty.isotropic(translation_mm=1e-6, rotation_rad=1e-8)


class Slab(BoxSpace):
    """Two edges, one visible from z = 460 upwards, the other up to half a micrometre above that."""

    low = 460.0
    high = 460.0005

    def _in_front(self, points, name):
        return points[:, 2] >= self.low if name == PAIR[0] else points[:, 2] <= self.high

    def covering_cells(self, names):
        low, high = WORKSPACE.copy()
        low[2] = self.low if PAIR[0] in names else low[2]
        high[2] = self.high if PAIR[1] in names else high[2]
        return BoxCells([BoxCell(low, high)])


def test_a_viewpoint_in_a_slab_of_half_a_micrometre_serves_both_edges():
    camera = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
    judge = Judge(
        Problem(Slab((120.0, 80.0, 60.0), WORKSPACE, PAIR), PAIR, camera, CERTAIN, 0.98, 0.9)
    )
    pose = look_at([[60.0, 40.0, 460.00025]], [60.0, 40.0, 60.0])
    if not judge(pose).inspects.all():
        pytest.fail("the pose must inspect both edges", pytrace=False)
    effort = Effort(bound_nodes=100_000)
    assert lower_bound(judge.problem, 2, np.eye(2, dtype=bool), effort=effort)[0] == 1

"""A setting is moved off its limits as far as nothing is measured less often from there."""

import itertools

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from planner import Camera, PoseUncertainty, look_at
from planner.effort import Effort
from planner.executors import Shared
from planner.request.problem import Problem
from planner.search import realise_column as centre_column
from planner.search.columns import Judge
from planner.search.evolution import Centring, least_share
from planner.search.plan_setting import setting_at
from planner.search.realise_column import centre_setting

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAME = "+z-y"
SPACE = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
REQUEST = Problem(SPACE, (NAME,), CAMERA, UNCERTAINTY, 0.98, 0.9)
# the edge is near to a side of the picture from the one, and in its middle from the other
START = look_at([[160.0, 0.0, 460.0]], [160.0, 0.0, 60.0])[0]
MIDDLE = look_at([[60.0, 0.0, 460.0]], [60.0, 0.0, 60.0])[0]


def moved_to(furthest_mm, monkeypatch, better=(MIDDLE,)):
    """Move the setting where poses farther from it than so much measure less often."""
    poses = itertools.chain(better, itertools.repeat(START))
    monkeypatch.setattr(centre_column, "centred", lambda *arguments: next(poses))

    def losses(judge, before, seed, give_up):
        def is_far(after):
            return bool(np.linalg.norm((after.cam2world - before.cam2world)[:3, 3]) > furthest_mm)

        return is_far

    monkeypatch.setattr(centre_column, "_Losses", losses)
    given = setting_at(REQUEST, START, (NAME,), "given")
    return centre_setting(Shared(Judge(REQUEST, Effort())), given, 0, 1000, Centring.of(Effort()))


@pytest.mark.parametrize(
    ("furthest_mm", "way_mm"), [(1000, 100.0), (60, 50.0), (49, 25.0), (20, 12.5), (5, 0.0)]
)
def test_it_goes_as_far_as_nothing_is_lost(furthest_mm, way_mm, monkeypatch):
    """All of the 100 mm, or a half, a quarter, an eighth of them, or it stays."""
    setting = moved_to(furthest_mm, monkeypatch)
    assert START[0, 3] - setting.cam2world[0, 3] == pytest.approx(way_mm)
    shares = [least_share(REQUEST, pose).share for pose in (START, setting.cam2world)]
    assert (shares[1] > shares[0]) == (way_mm > 0)
    assert set(setting.p_all) == {NAME}


@pytest.mark.parametrize(("furthest_mm", "way_mm"), [(15, 12.5), (10, 8.0), (5, 0.0)])
def test_a_search_nearby_comes_last(furthest_mm, way_mm, monkeypatch):
    near = look_at([[152.0, 0.0, 460.0]], [152.0, 0.0, 60.0])[0]
    setting = moved_to(furthest_mm, monkeypatch, (MIDDLE, near))
    assert START[0, 3] - setting.cam2world[0, 3] == pytest.approx(way_mm)

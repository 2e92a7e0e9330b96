"""The margin step: as far from the limits as it can be, at no cost in probability that was not agreed to."""

import numpy as np
import pytest
from grid_box import BoxSpace

from planner import Camera, PoseUncertainty, look_at
from planner.camera.pose import world_to_cam
from planner.effort import Effort
from planner.request.constraints import Requirements
from planner.request.problem import Problem
from planner.search import evolution
from planner.search.evolution import Centring, centred, least_share

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
BOX = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], ("+z-y", "+z+x"))
# in a corner of the picture, and turned away
START = look_at([[60.0, -280.0, 380.0]], [-80.0, 40.0, 60.0])[0]
EFFORT = Centring.of(Effort())


def request_of(*names, **more):
    need = Requirements(field_margin_px=10.0, **more)
    return Problem(BOX, names, CAMERA, UNCERTAINTY, 0.98, 0.9, need)


def pixels(request, pose):
    local = world_to_cam(request.ends, pose)
    return (local / local[..., 2:]) @ CAMERA.matrix.T


def test_a_single_edge_comes_to_the_middle_of_the_picture():
    """By symmetry: of the four sides none is nearer than the opposite one at the optimum."""
    request = request_of("+z-y")
    before = least_share(request, START)
    after = least_share(request, centred(request, START, EFFORT, 3))
    assert before.condition == "field_of_view_px"
    assert before.share < 0.3
    assert after.share > 0.6
    image = pixels(request, centred(request, START, EFFORT, 3))[0, :, :2]
    middle = np.array(CAMERA.resolution) / 2 - 0.5
    sides = np.minimum(image, np.array(CAMERA.resolution) - 1 - image).min(axis=0)
    # the ends lie opposite each other about the middle, as far as the other shares leave it to them
    assert np.abs(image.mean(axis=0) - middle).max() < 0.2 * min(CAMERA.resolution)
    assert sides.min() > 0.3 * min(CAMERA.resolution) / 2


@pytest.mark.parametrize("names", [("+z-y",), ("+z-y", "+z+x")])
@pytest.mark.parametrize("seed", range(4))
def test_no_share_is_lost_and_no_probability_beyond_what_is_given_up(names, seed):
    request = request_of(*names)
    rng = np.random.default_rng(seed)
    eye = np.array([60.0, -250.0, 380.0]) + rng.uniform(-60, 60, 3)
    start = look_at(eye[None], np.array([60.0, 40.0, 60.0]) + rng.uniform(-60, 60, 3))[0]
    before = least_share(request, start)
    pose = centred(request, start, EFFORT, seed)
    if before is None:
        assert (pose == start).all()
        return
    assert request.constraints.feasible(pose[None]).all()
    assert least_share(request, pose).share >= before.share
    was, now = (request.objective.probability(one[None])[0] for one in (start, pose))
    assert (now >= np.maximum(request.probability, was - EFFORT.give_up) - 1e-12).all()


def test_the_same_seed_gives_the_same_pose_and_nothing_given_up_none():
    request = request_of("+z-y")
    poses = [centred(request, START, EFFORT, 7) for _ in range(2)]
    assert (poses[0] == poses[1]).all()
    assert (centred(request, START, EFFORT._replace(give_up=0.0), 7) == START).all()


def test_the_part_comes_into_the_picture_where_nothing_else_binds(monkeypatch):
    """The box has a diagonal of 156 mm and the field at 400 mm is 350 mm wide: all of it fits."""
    request = request_of("+z-y")
    # the far side of the box is above the picture
    start = look_at([[60.0, -280.0, 380.0]], [60.0, -150.0, 60.0])[0]
    poses = []
    for weight in (1.0, 0.0):
        monkeypatch.setattr(evolution, "_OUTLINE", weight)
        poses.append(centred(request, start, EFFORT, 3))
    weighed, without = poses

    def outside(pose):
        local = world_to_cam(BOX.solid.vertices, pose)
        image = (local / local[..., 2:] @ CAMERA.matrix.T)[:, :2]
        return int(((image < -0.5) | (image > np.array(CAMERA.resolution) - 0.5)).any(axis=1).sum())

    assert outside(weighed) == 0
    assert outside(weighed) <= outside(without)
    assert outside(start) > 0


def test_a_pose_that_breaks_a_condition_is_left_alone():
    request = request_of("+z-y")
    away = look_at([[60.0, -150.0, 300.0]], [60.0, -900.0, 60.0])[0]
    assert least_share(request, away) is None
    assert (centred(request, away, EFFORT, 0) == away).all()

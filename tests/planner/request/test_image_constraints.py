"""The compiled passes against the plain formulas they stand for."""

import numpy as np
import pytest
from known_box import BoxSpace
from scipy.spatial.transform import Rotation

from planner import Camera, look_at
from planner.camera.pose import moved
from planner.request.constraints import Constraints, Requirements
from planner.request.image_constraints import Lens, image_slacks
from planner.request.reach import visibility_slacks

pytestmark = pytest.mark.uncompiled

CAMERA = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 600.0, largest_blur_mm=0.02)
CLOSE = Camera(6.0, (0.01, 0.01), (4000, 4000), 8.0, 80.0)


def plain_slacks(camera, ends_cam, min_length_mm, margin_px):
    """Eqs 16 to 18 and the rectangular image, whole arrays at a time."""
    depth = ends_cam[..., 2]
    in_front = depth > 0
    image = ends_cam[..., :2] / np.where(in_front, depth, 1.0)[..., None]
    length = camera.image_distance_mm * np.linalg.norm(image[..., 1, :] - image[..., 0, :], axis=-1)
    nearest, farthest = camera.depth_of_field_mm
    pixels = image * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    sides = [pixels[..., 0] + 0.5, camera.resolution[0] - 0.5 - pixels[..., 0]]
    sides += [pixels[..., 1] + 0.5, camera.resolution[1] - 0.5 - pixels[..., 1]]
    sides = [np.where(in_front, side - margin_px, -1e6) for side in sides]
    length = np.where(in_front.all(axis=-1), length, 0.0) - min_length_mm
    return np.concatenate([length[..., None], depth - nearest, farthest - depth, *sides], axis=-1)


def test_one_pass_gives_what_the_formulas_give():
    ends_cam = np.random.default_rng(0).normal(size=(200, 3, 2, 3)) * [80, 80, 200] + [0, 0, 350]
    assert 20 < (ends_cam[..., 2] <= 0).sum() < 300
    own = image_slacks(Lens.of(CAMERA, 0.3, 7.0), ends_cam)
    np.testing.assert_allclose(own, plain_slacks(CAMERA, ends_cam, 0.3, 7.0), rtol=1e-12, atol=1e-9)
    assert image_slacks(Lens.of(CAMERA), np.empty((0, 3, 2, 3))).shape == (0, 3, 13)


def test_moves_are_along_and_about_the_axes_of_the_camera():
    rng = np.random.default_rng(1)
    pose = look_at([[100.0, -200.0, 300.0]], [0, 0, 0], 0.1, -0.2, 0.7)[0]
    moves = rng.normal(size=(50, 6))
    moves[0] = 0.0
    moves[1] *= 1e-9
    moves[2, 3:] = 0.0
    moves[3, 3:] = [np.pi, 0, 0]
    reached = moved(pose, moves, 250.0)
    for move, own in zip(moves, reached, strict=True):
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(move[3:]).as_matrix()
        step[:3, 3] = 250.0 * move[:3]
        np.testing.assert_allclose(own, pose @ step, atol=1e-11)


def test_visibility_of_few_poses_is_that_of_many():
    """Few are asked for together with the points around them, many only if seen themselves."""
    space = BoxSpace()
    names = ["x00", "z00"]
    positions = np.random.default_rng(2).uniform(-150, 150, (400, 3))
    positions[::3] += [0, 0, 2000]
    for radius_mm in (0.0, 5.0):
        many = visibility_slacks(space, positions, names, radius_mm)
        few = np.concatenate(
            [visibility_slacks(space, part, names, radius_mm) for part in np.split(positions, 40)]
        )
        assert np.array_equal(many, few)
        assert 0 < (many > 0).sum() < many.size


def test_who_is_outside_the_part_s_box_by_more_than_the_stand_off_is_clear():
    """Feasible asks Open3D only near the part; that changes no answer."""
    space = BoxSpace()
    constraints = Constraints(space, ["x00"], CLOSE, Requirements(stand_off_mm=75))
    rng = np.random.default_rng(3)
    poses = look_at(rng.normal(size=(2000, 3)) * 60 + [30, -40, -40], [30.0, 0, 0])
    everything = np.all(
        [margin.min(axis=1) >= 0 for margin in constraints.margins(poses).values()], axis=0
    )
    but_clearance = [
        m.min(axis=1) >= 0
        for name, m in constraints.margins(poses).items()
        if name != "clearance_mm"
    ]
    assert np.array_equal(constraints.feasible(poses), everything)
    assert 10 < everything.sum() < np.all(but_clearance, axis=0).sum() - 10

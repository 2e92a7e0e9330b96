"""The compiled passes against the plain formulas they stand for."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest
from known_box import BoxSpace
from plan_examples import CAMERA, UNCERTAINTY, plan
from scipy.spatial.transform import Rotation

from planner import (
    BoxRegion,
    Camera,
    MeshRegion,
    PoseUncertainty,
    RequestError,
    SphereRegion,
    look_at,
    plan_setting,
)
from planner.camera.pose import moved, world_to_cam
from planner.exceptions import PlanFileError
from planner.options import InspectionOptions
from planner.plan import InspectionPlan
from planner.report.wording import requirement_rows
from planner.request.camera_limits import FocusReserve
from planner.request.constraints import (
    FIELD_OF_VIEW,
    FOCUS,
    RESOLUTION,
    Constraints,
    Lens,
    Requirements,
    cone_slacks,
    field_of_view_slacks,
    focus_slacks,
    image_margins,
    image_slacks,
    resolution_slacks,
)
from planner.request.reach import (
    SignedDistance,
    clearance_slacks,
    enclosing_sphere,
    reach_margin,
    visibility_slacks,
    workspace_slacks,
)

CAMERA_CONSTRAINTS = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 600.0, largest_blur_mm=0.02)


@pytest.fixture
def poses():
    rng = np.random.default_rng(5)
    return look_at(
        rng.normal(size=(40, 3)) * 400,
        rng.normal(size=(40, 3)) * 30,
        *rng.uniform(-0.3, 0.3, (3, 40)),
    )


@pytest.fixture
def ends():
    return np.random.default_rng(6).normal(size=(7, 2, 3)) * 40


def opencv_pixels(points, pose, camera):
    """Project with OpenCV, from the inverse pose: a road of its own to the pixels."""
    world2cam = np.linalg.inv(pose)
    rotation, _ = cv2.Rodrigues(world2cam[:3, :3])
    pixels, _ = cv2.projectPoints(
        points.reshape(-1, 3), rotation, world2cam[:3, 3], camera.matrix, None
    )
    return pixels.reshape(*points.shape[:-1], 2)


def depths(points, pose):
    return (points - pose[:3, 3]) @ pose[:3, 2]


def in_front(points, pose):
    return (depths(points, pose) > 0).all(axis=-1)


def test_resolution_is_the_image_length_of_opencv(poses, ends):
    slacks = resolution_slacks(CAMERA_CONSTRAINTS, world_to_cam(ends, poses), min_length_mm=0.2)
    assert slacks.shape == (40, 7, 1)
    checked = 0
    for pose, own in zip(poses, slacks[..., 0], strict=True):
        step = np.diff(
            opencv_pixels(ends, pose, CAMERA_CONSTRAINTS) * CAMERA_CONSTRAINTS.pixel_pitch_mm,
            axis=1,
        )[:, 0]
        visible = in_front(ends, pose)
        assert own[visible] == pytest.approx(np.linalg.norm(step, axis=1)[visible] - 0.2, abs=1e-9)
        assert np.all(own[~visible] == -0.2)
        checked += visible.sum()
    assert checked > 200


def test_resolution_is_equation_16_in_world_vectors(poses, ends):
    slacks = resolution_slacks(CAMERA_CONSTRAINTS, world_to_cam(ends, poses), min_length_mm=0.0)[
        ..., 0
    ]
    d = CAMERA_CONSTRAINTS.image_distance_mm
    for pose, own in zip(poses, slacks, strict=True):
        r_v = pose[:3, 3]
        v = pose[:3, 2]
        for (r_1, r_2), value in zip(ends, own, strict=True):
            if min((r_1 - r_v) @ v, (r_2 - r_v) @ v) <= 0:
                continue
            length = np.linalg.norm(r_2 - r_1)
            u = (r_2 - r_1) / length
            crossed = np.linalg.norm(np.cross(np.cross(r_1 - r_v, u), v))
            assert value == pytest.approx(
                d * length * crossed / (((r_1 - r_v) @ v) * ((r_2 - r_v) @ v))
            )


def test_focus_changes_sign_where_the_blur_circle_is_too_large(poses, ends):
    """The blur circle by the lens equation, evaluated on the fixed sensor: the sign must agree for every end."""
    near = look_at(
        poses[:, :3, 3] * (600 / np.linalg.norm(poses[:, :3, 3], axis=1, keepdims=True)), [0, 0, 0]
    )
    slacks = focus_slacks(CAMERA_CONSTRAINTS, world_to_cam(ends, near))
    depth = np.array([depths(ends, pose) for pose in near])
    image = (
        CAMERA_CONSTRAINTS.focal_length_mm * depth / (depth - CAMERA_CONSTRAINTS.focal_length_mm)
    )
    blur = (
        CAMERA_CONSTRAINTS.aperture_mm
        * np.abs(CAMERA_CONSTRAINTS.image_distance_mm - image)
        / image
    )
    sharp = (blur <= CAMERA_CONSTRAINTS.largest_blur_mm).all(axis=-1)
    assert 20 < sharp.sum() < sharp.size - 20
    assert np.array_equal(slacks.min(axis=-1) >= 0, sharp)


def test_focus_is_a_distance_along_the_axis():
    nearest, farthest = CAMERA_CONSTRAINTS.depth_of_field_mm
    ends_cam = np.array([[[[0, 0, nearest + 1.0], [50, -40, farthest - 2.5]]]])
    assert focus_slacks(CAMERA_CONSTRAINTS, ends_cam)[0, 0] == pytest.approx(
        [1, farthest - 2.5 - nearest, farthest - nearest - 1, 2.5]
    )


def test_a_lens_in_focus_to_infinity_has_no_far_limit():
    camera = Camera(25.0, (0.01, 0.01), (640, 480), 16.0, 20_000.0)
    ends_cam = np.array([[[[0, 0, 19_000.0], [0, 0, 1e9]]]])
    assert focus_slacks(camera, ends_cam).min() >= 0


def test_field_of_view_is_the_distance_from_the_sides_in_opencvs_image(poses, ends):
    slacks = field_of_view_slacks(CAMERA_CONSTRAINTS, world_to_cam(ends, poses), margin_px=5.0).min(
        axis=-1
    )
    width, height = CAMERA_CONSTRAINTS.resolution
    seen = 0
    for pose, own in zip(poses, slacks, strict=True):
        u, v = np.moveaxis(opencv_pixels(ends, pose, CAMERA_CONSTRAINTS), -1, 0)
        expected = np.min([u + 0.5, width - 0.5 - u, v + 0.5, height - 0.5 - v], axis=(0, 2)) - 5.0
        visible = in_front(ends, pose)
        assert own[visible] == pytest.approx(expected[visible], abs=1e-6)
        assert np.all(own[~visible] < -1000)
        seen += (own >= 0).sum()
    assert seen > 10


def test_the_cone_holds_exactly_the_spheres_whose_tangents_stay_within_half_the_angle():
    """Independent: from the apex, a sphere spans asin(R/distance) about its centre's direction."""
    rng = np.random.default_rng(8)
    centres = rng.normal(size=(500, 3)) * [60, 60, 1] + [0, 0, 500]
    half = math.atan(
        min(CAMERA_CONSTRAINTS.sensor_size_mm) / 2 / CAMERA_CONSTRAINTS.image_distance_mm
    )
    distance = np.linalg.norm(centres, axis=1)
    off_axis = np.arccos(centres[:, 2] / distance)
    expected = off_axis + np.arcsin(25.0 / distance) <= half
    assert 50 < expected.sum() < 400
    assert np.array_equal(cone_slacks(CAMERA_CONSTRAINTS, centres, 25.0)[:, 0, 0] >= 0, expected)


def test_the_cone_is_equations_19_and_20_in_world_vectors(poses):
    r_s = np.array([5.0, -8.0, 3.0])
    radius = 30.0
    own = cone_slacks(CAMERA_CONSTRAINTS, world_to_cam(r_s, poses), radius)[:, 0, 0]
    alpha = 2 * math.atan(
        min(CAMERA_CONSTRAINTS.sensor_size_mm) / (2 * CAMERA_CONSTRAINTS.image_distance_mm)
    )
    for pose, value in zip(poses, own, strict=True):
        r_v = pose[:3, 3]
        v = pose[:3, 2]
        r_k = r_s - radius / math.sin(alpha / 2) * v
        assert value == pytest.approx(
            (r_k - r_v) @ v - np.linalg.norm(r_k - r_v) * math.cos(alpha / 2)
        )


def test_the_cone_is_conservative(poses, ends):
    """Whatever the cone accepts has every end inside the exact image."""
    centre, radius = enclosing_sphere(ends[:1].reshape(-1, 3))
    far = look_at(poses[:, :3, 3] * 3, centre + np.random.default_rng(1).normal(size=(40, 3)) * 100)
    accepted = cone_slacks(CAMERA_CONSTRAINTS, world_to_cam(centre, far), radius)[:, 0, 0] >= 0
    assert 5 < accepted.sum() < 40
    assert (
        field_of_view_slacks(CAMERA_CONSTRAINTS, world_to_cam(ends[:1], far), 0.0)[accepted].min()
        >= 0
    )


def test_enclosing_sphere_holds_all_points_and_is_small():
    rng = np.random.default_rng(9)
    directions = rng.normal(size=(200, 3))
    points = 10 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + [100, 0, 0]
    centre, radius = enclosing_sphere(points)
    assert np.linalg.norm(points - centre, axis=1).max() <= radius
    assert radius == pytest.approx(10, rel=0.01)
    assert enclosing_sphere(np.array([[0.0, 0, 0], [6.0, 0, 0]])) == (pytest.approx([3, 0, 0]), 3.0)


def box_distance(points, low, high):
    """Signed distance to a box, by the textbook formula."""
    beyond = np.maximum(low - points, points - high)
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def triangle_distances(points, triangles):
    """Distance of points to a triangle soup by brute force: project on each plane, else on each side."""
    best = np.full(len(points), np.inf)
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        foot = points - ((points - a) @ normal / (normal @ normal))[:, None] * normal
        inside = np.ones(len(points), dtype=bool)
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= (np.cross(q - p, foot - p) @ normal) >= 0
            t = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * (q - p), axis=1))
        best = np.where(inside, np.minimum(best, np.linalg.norm(points - foot, axis=1)), best)
    return best


@pytest.mark.parametrize("origin", [0.0, 20_000.0])
def test_clearance_against_brute_force_near_and_far_from_the_origin(origin):
    space = BoxSpace()
    vertices = space.solid.vertices + origin
    points = np.random.default_rng(2).uniform(-20, 80, (400, 3)) + origin
    signed = (
        clearance_slacks(SignedDistance(vertices, space.solid.triangles), points, 7.0)[:, 0, 0]
        + 7.0
    )
    assert signed == pytest.approx(box_distance(points, vertices[0], vertices[-1]), abs=2e-4)
    assert np.abs(signed) == pytest.approx(
        triangle_distances(points, vertices[space.solid.triangles]), abs=2e-4
    )
    assert (signed < 0).sum() > 3


def test_workspace_margin_is_the_nearest_wall():
    slacks = workspace_slacks(
        ((-10, -20, -30), (10, 20, 30)), np.array([[0, 0, 0], [9, 0, 0], [0, 23, 0.0]])
    )
    assert slacks.min(axis=-1)[:, 0] == pytest.approx([10, 1, -3])


def test_visibility_follows_the_space_and_ends_at_the_workspace():
    space = BoxSpace()
    points = np.array([[10, -50, -50], [10, 20, 15], [10, 20, 500], [0, 0, 5000.0]])
    slacks = visibility_slacks(space, points, ["x00", "z11"])
    assert slacks[..., 0].tolist() == [[1, -1], [-1, -1], [-1, -1], [-1, -1]]


def test_reach_of_box_sphere_mesh_and_callable():
    points = np.array([[0, 0, 0], [30, 20, 15], [30, 20, 40], [200.0, 0, 0]])
    box = BoxSpace().solid
    low, high = box.bounds
    for region in (BoxRegion(low, high), MeshRegion(box.vertices, box.triangles)):
        assert reach_margin(region, points)[:3] == pytest.approx([0, 15, -10], abs=1e-4)
    assert reach_margin(SphereRegion((0, 0, 0), 100.0), points)[[0, 3]] == pytest.approx(
        [100, -100]
    )
    assert reach_margin(lambda p: p[:, 0] < 100, points).tolist() == [1, 1, 1, -1]


def test_a_reach_of_the_wrong_shape_is_refused():
    with pytest.raises(RequestError, match=r"one value per position, shape \(2,\)\. Got \(\)\."):
        reach_margin(lambda p: True, np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Requirements(stand_off_mm=-1),
            r"stand_off_mm must be finite and not negative\. Got -1\.",
        ),
        (lambda: Requirements(min_length_px=math.nan), r"min_length_px must be finite"),
        (
            lambda: Requirements(field_of_view="round"),
            r"field_of_view must be 'exact' or 'cone'\. Got 'round'\.",
        ),
        (
            lambda: Requirements(reach=3),
            r"reach must have a margin method or be callable\. Got 3\.",
        ),
        (lambda: SphereRegion((0, 0, 0), 0.0), r"radius_mm must be positive\. Got 0\.0\."),
        (lambda: BoxRegion((0, 0, 0), (1, -1, 1)), r"low must be below high"),
    ],
)
def test_bad_requirements_are_refused(make, message):
    with pytest.raises(RequestError, match=message):
        make()


@pytest.mark.parametrize("shape", ["exact", "cone"])
def test_feasible_is_every_margin_at_least_zero(shape):
    space = BoxSpace()
    needs = Requirements(field_of_view=shape, reach=BoxRegion((-700,) * 3, (700,) * 3))
    constraints = Constraints(space, ["x00", "z00"], CAMERA_CONSTRAINTS, needs)
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(3000, 3))
    directions *= (rng.uniform(500, 800, 3000) / np.linalg.norm(directions, axis=1))[:, None]
    many = look_at(directions, [20, 10, 10])
    margins = constraints.margins(many)
    by_hand = np.all([margin.min(axis=1) >= 0 for margin in margins.values()], axis=0)
    assert 20 < by_hand.sum() < 2900
    assert np.array_equal(constraints.feasible(many), by_hand)
    assert np.array_equal(constraints.violation(many) == 0, by_hand)
    assert set(margins) == set(constraints.constraint_names)
    assert margins["focus_mm"].shape == (3000, 2)
    assert margins["clearance_mm"].shape == (3000, 1)


def test_visibility_must_hold_around_the_pose():
    """Half a millimetre in front of the plane y = 0 the edge x00 is observable, but not from 1 mm around there."""
    space = BoxSpace()
    beside = np.array([[30.0, -0.5, 100.0]])
    for radius_mm, expected in ((0.0, 1.0), (0.4, 1.0), (1.0, -1.0)):
        assert visibility_slacks(space, beside, ["x00"], radius_mm)[0, 0, 0] == expected


def test_a_displaced_camera_still_sees_everything():
    """Of poses displaced by the uncertainty that was planned for, all but a few see all entities."""
    space = BoxSpace()
    sigma = 2.0
    uncertainty = PoseUncertainty.isotropic(translation_mm=sigma, rotation_rad=0.01)
    setting = plan_setting(space, ["x00", "z00"], CAMERA_CONSTRAINTS, uncertainty)
    displaced = setting.position + np.random.default_rng(0).normal(scale=sigma, size=(20_000, 3))
    assert space.observable(displaced, ["x00", "z00"]).all(axis=1).mean() > 0.99


# The compiled passes against the plain formulas they stand for.


CAMERA_IMAGE_CONSTRAINTS = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 600.0, largest_blur_mm=0.02)
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


@pytest.mark.uncompiled
def test_one_pass_gives_what_the_formulas_give():
    ends_cam = np.random.default_rng(0).normal(size=(200, 3, 2, 3)) * [80, 80, 200] + [0, 0, 350]
    assert 20 < (ends_cam[..., 2] <= 0).sum() < 300
    own = image_slacks(Lens.of(CAMERA_IMAGE_CONSTRAINTS, 0.3, 7.0), ends_cam)
    np.testing.assert_allclose(
        own, plain_slacks(CAMERA_IMAGE_CONSTRAINTS, ends_cam, 0.3, 7.0), rtol=1e-12, atol=1e-9
    )
    assert image_slacks(Lens.of(CAMERA_IMAGE_CONSTRAINTS), np.empty((0, 3, 2, 3))).shape == (
        0,
        3,
        13,
    )


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


# Limits of a request: the reserve of focus, and that the plan's file tells all of them.


LIMITS = Requirements(20.0, 27.0, stand_off_mm=50.0, visibility_radius_mm=0.6, focus_margin_mm=0.8)


def test_a_focus_margin_narrows_the_depth_of_field_at_both_ends():
    near, far = CAMERA.depth_of_field_mm
    depths = near + 0.5, far - 0.25
    ends = np.array([[[[0.0, 0.0, depths[0]], [0.0, 0.0, depths[1]]]]])
    slacks = image_slacks(Lens.of(CAMERA, focus_margin_mm=2.0), ends)[0, 0, FOCUS]
    # by definition: depth - (near + 2) of both ends, then (far - 2) - depth of both
    expected = [0.5 - 2.0, far - near - 0.25 - 2.0, far - near - 0.5 - 2.0, 0.25 - 2.0]
    np.testing.assert_allclose(slacks, expected, atol=1e-9)


def test_a_focus_margin_must_leave_a_depth_of_field():
    near, far = CAMERA.depth_of_field_mm
    just_less = InspectionOptions(focus_margin_mm=0.49 * (far - near)).requirements(
        CAMERA, UNCERTAINTY
    )
    assert just_less.focus_margin_mm == 0.49 * (far - near)
    for value, rule in (
        (0.51 * (far - near), "less than half the depth of field"),
        (-1.0, "not negative"),
    ):
        with pytest.raises(RequestError, match=f"focus_margin_mm must be .*{rule}"):
            InspectionOptions(focus_margin_mm=value).requirements(CAMERA, UNCERTAINTY)


def test_the_file_keeps_the_limits(tmp_path):
    found = plan(requirements=LIMITS)
    data = json.loads(json.dumps(found.to_dict()))
    stored = data["request"]["requirements"]
    assert {name: stored[name] for name in found.requirements} == found.requirements
    assert found.requirements == {
        "min_length_px": 20.0,
        "field_margin_px": 27.0,
        "focus_margin_mm": 0.8,
        "stand_off_mm": 50.0,
        "visibility_radius_mm": 0.6,
    }
    assert InspectionPlan.from_dict(data) == found
    stored["stand_off_mm"] = -1
    with pytest.raises(
        PlanFileError, match=r"requirements\.stand_off_mm must be finite and not negative\. Got -1"
    ):
        InspectionPlan.from_dict(data)


def test_the_report_tells_the_limits():
    rows = requirement_rows(plan(requirements=LIMITS))
    assert rows["Stand-off"] == "at least 50 mm from the part"
    assert rows["Margin of the field of view"].startswith("no target within 27 px ")
    assert rows["Margin of focus"].startswith("0.8 mm ")
    # the camera's place has a standard deviation of 0.05 mm along every axis
    assert rows["Margin of focus"].endswith(
        " (16 standard deviations of the camera along its axis)"
    )
    assert rows["Margin of visibility"].endswith(" (12 standard deviations of its position)")


def test_the_report_tells_the_field_of_views_usual_reserve_in_standard_deviations():
    usual = InspectionOptions().requirements(CAMERA, UNCERTAINTY)
    told = requirement_rows(plan(requirements=usual))["Margin of the field of view"]
    assert told.endswith(" (4 standard deviations of an image point in the corners)")
    exact = PoseUncertainty(np.zeros((6, 6)))
    assert "deviation" not in " ".join(
        requirement_rows(plan(requirements=usual, pose_uncertainty=exact)).values()
    )


def test_margins_in_one_pass_are_the_least_slacks_of_each_item():
    """Of items with several segments, some of them not to be resolved, behind the camera, and with a reserve."""
    rng = np.random.default_rng(6)
    segments = rng.uniform(-40.0, 40.0, (9, 2, 3))
    first = np.array([0, 3, 4])
    resolved = np.array([True, False, True, True, False, False, True, False, False])
    poses = look_at(rng.uniform(-400.0, 400.0, (300, 3)), rng.uniform(-300.0, 300.0, 3))
    sigma = np.diag([0.1, 0.1, 0.2, 1e-3, 2e-3, 1e-3]) ** 2
    reserve = FocusReserve.of(CAMERA_IMAGE_CONSTRAINTS, PoseUncertainty(sigma))
    lens = Lens.of(CAMERA_IMAGE_CONSTRAINTS, 0.3, 7.0, 0.1, reserve)
    margins = image_margins(lens, segments, resolved, first, poses)
    slacks = image_slacks(lens, world_to_cam(segments, poses))
    slacks[:, ~resolved, RESOLUTION] = np.inf
    by_item = [slacks[:, begin:end] for begin, end in zip(first, [3, 4, 9], strict=True)]
    for k, columns in enumerate((RESOLUTION, FOCUS, FIELD_OF_VIEW)):
        expected = np.stack([item[..., columns].min(axis=(1, 2)) for item in by_item], axis=1)
        np.testing.assert_allclose(margins[..., k], expected, rtol=1e-9, atol=1e-9)


def test_a_pose_that_is_no_number_meets_no_margin_of_the_image():
    space = BoxSpace()
    constraints = Constraints(space, ["x00"], CAMERA_CONSTRAINTS, Requirements())
    pose = look_at([[20.0, -400.0, 300.0]], [20.0, 0.0, 0.0])
    pose[0, 0, 3] = np.nan
    for name in constraints.of_image:
        assert not (constraints.margins(pose, [name])[name] >= 0).any()
    assert not constraints.feasible(pose).any()

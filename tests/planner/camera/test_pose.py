import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from planner import PoseUncertainty, RequestError, UncertaintyError, look_at
from planner.camera.pose import (
    aim,
    cam_to_paper,
    paper_displacement_jacobian,
    pose_between,
    world_to_cam,
)

pytestmark = pytest.mark.uncompiled

finite = st.floats(-500, 500, allow_nan=False)
angle = st.floats(-3, 3)


@given(st.tuples(finite, finite, finite), st.tuples(finite, finite, finite), angle, angle, angle)
@settings(max_examples=60, deadline=None)
def test_look_at_gives_rigid_poses_with_the_target_on_the_axis(position, target, pan, tilt, roll):
    if np.array_equal(position, target):
        with pytest.raises(RequestError, match=r"^target must not be the camera's position\. Got "):
            look_at([position], target, [pan], [tilt], [roll])
        return
    pose = look_at([position], target, [pan], [tilt], [roll])[0]
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert pose[:3, 3] == pytest.approx(position)
    if np.linalg.norm(np.subtract(target, position)) > 1e-6:
        seen = world_to_cam(target, look_at([position], target, roll=[roll])[0])
        assert seen[:2] == pytest.approx([0, 0], abs=1e-9)
        assert seen[2] == pytest.approx(np.linalg.norm(np.subtract(target, position)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0), (0, 0, 1)), "positions must have the shape (n, 3). Got (2,)."),
        (([[100, 50]], (0, 0, 0)), "positions must have the shape (n, 3). Got (1, 2)."),
        (([[[0, 0, 9]]], (0, 0, 0)), "positions must have the shape (n, 3). Got (1, 1, 3)."),
        ((9, (0, 0, 0)), "positions must have the shape (n, 3). Got ()."),
        (("up", (0, 0, 0)), "positions must be an array of numbers. Got 'up'."),
        (([[0, 0, np.nan]], (0, 0, 0)), "positions must be finite. Got nan."),
        (
            ([[0, 0, 9]], (0, 0)),
            "target must have the shape (3,), or (1, 3) like positions. Got (2,).",
        ),
        (
            ([[0, 0, 9]] * 3, [[0, 0, 0]] * 2),
            "target must have the shape (3,), or (3, 3) like positions. Got (2, 3).",
        ),
        (([[0, 0, 9]], (0, 0, np.inf)), "target must be finite. Got inf."),
        (
            ([[0, 0, 9], [1, 2, 3]], (1, 2, 3)),
            "target must not be the camera's position. Got [1.0, 2.0, 3.0].",
        ),
        (
            ([[0, 0, 9]], (0, 0, 0), 0.0, [0.1, 0.2]),
            "tilt must be a number or have the shape (1,). Got (2,).",
        ),
        (([[0, 0, 9]], (0, 0, 0), 0.0, 0.0, np.nan), "roll must be finite. Got nan."),
    ],
)
def test_look_at_names_an_argument_that_breaks_its_rule(arguments, message):
    with pytest.raises(RequestError) as caught:
        look_at(*arguments)
    assert str(caught.value) == message


def test_look_at_takes_one_position_and_none():
    assert np.array_equal(look_at((0, 0, 9), (0, 0, 0)), look_at([[0, 0, 9]], [[0, 0, 0]]))
    assert look_at(np.zeros((0, 3)), (0, 0, 1)).shape == (0, 4, 4)


@pytest.mark.parametrize("side", [1, -1])
def test_views_along_the_vertical_are_well_defined(side):
    rotation = aim([[0.0, 0.0, 100.0 * side]], [0.0, 0.0, 0.0])[0]
    assert rotation[:, 2] == pytest.approx([0, 0, -side])
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_a_level_view_has_x_right_and_y_down():
    rotation = aim([[0.0, -10.0, 0.0]], [0.0, 0.0, 0.0])[0]
    assert rotation == pytest.approx(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))


def test_pan_turns_the_view_right_tilt_up_and_roll_clockwise():
    ahead = look_at([[0.0, -10.0, 0.0]], [0.0, 0.0, 0.0])[0]
    for turn, axis, towards in [({"pan": 0.1}, 2, 0), ({"tilt": 0.1}, 2, 1), ({"roll": 0.1}, 0, 1)]:
        turned = look_at([[0.0, -10.0, 0.0]], [0.0, 0.0, 0.0], **turn)[0]
        in_old_frame = ahead[:3, :3].T @ turned[:3, axis]
        expected = np.zeros(3)
        expected[axis] = np.cos(0.1)
        expected[towards] = np.sin(0.1) * (-1 if "tilt" in turn else 1)
        assert in_old_frame == pytest.approx(expected)


def test_world_to_cam_matches_opencv_for_many_poses():
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(3)
    points = rng.normal(size=(5, 2, 3)) * 50
    poses = look_at(rng.normal(size=(4, 3)) * 400, [0, 0, 0], *rng.uniform(-0.3, 0.3, (3, 4)))
    local = world_to_cam(points, poses)
    assert local.shape == (4, 5, 2, 3)
    for pose, own in zip(poses, local, strict=True):
        world2cam = np.linalg.inv(pose)
        pixels, _ = cv2.projectPoints(
            points.reshape(-1, 3), world2cam[:3, :3], world2cam[:3, 3], np.eye(3), None
        )
        assert (own[..., :2] / own[..., 2:]).reshape(-1, 2) == pytest.approx(pixels[:, 0], abs=1e-9)


def test_paper_frame_projects_like_the_camera():
    # eqs 4–5: u = f·C1/(f − C3), v = f·C2/(f − C3), with C2 upwards
    f = 26.0
    point = np.array([30.0, -12.0, 580.0])
    c1, c2, c3 = cam_to_paper(point, f)
    assert c3 < 0
    assert f * c1 / (f - c3) == pytest.approx(f * point[0] / point[2])
    assert f * c2 / (f - c3) == pytest.approx(-f * point[1] / point[2])


@pytest.mark.parametrize("direction", range(6))
@pytest.mark.parametrize("f", [8.0, 26.0])
def test_jacobian_into_the_papers_displacement_against_displaced_cameras(direction, f):
    """Move the camera exactly; the object must move in the paper's frame as C + φ×C + d says, to first order."""
    points = np.random.default_rng(0).uniform([-60, -60, 500], [60, 60, 700], (20, 3))
    size = 1e-6
    move = np.zeros(6)
    move[direction] = size
    rotation = Rotation.from_rotvec(move[3:]).as_matrix()
    translation = move[:3]
    displaced = cam_to_paper((points - translation) @ rotation, f)
    d, phi = np.split(paper_displacement_jacobian(f) @ move, 2)
    c = cam_to_paper(points, f)
    assert displaced == pytest.approx(c + np.cross(phi, c) + d, abs=1e-9)
    assert np.abs(displaced - c).max() > 0.5 * size


def test_paper_covariance_against_sampled_displacements():
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(6, 6)) * np.repeat([0.03, 1e-4], 3)[:, None]
    uncertainty = PoseUncertainty(mixing @ mixing.T)
    f = 26.0
    points = rng.uniform([-60, -60, 500], [60, 60, 700], (3, 3))
    moves = rng.multivariate_normal(np.zeros(6), uncertainty.covariance, 200_000, method="eigh")
    shift = -np.cross(moves[:, None, 3:], points) - moves[:, None, :3]
    expected = np.cov((shift * [1, -1, -1]).reshape(len(moves), -1).T)
    c = cam_to_paper(points, f)
    # C + φ×C + d: identity for d, and for φ the columns e_i × C
    to_shift = np.vstack([np.hstack([np.eye(3), np.cross(np.eye(3), p).T]) for p in c])
    predicted = to_shift @ uncertainty.paper_covariance(f) @ to_shift.T
    assert predicted == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_isotropic_has_the_given_standard_deviations():
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    assert uncertainty.sigmas == pytest.approx([0.05, 0.05, 0.05, 0.001, 0.001, 0.001])
    assert PoseUncertainty.from_dict(uncertainty.to_dict()) == uncertainty
    assert hash(PoseUncertainty.from_dict(uncertainty.to_dict())) == hash(uncertainty)


def test_robot_hand_eye_against_displaced_flanges():
    """Displace the flange about its own origin and read the camera's displacement off the product of poses."""
    cam2flange = np.eye(4)
    cam2flange[:3, :3] = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix()
    cam2flange[:3, 3] = [40.0, -10.0, 90.0]
    uncertainty = PoseUncertainty.robot_hand_eye(
        robot_translation_mm=0.02,
        robot_rotation_rad=1e-4,
        hand_eye_translation_mm=0.0,
        hand_eye_rotation_rad=0.0,
        cam2flange=cam2flange,
    )
    rng = np.random.default_rng(2)
    n = 100_000
    flange = np.tile(np.eye(4), (n, 1, 1))
    flange[:, :3, 3] = rng.normal(size=(n, 3)) * 0.02
    flange[:, :3, :3] = Rotation.from_rotvec(rng.normal(size=(n, 3)) * 1e-4).as_matrix()
    camera = np.linalg.inv(cam2flange) @ flange @ cam2flange
    moves = np.hstack([camera[:, :3, 3], Rotation.from_matrix(camera[:, :3, :3]).as_rotvec()])
    scale = np.outer(uncertainty.sigmas, uncertainty.sigmas)
    assert np.cov(moves.T) / scale == pytest.approx(uncertainty.covariance / scale, abs=0.015)


def test_hand_eye_uncertainty_adds():
    robot = {"robot_translation_mm": 0.0, "robot_rotation_rad": 0.0, "cam2flange": np.eye(4)}
    both = PoseUncertainty.robot_hand_eye(
        hand_eye_translation_mm=0.1, hand_eye_rotation_rad=0.002, **robot
    )
    assert both == PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.002)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.eye(5), r"must have the shape \(6, 6\)\. Got \(5, 5\)"),
        ("many", r"must be a \(6, 6\) array of numbers"),
        (np.diag([1, 1, 1, np.nan, 0, 0]), r"must be finite\. Got nan"),
        (np.diag([1, 1, 1, 0.1, 0.1, 0.1]) + np.eye(6, k=1) * 0.01, r"must be symmetric"),
        (np.diag([1, 1, -1, 0.1, 0.1, 0.1]), r"non-negative variances\. Got -1"),
        (
            np.diag([1.0] * 6) * 1e-4 + 2e-4 * (np.eye(6, k=3) + np.eye(6, k=-3)),
            r"positive semi-definite",
        ),
        (np.diag([1, 1, 1, 1.21, 0, 0]), r"at most 1 rad for phi_x .*Got 1\.1 rad"),
        (np.diag([1, 150.0**2, 1, 0, 0, 0]), r"at most 100 mm for dy .*Got 150 mm"),
    ],
)
def test_impossible_covariances_are_refused(covariance, message):
    with pytest.raises(UncertaintyError, match=message):
        PoseUncertainty(covariance)


def test_negative_standard_deviations_are_refused():
    with pytest.raises(
        UncertaintyError, match=r"rotation_rad must be finite and not negative\. Got -0\.1\."
    ):
        PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=-0.1)


def test_covariance_is_read_only():
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.1)
    with pytest.raises(ValueError, match="read-only"):
        uncertainty.covariance[0, 0] = 1.0


@pytest.mark.parametrize("away", [1e-3, 1e-100, 1e-200, 1e-300])
def test_a_target_however_near_gives_the_direction(away):
    """Squares of numbers below 1e-154 are zero or lose digits."""
    pose = look_at([[0.0, 0.0, 0.0]], [3.0 * away, 4.0 * away, 0.0])[0]
    assert pose[:3, 2] == pytest.approx([0.6, 0.8, 0.0], abs=1e-12)
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 1.0])
def test_a_pose_between_two_has_its_part_of_the_way_and_of_the_turn(part):
    """Against the interpolation of scipy (Slerp)."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        ends = np.tile(np.eye(4), (2, 1, 1))
        turns = Rotation.from_rotvec(rng.normal(0.0, 0.4, (2, 3)))
        ends[:, :3, :3] = turns.as_matrix()
        ends[:, :3, 3] = rng.normal(0.0, 100.0, (2, 3))
        between = pose_between(ends[0], ends[1], part)
        expected = Slerp([0.0, 1.0], turns)(part).as_matrix()
        assert between[:3, :3] == pytest.approx(expected, abs=1e-12)
        assert between[:3, 3] == pytest.approx((1 - part) * ends[0, :3, 3] + part * ends[1, :3, 3])
    same = np.eye(4)
    assert np.array_equal(pose_between(same, same, part), same)


def test_a_translation_in_other_units_is_refused_by_its_name():
    with pytest.raises(UncertaintyError) as info:
        PoseUncertainty.isotropic(translation_mm=500, rotation_rad=0.001)
    assert str(info.value) == (
        "translation_mm must have standard deviations of at most 100 mm. "
        "Got 500 mm; 500 µm are 0.5 mm."
    )
    assert PoseUncertainty.isotropic(translation_mm=100, rotation_rad=0.001).sigmas[0] == 100.0

"""A value whose two entities are measured in images of their own: closed forms, draws, and the bound of each end."""

import math
import pickle

import numpy as np
import pytest
from dimension_examples import PITCH, F
from measured_exactly import look_at
from scipy.spatial.transform import Rotation

from errors.exceptions import InvalidShapeError, MeasurandError
from errors.measurands import Circle, Line, Localisation, MeasurandModel
from errors.measurands.measurand import measurand
from errors.measurands.split import End, SplitModel

EXACT = Localisation.gaussian(0.0, floor_px=0.0)
UP = (0.0, 0.0, 1.0)
COVARIANCE = np.diag([0.03**2] * 3 + [2e-4**2] * 3)
# two entities 200 mm apart, on top of a part
KINDS = {
    "distance": (Line((-20, 0, 0), (20, 0, 0)), Line((-20, 200, 0), (20, 200, 0))),
    "centre_distance": (Circle((0, 0, 0), UP, 8.0), Circle((0, 200, 0), UP, 6.0)),
    "centre_to_edge": (Circle((0, 0, 0), UP, 8.0), Line((-20, 200, 0), (20, 200, 0))),
}


def model_of(kind, *, localisation=EXACT, covariance=COVARIANCE, permitted=0.12, surfaces_mm=0.0):
    return MeasurandModel(
        measurand(kind, KINDS[kind]),
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=covariance,
        localisation=localisation,
        permitted_error=permitted,
        surfaces_mm=surfaces_mm,
    )


def views(rng=None, tilt=0.3):
    """A pose for each entity; straight on without a generator."""
    poses = []
    for y in (0.0, 200.0):
        off = np.zeros(3) if rng is None else 250 * tilt * rng.uniform(-1, 1, 3) * [1, 1, 0]
        eye = np.array([0.0, y, 250.0]) + off
        poses.append(look_at(eye, [1.0, y, 0.0], 0.0 if rng is None else rng.uniform(0, 6)))
    return np.array(poses)


def found_in(shape, pose, moves):
    """What is fitted in the plane z = 0, with the planned pose: y of a line in its middle, or the centre; (n,)."""
    share = (np.arange(24) + 0.5) / 24
    if isinstance(shape, Line):
        points = shape.p + share[:, None] * (shape.q - shape.p)
    else:
        points = shape.points(2 * np.pi * share)
    inside = points @ pose[:3, :3].T + pose[:3, 3]
    turns = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    seen = np.einsum("nij,nmi->nmj", turns, inside - moves[:, None, :3])
    rays = (seen / seen[..., 2:]) @ pose[:3, :3]
    eye = -pose[:3, :3].T @ pose[:3, 3]
    flat = eye[:2] - eye[2] * rays[..., :2] / rays[..., 2:]
    if isinstance(shape, Line):
        x = flat[..., 0] - flat[..., 0].mean(axis=1, keepdims=True)
        y = flat[..., 1]
        slope = (x * y).sum(axis=1) / (x**2).sum(axis=1)
        return y.mean(axis=1) + slope * (shape.middle[0] - flat[..., 0].mean(axis=1))
    # the algebraic circle x² + y² = 2 a x + 2 b y + c
    design = np.concatenate([2 * flat, np.ones((*flat.shape[:2], 1))], axis=2)
    right = (flat**2).sum(axis=2)
    normal = np.einsum("nmi,nmj->nij", design, design)
    return np.linalg.solve(normal, np.einsum("nmi,nm->ni", design, right)[..., None])[:, 1, 0]


def test_straight_on_it_is_the_closed_form():
    """Each end is off by the camera's place and by its tilt times the height, and the ends are independent."""
    sigma = math.sqrt(2 * (0.03**2 + (250 * 2e-4) ** 2))
    for permitted in (0.05, 0.12, 0.3):
        split = SplitModel(model_of("distance", permitted=permitted))
        expected = math.erf(permitted / sigma / math.sqrt(2))
        assert split.probability(views()) == pytest.approx(expected, abs=3e-4)
    assert split.standard_uncertainty(views()) == pytest.approx(sigma, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(2))
def test_draws_of_both_cameras_agree(kind, seed):
    rng = np.random.default_rng(seed)
    poses = views(rng)
    n = 40_000
    root = np.linalg.cholesky(COVARIANCE)
    ends = [
        found_in(shape, pose, rng.normal(size=(n, 6)) @ root.T)
        for shape, pose in zip(KINDS[kind], poses, strict=True)
    ]
    error = ends[1] - ends[0] - 200.0
    split = SplitModel(model_of(kind))
    share = np.mean(np.abs(error) <= 0.12)
    chance = math.sqrt(share * (1 - share) / n)
    assert split.probability(poses) == pytest.approx(share, abs=4 * chance + 1e-3)
    assert split.standard_uncertainty(poses) == pytest.approx(error.std(), rel=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_by_exact_cameras_of_one_pose_it_is_the_whole_value(kind):
    still = np.zeros((6, 6))
    pose = look_at(np.array([10.0, 90.0, 500.0]), [0.0, 100.0, 0.0], 0.4)
    localisation = Localisation.fit(sigma_px=2.0)
    whole = model_of(kind, localisation=localisation, covariance=still, permitted=0.05)
    together = SplitModel(whole).probability([pose, pose])
    assert 0.05 < together < 0.999
    assert together == pytest.approx(float(whole.probability(pose[None])[0]), abs=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_face_that_carries_both_cancels_in_parallel_views(kind):
    split = SplitModel(model_of(kind, surfaces_mm=0.02))
    poses = views()
    assert split.by_surfaces(poses) == pytest.approx(0.0, abs=1e-3 * 0.02)
    # seen from outside on both sides, a higher face makes it longer at both ends
    tilted = np.array(
        [look_at(np.array([0.0, y, 250.0]), [0.0, z, 0.0], 0.0) for y, z in ((-100, 0), (300, 200))]
    )
    assert split.by_surfaces(tilted) == pytest.approx(0.02 * 2 * 100 / 250, rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_plane_does_to_one_end_is_what_the_compiled_model_says(kind):
    rng = np.random.default_rng(3)
    for pose, k in zip(views(rng), range(2), strict=True):
        end = End(measurand(kind, KINDS[kind]), k)
        model = MeasurandModel(
            end,
            image_distance_mm=F,
            pixel_pitch_mm=PITCH,
            pose_covariance=np.zeros((6, 6)),
            localisation=EXACT,
            permitted_error=0.05,
            surfaces_mm=0.02,
        )
        surfaces = math.sqrt(model.describe(pose).budget["surfaces"])
        assert surfaces == pytest.approx(0.02 * abs(end.by_plane(pose)), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_no_end_alone_is_less_probable_than_both(kind, seed):
    """Anderson (1955): another independent symmetric unimodal error makes a small sum less probable."""
    rng = np.random.default_rng(seed)
    permitted = rng.uniform(0.03, 0.2)
    whole = model_of(kind, permitted=permitted, localisation=Localisation.fit(sigma_px=0.2))
    split = SplitModel(whole)
    poses = views(rng)
    together = split.probability(poses)
    for k in range(2):
        alone = split.end_probability(k, poses[k])
        assert together <= alone + 1e-3


def test_ends_go_through_files_and_processes():
    end = End(measurand("centre_distance", KINDS["centre_distance"]), 1)
    again = pickle.loads(pickle.dumps(end))
    assert again.entity == 1
    np.testing.assert_array_equal(again.fitted.gradient, end.fitted.gradient)
    moved = np.array([[0.0, 0.1, 6.0]])
    assert abs(float(again.value([moved])[0])) == pytest.approx(0.1, abs=1e-4)


def test_refusals_say_what_is_wrong():
    diameter = MeasurandModel(
        measurand("diameter", (Circle((0, 0, 0), UP, 8.0),)),
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=COVARIANCE,
        localisation=EXACT,
        permitted_error=0.05,
    )
    with pytest.raises(MeasurandError, match="must have two entities"):
        SplitModel(diameter)
    length = measurand("length", (Line((0, 0, 0), (10, 0, 0)),))
    with pytest.raises(MeasurandError, match="'length'"):
        End(length, 0)
    with pytest.raises(InvalidShapeError, match="world_to_camera must have shape"):
        SplitModel(model_of("distance")).probability(np.eye(4)[None])
    behind = views()
    behind[1] = look_at(np.array([0.0, 200.0, 250.0]), [0.0, 200.0, 500.0], 0.0)
    assert SplitModel(model_of("distance")).probability(behind) == 0.0

"""A value whose ends are measured in images of their own: closed forms, draws, and the bound of each end."""

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
from errors.measurands.split import End, SplitModel, end_groups, split_model

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


def flat_points(shape, pose, moves):
    """Points (n, m, 2) of an entity in the plane z = 0, carried back with the planned pose."""
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
    return eye[:2] - eye[2] * rays[..., :2] / rays[..., 2:]


def line_in(shape, pose, moves):
    """Place across a line at its middle, and its slope, each (n,); across one along y is -x."""
    flat = flat_points(shape, pose, moves)
    if abs(shape.direction[0]) < abs(shape.direction[1]):
        flat = np.stack([flat[..., 1], -flat[..., 0]], axis=2)
        middle = shape.middle[1]
    else:
        middle = shape.middle[0]
    x = flat[..., 0] - flat[..., 0].mean(axis=1, keepdims=True)
    y = flat[..., 1]
    slope = (x * y).sum(axis=1) / (x**2).sum(axis=1)
    return y.mean(axis=1) + slope * (middle - flat[..., 0].mean(axis=1)), slope


def circle_in(shape, pose, moves):
    """Centres (n, 2) of the algebraic circle x² + y² = 2 a x + 2 b y + c."""
    flat = flat_points(shape, pose, moves)
    design = np.concatenate([2 * flat, np.ones((*flat.shape[:2], 1))], axis=2)
    right = (flat**2).sum(axis=2)
    normal = np.einsum("nmi,nmj->nij", design, design)
    return np.linalg.solve(normal, np.einsum("nmi,nm->ni", design, right)[..., None])[:, :2, 0]


def found_in(shape, pose, moves):
    """What is fitted in the plane z = 0, with the planned pose: y of a line in its middle, or the centre; (n,)."""
    if isinstance(shape, Line):
        return line_in(shape, pose, moves)[0]
    return circle_in(shape, pose, moves)[:, 1]


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
        assert surfaces == pytest.approx(
            0.02 * abs(float(end.by_planes(pose)[0, 0])), rel=1e-6, abs=1e-12
        )


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
    assert again.entities == (1,)
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
    with pytest.raises(MeasurandError, match="must have two entities, or be a position"):
        SplitModel(diameter)
    length = measurand("length", (Line((0, 0, 0), (10, 0, 0)),))
    with pytest.raises(MeasurandError, match="'length'"):
        End(length, 0)
    with pytest.raises(InvalidShapeError, match="world_to_camera must have shape"):
        SplitModel(model_of("distance")).probability(np.eye(4)[None])
    behind = views()
    behind[1] = look_at(np.array([0.0, 200.0, 250.0]), [0.0, 200.0, 500.0], 0.0)
    assert SplitModel(model_of("distance")).probability(behind) == 0.0


# a rim, and far from it an edge that fixes the turn and a second rim that fixes the place along the edge
RIM = Circle((0, 0, 0), UP, 8.0)
EDGE = Line((-20, 200, 0), (20, 200, 0))
OTHER = Circle((30, 180, 0), UP, 6.0)
SQUARE = Line((40, 180, 0), (40, 220, 0))


def position_model(*, permitted=0.3, datums=(EDGE, OTHER), surfaces_mm=0.0, localisation=EXACT):
    return measurand("position", (RIM, *datums)).model(
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=COVARIANCE,
        localisation=localisation,
        permitted_error=permitted,
        surfaces_mm=surfaces_mm,
    )


def drawn_deviations(poses, n, rng):
    """e (n, 2) of draws: the edge's own direction turns the frame, which begins on it, at the foot of the other rim."""
    root = np.linalg.cholesky(COVARIANCE)
    moves = [rng.normal(size=(n, 6)) @ root.T for _ in range(2)]
    centre = circle_in(RIM, poses[0], moves[0])
    other = circle_in(OTHER, poses[1], moves[1])
    place, slope = line_in(EDGE, poses[1], moves[1])
    size = np.hypot(1.0, slope)
    along = np.stack([1.0 / size, slope / size], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    on_edge = np.stack([np.zeros(n), place], axis=1)
    x = ((centre - other) * along).sum(axis=1) + 30.0
    y = ((centre - on_edge) * across).sum(axis=1) + 200.0
    return np.stack([x, y], axis=1)


@pytest.mark.parametrize("seed", range(2))
def test_draws_of_a_position_and_its_datums_agree(seed):
    rng = np.random.default_rng(seed)
    poses = views(rng)
    split = split_model(position_model())
    e = drawn_deviations(poses, 40_000, rng)
    for permitted in (0.15, 0.3):
        share = np.mean(2.0 * np.hypot(*e.T) <= permitted)
        predicted = split_model(position_model(permitted=permitted)).probability(poses)
        assert 0.1 < share < 0.999
        assert predicted == pytest.approx(share, abs=0.01)
    np.testing.assert_allclose(split.covariance_at(poses), np.cov(e.T), atol=0.04 * e.var())
    largest = math.sqrt(np.linalg.eigvalsh(np.cov(e.T))[-1])
    assert split.standard_uncertainty(poses) == pytest.approx(2 * largest, rel=0.03)


def test_the_rim_is_one_end_and_its_far_datums_are_the_other():
    value = measurand("position", (RIM, EDGE, OTHER))
    assert end_groups(value) == ((0,), (1, 2))
    near = Circle((20, 5, 0), UP, 3.0)
    assert end_groups(measurand("position", (RIM, EDGE, near))) == ((0, 2), (1,))
    assert end_groups(measurand("distance", KINDS["distance"])) == ((0,), (1,))
    # too many to try all groups: cut where they lie apart
    holes = [Circle((x, y, 0), UP, 2.0) for y in (0, 200) for x in range(20, 120, 20)]
    pattern = measurand("position", (RIM, EDGE, OTHER, *holes), groups=(1, 1))
    first, second = end_groups(pattern)
    assert first == (0, 3, 4, 5, 6, 7)
    assert second == (1, 2, 8, 9, 10, 11, 12)


def test_exact_cameras_of_one_pose_give_the_whole_position():
    pose = look_at(np.array([10.0, 90.0, 500.0]), [0.0, 100.0, 0.0], 0.4)
    whole = measurand("position", (RIM, EDGE, OTHER)).model(
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=np.zeros((6, 6)),
        localisation=Localisation.fit(sigma_px=2.0),
        permitted_error=0.12,
        surfaces_mm=0.02,
    )
    together = split_model(whole)
    assert 0.05 < float(whole.probability(pose[None])[0]) < 0.999
    assert together.probability([pose, pose]) == pytest.approx(
        float(whole.probability(pose[None])[0]), abs=1e-6
    )
    np.testing.assert_allclose(together.covariance_at([pose, pose]), whole.covariance_at(pose))


def test_a_face_that_carries_rim_and_datums_cancels_in_parallel_views():
    """Three faces would move e by their parts; the one face of all moves it by their sum, which is none."""
    split = split_model(position_model(surfaces_mm=0.5))
    # straight above the rim, and above where the datums fix the place along the edge and across it
    places = np.array([[0.0, 0.0, 250.0], [30.0, 200.0, 250.0]])
    above = np.array([look_at(at, at * [1, 1, 0], 0.0) for at in places])
    np.testing.assert_allclose(split.by_faces(above), 0.0, atol=1e-3)
    # views that are tilted by 100 in 250 move their ends by .4 of what the face is off, both outwards
    outwards = np.array([[0.0, -100.0, 0.0], [0.0, 100.0, 0.0]])
    tilted = np.array(
        [look_at(at + out, at * [1, 1, 0], 0.0) for at, out in zip(places, outwards, strict=True)]
    )
    assert np.linalg.norm(split.by_faces(tilted)) == pytest.approx(2 * 100 / 250, rel=0.02)
    carried = np.concatenate(
        [end.by_planes(at).T for end, at in zip(split.ends, tilted, strict=True)]
    )
    assert np.linalg.norm(carried[0]) == pytest.approx(0.4, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_no_end_of_a_position_is_less_probable_than_both(seed):
    """Anderson (1955): the disc is convex and symmetric, so a further symmetric unimodal error cannot help."""
    rng = np.random.default_rng(seed)
    model = position_model(
        permitted=rng.uniform(0.1, 0.4), localisation=Localisation.fit(sigma_px=0.2)
    )
    split = split_model(model)
    poses = views(rng)
    together = split.probability(poses)
    for k in range(2):
        assert together <= split.end_probability(k, poses[k]) + 1e-3


def test_a_deviation_of_one_component_is_an_interval():
    """About a hole as the only datum, the radius counts: the error is that of a distance of centres."""
    permitted = 0.2
    radial = split_model(position_model(permitted=2 * permitted, datums=(OTHER,)))
    distance = measurand("centre_distance", (RIM, OTHER)).model(
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=COVARIANCE,
        localisation=EXACT,
        permitted_error=permitted,
    )
    poses = views(np.random.default_rng(1))
    assert radial.probability(poses) == pytest.approx(
        split_model(distance).probability(poses), abs=2e-3
    )


@pytest.mark.parametrize("seed", range(2))
def test_draws_of_an_angle_agree(seed):
    rng = np.random.default_rng(seed)
    lines = Line((-20, 0, 0), (20, 0, 0)), SQUARE
    model = measurand("angle", lines).model(
        image_distance_mm=F,
        pixel_pitch_mm=PITCH,
        pose_covariance=COVARIANCE,
        localisation=EXACT,
        permitted_error=0.03,
    )
    poses = views(rng)
    root = np.linalg.cholesky(COVARIANCE)
    moves = [rng.normal(size=(40_000, 6)) @ root.T for _ in range(2)]
    slopes = [
        line_in(shape, pose, move)[1] for shape, pose, move in zip(lines, poses, moves, strict=True)
    ]
    error = np.degrees(np.arctan(slopes[1]) - np.arctan(slopes[0]))
    split = split_model(model)
    assert split.ends[0].unit == "deg"
    assert split.probability(poses) == pytest.approx(np.mean(np.abs(error) <= 0.03), abs=0.01)
    assert split.standard_uncertainty(poses) == pytest.approx(error.std(), rel=0.03)

"""The floor of localisation and surfaces that are off: answers in closed form, and against exact measurements."""

import math

import numpy as np
import pytest
from dimension_examples import EXAMPLES, PITCH, F, geometry_of, isotropic
from measured_exactly import look_at, measure, random_view
from test_measurand_answers import KINDS, OVERHEAD, SQUARE, STILL, Z, predict

from errors.exceptions import InvalidParameterError
from errors.measurands import Circle, Line, Localisation, MeasurandModel
from errors.measurands.measurand import measurand

pytestmark = pytest.mark.uncompiled

S = 0.05
FLOOR = Localisation.gaussian(0.0, floor_px=S)
EXACT = Localisation.gaussian(0.0, floor_px=0.0)
STEP = S * SQUARE[0] * Z / F
"""The floor in the plane Z away, mm."""


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("diameter", 2 * STEP),
        ("radius", STEP),
        ("distance", math.sqrt(2) * STEP),
        ("length", math.sqrt(2) * STEP),
        # the centre of a rim that grows stays where it is; the line is shifted
        ("centre_distance", 0.0),
        ("centre_to_edge", STEP),
        ("angle", 0.0),
    ],
)
def test_floor_square_on(kind, expected):
    found = predict(kind, KINDS[kind], STILL, FLOOR)
    assert found.standard_uncertainty == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert found.budget["localisation_floor"] == pytest.approx(expected**2, rel=1e-9, abs=1e-20)
    assert found.budget["localisation"] == found.budget["surfaces"] == 0.0


def test_no_number_of_points_averages_the_floor_out():
    for points in (4, 16, 400):
        how = Localisation.gaussian(0.2, points, floor_px=S)
        found = predict("diameter", KINDS["diameter"], STILL, how)
        random = 2 * 0.2 * SQUARE[0] * Z / F / math.sqrt(points)
        assert found.standard_uncertainty == pytest.approx(math.hypot(random, 2 * STEP), rel=1e-9)


def test_the_radius_of_a_short_arc_grows_by_the_floor_as_that_of_a_rim():
    # all of its points move outward about the same centre, so the fit is leveraged by nothing
    arc = Circle((0, 0, 0), (0, 0, 1), 10.0, (1, 0, 0), 2.0)
    found = predict("radius", (arc,), STILL, FLOOR)
    assert math.sqrt(found.budget["localisation_floor"]) == pytest.approx(STEP, rel=1e-9)


def test_floor_of_pixels_that_are_not_square():
    # lines along x are shifted across it, by pixels of the pitch along y; and the other way round
    for order, pitch in (([0, 1, 2], PITCH[1]), ([1, 0, 2], PITCH[0])):
        lines = tuple(Line(one.p[order], one.q[order]) for one in KINDS["distance"])
        found = predict("distance", lines, STILL, FLOOR, pitch=PITCH)
        assert found.standard_uncertainty == pytest.approx(
            math.sqrt(2) * S * pitch * Z / F, rel=1e-9
        )


def test_a_probability_counts_the_floor_as_a_normal_error():
    found = predict("diameter", KINDS["diameter"], STILL, FLOOR, permitted=1.3 * 2 * STEP)
    assert found.probability == pytest.approx(math.erf(1.3 / math.sqrt(2)), abs=2e-5)


@pytest.mark.parametrize("across", [(0.0, 0.0), (40.0, -25.0)])
@pytest.mark.parametrize(("kind", "size"), [("diameter", 20.0), ("radius", 10.0)])
def test_a_face_that_is_off_scales_its_circle(across, kind, size):
    # between parallel planes the projection is a homothety of 1 + delta / Z, on the axis and off it
    rim = (Circle((*across, 0), (0, 0, 1), 10.0),)
    found = predict(kind, rim, STILL, surfaces=0.02)
    assert found.standard_uncertainty == pytest.approx(0.02 * size / Z, rel=1e-9)
    assert found.budget["surfaces"] == pytest.approx((0.02 * size / Z) ** 2, rel=1e-9)


def test_seen_at_a_slant_the_plane_s_distance_counts():
    pose = look_at(np.array([120.0, -50, 260]), [3.0, 4, 0], 0.3)
    found = predict("diameter", KINDS["diameter"], STILL, pose=pose, surfaces=0.02)
    assert found.standard_uncertainty == pytest.approx(0.02 * 20 / 260, rel=1e-9)


def test_entities_of_one_face_share_its_deviation_and_others_do_not():
    lines = Line((-15, 10, 0), (15, 10, 0)), Line((-15, 30, 0), (15, 30, 0))
    one = predict("distance", lines, STILL, surfaces=0.02, way=(0, 1, 0))
    assert one.standard_uncertainty == pytest.approx(0.02 * 20 / Z, rel=1e-9)
    raised = lines[0], Line((-15, 30, 40), (15, 30, 40))
    two = predict("distance", raised, STILL, surfaces=0.02, way=(0, 1, 0))
    # each line moves by its own y delta / height, away from the foot of the axis
    expected = 0.02 * math.hypot(10 / Z, 30 / (Z - 40))
    assert two.standard_uncertainty == pytest.approx(expected, rel=1e-9)


def test_surfaces_of_the_other_kinds_square_on():
    found = {
        kind: predict(kind, KINDS[kind], STILL, surfaces=0.02).standard_uncertainty
        for kind in ("centre_distance", "centre_to_edge", "angle", "length")
    }
    # homothety again: distances in one face grow by delta / Z, angles stay
    assert found["centre_distance"] == pytest.approx(0.02 * 20 / Z, rel=1e-9)
    assert found["centre_to_edge"] == pytest.approx(0.02 * 20 / Z, rel=1e-9)
    assert found["angle"] == pytest.approx(0.0, abs=1e-12)
    # an edge in the middle of the image: only its depth counts
    assert found["length"] == pytest.approx(0.02 * 20 / Z, rel=1e-9)


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_derivatives_against_exact_measurements(name):
    """One standard deviation of each common error alone, measured by another program from slanted views."""
    kind, plain, direction = EXAMPLES[name]
    value = measurand(kind, geometry_of(plain), direction)
    rng = np.random.default_rng(5)
    still = np.zeros((1, 6))
    surface, _ = value.surfaces
    for _ in range(6):
        pose = random_view(rng)
        for how, off in ((FLOOR, 0.0), (EXACT, 0.02)):
            found = MeasurandModel(
                value,
                image_distance_mm=F,
                pixel_pitch_mm=PITCH,
                pose_covariance=STILL,
                localisation=how,
                permitted_error=0.01,
                surfaces_mm=off,
            ).describe(pose)
            square = 0.0
            for common in _each(kind, len(plain), surface, off):
                two = [
                    measure(
                        kind, plain, pose, still, f=F, direction=direction, pitch=PITCH,
                        common={part: sign * one for part, one in common.items()},
                    )[0]
                    for sign in (1, -1)
                ]  # fmt: skip
                square += ((two[0] - two[1]) / 2) ** 2
            assert found.standard_uncertainty == pytest.approx(
                math.sqrt(square), rel=2e-3, abs=1e-7
            )


def _each(kind, n, surface, off):
    """The independent common errors, one after the other, one standard deviation each."""
    if kind == "length":
        return [{"places": off * way} for way in np.eye(2)] if off else [
            {"ends_px": S * way} for way in np.eye(2)
        ]  # fmt: skip
    if not off:
        return [{"floor_px": S * way} for way in np.eye(n)]
    return [{"surfaces_mm": off * (np.asarray(surface) == one)} for one in dict.fromkeys(surface)]


def test_simulated_errors_stay_within_what_is_stated():
    """2u holds 95 % of exact measurements that have all errors at once, drawn independently."""
    rng = np.random.default_rng(11)
    covariance = isotropic(0.02, 0.0003)
    n = 4000
    moves = rng.multivariate_normal(np.zeros(6), covariance, n)
    for name in ("diameter", "distance", "centre_to_edge"):
        kind, plain, direction = EXAMPLES[name]
        value = measurand(kind, geometry_of(plain), direction)
        pose = random_view(rng)
        how = Localisation.gaussian(0.1, floor_px=S)
        told = MeasurandModel(
            value,
            image_distance_mm=F,
            pixel_pitch_mm=PITCH,
            pose_covariance=covariance,
            localisation=how,
            permitted_error=1.0,
            surfaces_mm=0.05,
        ).describe(pose)
        surface, _ = value.surfaces
        common = {
            "floor_px": rng.normal(0, S, (n, len(plain))),
            "surfaces_mm": rng.normal(0, 0.05, (n, len(plain)))[:, surface],
        }
        sigma = tuple(0.1 * pitch for pitch in PITCH)
        error = measure(
            kind, plain, pose, moves, f=F, sigma_mm=sigma, rng=rng, direction=direction,
            pitch=PITCH, common=common,
        )  # fmt: skip
        assert told.standard_uncertainty == pytest.approx(error.std(), rel=0.04)
        held = np.mean(np.abs(error) <= told.expanded_uncertainty)
        assert held == pytest.approx(math.erf(math.sqrt(2)), abs=0.012)


@pytest.mark.parametrize("wrong", [-0.01, math.nan, "much"])
def test_surfaces_are_checked(wrong):
    with pytest.raises(InvalidParameterError, match="surfaces_mm must"):
        predict("diameter", KINDS["diameter"], STILL, surfaces=wrong)


def test_whole_pixels_have_no_floor():
    with pytest.raises(InvalidParameterError, match=r"floor_px must be 0 with rounding\. Got 0\.1"):
        Localisation("rounding", 0.3, floor_px=0.1)


def test_surfaces_are_found_from_planes():
    assert OVERHEAD[2, 3] == Z
    level = measurand("distance", KINDS["distance"], (0, 1, 0))
    assert level.surfaces[0].tolist() == [0, 0]
    raised = Line((-15, -10, 0), (15, -10, 0)), Line((-15, 10, 5), (15, 10, 5))
    index, normals = measurand("distance", raised, (0, 1, 0)).surfaces
    assert index.tolist() == [0, 1]
    assert np.abs(normals[:, 2]).tolist() == [1.0, 1.0]

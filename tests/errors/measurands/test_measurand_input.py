"""What dimensions, their entities and the ways to find these refuse, and what they say of themselves."""

import math

import numpy as np
import pytest
from dimension_examples import PITCH, F, isotropic

from errors import InvalidParameterError, InvalidShapeError
from errors.measurands import Circle, Line, Localisation, MeasurandError, MeasurandModel
from errors.measurands.measurand import measurand
from ground.convert import from_plain, to_plain

LOW = Line((-15, -10, 0), (15, -10, 0))
HIGH = Line((-15, 10, 0), (15, 10, 0))
LEFT = Circle((-10, 0, 0), (0, 0, 1), 4.0)
RIGHT = Circle((10, 0, 0), (0, 0, 1), 6.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Localisation("guess", 0.1), r"must be one of .*Got 'guess'"),
        (
            lambda: Localisation("gaussian", -0.1),
            r"sigma_px must be finite and not negative\. Got -0\.1",
        ),
        (
            lambda: Localisation("gaussian", True),
            r"sigma_px must be finite and not negative\. Got True",
        ),
        (lambda: Localisation("fit", 0.1), r"correlation_px must be positive\. Got 0"),
        (
            lambda: Localisation("gaussian", 0.1, points=2),
            r"points must be an integer of at least 3\. Got 2",
        ),
        (lambda: Localisation("gaussian", 0.1, points=3.0), r"at least 3\. Got 3\.0"),
        (
            lambda: Line((1, 2, 3), (1, 2, 3)),
            r"two different ends\. Got \[1\.0, 2\.0, 3\.0\] twice",
        ),
        (lambda: Line((1, 2), (1, 2, 3)), r"p must be three finite numbers\. Got \(1, 2\)"),
        (
            lambda: Circle((0, 0, 0), (0, 0, 0), 1.0),
            r"axis must have a length\. Got \[0\.0, 0\.0, 0\.0\]",
        ),
        (lambda: Circle((0, 0, 0), (0, 0, 1), math.inf), r"radius_mm must be positive\. Got inf"),
        (
            lambda: Circle((0, 0, 0), (0, 0, 1), 1.0, (1, 0, 0), 7.0),
            r"span_rad must be in \(0, 2 pi\]\. Got 7\.0",
        ),
        (
            lambda: Circle((0, 0, 0), (0, 0, 1), 1.0, (0, 0, -3), 1.0),
            r"start must not run along the axis\. Got \[0",
        ),
    ],
)
def test_numbers_out_of_range_are_refused(call, message):
    with pytest.raises(InvalidParameterError, match=message):
        call()


@pytest.mark.parametrize(
    ("kind", "entities", "direction", "message"),
    [
        ("distance", (LOW, Line((0, 10, 0), (0, 20, 0))), None, r"must be parallel\. Got 90 degrees"),
        ("distance", (LOW, Line((20, -10, 0), (30, -10, 0))), None, r"must lie apart\. Got one line"),
        ("distance", (LOW, HIGH), (1, 0, 0), r"must not run along the edges of a distance\. Got one that"),
        ("distance", (LOW, HIGH), (0, 0, 1), r"must lie apart along its direction\. Got 0 mm"),
        ("centre_distance", (LEFT, RIGHT), (0, 0, 1), r"must not run along the rims' axis\. Got one that does"),
        ("centre_distance", (LEFT, RIGHT), (0, 1, 0), r"must lie apart\. Got two on one axis"),
    ],
)  # fmt: skip
def test_directions_that_measure_nothing_are_refused(kind, entities, direction, message):
    with pytest.raises(MeasurandError, match=message):
        measurand(kind, entities, direction)


def test_a_distance_of_centres_along_a_direction_is_its_share():
    """20 mm apart along x; along a direction at 60 degrees, half of that, whichever way it points and however long."""
    for sign in (1.0, -3.0):
        way = sign * np.array([0.5, math.sqrt(0.75), 0.0])
        assert measurand("centre_distance", (LEFT, RIGHT), way).nominal == pytest.approx(10.0)
    # what lies along the rims' axis does not count
    assert measurand("centre_distance", (LEFT, RIGHT), (1.0, 0.0, 5.0)).nominal == pytest.approx(
        20.0
    )


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"pose_covariance": np.zeros((2, 6, 6))}, InvalidShapeError, r"shape \(6, 6\)\. Got shape \(2, 6, 6\)"),
        ({"permitted_error": 20.0}, InvalidParameterError, r"smaller than the nominal value 20\. Got 20\.0"),
    ],
)  # fmt: skip
def test_a_model_is_checked_once(changes, error, message):
    given = {
        "image_distance_mm": F,
        "pixel_pitch_mm": PITCH,
        "pose_covariance": isotropic(0.01, 0.001),
        "localisation": Localisation.gaussian(0.1, floor_px=0.0),
        "permitted_error": 0.05,
    }
    with pytest.raises(error, match=message):
        MeasurandModel(measurand("distance", (LOW, HIGH)), **{**given, **changes})
    with pytest.raises(
        InvalidShapeError, match=r"world_to_camera must have shape \(n, 4, 4\)\. Got \(4, 4\)"
    ):
        MeasurandModel(measurand("distance", (LOW, HIGH)), **given).probability(np.eye(4))


@pytest.mark.parametrize("one", [LOW, LEFT, Circle((1, 2, 3), (0, 1, 0), 5.0, (1, 0, 0), 2.0)])
def test_lines_and_circles_come_back_from_plain_values(one):
    again = from_plain(type(one), to_plain(one), InvalidParameterError)
    assert type(again) is type(one)
    for name, value in vars(one).items():
        assert np.array_equal(getattr(again, name), value)


@pytest.mark.parametrize(
    ("localisation", "words"),
    [
        (Localisation.rounding(), "rounding to whole pixels"),
        (Localisation.gaussian(0.25, floor_px=0.0), "gaussian, 0.25 px per point"),
        (Localisation.gaussian(0.25), "gaussian, 0.25 px per point, 0.05 px per entity"),
        (
            Localisation("fit", 0.5, correlation_px=4.0, floor_px=0.02),
            "fit, 0.5 px per 4 px of image, 0.02 px at best",
        ),
    ],
)
def test_a_report_says_how_points_are_found(localisation, words):
    assert str(localisation) == words
    assert from_plain(Localisation, to_plain(localisation), InvalidParameterError) == localisation

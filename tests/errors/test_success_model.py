"""The model with its parameters checked once says what the one call says, and 0 where there is no image."""

import re
from pathlib import Path

import jupytext
import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, F, random_covariance, random_edges

from errors import (
    AxisDisplacement,
    AxisQuantization,
    BehindLensError,
    CovarianceError,
    DegenerateSegmentError,
    InvalidParameterError,
    InvalidShapeError,
    MeasurementModelError,
    NormalRatio,
    SegmentQuantization,
    SuccessModel,
    displace,
    measure_lengths,
    point_displacement,
    project,
    simulate_measurement,
    simulate_success,
    success_probability,
)

BEHIND = EDGE + np.array([0.0, 0.0, 400.0])
END_ON = np.array([[20.0, 10.0, F - 200.0], [40.0, 20.0, F - 400.0]])


@pytest.mark.parametrize("model", ["joint", "independent", "montecarlo"])
def test_the_same_values_as_the_one_call(model):
    rng = np.random.default_rng(3)
    edges = random_edges(12, rng).reshape(3, 4, 2, 3)
    how = {
        **CAMERA,
        "pose_covariance": random_covariance(rng, 0.01),
        "accuracy": 0.98,
        "model": model,
    }
    np.testing.assert_allclose(
        SuccessModel(**how)(edges), success_probability(edges, **how), atol=1e-9
    )


@pytest.mark.parametrize(
    "model", [pytest.param("joint", marks=pytest.mark.uncompiled), "independent", "montecarlo"]
)
def test_edges_without_image_have_no_chance_and_disturb_no_other(model):
    how = {**CAMERA, "pose_covariance": PAPER_COVARIANCE, "accuracy": 0.98, "model": model}
    half_behind = np.array([EDGE[0], BEHIND[1]])
    p = SuccessModel(**how)(np.array([BEHIND, EDGE, END_ON, half_behind]))
    assert p[1] == pytest.approx(success_probability(EDGE, **how))
    assert p[[0, 2, 3]].tolist() == [0, 0, 0]
    assert SuccessModel(**how)(np.array([BEHIND])).tolist() == [0]
    assert SuccessModel(**how)(np.empty((0, 5, 2, 3))).shape == (0, 5)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"accuracy": 1.2}, InvalidParameterError, r"accuracy must be in \(0, 1\)\. Got 1\.2\."),
        ({"model": "best"}, InvalidParameterError, r"model must be one of .*Got 'best'\."),
        (
            {"focal_length_mm": 0},
            InvalidParameterError,
            r"focal_length_mm must be > 0\. Got 0\.0\.",
        ),
        (
            {"pose_covariance": -np.eye(6)},
            CovarianceError,
            r"positive semi-definite\. Got smallest eigenvalue -1\.",
        ),
        (
            {"pose_covariance": np.ones((2, 6, 6))},
            InvalidShapeError,
            r"must have shape \(6, 6\)\. Got shape \(2, 6, 6\)",
        ),
    ],
)
def test_parameters_are_checked_once_and_for_all(changes, error, message):
    with pytest.raises(error, match=message):
        SuccessModel(**{**CAMERA, "pose_covariance": PAPER_COVARIANCE, "accuracy": 0.98, **changes})


VALID = {**CAMERA, "pose_covariance": PAPER_COVARIANCE, "accuracy": 0.98}


def call(endpoints=EDGE, **changes):
    return success_probability(endpoints, **{**VALID, **changes})


def with_entry(array, index, value):
    array = np.array(array, dtype=float)
    array[index] = value
    return array


@pytest.mark.parametrize("model", ["joint", "independent", "montecarlo"])
@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"accuracy": 1.2}, InvalidParameterError, r"accuracy must be in \(0, 1\)\. Got 1\.2\."),
        ({"accuracy": 0.0}, InvalidParameterError, r"accuracy must be in \(0, 1\)\. Got 0\.0\."),
        ({"accuracy": np.nan}, InvalidParameterError, r"accuracy must be finite\. Got nan"),
        (
            {"accuracy": [0.9]},
            InvalidShapeError,
            r"accuracy must be a single number\. Got an array of shape \(1,\)",
        ),
        (
            {"pose_covariance": with_entry(PAPER_COVARIANCE, (0, 1), 0.01)},
            CovarianceError,
            r"pose_covariance must be symmetric\. Got a largest asymmetry of 0\.01\.",
        ),
        (
            {"pose_covariance": with_entry(np.eye(6), (2, 2), -0.5)},
            CovarianceError,
            r"pose_covariance must be positive semi-definite\. Got smallest eigenvalue -0\.5\.",
        ),
        (
            {"pose_covariance": np.eye(6) + 2.0 * np.eye(6)[::-1]},
            CovarianceError,
            r"positive semi-definite\. Got smallest eigenvalue -1\.",
        ),
        (
            {"pose_covariance": np.eye(5)},
            InvalidShapeError,
            r"must have shape \(\.\.\., 6, 6\)\. Got shape \(5, 5\)",
        ),
        (
            {"pose_covariance": with_entry(np.eye(6), (3, 3), np.inf)},
            InvalidParameterError,
            r"pose_covariance must be finite\. Got inf at index \(3, 3\)\.",
        ),
        (
            {"endpoints": with_entry(EDGE, (1, 2), F)},
            BehindLensError,
            r"endpoints must lie in front of the lens centre \(C3 < focal_length_mm = 25\.0\)\. "
            r"Got C3 = 25\.0 at index \(1,\)",
        ),
        (
            {"endpoints": with_entry(np.tile(EDGE, (3, 1, 1)), (2, 1, 0), np.nan)},
            InvalidParameterError,
            r"endpoints must be finite\. Got nan at index \(2, 1, 0\)\.",
        ),
        (
            {"endpoints": np.array([EDGE, [[10.0, 5.0, F - 100.0], [20.0, 10.0, F - 200.0]]])},
            DegenerateSegmentError,
            r"endpoints must project to a segment longer than zero\. Got image length \S+ mm at index \(1,\)\.",
        ),
        (
            {"endpoints": np.zeros((4, 3))},
            InvalidShapeError,
            r"endpoints must have shape \(\.\.\., 2, 3\)\. Got shape \(4, 3\)\.",
        ),
        ({"endpoints": "edge"}, InvalidParameterError, r"endpoints must be numeric\. Got 'edge'\."),
        (
            {"focal_length_mm": -1.0},
            InvalidParameterError,
            r"focal_length_mm must be > 0\. Got -1\.0\.",
        ),
        (
            {"focal_length_mm": [1.0]},
            InvalidShapeError,
            r"focal_length_mm must be a single number\.",
        ),
        (
            {"pixel_pitch_mm": (0.01, 0.0)},
            InvalidParameterError,
            r"pixel_pitch_mm must be > 0\. Got \(0\.01, 0\.0\)",
        ),
        (
            {"pixel_pitch_mm": 0.01},
            InvalidShapeError,
            r"pixel_pitch_mm must have shape \(2,\)\. Got shape \(\)\.",
        ),
        (
            {
                "endpoints": np.tile(EDGE, (3, 1, 1)),
                "pose_covariance": np.tile(PAPER_COVARIANCE, (2, 1, 1)),
            },
            InvalidShapeError,
            r"leading shapes that broadcast\. Got \(3, 2, 3\) and \(2, 6, 6\)",
        ),
    ],
)
def test_bad_input_is_named(model, changes, error, message):
    with pytest.raises(error, match=message) as caught:
        call(model=model, **changes)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, MeasurementModelError)


def test_unknown_model():
    with pytest.raises(
        InvalidParameterError, match=r"model must be one of .*'joint'.*\. Got 'exact'\."
    ):
        call(model="exact")


@pytest.mark.parametrize("samples", [0, 1.5, True])
def test_samples(samples):
    with pytest.raises(
        InvalidParameterError, match=rf"samples must be an integer >= 1\. Got {samples}\."
    ):
        call(model="montecarlo", samples=samples)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (
            lambda: simulate_success(EDGE, **VALID, confidence=1.0),
            r"confidence must be in \(0, 1\)\. Got 1\.0\.",
        ),
        (
            lambda: simulate_success(
                [EDGE] * 3, **{**VALID, "pose_covariance": [PAPER_COVARIANCE] * 2}
            ),
            r"leading shapes that broadcast",
        ),
        (
            lambda: simulate_success(EDGE, **VALID, quantization="x"),
            r"quantization must be one of .* Got 'x'\.",
        ),
        (
            lambda: simulate_measurement(EDGE, **VALID, detector="x"),
            r"detector must be one of .* Got 'x'\.",
        ),
        (
            lambda: simulate_measurement([EDGE], **VALID),
            r"endpoints must have shape \(2, 3\)\. Got shape \(1, 2, 3\)",
        ),
        (
            lambda: measure_lengths(np.zeros(4), pixel_pitch_mm=(1, 1)),
            r"segments must have shape .* Got shape \(4,\)",
        ),
        (lambda: AxisQuantization(0.0), r"pitch_mm must be > 0\. Got 0\.0\."),
        (lambda: SegmentQuantization(np.inf, (1, 1)), r"angle_rad must be finite\. Got inf"),
        (lambda: NormalRatio(-1.0, 1.0, 0.0, 1.0), r"var_n must be >= 0\. Got -1\.0\."),
        (
            lambda: NormalRatio(1.0, 1.0, 1.1, 1.0),
            r"cov must satisfy cov\^2 <= var_n var_d\. Got 1\.1\.",
        ),
        (lambda: NormalRatio(1.0, 1.0, 0.0, 0.0), r"mean_d must be > 0\. Got 0\.0\."),
        (
            lambda: project(np.zeros(2), focal_length_mm=F),
            r"points must have shape \(\.\.\., 3\)\. Got shape \(2,\)\.",
        ),
        (
            lambda: displace(EDGE, np.zeros(5)),
            r"displacement must have shape \(\.\.\., 6\)\. Got shape \(5,\)\.",
        ),
        (
            lambda: AxisDisplacement(
                EDGE, "w", focal_length_mm=F, pose_covariance=PAPER_COVARIANCE
            ),
            r"axis must be 'u' or 'v'\. Got 'w'\.",
        ),
        (
            lambda: point_displacement(
                [0.0, 0.0, 30.0], focal_length_mm=F, pose_covariance=PAPER_COVARIANCE
            ),
            r"points must lie in front of the lens centre .* Got C3 = 30\.0",
        ),
    ],
)
def test_other_calls(function, message):
    with pytest.raises(InvalidParameterError, match=message):
        function()


def test_roundoff_in_a_covariance_passes():
    factor = np.random.default_rng(0).normal(size=(6, 2)) * [[1e-1]] * 3
    singular = factor @ factor.T
    singular[0, 1] += 1e-14
    assert 0.0 <= call(pose_covariance=singular * 1e-4) <= 1.0


NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "measurement_error.ipynb"


@pytest.mark.parametrize("figure", ["Fig. 2", "Fig. 4", "Fig. 7"])
def test_the_papers_figures_are_drawn(figure):
    code = [cell.source for cell in jupytext.read(NOTEBOOK).cells if cell.cell_type == "code"]
    assert sum(bool(re.search(rf'suptitle\(\s*"{figure}', source)) for source in code) == 1

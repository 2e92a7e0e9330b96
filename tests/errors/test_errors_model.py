"""The model with its parameters checked once says what the one call says, and 0 where there is no image."""

import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, F, random_covariance, random_edges

from errors import (
    CovarianceError,
    InvalidParameterError,
    InvalidShapeError,
    SuccessModel,
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

"""Square roots of covariance matrices, also singular ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def covariance_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return S with S S' = covariance, for symmetric positive semi-definite matrices of shape (..., k, k).

    The factor comes from the eigenvectors of the scale-free matrix, so it exists for singular covariances and does not
    lose the rotations (rad2) beside the translations (mm2).
    """
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / (safe[..., :, None] * safe[..., None, :]))
    return safe[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]

"""The same probability asked for again and again: parameters checked once, no edge an error."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    check_covariance,
    check_pixel_pitch,
    check_positive,
    check_probability,
    has_image,
)
from errors.covariance import covariance_root
from errors.exceptions import InvalidParameterError, InvalidShapeError
from errors.joint import joint_probability
from errors.probability import MODELS, success_probability


class SuccessModel:
    """A version of `success_probability` for many small calls with the same parameters.

    Guarantee: the values are those of `success_probability`. They are 0 for an edge without an
    image, with an end behind the lens or seen end-on. The ends themselves are not checked.

    Parameters
    ----------
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad; one for all edges, see `success_probability`.
    accuracy : float
        A in (0, 1). The permitted error is the fraction 1 - A of the length.
    model : {"joint", "independent", "montecarlo"}
        How to compute the probability; see `success_probability`.

    Raises
    ------
    InvalidParameterError
        As `success_probability`; a covariance of another shape raises its kind `InvalidShapeError`.

    Examples
    --------
    >>> import numpy as np
    >>> from errors import SuccessModel
    >>> covariance = np.diag([0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6])
    >>> model = SuccessModel(
    ...     focal_length_mm=10.0,
    ...     pixel_pitch_mm=(0.005, 0.005),
    ...     pose_covariance=covariance,
    ...     accuracy=0.98,
    ... )
    >>> square_on, end_on = model(np.array([[[-20, 0, -90], [20, 0, -90]], [[0, 0, -90], [0, 0, -50]]]))
    >>> bool(square_on > 0.99), float(end_on)
    (True, 0.0)
    """

    def __init__(
        self,
        *,
        focal_length_mm: float,
        pixel_pitch_mm: ArrayLike,
        pose_covariance: ArrayLike,
        accuracy: float,
        model: str = "joint",
    ) -> None:
        if model not in MODELS:
            raise InvalidParameterError.of_rule("model", f"must be one of {MODELS}", repr(model))
        self.focal_length_mm = check_positive(focal_length_mm, "focal_length_mm")
        self.pixel_pitch_mm = check_pixel_pitch(pixel_pitch_mm)
        self.covariance = check_covariance(pose_covariance)
        if self.covariance.shape != (6, 6):
            raise InvalidShapeError.of_rule(
                "pose_covariance", "must have shape (6, 6)", f"shape {self.covariance.shape}"
            )
        self.accuracy = check_probability(accuracy, "accuracy")
        self.model = model
        self._root = covariance_root(self.covariance)[None]

    def __call__(
        self, endpoints: NDArray[np.float64], root: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return the probability that each edge is measured to the required accuracy.

        Parameters
        ----------
        endpoints : array, shape (..., 2, 3)
            Edge ends in the paper's camera frame, in mm.
        root : array, shape (n, 6, 6), optional
            S with S S' the covariance of each edge's own displacement. Only of the model "joint".
            Default: the covariance of all.

        Returns
        -------
        array, shape (...)
            Probabilities in [0, 1]; 0 for an edge without an image.
        """
        flat = np.asarray(endpoints, dtype=np.float64).reshape(-1, 2, 3)
        shape = endpoints.shape[:-2]
        if self.model == "joint":
            return self._joint(flat, self._root if root is None else root).reshape(shape)
        return self._of_imaged(flat).reshape(shape)

    def _joint(self, flat: NDArray[np.float64], root: NDArray[np.float64]) -> NDArray[np.float64]:
        return joint_probability(
            flat, self.focal_length_mm, self.pixel_pitch_mm, root, self.accuracy
        )

    def _of_imaged(self, flat: NDArray[np.float64]) -> NDArray[np.float64]:
        probability = np.zeros(len(flat))
        imaged = has_image(flat, self.focal_length_mm)
        if imaged.any():
            probability[imaged] = success_probability(
                flat[imaged],
                focal_length_mm=self.focal_length_mm,
                pixel_pitch_mm=self.pixel_pitch_mm,
                pose_covariance=self.covariance,
                accuracy=self.accuracy,
                model=self.model,
            )
        return probability

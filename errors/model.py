"""The same probability asked for again and again: parameters checked once, no edge an error."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    FloatArray,
    check_covariance,
    check_endpoints,
    check_leading_shapes,
    check_pixel_pitch,
    check_positive,
    check_probability,
    covariance_root,
    has_image,
)
from errors.exceptions import InvalidParameterError, InvalidShapeError
from errors.joint import joint_probability
from errors.referee import simulate_success
from errors.segment import independent_probability

# The one call: probability that an edge is measured within the required accuracy.


MODELS = ("joint", "independent", "montecarlo")

# Edges handled at a time: bounds the memory of whatever a model needs per edge.
_CHUNK = {"joint": 1 << 16, "independent": 1 << 9}


def success_probability(
    endpoints: ArrayLike,
    *,
    focal_length_mm: float,
    pixel_pitch_mm: ArrayLike,
    pose_covariance: ArrayLike,
    accuracy: float,
    model: str = "joint",
    samples: int = 100_000,
    rng: int | np.random.Generator = 0,
) -> NDArray[np.float64] | np.float64:
    """Return the probability that the image length of an edge is measured to the required accuracy.

    It is P(|epsilon| <= (1 - A) L). L is the nominal image length, and epsilon the error of the
    measured one. The error combines displacement of the camera and quantization of both ends.

    Guarantee: the result of every edge depends on that edge (and its covariance) alone, not on the
    rest of the batch ("independent": up to 1e-7). "joint" agrees with "montecarlo" to 0.002 for
    rotations of up to 0.03 rad s.d. and to 0.004 up to 0.055 rad. The memory beyond the result and
    one bool per coordinate is bounded for every batch size.

    A single bad edge is an error for the whole batch, so remove edges without an image first.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in mm, in the paper's camera frame: C1 right, C2 up, C3 backwards, image plane at 0, lens centre at f.
    focal_length_mm : float
        Distance from image plane to lens centre, in mm: the image distance of a thin lens focused at a distance.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6) or (..., 6, 6)
        Covariance of the displacement (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad, in the camera frame, phi a
        rotation vector about the frame's origin. Leading dimensions broadcast against those of `endpoints`.
    accuracy : float
        A in (0, 1); 0.98 allows an error of 2 % of the length.
    model : {"joint", "independent", "montecarlo"}
        "joint": both ends moved by one displaced pose, second order (see `errors.joint`). "independent": the paper's
        eqs 10-15, which take the ends' displacements as independent. "montecarlo": exact rotation, random poses.
    samples : int
        Number of draws of model "montecarlo"; see `simulate_success` for its interval.
    rng : int or numpy.random.Generator
        Seed or source of chance of model "montecarlo".

    Returns
    -------
    array, shape (...)
        Probabilities in [0, 1]; a numpy scalar for a single edge.

    Raises
    ------
    InvalidShapeError
        If an array does not have the documented shape.
    CovarianceError
        If the covariance is not symmetric or not positive semi-definite.
    BehindLensError
        If an end point has C3 >= focal_length_mm.
    DegenerateSegmentError
        If an edge is seen end-on, so that its image has no length.
    InvalidParameterError
        If accuracy is outside (0, 1), a length is not positive, a value is not finite or the model is unknown. All of
        the above inherit from it.

    Examples
    --------
    An edge of 50 mm, 600 mm in front of the lens, and one half as long:

    >>> import numpy as np
    >>> from errors import success_probability
    >>> edges = [[[-25, 0, -575], [25, 0, -575]], [[-12.5, 0, -575], [12.5, 0, -575]]]
    >>> covariance = np.diag([0.05**2] * 3 + [0.001**2] * 3)
    >>> request = {"focal_length_mm": 25.0, "pixel_pitch_mm": (0.01, 0.01), "pose_covariance": covariance}
    >>> p = success_probability(edges, accuracy=0.995, **request)
    >>> p.round(2).tolist()
    [1.0, 0.77]
    """
    if model not in MODELS:
        raise InvalidParameterError.of_rule("model", f"must be one of {MODELS}", repr(model))
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    pitch = check_pixel_pitch(pixel_pitch_mm)
    covariance = check_covariance(pose_covariance)
    accuracy = check_probability(accuracy, "accuracy")
    lead = check_leading_shapes(endpoints, covariance)
    if model == "montecarlo":
        estimate = simulate_success(
            endpoints,
            focal_length_mm=f,
            pixel_pitch_mm=pitch,
            pose_covariance=covariance,
            accuracy=accuracy,
            samples=samples,
            rng=rng,
        )
        return estimate.probability[()]
    out = np.empty(lead)
    solve: Callable[..., FloatArray]
    if model == "joint":
        solve = joint_probability
        spread = covariance_root(covariance)
    else:
        solve = independent_probability
        spread = covariance
    for ends, part_spread, part in _chunks(endpoints, spread, out, _CHUNK[model]):
        part[:] = solve(ends, f, pitch, part_spread, accuracy)
    return out[()]


def _chunks(
    endpoints: FloatArray, spread: FloatArray, out: FloatArray, size: int
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield flat pieces (ends, covariance or its root, view of out); a single covariance is passed on unrepeated."""
    flat_out = out.reshape(-1)
    if spread.ndim == 2 and endpoints.shape[:-2] == out.shape:
        flat_ends = endpoints.reshape(-1, 2, 3)
        for start in range(0, len(flat_out), size):
            yield flat_ends[start : start + size], spread[None], flat_out[start : start + size]
        return
    ends = np.broadcast_to(endpoints, (*out.shape, 2, 3))
    spreads = np.broadcast_to(spread, (*out.shape, 6, 6))
    for start in range(0, len(flat_out), size):
        index = np.unravel_index(np.arange(start, min(start + size, len(flat_out))), out.shape)
        yield ends[index], spreads[index], flat_out[start : start + size]


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

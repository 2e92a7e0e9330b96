"""Arguments that are checked, and numbers put into words."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.exceptions import (
    BehindLensError,
    CovarianceError,
    DegenerateSegmentError,
    InvalidParameterError,
    InvalidShapeError,
)

# Numbers as text: percents, and probabilities, which are rounded to the safe side and never 1.


# four decimals tell what 10,000 simulated poses can
_DIGITS = 4
_LARGEST = math.nextafter(1.0, 0.0)


def below_one(value: float) -> float:
    """Return a probability for a file: the largest number below 1 where rounding gave 1.

    No model proves certainty, so 1 is an effect of rounding.

    Parameters
    ----------
    value : float
        In [0, 1]; nan is kept.

    Returns
    -------
    float
        In [0, 1).
    """
    return _LARGEST if value >= 1.0 else value


def percent_text(share: float, digits: int = 3) -> str:
    """Return a share in percent with so many digits, and never with an exponent.

    Parameters
    ----------
    share : float
        1 is 100 %.
    digits : int
        Significant digits; a whole number of percents keeps all of its own.

    Returns
    -------
    str
        Such as ``"2.5 %"``, or ``"1000 %"``.
    """
    percents = 100.0 * share
    if abs(percents) >= 10.0 ** (digits - 1) or not math.isfinite(percents):
        return f"{percents:.0f} %"
    text = f"{Decimal(f'{percents:.{digits - 1}e}'):f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def is_nearly_one(value: float, required: float = 0.0) -> bool:
    """Say whether `probability_text` gives no more than a bound such as ``"> 0.9999"``.

    Parameters
    ----------
    value, required : float
        As for `probability_text`.
    """
    return probability_text(value, required).startswith(">")


def relation_text(value: float, required: float = 0.0) -> str:
    """Return what follows the name of a probability, such as ``"= 0.9512"`` or ``"> 0.9999"``.

    Parameters
    ----------
    value, required : float
        As `probability_text` takes them.

    Returns
    -------
    str
        With its sign.
    """
    text = probability_text(value, required)
    return text if text.startswith(">") else f"= {text}"


def probability_text(value: float, required: float = 0.0) -> str:
    """Return a probability rounded down; near 1 only a bound, because no model proves certainty.

    Parameters
    ----------
    value : float
        In [0, 1], or nan.
    required : float
        The text keeps enough decimals to show on which side of this the value is.

    Returns
    -------
    str
        Such as ``"0.9512"`` or ``"> 0.9999"``.
    """
    if math.isnan(value):
        return "nan"
    digits = _DIGITS
    if 0.0 < 1.0 - required < 1e-3:
        digits = 1 - math.floor(math.log10(1.0 - required) + 1e-9)
    unit = Decimal(1).scaleb(-digits)
    ceiling = 1 - unit
    if Decimal(repr(float(value))) > ceiling:
        return f"> {ceiling}"
    return str(_rounded(value, digits, ROUND_FLOOR))


def frequency_text(successes: int, n: int) -> str:
    """Return how often a trial succeeded: a share rounded down, and the counts where the share would seem to be 1.

    Parameters
    ----------
    successes, n : int
        Successes among n trials.

    Returns
    -------
    str
        Such as ``"0.9512"`` or ``"10000 of 10000"``.
    """
    share = _rounded(successes / n, _DIGITS, ROUND_FLOOR)
    return str(share) if share < 1 - Decimal(1).scaleb(-_DIGITS) else f"{successes} of {n}"


def interval_text(low: float, high: float, between: str = " to ") -> str:
    """Return an interval of probabilities, rounded outwards; without an upper limit where that rounds to 1.

    Parameters
    ----------
    low, high : float
        Its limits, in [0, 1].
    between : str
        What stands between them.

    Returns
    -------
    str
        Such as ``"0.9471 to 0.9551"`` or ``"0.9994 or more"``.
    """
    lower = _rounded(low, _DIGITS, ROUND_FLOOR)
    upper = _rounded(high, _DIGITS, ROUND_CEILING)
    if upper >= 1:
        return f"{min(lower, 1 - Decimal(1).scaleb(-_DIGITS))} or more"
    return f"{lower}{between}{upper}"


def _rounded(value: float, digits: int, rounding: str) -> Decimal:
    """Return a number with so many decimals; as it is written, so that 0.29 is not rounded down to 0.28."""
    return Decimal(repr(float(value))).quantize(Decimal(1).scaleb(-digits), rounding=rounding)


# Checks at the public boundary: each returns the cleaned array or raises with parameter, rule and
# value.


# Names of the array types that the laws of errors use.


FloatArray: TypeAlias = NDArray[np.float64]

# A field that takes what is array-like and holds an array of float64 once it is built: no annotation says both.
ArrayField: TypeAlias = Any


# Square roots of covariance matrices, also singular ones.


def chi_squared_quantile(share: float, freedoms: int) -> float:
    """Return what a sum of so many squares of standard normal deviates is at most, in this share of all cases.

    As ``scipy.stats.chi2.ppf``, whose module takes longer to load than a small plan's others.
    """
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(freedoms / 2.0, share))


def covariance_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return S with S S' = covariance, for symmetric positive semi-definite matrices of shape (..., k, k).

    The factor comes from the eigenvectors of the scale-free matrix, so it exists for singular covariances and does not
    lose the rotations (rad2) beside the translations (mm2).
    """
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / (safe[..., :, None] * safe[..., None, :]))
    return safe[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]


# An image segment shorter than this (mm, a thousandth of an atom) is the image of an edge seen end-on.
MIN_IMAGE_LENGTH_MM = 1e-10

# Symmetry and semi-definiteness are judged relative to the largest entry: round-off of a product of matrices passes.
_COVARIANCE_RTOL = 1e-9

# Edges checked at a time, so that checking a large batch needs no memory of its size.
_CHUNK = 1 << 16


def check_finite(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `value` as a float64 array without NaN or infinity."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError.of_rule(name, "must be numeric", repr(value)) from error
    bad = ~np.isfinite(array)
    if bad.any():
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InvalidParameterError.of_rule(
            name, "must be finite", f"{array[index]} at index {index}"
        )
    return array


def check_positive(value: float, name: str) -> float:
    """Return `value` as a float greater than zero."""
    array = check_finite(value, name)
    if array.ndim != 0:
        raise InvalidShapeError.of_rule(
            name, "must be a single number", f"an array of shape {array.shape}"
        )
    if array <= 0.0:
        raise InvalidParameterError.of_rule(name, "must be > 0", str(float(array)))
    return float(array)


def check_not_negative(value: float, name: str) -> float:
    """Return `value` as a finite float of at least zero."""
    array = check_finite(value, name)
    if array.ndim != 0:
        raise InvalidShapeError.of_rule(
            name, "must be a single number", f"an array of shape {array.shape}"
        )
    if array < 0.0:
        raise InvalidParameterError.of_rule(name, "must not be negative", str(float(array)))
    return float(array)


def check_count(value: int, name: str) -> int:
    """Return `value` as an integer of at least one."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
        raise InvalidParameterError.of_rule(name, "must be an integer >= 1", repr(value))
    return int(value)


def check_probability(value: float, name: str) -> float:
    """Return `value` as a float in the open interval (0, 1)."""
    array = check_finite(value, name)
    if array.ndim != 0:
        raise InvalidShapeError.of_rule(
            name, "must be a single number", f"an array of shape {array.shape}"
        )
    if not 0.0 < array < 1.0:
        raise InvalidParameterError.of_rule(name, "must be in (0, 1)", str(float(array)))
    return float(array)


def check_pixel_pitch(value: ArrayLike, name: str = "pixel_pitch_mm") -> NDArray[np.float64]:
    """Return the pixel pitch (r_x, r_y) in millimetres, both greater than zero."""
    pitch = check_finite(value, name)
    if pitch.shape != (2,):
        raise InvalidShapeError.of_rule(name, "must have shape (2,)", f"shape {pitch.shape}")
    if (pitch <= 0.0).any():
        raise InvalidParameterError.of_rule(name, "must be > 0", str(tuple(pitch.tolist())))
    return pitch


def check_points(
    value: ArrayLike, focal_length_mm: float, name: str = "points"
) -> NDArray[np.float64]:
    """Return camera-frame points (..., 3), all in front of the lens centre."""
    points = check_finite(value, name)
    if points.ndim < 1 or points.shape[-1] != 3:
        raise InvalidShapeError.of_rule(name, "must have shape (..., 3)", f"shape {points.shape}")
    _check_in_front(points, focal_length_mm, name)
    return points


def check_endpoints(
    value: ArrayLike, focal_length_mm: float, name: str = "endpoints"
) -> NDArray[np.float64]:
    """Return edge ends (..., 2, 3) that lie in front of the lens and whose image has a length."""
    endpoints = check_finite(value, name)
    if endpoints.ndim < 2 or endpoints.shape[-2:] != (2, 3):
        raise InvalidShapeError.of_rule(
            name, "must have shape (..., 2, 3)", f"shape {endpoints.shape}"
        )
    _check_in_front(endpoints, focal_length_mm, name)
    _check_image_length(endpoints, focal_length_mm, name)
    return endpoints


def check_covariance(value: ArrayLike, name: str = "pose_covariance") -> NDArray[np.float64]:
    """Return covariances (..., 6, 6) that are symmetric and positive semi-definite."""
    covariance = check_finite(value, name)
    if covariance.ndim < 2 or covariance.shape[-2:] != (6, 6):
        raise InvalidShapeError.of_rule(
            name, "must have shape (..., 6, 6)", f"shape {covariance.shape}"
        )
    # Translations (mm2) and rotations (rad2) differ by orders of magnitude: judge the scale-free matrix.
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0.0, scale, 1.0)
    normalised = covariance / (scale[..., :, None] * scale[..., None, :])
    asymmetry = np.abs(normalised - np.swapaxes(normalised, -1, -2))
    if (asymmetry > _COVARIANCE_RTOL).any():
        largest = np.abs(covariance - np.swapaxes(covariance, -1, -2)).max()
        raise CovarianceError.of_rule(
            name, "must be symmetric", f"a largest asymmetry of {largest:.6g}"
        )
    smallest = np.linalg.eigvalsh(normalised).min(initial=0.0)
    if smallest < -_COVARIANCE_RTOL:
        smallest = np.linalg.eigvalsh(covariance).min()
        raise CovarianceError.of_rule(
            name, "must be positive semi-definite", f"smallest eigenvalue {smallest:.6g}"
        )
    return covariance


def check_leading_shapes(
    endpoints: NDArray[np.float64], covariance: NDArray[np.float64]
) -> tuple[int, ...]:
    """Return the common leading shape of endpoints (..., 2, 3) and covariances (..., 6, 6)."""
    try:
        return np.broadcast_shapes(endpoints.shape[:-2], covariance.shape[:-2])
    except ValueError as error:
        raise InvalidShapeError(
            "endpoints and pose_covariance must have leading shapes that broadcast. "
            f"Got {endpoints.shape} and {covariance.shape}."
        ) from error


def _check_in_front(points: NDArray[np.float64], focal_length_mm: float, name: str) -> None:
    behind = points[..., 2] >= focal_length_mm
    if behind.any():
        index = tuple(int(i) for i in np.argwhere(behind)[0])
        raise BehindLensError.of_rule(
            name,
            f"must lie in front of the lens centre (C3 < focal_length_mm = {focal_length_mm})",
            f"C3 = {float(points[index][2])} at index {index}",
        )


def _check_image_length(endpoints: NDArray[np.float64], focal_length_mm: float, name: str) -> None:
    flat = endpoints.reshape(-1, 2, 3)
    for start in range(0, len(flat), _CHUNK):
        length = _image_length(flat[start : start + _CHUNK], focal_length_mm)
        short = np.flatnonzero(length <= MIN_IMAGE_LENGTH_MM)
        if len(short):
            index = tuple(int(i) for i in np.unravel_index(start + short[0], endpoints.shape[:-2]))
            raise DegenerateSegmentError.of_rule(
                name,
                "must project to a segment longer than zero",
                f"image length {float(length[short[0]])} mm at index {index}",
            )


def has_image(endpoints: NDArray[np.float64], focal_length_mm: float) -> NDArray[np.bool_]:
    """Return which edges (n, 2, 3) lie in front of the lens and have an image with a length; (n,) bool."""
    result: NDArray[np.bool_] = np.all(endpoints[..., 2] < focal_length_mm, axis=1)
    result[result] = _image_length(endpoints[result], focal_length_mm) > MIN_IMAGE_LENGTH_MM
    return result


def _image_length(endpoints: NDArray[np.float64], focal_length_mm: float) -> NDArray[np.float64]:
    image = endpoints[..., :2] * (focal_length_mm / (focal_length_mm - endpoints[..., 2:]))
    return np.hypot(image[:, 1, 0] - image[:, 0, 0], image[:, 1, 1] - image[:, 0, 1])

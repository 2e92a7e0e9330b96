"""Errors in a plane: how likely they stay in a disc, and what a measured position says of a part.

A position tolerance allows a disc of diameter T about the true position. The error e of a measured position has two
components, so its length is not normal, and guard bands of one dimension are wrong: the largest deviation that
conforms with 95 % at R = 0.4 and a standard deviation of 0.1 is 0.2185, and not 0.4 - 1.645 * 0.1 = 0.2355.

Reference: ISO 1101 and ISO 2692 for zones and the bonus of a material condition; ISO 14253-1 and JCGM 106 for the
decision; Gil-Pelaez (1951) in two dimensions for errors of second order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import check_finite, check_not_negative, check_positive
from errors.exceptions import CovarianceError, InvalidParameterError, InvalidShapeError
from errors.measurands.measurand import (
    Decision,
    DecisionRule,
    decide,
)

Floats = NDArray[np.float64]

_FAR = 9.0
"""Standard deviations beyond which a normal variable is taken to have no probability: 2e-19."""

_SHARP = 1e-4
"""Where the standard deviation is a smaller share of the radius, the disc is as good as a half-plane."""

_THIN = (0.005, 0.03)
"""Where the narrower standard deviation is a smaller share of the radius, the error is taken along the wider axis.

The second one is that of errors that rarely stay in the disc. Both change no probability by more than 2e-4.
"""

_CERTAIN = 100.0
"""Standard deviations beyond which a quadratic form of normal variables has no probability.

It is at most exp(−_CERTAIN/e), 1e-16 (Janson, Gaussian Hilbert Spaces, 1997, theorem 6.7).
"""

_TOGETHER = 64
"""Directions that are integrated together, over the same steps."""

_MOST_VALUES = 4_000_000
"""Values of the characteristic function that are held at a time."""

_ANGLES = 24
"""Directions over half a turn in which the characteristic function is integrated, at least."""


@dataclass(frozen=True)
class Bonus:
    """The size of a hole or pin that widens its zone (ISO 2692).

    Attributes
    ----------
    surplus_mm : float
        How far the measured size has left the material condition towards the other one. Of a hole with (M), the size
        minus the maximum material size; of a pin with (M), the reverse. Negative if the size is beyond the limit.
    u_mm : float
        Standard uncertainty of the size, not negative.
    covariance_mm2 : tuple of float
        Covariance of the surplus with each component of the position.

    Raises
    ------
    InvalidParameterError
        A number is not finite, or the uncertainty is negative.
    """

    surplus_mm: float
    u_mm: float
    covariance_mm2: tuple[float, ...] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_finite(self.surplus_mm, "surplus_mm")
        check_not_negative(self.u_mm, "u_mm")
        check_finite(self.covariance_mm2, "covariance_mm2")


def disc_probability(covariance: ArrayLike, radius: float, centre: ArrayLike = (0.0, 0.0)) -> float:
    """Return P(‖centre + e‖ <= radius) of an error e that is normal with mean 0.

    Parameters
    ----------
    covariance : array (2, 2)
        Of e, mm².
    radius : float
        Of the disc, mm; not negative.
    centre : array (2,)
        Mean of what must stay in the disc, mm.

    Returns
    -------
    float
        In [0, 1].

    Raises
    ------
    CovarianceError
        The covariance is not symmetric, or has a negative eigenvalue.
    InvalidParameterError, InvalidShapeError
        The radius is negative, or the centre no point of the plane.

    Notes
    -----
    With eigenvalues λ₁ and λ₂ and the centre 0, P = 1/(2π √(λ₁λ₂)) ∫ (1 − exp(−r² g/2))/g dθ over a turn, where
    g = cos²θ/λ₁ + sin²θ/λ₂. Otherwise the normal density along the longer axis is integrated, with x = r sin t. Both
    integrands are periodic, so the trapezoidal rule converges exponentially.
    """
    variances, axes = _principal(covariance)
    radius = check_not_negative(radius, "radius")
    middle = axes.T @ _point(centre)
    if variances[0] <= 0.0:
        return float(math.hypot(*middle) <= radius)
    if radius == 0.0:
        return 0.0
    if not middle.any() and variances[1] > 0.0:
        return _about_zero(variances, radius)
    return _off_centre(np.sqrt(variances), radius, middle)


def _about_zero(variances: Floats, radius: float) -> float:
    ratio = math.sqrt(variances[0] / variances[1])
    n = int(min(1 << 16, 64 + 32 * ratio))
    theta = 2.0 * math.pi * np.arange(n) / n
    g = np.cos(theta) ** 2 / variances[0] + np.sin(theta) ** 2 / variances[1]
    mean = np.mean(-np.expm1(-0.5 * radius**2 * g) / g)
    return float(mean / math.sqrt(variances[0] * variances[1]))


def _off_centre(sigma: Floats, radius: float, middle: Floats) -> float:
    """Return the probability about a mean; axes are the principal ones, the longer first."""
    if sigma[0] < _SHARP * radius:
        distance = math.hypot(*middle)
        across = math.hypot(*(sigma * middle)) / distance if distance else sigma[0]
        return _below((radius - distance) / across) if across else float(distance <= radius)
    from scipy.special import ndtr

    n = int(min(1 << 16, 128 + 48 * radius / max(sigma[1], _SHARP * radius)))
    t = math.pi * (np.arange(n) + 0.5) / n - 0.5 * math.pi
    x = radius * np.sin(t)
    half = radius * np.cos(t)
    density = np.exp(-0.5 * ((x - middle[0]) / sigma[0]) ** 2) / (math.sqrt(2 * math.pi) * sigma[0])
    if sigma[1] > 0.0:
        inside = ndtr((half - middle[1]) / sigma[1]) - ndtr((-half - middle[1]) / sigma[1])
    else:
        inside = (np.abs(middle[1]) <= half).astype(np.float64)
    return float(min(1.0, math.pi / n * np.sum(density * inside * half)))


def quadratic_disc_probability(
    gradient: ArrayLike, hessian: ArrayLike, noise: ArrayLike, radius: float
) -> float:
    """Return P(‖e‖ <= radius) of the error e = Gδ + ½ δ'Hδ + noise, exact to second order.

    Parameters
    ----------
    gradient : array (2, k)
        G, in the k independent standard normal variables δ.
    hessian : array (2, k, k)
        H, symmetric.
    noise : array (2, 2)
        Covariance of a further normal error, mm².
    radius : float
        Of the disc, mm; positive.

    Returns
    -------
    float
        In [0, 1].

    Raises
    ------
    CovarianceError
        The noise is not symmetric, or has a negative eigenvalue.
    InvalidParameterError, InvalidShapeError
        The radius is not positive, or arrays do not match.

    Notes
    -----
    In each direction the error is a quadratic form of normal variables, whose characteristic function φ is known.
    The Fourier transform of the disc gives P = r/(2π) ∫ dθ ∫ J₁(rs) φ(s cos θ, s sin θ) ds. Only the half turn of θ is
    needed, because φ(−t) is the conjugate of φ(t). An error that is thin beside the radius r is integrated along its
    wider axis, over ±(r − m/2r), where m is the mean square of the thin component.
    """
    g = check_finite(gradient, "gradient")
    h = check_finite(hessian, "hessian")
    if g.ndim != 2 or len(g) != 2 or h.shape != (2, g.shape[1], g.shape[1]):
        raise InvalidShapeError(
            f"gradient and hessian must have shapes (2, k) and (2, k, k). Got {g.shape} and {h.shape}."
        )
    variances, axes = _principal(noise)
    extra = (axes * variances) @ axes.T
    radius = check_positive(radius, "radius")
    whole = g @ g.T + extra + 0.5 * np.einsum("aij,bij->ab", h, h)
    mean = 0.5 * np.einsum("aii->a", h)
    widths, sides = np.linalg.eigh(whole)
    thin, wide = np.sqrt(np.maximum(widths, 0.0))
    if _CERTAIN * wide + math.hypot(*mean) <= radius:
        return 1.0
    if thin <= min(_THIN[0] * (1.0 + (wide / radius) ** 2), _THIN[1]) * radius:
        across, along = sides.T
        shorter = radius - (thin**2 + (across @ mean) ** 2) / (2.0 * radius)
        bend = np.einsum("a,aij->ij", along, h)
        # rounding may leave a little less than nothing
        variance = max(0.0, float(along @ extra @ along))
        return quadratic_interval_probability(along @ g, bend, variance, shorter)
    n_angles = _ANGLES + int(min(4000.0, 8.0 * math.hypot(thin, wide) / thin))
    theta = math.pi * np.arange(n_angles) / n_angles
    directions = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    values, vectors = np.linalg.eigh(np.einsum("na,aij->nij", directions, h))
    along = np.einsum("ni,nij->nj", directions @ g, vectors)
    variances = np.einsum("na,ab,nb->n", directions, extra, directions)
    total = _along(values, along, variances, radius)
    return float(min(1.0, max(0.0, radius * total / n_angles)))


def quadratic_interval_probability(
    gradient: ArrayLike, hessian: ArrayLike, variance: float, radius: float
) -> float:
    """Return P(|e| <= radius) of the error e = gδ + ½ δ'Hδ + noise of one component, exact to second order.

    Parameters
    ----------
    gradient : array (k,)
        g, in the k independent standard normal variables δ.
    hessian : array (k, k)
        H, symmetric.
    variance : float
        Of a further normal error, mm².
    radius : float
        mm; positive.

    Returns
    -------
    float
        In [0, 1].

    Raises
    ------
    InvalidParameterError
        The radius is not positive, or the variance negative.

    Notes
    -----
    P = 2/π ∫ sin(rs) / s Re φ(s) ds over s > 0, with the characteristic function φ of e (Gil-Pelaez, 1951).
    """
    g = check_finite(gradient, "gradient")
    h = check_finite(hessian, "hessian")
    extra = check_not_negative(variance, "variance")
    radius = check_positive(radius, "radius")
    values, vectors = np.linalg.eigh(h)
    along = (g @ vectors)[None]
    spread = math.sqrt(extra + float(np.sum(along**2)) + 0.5 * float(np.sum(values**2)))
    if _CERTAIN * spread + 0.5 * abs(float(np.sum(values))) <= radius:
        return 1.0
    total = _along(values[None], along, np.array([extra]), radius, _interval)
    return float(min(1.0, max(0.0, 2.0 / math.pi * total)))


def _disc(radius: float, s: Floats) -> Floats:
    from scipy.special import j1

    return np.asarray(j1(radius * s))


def _interval(radius: float, s: Floats) -> Floats:
    return np.asarray(np.sin(radius * s) / s)


def _along(
    values: Floats,
    gradient: Floats,
    variance: Floats,
    radius: float,
    kernel: Callable[[float, Floats], Floats] = _disc,
) -> float:
    """Return the sum over directions of ∫ K(r, s) Re φ(s) ds from 0; ``values`` are eigenvalues of the Hessian.

    Directions of like spread are integrated together: the narrowest one needs the most and shortest steps.
    """
    spreads = np.sqrt(variance + np.sum(gradient**2, axis=1) + 0.5 * np.sum(values**2, axis=1))
    order = np.argsort(spreads)
    total = 0.0
    for first in range(0, len(order), _TOGETHER):
        group = order[first : first + _TOGETHER]
        forms = (values[group], gradient[group], variance[group])
        s, weights = _steps(*forms, radius, spreads[group[0]])
        weights = weights * kernel(radius, s)
        count = max(1, _MOST_VALUES // len(s))
        for start in range(0, len(group), count):
            rows = group[start : start + count]
            phi = _characteristic(values[rows], gradient[rows], variance[rows], s)
            total += float(np.sum(phi @ weights))
    return total


def _steps(
    values: Floats, gradient: Floats, variance: Floats, radius: float, spread: float
) -> tuple[Floats, Floats]:
    """Return where φ is evaluated, and the weights of these steps; ``spread`` is the least of the directions."""
    end = _FAR / spread
    while _modulus(values, gradient, variance, end) > 1e-12 and end * spread < 1e4:
        end *= 1.5
    panels = max(2, math.ceil(end * max(radius, spread) / 12.0))
    nodes, weights = _legendre()
    width = end / panels
    s = (width * (np.arange(panels)[:, None] + 0.5 * (nodes + 1.0))).ravel()
    return s, np.tile(0.5 * width * weights, panels)


def _characteristic(values: Floats, gradient: Floats, variance: Floats, s: Floats) -> Floats:
    """Return Re φ(s) in each direction: exp(−½ (s²v + Σ (sg)² / (1 − iw) + log (1 − iw))) with w = s times eigenvalue.

    In real numbers, log (1 − iw) is ½ log (1 + w²) − i arctan w. It takes a quarter of the time of complex ones.
    """
    n = len(values)
    decay = np.multiply.outer(variance, s**2)
    phase = np.zeros((n, len(s)))
    product = np.ones((n, len(s)))
    for k in range(values.shape[1]):
        w = np.multiply.outer(values[:, k], s)
        widened = 1.0 + w * w
        shares = np.multiply.outer(gradient[:, k] ** 2, s**2) / widened
        decay += shares
        phase += shares * w - np.arctan(w)
        product *= widened
    return np.asarray(np.exp(-0.5 * decay) * product**-0.25 * np.cos(0.5 * phase))


def _modulus(values: Floats, gradient: Floats, variance: Floats, s: float) -> float:
    """Return the largest |φ(s)| of all directions."""
    widened = 1.0 + (s * values) ** 2
    power = 0.5 * s**2 * (variance + np.sum(gradient**2 / widened, axis=1))
    return math.exp(-float((power + 0.25 * np.sum(np.log(widened), axis=1)).min()))


def position_conformance(
    measured: ArrayLike, covariance: ArrayLike, zone_mm: float, bonus: Bonus | None = None
) -> float:
    """Return the probability that a measured position lies within its zone.

    Parameters
    ----------
    measured : array (c,)
        Measured deviation from the true position, mm; one or two components.
    covariance : array (c, c)
        Of the measurement, mm².
    zone_mm : float
        Width or diameter of the zone, positive.
    bonus : Bonus, optional
        The measured size, where a material condition widens the zone by ``max(0, surplus)``.

    Returns
    -------
    float
        P(‖measured + e‖ <= R), where R is half of the widened zone, and e and the size are jointly normal.

    Raises
    ------
    CovarianceError
        A covariance is none.
    InvalidParameterError, InvalidShapeError
        The zone is not positive, or arrays do not match.
    """
    zone_mm = check_positive(zone_mm, "zone_mm")
    m = _deviation(measured)
    if bonus is None:
        return _within(covariance, 0.5 * zone_mm, m)
    if len(bonus.covariance_mm2) != len(m):
        raise InvalidShapeError(
            f"covariance_mm2 of a bonus must have {len(m)} numbers. Got {len(bonus.covariance_mm2)}."
        )
    if bonus.u_mm == 0.0:
        return _within(covariance, 0.5 * (zone_mm + max(0.0, bonus.surplus_mm)), m)
    lean = np.asarray(bonus.covariance_mm2, dtype=np.float64) / bonus.u_mm**2
    remaining = np.asarray(covariance, dtype=np.float64) - np.outer(lean, lean) * bonus.u_mm**2
    low = bonus.surplus_mm - _FAR * bonus.u_mm
    high = bonus.surplus_mm + _FAR * bonus.u_mm
    # the zone has a kink where the bonus begins
    kink = min(max(0.0, low), high)
    nodes, weights = _legendre()
    total = 0.0
    for start, end in ((low, kink), (kink, high)):
        for node, weight in zip(nodes, weights, strict=True):
            size = start + 0.5 * (end - start) * (node + 1.0)
            offset = size - bonus.surplus_mm
            density = math.exp(-0.5 * (offset / bonus.u_mm) ** 2) / bonus.u_mm
            if start < end and density * bonus.u_mm > 1e-16:
                radius = 0.5 * (zone_mm + max(0.0, size))
                p = _within(remaining, radius, m + lean * offset)
                total += 0.5 * (end - start) * weight * density * p
    return min(1.0, total / math.sqrt(2.0 * math.pi))


def _within(covariance: ArrayLike, radius: float, measured: Floats) -> float:
    """Return P(‖measured + e‖ <= radius), of one or two components."""
    if len(measured) == 2:
        return disc_probability(covariance, radius, measured)
    variance = float(np.asarray(covariance, dtype=np.float64).reshape(-1)[0])
    distance = float(measured[0])
    if variance <= 0.0:
        return float(abs(distance) <= radius)
    sigma = math.sqrt(variance)
    return _below((radius - distance) / sigma) - _below((-radius - distance) / sigma)


def decide_position(p_conforms: float, rule: DecisionRule) -> Decision:
    """Return what the probability of a conforming position says of a part.

    Parameters
    ----------
    p_conforms : float
        See `position_conformance`.
    rule : DecisionRule
        That of ISO 14253-1 with its level. The simple rule is that of the level 0.5.

    Returns
    -------
    Decision
        The decision.

    Raises
    ------
    InvalidParameterError
        The rule has guard bands of U, which a disc does not have.
    """
    if rule.name == "guard U":
        raise InvalidParameterError.of_rule(
            "rule", "must be iso14253-1 or simple for a position", repr(rule.name)
        )
    level = rule.level
    if rule.name == "simple":
        level = 0.5
    if p_conforms >= level:
        return Decision.CONFORMS
    if 1.0 - p_conforms >= level:
        return Decision.DOES_NOT_CONFORM
    return Decision.UNDECIDED


def decide_deviation(
    measured: ArrayLike,
    covariance: ArrayLike,
    zone_mm: float,
    rule: DecisionRule,
    bonus: Bonus | None = None,
) -> tuple[Decision, float]:
    """Return the decision of a measured deviation of one or two components, and the probability that it conforms.

    Parameters
    ----------
    measured : array (c,)
        Deviation from the true position, mm.
    covariance : array (c, c)
        Of the measurement, mm².
    zone_mm : float
        Width or diameter of the zone, positive.
    rule : DecisionRule
        How it is decided; one with guard bands of U counts the standard deviation along the deviation.
    bonus : Bonus, optional
        The measured size, where a material condition widens the zone.

    Returns
    -------
    (Decision, float)
        The decision and the probability.
    """
    m = check_finite(measured, "measured")
    matrix = check_finite(covariance, "covariance")
    distance = float(np.linalg.norm(m))
    p = position_conformance(m, matrix, zone_mm, bonus)
    if rule.name != "guard U":
        return decide_position(p, rule), p
    axis = np.linalg.eigh(matrix)[1][:, -1]
    if distance > 0.0:
        axis = m / distance
    variance = float(axis @ matrix @ axis)
    limit = 0.5 * zone_mm
    if bonus is not None and bonus.surplus_mm > 0.0:
        limit += 0.5 * bonus.surplus_mm
        with_size = float(axis @ np.asarray(bonus.covariance_mm2))
        variance += 0.25 * bonus.u_mm**2 - with_size
    return decide(distance, math.sqrt(max(variance, 0.0)), (-math.inf, limit), rule), p


def deviation_interval(
    measured: ArrayLike, covariance: ArrayLike, coverage: float = 0.95
) -> tuple[float, float]:
    """Return the interval of the position value 2‖m + e‖ that has this probability, with equal tails.

    The value is not normal near 0, where ±U would reach below it.

    Parameters
    ----------
    measured : array (c,)
        Measured deviation m from the true position, mm; one or two components.
    covariance : array (c, c)
        Of the measurement, mm².
    coverage : float
        In (0, 1).

    Returns
    -------
    (float, float)
        Lower and upper end, mm; diameters, as the zone is stated.

    Raises
    ------
    CovarianceError
        The covariance is none.
    InvalidParameterError, InvalidShapeError
        The coverage is not in (0, 1), or what was measured has other than one or two components.
    """
    if not 0.0 < coverage < 1.0:
        raise InvalidParameterError.of_rule("coverage", "must be in (0, 1)", repr(coverage))
    m = _deviation(measured)
    if len(m) == 2:
        variances, _ = _principal(covariance)
    else:
        variances = check_finite(covariance, "covariance").reshape(-1)
    distance = math.hypot(*m)
    if variances[0] <= 0.0:
        return 2.0 * distance, 2.0 * distance
    from scipy.optimize import brentq

    end = distance + _FAR * math.sqrt(variances[0])

    def radius_of(share: float) -> float:
        return float(brentq(lambda r: _within(covariance, r, m) - share, 0.0, end))

    tail = 0.5 * (1.0 - coverage)
    return 2.0 * radius_of(tail), 2.0 * radius_of(1.0 - tail)


def _deviation(value: ArrayLike) -> Floats:
    deviation = check_finite(value, "measured")
    if deviation.shape not in ((1,), (2,)):
        raise InvalidShapeError(
            f"measured must have one or two components. Got the shape {deviation.shape}."
        )
    return deviation


def _point(value: ArrayLike) -> Floats:
    point = check_finite(value, "point")
    if point.shape != (2,):
        raise InvalidShapeError(f"a point of the plane must have shape (2,). Got {point.shape}.")
    return point


def _principal(covariance: ArrayLike) -> tuple[Floats, Floats]:
    """Return the variances along the principal axes, the larger first, and the axes as columns."""
    matrix = check_finite(covariance, "covariance")
    if matrix.shape != (2, 2):
        raise InvalidShapeError(f"covariance must have shape (2, 2). Got {matrix.shape}.")
    size = float(np.abs(matrix).max())
    variances, axes = np.linalg.eigh(matrix)
    if not np.allclose(matrix, matrix.T, rtol=0, atol=1e-9 * size) or variances[0] < -1e-9 * size:
        raise CovarianceError(
            f"covariance must be symmetric without negative eigenvalues. Got {matrix.tolist()}."
        )
    return np.maximum(variances[::-1], 0.0), axes[:, ::-1]


@cache
def _legendre() -> tuple[Floats, Floats]:
    nodes: Sequence[Floats] = np.polynomial.legendre.leggauss(32)
    return nodes[0], nodes[1]


def _below(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2.0))

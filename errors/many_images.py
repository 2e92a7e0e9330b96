"""One posterior over many images: what they share is estimated once, and each value has a prior of its own.

Algebra without images, as in `errors.registration`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import check_finite, check_not_negative
from errors.exceptions import CovarianceError, InvalidShapeError
from errors.registration import Rows, free_biases

# Notation
# --------
# p   unknowns of one view alone: poses of its images, covariance P before     s   unknowns that all views share
# H   information of a view's rows about (p, s)                               b   their right-hand side
#
# The unknowns of each view are eliminated by themselves:
#
#     K = (P⁻¹ + H_pp)⁻¹,   T = −K H_ps,   p given s has mean K b_p + T s and covariance K
#     S = Σ H_ss + H_sp T,   β = Σ b_s + Tᵀ b_p        over views
#
# With the variances V before, s has covariance C = (V⁻¹ + S)⁻¹ and mean C β. A value with
# gradients g_p and g_s has the gradient h = g_s + Tᵀ g_p by s alone, and what is left of p is
# independent of s and of other views.
#
# The prior of a value frees the unknowns E that it measures itself: their variances grow from V
# to V'. In units of V, with D = 1 − V / V' (Woodbury, 1950):
#
#     C' = C + C E √D (1 − √D Eᵀ C E √D)⁻¹ √D Eᵀ C
#
# Neither K, T nor S depends on the prior of s. So what else is asked does not matter.


Array = NDArray[np.float64]
Places = NDArray[np.int64]


class Evidence(NamedTuple):
    """What rows tell of unknowns.

    Attributes
    ----------
    information : array (n, n)
        Inverse of the covariance that they would have by the rows alone.
    right : array (n,)
        Information times the estimate by the rows alone.
    """

    information: Array
    right: Array

    def __add__(self, other: object) -> Evidence:
        """Return what both tell together: their rows are independent."""
        if not isinstance(other, Evidence):
            return NotImplemented
        return Evidence(self.information + other.information, self.right + other.right)

    @classmethod
    def nothing(cls, n: int) -> Evidence:
        """Return what no rows tell of so many unknowns."""
        return cls(np.zeros((n, n)), np.zeros(n))


def evidence_of(rows: Iterable[Rows], n: int, bias_variance: float) -> Evidence:
    """Return what rows tell of unknowns; the biases of their groups are eliminated.

    Parameters
    ----------
    rows : iterable of Rows
        The rows of each group.
    n : int
        Number of unknowns.
    bias_variance : float
        Variance of each bias of a group, in the square of the unit of the residuals.

    Returns
    -------
    Evidence
        With a prior covariance P, the posterior is (P⁻¹ + information)⁻¹, as in `errors.registration.posterior`.

    Raises
    ------
    InvalidParameterError
        If the variance is negative.
    """
    bias = check_not_negative(bias_variance, "bias_variance")
    evidence = Evidence.nothing(n)
    for group in rows:
        places = group.unknowns
        weighted = group.design.T * group.weight
        modes, free = free_biases(group, bias)
        common = weighted @ modes
        evidence.information[np.ix_(places, places)] += (
            weighted @ group.design - common @ free @ common.T
        )
        evidence.right[places] += weighted @ group.residual - common @ free @ (
            modes.T @ (group.weight * group.residual)
        )
    return evidence


class View(NamedTuple):
    """Images whose rows move with unknowns of their own (q) and with those that all share (m).

    Attributes
    ----------
    prior : array (q, q)
        Covariance of its own unknowns before.
    evidence : Evidence
        Of its own unknowns, then of the shared ones.
    """

    prior: Array
    evidence: Evidence


@dataclass(frozen=True)
class Slope:
    """How a value changes with unknowns.

    Attributes
    ----------
    by_view : dict of int to array (q,)
        By those of views, by their number.
    shared : array (m,)
        By those that all share.
    """

    by_view: dict[int, Array]
    shared: Array

    def times(self, factor: float) -> Slope:
        """Return the slope of a multiple of the value."""
        by_view = {number: factor * part for number, part in self.by_view.items()}
        return Slope(by_view, factor * self.shared)

    def __add__(self, other: Slope) -> Slope:
        """Return the slope of the sum of two values."""
        by_view = dict(self.by_view)
        for number, part in other.by_view.items():
            by_view[number] = by_view[number] + part if number in by_view else part
        return Slope(by_view, self.shared + other.shared)


class Eliminated(NamedTuple):
    """A view whose own unknowns are eliminated; see the notation of this module.

    Attributes
    ----------
    covariance : array (q, q)
        K, of its own unknowns if the shared ones were known.
    by_shared : array (q, m)
        T, how the estimate of its own unknowns moves with the shared ones.
    middle : array (q,)
        That estimate with the shared ones at 0.
    evidence : Evidence
        What is left, of the shared ones.
    """

    covariance: Array
    by_shared: Array
    middle: Array
    evidence: Evidence


def eliminated(view: View, scale: Array) -> Eliminated:
    """Return a view without unknowns of its own, the shared ones in units of a scale (m,)."""
    size = len(view.prior)
    information, right = view.evidence
    root = np.sqrt(np.diag(view.prior))
    units = np.outer(root, root)
    # millimetres and radians are far apart: solved in units of the prior
    inner = np.linalg.inv(view.prior / units)
    inner += information[:size, :size] * units
    covariance = np.linalg.inv(inner) * units
    covariance = (covariance + covariance.T) / 2
    across = information[:size, size:] * scale
    by_shared = -covariance @ across
    reduced = information[size:, size:] * np.outer(scale, scale) + across.T @ by_shared
    evidence = Evidence(
        (reduced + reduced.T) / 2, scale * right[size:] + by_shared.T @ right[:size]
    )
    return Eliminated(covariance, by_shared, covariance @ right[:size], evidence)


@dataclass(frozen=True)
class Prior:
    """What is known of the shared unknowns before, for one value.

    Attributes
    ----------
    free : array of int (e,)
        Which of them the value measures itself.
    variances : array (e,)
        Their variances; not below those of the others' prior.
    """

    free: Places
    variances: Array


class Estimate(NamedTuple):
    """A value that is estimated, and what is known before.

    Attributes
    ----------
    value : Slope
        How it changes with unknowns.
    prior : Prior
        Of the shared unknowns.
    """

    value: Slope
    prior: Prior


class ManyImages:
    """The joint posterior of the unknowns of views and of those that they share.

    Parameters
    ----------
    variances : array (m,)
        Of the shared unknowns before, about 0 and independent of each other; positive.
    views : sequence of View
        The views.

    Raises
    ------
    CovarianceError
        If a variance is not positive.
    InvalidShapeError
        If a view's evidence is not of its own and the shared unknowns.

    Examples
    --------
    A number is stated to 1, and each of two views shows it to 1, if its own offset is known to 1:

    >>> import numpy as np
    >>> from errors.many_images import Estimate, Evidence, ManyImages, Prior, Slope, View
    >>> view = View(np.eye(1), Evidence(np.ones((2, 2)), np.array([3.0, 3.0])))
    >>> both = ManyImages(np.ones(1), [view, view])
    >>> nothing_free = Prior(np.empty(0, int), np.empty(0))
    >>> number = Estimate(Slope({}, np.ones(1)), nothing_free)
    >>> both.mean(*number), both.covariance(number, number)
    (1.5, 0.5)
    """

    def __init__(self, variances: Array, views: Sequence[View]) -> None:
        stated = check_finite(variances, "variances")
        if stated.ndim != 1 or not (stated > 0).all():
            raise CovarianceError.of_rule("variances", "must be positive", f"{stated.min():g}")
        for view in views:
            size = len(view.prior) + len(stated)
            if view.evidence.information.shape != (size, size):
                shape = f"shape {view.evidence.information.shape}"
                raise InvalidShapeError.of_rule("evidence", f"must have shape {size, size}", shape)
        self._scale = np.sqrt(stated)
        self._views = [eliminated(view, self._scale) for view in views]
        total = Evidence.nothing(len(stated))
        for reduced in self._views:
            total += reduced.evidence
        self._told = total

    @cached_property
    def _covariance(self) -> Array:
        """Covariance (m, m) of the shared unknowns if none is free, in units of the prior."""
        n = len(self._scale)
        # what no row tells of stays as it was: an image shows few of a large part's surfaces
        shown = np.flatnonzero(self._told.information.any(axis=1))
        covariance = np.eye(n)
        block = np.ix_(shown, shown)
        inverse = np.linalg.inv(np.eye(len(shown)) + self._told.information[block])
        covariance[block] = (inverse + inverse.T) / 2
        return covariance

    @cached_property
    def _mean(self) -> Array:
        return self._covariance @ self._told.right

    def _freed(self, prior: Prior) -> tuple[Array, Array]:
        """Return columns U (m, e) and M (e, e) with C' = C + U M Uᵀ."""
        columns = self._covariance[:, prior.free]
        root = np.sqrt(1.0 - self._scale[prior.free] ** 2 / prior.variances)
        inner = np.eye(len(root)) - root[:, None] * columns[prior.free] * root
        middle = np.linalg.inv((inner + inner.T) / 2)
        return columns, root[:, None] * middle * root

    def mean(self, value: Slope, prior: Prior) -> float:
        """Return the estimate of a value, to first order about all unknowns at 0."""
        columns, middle = self._freed(prior)
        mean = self._mean + columns @ (middle @ self._mean[prior.free])
        total = float(self._alone(value) @ mean)
        return total + sum(
            float(slope @ self._views[number].middle) for number, slope in value.by_view.items()
        )

    def covariance(self, first: Estimate, second: Estimate) -> float:
        """Return the covariance of the errors of two values, each estimated with its own prior.

        An unknown that only one of them frees has the precision of the freer prior: so the covariance matrix of many
        values has no negative eigenvalue, and its diagonal is the posterior's.
        """
        rays = [self._ray(*each) for each in (first, second)]
        precision = np.minimum(*(self._precision(prior) for _, prior in (first, second)))
        total = float(rays[0] @ self._told.information @ rays[1] + (rays[0] * precision) @ rays[1])
        others = second.value.by_view
        for number, slope in first.value.by_view.items():
            if number in others:
                total += float(slope @ self._views[number].covariance @ others[number])
        return total

    def shared(self) -> tuple[Array, Array]:
        """Return means and variances (m,) of the shared unknowns if none is free."""
        variances = np.diag(self._covariance) * self._scale**2
        return self._scale * self._mean, variances

    def of_view(self, number: int, prior: Prior) -> tuple[Array, Array]:
        """Return mean (n,) and covariance (n, n) of a view's own and of the shared unknowns, with a prior.

        Parameters
        ----------
        number : int
            Of the view.
        prior : Prior
            Of the shared unknowns.
        """
        columns, middle = self._freed(prior)
        shared = self._covariance + columns @ middle @ columns.T
        mean = self._mean + columns @ (middle @ self._mean[prior.free])
        view = self._views[number]
        across = view.by_shared @ shared
        block = view.covariance + across @ view.by_shared.T
        scaled = across * self._scale
        covariance = np.block(
            [
                [(block + block.T) / 2, scaled],
                [scaled.T, shared * np.outer(self._scale, self._scale)],
            ]
        )
        return np.concatenate([view.middle + view.by_shared @ mean, self._scale * mean]), covariance

    def _alone(self, value: Slope) -> Array:
        """Return the slope (m,) of a value by the shared unknowns alone, in units of the prior."""
        total = self._scale * value.shared
        for number, slope in value.by_view.items():
            total = total + self._views[number].by_shared.T @ slope
        return np.asarray(total)

    def _ray(self, value: Slope, prior: Prior) -> Array:
        """Return the covariance (m,) of a value with the shared unknowns, in units of the prior."""
        columns, middle = self._freed(prior)
        slope = self._alone(value)
        return np.asarray(self._covariance @ slope + columns @ (middle @ (columns.T @ slope)))

    def _precision(self, prior: Prior) -> Array:
        """Return the precision (m,) of the shared unknowns before, in units of the prior."""
        precision = np.ones(len(self._scale))
        precision[prior.free] = self._scale[prior.free] ** 2 / prior.variances
        return precision


def best_weights(covariance: Array) -> Array:
    """Return the weights of readings of one value that give the least variance, none of them negative.

    Those of the posterior of a value of which nothing is known before (Gauss–Markov; Aitken, 1935). Where errors have
    much in common, a negative weight would extrapolate from readings: such a reading counts nothing instead.

    Parameters
    ----------
    covariance : array (n, n)
        Of the readings; positive definite.

    Returns
    -------
    array (n,)
        Weights with the sum 1.

    Examples
    --------
    >>> import numpy as np
    >>> best_weights(np.diag([1.0, 3.0])).tolist()
    [0.75, 0.25]
    """
    chosen = np.arange(len(covariance))
    while True:
        raw = np.linalg.solve(covariance[np.ix_(chosen, chosen)], np.ones(len(chosen)))
        share = raw / raw.sum()
        if len(chosen) == 1 or (share >= 0).all():
            break
        chosen = np.delete(chosen, int(np.argmin(share)))
    weights = np.zeros(len(covariance))
    weights[chosen] = share
    return weights

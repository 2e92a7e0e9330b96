"""Registration: a camera's pose and the deviations of a part's surfaces, estimated together, with their covariance.

Algebra without images. Rows say how far points were found off their prediction and how unknowns move them; a normal
prior says what is known of the unknowns beforehand.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import check_finite, check_not_negative
from errors.exceptions import CovarianceError, InvalidShapeError
from ground.decorators import njit

# The joint posterior of unknowns from linear rows with biases that all rows of a group have in
# common.
#
# Notation
# --------
# x   unknowns, normal with mean 0 and covariance P before     r   residuals of rows
# A   how unknowns move rows                                   w   weights: 1 / variance of single rows
# b   biases of a group, independent, with variance t each     M   how far they move the group's rows
#
# With r = A x + M b + noise, the biases of a group are eliminated: its rows have the covariance
# diag(1/w) + t M Mᵀ, whose inverse is W = diag(w) − diag(w) M (1/t + Mᵀ diag(w) M)⁻¹ Mᵀ diag(w)
# (Woodbury, 1950). The posterior is normal with covariance C = (P⁻¹ + Σ Aᵀ W A)⁻¹ and mean C Σ Aᵀ
# W r over groups.


# Whether an estimate agrees with what was said of the unknowns before.
#
# Notation
# --------
# m   estimate of the unknowns      P   their prior covariance      C   their posterior covariance
#
# If the prior is right, m is normal with mean 0 and covariance P − C: what was learnt. In units
# of the prior, this covariance has eigenvalues between 0 (nothing was learnt along a direction)
# and 1.


Array = NDArray[np.float64]

LEARNT = 0.25
"""Share of the prior's variance along a direction from which on the estimate says something of the prior."""


def surprise(mean: Array, covariance: Array, prior: Array) -> tuple[float, int]:
    """Return how much larger an estimate is than its prior lets expect.

    Parameters
    ----------
    mean : array (n,)
        The estimate.
    covariance, prior : array (n, n)
        Of the unknowns after and before; the prior is positive definite.

    Returns
    -------
    (float, int)
        Sum of squares along the directions that were learnt, each over its expected value; and their number. If the
        prior is right, the sum has a chi-squared distribution with so many degrees of freedom. If true unknowns are s
        times larger than stated, it is about s² times larger, or less.

    Examples
    --------
    One unknown is stated to 1 and was measured to 0.1 as 5:

    >>> import numpy as np
    >>> total, n = surprise(np.array([5.0]), np.array([[0.01]]), np.eye(1))
    >>> round(total, 2), n
    (25.25, 1)
    """
    if not len(mean):
        return 0.0, 0
    inverse = np.linalg.inv(np.linalg.cholesky(prior))
    learnt = np.eye(len(prior)) - inverse @ covariance @ inverse.T
    values, vectors = np.linalg.eigh((learnt + learnt.T) / 2)
    chosen = values >= LEARNT
    along = vectors[:, chosen].T @ (inverse @ mean)
    return float((along**2 / values[chosen]).sum()), int(chosen.sum())


# What an image does not determine: directions of the unknowns of which the posterior knows as
# little as the prior.


RESTS_SHARE = 0.8
"""A value rests on the prior if its standard deviation falls to no less than this share of it."""


def undetermined(covariance: Array, prior: Array, share: float = RESTS_SHARE) -> Array:
    """Return the directions of the unknowns that were learnt little about.

    Parameters
    ----------
    covariance, prior : array (n, n)
        Of the unknowns after and before; the prior is positive definite.
    share : float
        Least share of the prior's standard deviation that is left along a direction.

    Returns
    -------
    array (k, n)
        Directions, each one standard deviation of the prior long, those that were learnt least about first.
    """
    root = np.linalg.cholesky(prior)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    chosen = np.flatnonzero(values >= share**2)[::-1]
    return np.asarray((root @ vectors[:, chosen]).T)


def rests_on_prior(
    covariance: Array, prior: Array, gradient: Array, standard_uncertainty: float
) -> bool:
    """Return whether a value is known from the prior rather than from the image.

    Parameters
    ----------
    covariance, prior : array (n, n)
        Of the unknowns after and before.
    gradient : array (n,)
        Of the value by the unknowns.
    standard_uncertainty : float
        Its whole u.

    Returns
    -------
    bool
        True if the unknowns are half of its variance or more, and their part of its standard deviation has fallen by
        less than a fifth (`RESTS_SHARE`).
    """
    after = float(gradient @ covariance @ gradient)
    before = float(gradient @ prior @ gradient)
    if after < 0.5 * standard_uncertainty**2:
        return False
    return after >= RESTS_SHARE**2 * before


def variance_by_input(
    covariance: Array, prior: Array, gradient: Array, first: int
) -> tuple[float, float, float]:
    """Return the variance of a value by what its error comes from: pose, surfaces and rows.

    The error of the estimate is C (Aᵀ W e − P⁻¹ x), with the errors e of the rows and the unknowns x themselves, which
    are independent. So the variance g' C g is the sum of g' C P⁻¹ C g, by group of x, and of the rows' part. No part
    is negative. Errors that pose and surfaces have after registration would cancel in most values.

    Parameters
    ----------
    covariance, prior : array (n, n)
        Of the unknowns after and before; before, surfaces are independent of the pose and of each other.
    gradient : array (n,)
        Of the value by the unknowns.
    first : int
        Number of unknowns of the pose; those of the surfaces follow.

    Returns
    -------
    tuple of float
        By pose, surfaces and rows; together the variance of the value.
    """
    way = covariance @ gradient
    pose = float(way[:first] @ np.linalg.solve(prior[:first, :first], way[:first]))
    surfaces = float((way[first:] ** 2 / np.diag(prior)[first:]).sum())
    # without rows, a digit of rounding is left
    return pose, surfaces, max(float(gradient @ way) - pose - surfaces, 0.0)


class Rows(NamedTuple):
    """Rows of one group.

    Attributes
    ----------
    unknowns : array of int (k,)
        Which unknowns move them.
    design : array (m, k)
        How far, for each unit of these.
    residual : array (m,)
        How far off the rows were found.
    weight : array (m,)
        1 over the variance of each.
    modes : array (m, q) or None
        How far each bias of the group moves its rows. None is one bias, which moves all of them alike.
    """

    unknowns: NDArray[np.int64]
    design: Array
    residual: Array
    weight: Array
    modes: Array | None = None

    @property
    def biases(self) -> Array:
        """How far each bias moves the rows (m, q)."""
        return np.ones((len(self.weight), 1)) if self.modes is None else self.modes


@dataclass(frozen=True)
class Posterior:
    """What is known of the unknowns afterwards.

    Attributes
    ----------
    mean : array (n,)
        Their estimate.
    covariance : array (n, n)
        Its covariance.
    """

    mean: Array
    covariance: Array


def posterior(prior_covariance: Array, rows: Iterable[Rows], bias_variance: float) -> Posterior:
    """Return the posterior of unknowns.

    Parameters
    ----------
    prior_covariance : array (n, n)
        What is known before, about 0; positive definite.
    rows : iterable of Rows
        The rows of each group.
    bias_variance : float
        Variance of each bias of a group, in the square of the unit of the residuals.

    Returns
    -------
    Posterior
        Mean and covariance.

    Raises
    ------
    InvalidParameterError
        If the bias is negative, or the covariance is not positive definite.
    """
    prior = _check_prior(prior_covariance)
    bias = check_not_negative(bias_variance, "bias_variance")
    groups = list(rows)
    moving = _moving(prior, groups)
    scale = np.sqrt(np.diag(prior))[moving]
    # millimetres and radians are far apart: solved in units of the prior
    information = np.linalg.inv(prior[np.ix_(moving, moving)] / np.outer(scale, scale))
    right = np.zeros(len(moving))
    for group in groups:
        places = np.searchsorted(moving, group.unknowns)
        design = group.design * scale[places]
        weighted = design.T * group.weight
        modes, free = free_biases(group, bias)
        common = weighted @ modes
        information[np.ix_(places, places)] += weighted @ design - common @ free @ common.T
        right[places] += weighted @ group.residual - common @ free @ (
            modes.T @ (group.weight * group.residual)
        )
    covariance = np.linalg.inv(information)
    covariance = (covariance + covariance.T) / 2
    mean = np.zeros(len(prior))
    mean[moving] = scale * (covariance @ right)
    every = prior.copy()
    every[np.ix_(moving, moving)] = covariance * np.outer(scale, scale)
    return Posterior(mean, every)


def bias_variance_of(rows: Iterable[Rows], estimate: Posterior, bias_variance: float) -> float:
    """Return the variance of the biases of groups that their rows show, given an estimate with another one.

    A step of expectation and maximization (Dempster, Laird and Rubin, 1977): the mean square of the biases, of what is
    estimated of them and of what remains unknown. Repeated, it ends at the variance that makes the rows most likely.

    Parameters
    ----------
    rows : iterable of Rows
        The rows of each group.
    estimate : Posterior
        Estimate of the unknowns from them.
    bias_variance : float
        The variance of each bias that it was estimated with, positive.

    Returns
    -------
    float
        The variance; the given one if there are no rows.
    """
    total = 0.0
    count = 0
    for group in rows:
        modes, free = free_biases(group, bias_variance)
        gain = free @ (modes.T * group.weight)
        residual = group.residual - group.design @ estimate.mean[group.unknowns]
        moved = gain @ group.design
        covariance = estimate.covariance[np.ix_(group.unknowns, group.unknowns)]
        total += float(
            ((gain @ residual) ** 2).sum() + np.trace(free) + np.trace(moved @ covariance @ moved.T)
        )
        count += modes.shape[1]
    return total / count if count else bias_variance


def free_biases(group: Rows, bias: float) -> tuple[Array, Array]:
    """Return how far biases move a group's rows (m, q), and the covariance (q, q) of the biases if only they did."""
    modes = group.biases
    if not bias > 0:
        return modes, np.zeros((modes.shape[1], modes.shape[1]))
    return modes, np.asarray(
        np.linalg.inv(np.eye(modes.shape[1]) / bias + (modes.T * group.weight) @ modes)
    )


def _moving(prior: Array, groups: list[Rows]) -> NDArray[np.int64]:
    """Return the unknowns that rows say something of: of the others only the prior tells.

    An image shows few of a large part's surfaces. All are returned if the prior ties the others to these.
    """
    mask = np.zeros(len(prior), dtype=bool)
    for group in groups:
        mask[group.unknowns] = True
    if prior[np.ix_(mask, ~mask)].any():
        return np.arange(len(prior))
    return np.flatnonzero(mask)


def _check_prior(value: Array) -> Array:
    """Return a covariance (n, n) that is positive definite."""
    prior = check_finite(value, "prior_covariance")
    if prior.ndim != 2 or prior.shape[0] != prior.shape[1]:
        raise InvalidShapeError.of_rule(
            "prior_covariance", "must have shape (n, n)", f"shape {prior.shape}"
        )
    variances = np.diag(prior)
    if not (variances > 0).all():
        raise CovarianceError.of_rule(
            "prior_covariance", "must have positive variances", f"{variances.min():g}"
        )
    # what is tied to nothing else is positive definite by its variance
    tied = np.flatnonzero(np.count_nonzero(prior, axis=1) > 1)
    scale = np.sqrt(variances[tied])
    correlation = prior[np.ix_(tied, tied)] / np.outer(scale, scale)
    try:
        # a third of the work of eigenvalues
        np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        lowest = float(np.linalg.eigvalsh(correlation).min())
        raise CovarianceError.of_rule(
            "prior_covariance", "must be positive definite", f"the (scaled) eigenvalue {lowest:g}"
        ) from None
    return prior


# The loops of `errors.registration`; its notation is theirs.


POSE = 6
"""Numbers of a camera's displacement."""

# numbers of a surface
_OWN = 3
# biases of an edge: one of all of it; of a line, half as large, of its ends against each other; of a circle, of
# opposite sides together
_BIASES = 3


@njit(error_model="numpy")
def find_known_poses(poses, prior, stretches, imaging, values, covariance, root, roots, variance):
    """Write covariance and root of each pose, and the variance of each value: by all, and by the pose alone.

    And the root of the pose for each value, whose own surfaces are free.
    """
    sigmas = stretches.sigmas
    rows = np.zeros((len(stretches.points), POSE + 2 * _OWN))
    weights = np.zeros(len(stretches.points))
    shown = np.zeros((len(stretches.points), 6))
    scale = np.empty(POSE)
    for i in range(POSE):
        scale[i] = np.sqrt(prior[i, i])
    before = _inverse_scaled(prior, scale)
    place = np.empty(len(sigmas), np.int64)
    first = 0
    for i in range(len(poses)):
        last = first
        while last < len(values.pose) and values.pose[last] == i:
            last += 1
        _look(poses[i], stretches, imaging, rows, weights, shown)
        count = _placed(stretches, values, first, last, weights, place)
        information = np.zeros((count + POSE, count + POSE))
        for j in range(count):
            information[j, j] = 1.0
        for j in range(POSE):
            for k in range(POSE):
                information[count + j, count + k] = before[j, k]
        _inform(information, stretches, imaging, (rows, weights, shown, place, scale, count))
        factor = information.copy()
        _factor(factor, 0)
        _pose_of(factor, scale, covariance[i], root[i])
        scratch = np.empty((POSE, POSE))
        for t in range(first, last):
            state = poses[i], root[i], place, scale, count
            freed = _freed_factor(information, factor, stretches, values, t, place)
            _pose_of(freed, scale, scratch, roots[t])
            _variance(freed, values, t, sigmas, state, variance[t])
        first = last


@njit(error_model="numpy")
def _freed_factor(information, factor, stretches, values, t, place):
    """Return the factor with the prior of a value, whose own surfaces are free: from the first of these on."""
    start = len(factor)
    for k in range(len(place)):
        if values.free[t, k] and place[k] >= 0:
            start = min(start, place[k])
    if start == len(factor):
        return factor
    freed = factor.copy()
    freed[start:] = information[start:]
    for k in range(len(place)):
        if values.free[t, k] and place[k] >= 0:
            for j in range(_OWN):
                # the prior's precision is 1 in units of what is known of surfaces that are not free
                ratio = stretches.sigmas[k, j] / stretches.free_sigmas[k, j]
                freed[place[k] + j, place[k] + j] += ratio * ratio - 1.0
    _factor(freed, start)
    return freed


@njit(error_model="numpy")
def _look(pose, stretches, imaging, rows, weights, shown):
    """Write how stretches move across their edges in an image, and their weights, 0 if not shown.

    ``shown`` (m, 6) gets their lengths, middles and half their vectors, px, and whether they may be another line.
    """
    turn = pose[:3, :3]
    at = np.empty(3)
    way = np.empty(3)
    row = np.empty(3)
    centre = np.empty(3)
    for i in range(3):
        centre[i] = -(turn[0, i] * pose[0, 3] + turn[1, i] * pose[1, 3] + turn[2, i] * pose[2, 3])
    fx, fy = imaging.focal_px
    for m in range(len(stretches.points)):
        weights[m] = 0.0
        shown[m] = 0.0
        point = stretches.points[m]
        for i in range(3):
            at[i] = turn[i, 0] * point[0] + turn[i, 1] * point[1] + turn[i, 2] * point[2]
            at[i] += pose[i, 3]
        z = at[2]
        if not z > 0.0:
            continue
        u = imaging.centre_px[0] + fx * at[0] / z
        v = imaging.centre_px[1] + fy * at[1] / z
        edge = imaging.margin_px
        if not (edge <= u <= imaging.limits_px[0] - 1 - edge):
            continue
        if not (edge <= v <= imaging.limits_px[1] - 1 - edge):
            continue
        tangent = stretches.tangents[m]
        for i in range(3):
            way[i] = turn[i, 0] * tangent[0] + turn[i, 1] * tangent[1] + turn[i, 2] * tangent[2]
        tu = fx * (way[0] - way[2] * at[0] / z) / z
        tv = fy * (way[1] - way[2] * at[1] / z) / z
        size = np.sqrt(tu * tu + tv * tv)
        if not size > 0.0:
            continue
        free = _free_ways(stretches, m, centre)
        length = size * stretches.lengths[m]
        shown[m, 1] = u
        shown[m, 2] = v
        shown[m, 3] = tu * stretches.lengths[m] / 2.0
        shown[m, 4] = tv * stretches.lengths[m] / 2.0
        # what may be seen may be taken for another line
        shown[m, 5] = 1.0 if free > 0 else 0.0
        blur = max(abs(1.0 / z - imaging.focus[0]) / imaging.focus[1], 1.0)
        if free < 4 or blur > imaging.focus[2]:
            continue
        row[0] = -tv / size * fx / z
        row[1] = tu / size * fy / z
        row[2] = -(row[0] * at[0] + row[1] * at[1]) / z
        _unknowns_of(row, at, turn, stretches.moves[m], rows[m])
        variance = imaging.noise_px * imaging.noise_px * blur * blur * blur
        weights[m] = length / (imaging.correlation_px * variance)
        shown[m, 0] = length
    _keep_apart(stretches.edge, imaging.apart_px, weights, shown)


@njit(error_model="numpy")
def _unknowns_of(across, at, turn, moves, row):
    """Write how an image moves with the unknowns, given how it moves with its point (3,) in the camera's frame."""
    for i in range(3):
        row[i] = -across[i]
    row[3] = across[1] * at[2] - across[2] * at[1]
    row[4] = across[2] * at[0] - across[0] * at[2]
    row[5] = across[0] * at[1] - across[1] * at[0]
    for j in range(2 * _OWN):
        total = 0.0
        for k in range(3):
            along = across[0] * turn[0, k] + across[1] * turn[1, k] + across[2] * turn[2, k]
            total += along * moves[k, j]
        row[POSE + j] = total


@njit(error_model="numpy")
def _free_ways(stretches, m, centre):
    """Return how many of the four directions of the grid around that to a centre are free; a stretch is seen by all."""
    n = stretches.free.shape[1]
    turn = stretches.turn
    x = centre[0] - stretches.points[m, 0]
    y = centre[1] - stretches.points[m, 1]
    z = centre[2] - stretches.points[m, 2]
    a = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
    b = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
    c = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
    # the direction on an octahedron, whose lower half unfolds round the upper one to a square
    size = abs(a) + abs(b) + abs(c)
    if not size > 0.0:
        return 0
    a /= size
    b /= size
    if c < 0.0:
        a, b = (
            (1.0 - abs(b)) * (1.0 if a >= 0.0 else -1.0),
            (1.0 - abs(a)) * (1.0 if b >= 0.0 else -1.0),
        )
    p = (a + 1.0) / 2.0 * (n - 1)
    q = (b + 1.0) / 2.0 * (n - 1)
    i = min(int(p), n - 2)
    j = min(int(q), n - 2)
    free = stretches.free[m]
    return int(free[i, j]) + int(free[i + 1, j]) + int(free[i, j + 1]) + int(free[i + 1, j + 1])


@njit(error_model="numpy")
def _keep_apart(edge, apart, weights, shown):
    """Take from weights and lengths the share of stretches near another edge in the image: of five points on each."""
    for m in range(len(weights)):
        if weights[m] == 0.0:
            continue
        near = 0
        reach = abs(shown[m, 3]) + apart
        rise = abs(shown[m, 4]) + apart
        for n in range(len(weights)):
            if shown[n, 5] == 0.0 or edge[n] == edge[m]:
                continue
            du = shown[n, 1] - shown[m, 1]
            dv = shown[n, 2] - shown[m, 2]
            # too far away for any point of both to be near
            if abs(du) > reach + abs(shown[n, 3]) or abs(dv) > rise + abs(shown[n, 4]):
                continue
            near |= _near_points(du, dv, shown[m], shown[n], apart)
        n_clear = 5
        for k in range(5):
            if near & (1 << k):
                n_clear -= 1
        weights[m] *= n_clear / 5.0
        shown[m, 0] *= n_clear / 5.0


@njit(error_model="numpy")
def _near_points(du, dv, stretch, other, apart):
    """Return as bits which of five points of a stretch have another one near, whose middle is (du, dv) away."""
    hu = other[3]
    hv = other[4]
    size = hu * hu + hv * hv
    bits = 0
    for k in range(5):
        share = 0.4 * (k - 2)
        pu = share * stretch[3] - du
        pv = share * stretch[4] - dv
        along = 0.0
        if size > 0.0:
            # nearest place on the other stretch, which ends at -1 and 1
            along = min(max((pu * hu + pv * hv) / size, -1.0), 1.0)
        pu -= along * hu
        pv -= along * hv
        if pu * pu + pv * pv < apart * apart:
            bits |= 1 << k
    return bits


@njit(error_model="numpy")
def _placed(stretches, values, first, last, weights, place):
    """Write where the numbers of each surface begin among the unknowns, -1 where nothing asks; return how many."""
    place[:] = -1
    for m in range(len(weights)):
        if weights[m] > 0.0:
            for side in range(2):
                place[stretches.surfaces[stretches.edge[m], side]] = 0
    for t in range(first, last):
        for e in range(values.surfaces.shape[1]):
            for side in range(2):
                if values.surfaces[t, e, side] >= 0:
                    place[values.surfaces[t, e, side]] = 0
    count = 0
    for k in range(len(place)):
        if place[k] == 0:
            place[k] = count
            count += _OWN
    return count


@njit(error_model="numpy")
def _inform(information, stretches, imaging, state):
    """Add what the shown stretches say of the unknowns, in units of their standard deviations before."""
    rows, weights, shown, place, scale, count = state
    size = POSE + 2 * _OWN
    sums = np.empty((size + _BIASES, size + _BIASES))
    modes = np.empty((len(weights), _BIASES))
    at = np.empty(size, np.int64)
    unit = np.empty(size)
    start = 0
    while start < len(weights):
        edge = stretches.edge[start]
        end = start
        total = 0.0
        length = 0.0
        while end < len(weights) and stretches.edge[end] == edge:
            total += weights[end]
            length += shown[end, 0]
            end += 1
        if total > 0.0:
            share = max(length - 2.0 * imaging.end_px, 0.0) / length
            _write_modes(stretches, weights, start, end, modes)
            _sum_edge((rows, modes), weights, start, end, share, sums)
            # what a bias may have caused says nothing of pose and surfaces
            _leave_out_biases(sums, 1.0 / imaging.bias_px**2)
            for j in range(POSE):
                at[j] = count + j
                unit[j] = scale[j]
            for side in range(2):
                surface = stretches.surfaces[edge, side]
                for j in range(_OWN):
                    at[POSE + _OWN * side + j] = place[surface] + j
                    unit[POSE + _OWN * side + j] = stretches.sigmas[surface, j]
            for j in range(size):
                for k in range(size):
                    information[at[j], at[k]] += imaging.share * sums[j, k] * unit[j] * unit[k]
        start = end


@njit(error_model="numpy")
def _write_modes(stretches, weights, start, end, modes):
    """Write how far the biases of an edge move its shown stretches (m, 3); see `errors.registration`."""
    span = stretches.spans[stretches.edge[start]]
    low = 1.0
    high = 0.0
    for m in range(start, end):
        if weights[m] > 0.0:
            low = min(low, stretches.along[m])
            high = max(high, stretches.along[m])
    middle = (low + high) / 2.0
    half = max((high - low) / 2.0, 1e-12)
    for m in range(start, end):
        # all points shift alike; beyond that, one wave round an arc, or a tilt of a line
        modes[m, 0] = 1.0
        if span > 0.0:
            modes[m, 1] = 0.5 * np.cos(span * stretches.along[m])
            modes[m, 2] = 0.5 * np.sin(span * stretches.along[m])
        else:
            modes[m, 1] = 0.5 * (stretches.along[m] - middle) / half
            modes[m, 2] = 0.0


@njit(error_model="numpy")
def _sum_edge(parts, weights, start, end, share, sums):
    """Write the sums of products of what moves the stretches of an edge: unknowns, then biases."""
    rows, modes = parts
    size = rows.shape[1]
    row = np.empty(len(sums))
    sums[:] = 0.0
    for m in range(start, end):
        w = weights[m] * share
        if w > 0.0:
            row[:size] = rows[m]
            row[size:] = modes[m]
            for j in range(len(row)):
                for k in range(j + 1):
                    sums[j, k] += w * row[j] * row[k]
    # symmetric: only one half was summed
    for j in range(len(sums)):
        for k in range(j):
            sums[k, j] = sums[j, k]


@njit(error_model="numpy")
def _leave_out_biases(information, before):
    """Take from the information of unknowns what biases, the last of them, might explain as well."""
    for b in range(len(information) - 1, len(information) - 1 - _BIASES, -1):
        # Schur complement: a bias of known variance before, eliminated
        information[b, b] += before
        for j in range(b):
            for k in range(b):
                information[j, k] -= information[j, b] * information[b, k] / information[b, b]


@njit(error_model="numpy")
def _factor(matrix, start):
    """Write the Cholesky factor into the lower half of a positive definite matrix; zeros left of it are skipped.

    The rows before the start are the factor's.
    """
    n = len(matrix)
    begin = np.empty(n, np.int64)
    for i in range(n):
        begin[i] = i
        for j in range(i):
            if matrix[i, j] != 0.0:
                begin[i] = j
                break
        if i < start:
            continue
        for j in range(begin[i], i + 1):
            total = matrix[i, j]
            for k in range(max(begin[i], begin[j]), j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@njit(error_model="numpy")
def _inverse_scaled(covariance, scale):
    """Return the inverse of a covariance (6, 6) in units of standard deviations."""
    n = len(covariance)
    factor = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            factor[i, j] = covariance[i, j] / (scale[i] * scale[j])
    _factor(factor, 0)
    lower = np.zeros((n, n))
    _invert_lower(factor, 0, lower)
    inverse = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            # (L L')^-1 = L'^-1 L^-1, and L^-1 has only zeros above its diagonal
            for k in range(max(i, j), n):
                inverse[i, j] += lower[k, i] * lower[k, j]
    return inverse


@njit(error_model="numpy")
def _invert_lower(factor, start, lower):
    """Write the inverse of the last block of a lower triangular matrix, from a row on."""
    n = len(lower)
    for j in range(n):
        lower[j, j] = 1.0 / factor[start + j, start + j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= factor[start + i, start + k] * lower[k, j]
            lower[i, j] = total / factor[start + i, start + i]


@njit(error_model="numpy")
def _pose_of(factor, scale, covariance, root):
    """Write covariance and root of the pose, from the factor of the information with the pose last."""
    # with the pose last, its covariance rests on the last block of the factor alone
    lower = np.zeros((POSE, POSE))
    _invert_lower(factor, len(factor) - POSE, lower)
    for i in range(POSE):
        for k in range(POSE):
            root[i, k] = scale[i] * lower[k, i]
    for i in range(POSE):
        for j in range(POSE):
            total = 0.0
            for k in range(max(i, j), POSE):
                total += root[i, k] * root[j, k]
            covariance[i, j] = total


@njit(error_model="numpy")
def _variance(factor, values, t, sigmas, state, out):
    """Write the variance of a value, and that by the pose alone."""
    pose, root, place, scale, count = state
    n = len(factor)
    y = np.zeros(n)
    for e in range(values.gradient.shape[1]):
        gradient = values.gradient[t, e]
        for j in range(POSE):
            y[count + j] += gradient[j] * scale[j]
        for side in range(2):
            surface = values.surfaces[t, e, side]
            if surface >= 0:
                for j in range(_OWN):
                    moved = _by_motion(pose, gradient, values.motions[t, e, side, j])
                    y[place[surface] + j] += moved * sigmas[surface, j]
    out[1] = 0.0
    for j in range(POSE):
        total = 0.0
        for i in range(POSE):
            # y and the root both hold the scale
            total += root[i, j] * y[count + i] / scale[i]
        out[1] += total * total
    out[0] = 0.0
    for i in range(n):
        # y' (L L')^-1 y = |L^-1 y|^2: solved row by row
        total = y[i]
        for k in range(i):
            total -= factor[i, k] * y[k]
        y[i] = total / factor[i, i]
        out[0] += y[i] * y[i]


@njit(error_model="numpy")
def _by_motion(pose, gradient, motion):
    """Return how a value changes as an entity moves: as if the camera moved the other way."""
    centre = np.empty(3)
    shift = np.empty(3)
    for i in range(3):
        # the lens in the frame of the part: -R't
        centre[i] = -(pose[0, i] * pose[0, 3] + pose[1, i] * pose[1, 3] + pose[2, i] * pose[2, 3])
    # a motion turns about the origin of the part, which shifts the lens by turn x centre
    shift[0] = motion[0] + motion[4] * centre[2] - motion[5] * centre[1]
    shift[1] = motion[1] + motion[5] * centre[0] - motion[3] * centre[2]
    shift[2] = motion[2] + motion[3] * centre[1] - motion[4] * centre[0]
    total = 0.0
    for i in range(3):
        along = 0.0
        about = 0.0
        for j in range(3):
            along += pose[i, j] * shift[j]
            about += pose[i, j] * motion[3 + j]
        total -= gradient[i] * along + gradient[3 + i] * about
    return total


# What registering an image to the part's own edges leaves unknown of the camera's pose, before
# there is an image.
#
# Notation
# --------
# x   unknowns: displacement of the camera (6), then three numbers of each surface, normal with mean 0 and known
#     variances
# A   how the image of a sample moves across its edge with x, px
# w   1 / variance of what is found of a sample's stretch of its edge
# b   biases of an edge; M how far they move its samples
#
# Stretches of edges that a pose shows give the information of `errors.registration`,
# edge after edge:
#
#     P⁻¹ + q Σ_edges [Σ w A Aᵀ − (Σ w A Mᵀ) (1/Var b + Σ w M Mᵀ)⁻¹ (Σ w M Aᵀ)],   q the share of the edges that are
#     found
#
# Its Cholesky factor has the pose last. So the pose's own covariance, with the surfaces not
# known, is the inverse of its last block; and the variance of a value with the gradient g is
# |y|², L y = g. All are plain loops in one order: what a plan decides by them is the same on all
# machines.


class Stretches(NamedTuple):
    """Stretches (m) of edges (e) that surfaces (k) carry.

    Attributes
    ----------
    points, tangents : array (m, 3)
        Their middles, mm, and unit vectors along them.
    lengths : array (m,)
        Along the edge, mm.
    moves : array (m, 3, 6)
        How they move with the numbers of both surfaces of their edge.
    edge : array of int (m,)
        Which edge each is of, ascending.
    along : array (m,)
        Where on it their middles are, from 0 to 1.
    spans : array (e,)
        Angle of each edge that is round, rad; 0 of lines.
    surfaces : array of int (e, 2)
        The surfaces of each edge.
    free : array of bool (m, n, n)
        Whether they can be seen from far away in directions of an octahedral grid.
    turn : array (3, 3)
        From the part's frame to the grid's.
    sigmas : array (k, 3)
        Standard deviations of the numbers of the surfaces before the image, mm; positive.
    free_sigmas : array (k, 3)
        The same of surfaces that a value measures itself; not smaller.
    """

    points: Array
    tangents: Array
    lengths: Array
    moves: Array
    edge: NDArray[np.int64]
    along: Array
    spans: Array
    surfaces: NDArray[np.int64]
    free: NDArray[np.bool_]
    turn: Array
    sigmas: Array
    free_sigmas: Array


class Imaging(NamedTuple):
    """How a camera shows them, and how well they are found.

    Attributes
    ----------
    focal_px : tuple of float
        Image distance over pixel pitch, along x and y.
    centre_px : tuple of float
        Where the axis meets the image.
    limits_px : tuple of float
        Width and height of the image.
    focus : tuple of float
        1 / the depth in focus; by how much 1 / depth differs where the blur is still small, 1/mm; and how many times
        that blur an edge may have. Beyond it once, the variance of found points grows with the blur's third power.
    noise_px, correlation_px : float
        Standard deviation of a found point, and how far apart points are independent.
    bias_px : float
        Standard deviation of an edge's bias.
    margin_px, apart_px, end_px : float
        Strip along the border without samples; how far other edges must be in the image; what is not sampled at each
        end of an edge.
    share : float
        Share of what is shown that is found.
    """

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    limits_px: tuple[float, float]
    focus: tuple[float, float, float]
    noise_px: float
    correlation_px: float
    bias_px: float
    margin_px: float
    apart_px: float
    end_px: float
    share: float


class Values(NamedTuple):
    """Values (t) whose variance is asked for, each at one pose.

    A surface that is off moves an entity as a rigid body, as far as a value feels it: by a vector and a small turn
    about the origin of the part.

    Attributes
    ----------
    pose : array of int (t,)
        At which pose, ascending.
    gradient : array (t, e, 6)
        By the displacement of the camera, of each entity alone.
    surfaces : array of int (t, e, 2)
        The surfaces that carry each entity; -1 for none.
    motions : array (t, e, 2, 3, 6)
        How it moves with the numbers of each: vector, mm, and turn, rad.
    free : array of bool (t, k)
        Which surfaces each value measures itself, so that nothing is assumed of them.
    """

    pose: NDArray[np.int64]
    gradient: Array
    surfaces: NDArray[np.int64]
    motions: Array
    free: NDArray[np.bool_]


class KnownPoses(NamedTuple):
    """What is known of poses (n) after registration.

    Attributes
    ----------
    covariance : array (n, 6, 6)
        Of the displacement of the camera.
    root : array (n, 6, 6)
        S with S S' that covariance.
    variance : array (t,)
        Of the values, by pose and surfaces together, where what a value measures itself is free.
    by_pose : array (t,)
        Of the values, by the pose alone.
    roots : array (t, 6, 6)
        S for the pose where what a value measures itself is free.
    """

    covariance: Array
    root: Array
    variance: Array
    by_pose: Array
    roots: Array


def known_poses(
    world_to_camera: Array,
    pose_covariance: Array,
    stretches: Stretches,
    imaging: Imaging,
    values: Values,
) -> KnownPoses:
    """Return what registration leaves unknown of poses.

    Parameters
    ----------
    world_to_camera : array (n, 4, 4)
        Planned poses.
    pose_covariance : array (6, 6)
        Of the displacement of the camera before the image; positive definite.
    stretches : Stretches
        The part's edges.
    imaging : Imaging
        The camera.
    values : Values
        What is measured.

    Returns
    -------
    KnownPoses
        Covariances of poses, and variances of values.
    """
    n = len(world_to_camera)
    covariance = np.zeros((n, POSE, POSE))
    root = np.zeros((n, POSE, POSE))
    variance = np.zeros((len(values.pose), 2))
    roots = np.zeros((len(values.pose), POSE, POSE))
    find_known_poses(
        np.ascontiguousarray(world_to_camera, dtype=np.float64),
        np.ascontiguousarray(pose_covariance, dtype=np.float64),
        stretches,
        imaging,
        values,
        covariance,
        root,
        roots,
        variance,
    )
    return KnownPoses(covariance, root, variance[:, 0].copy(), variance[:, 1].copy(), roots)

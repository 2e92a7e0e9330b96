"""A pose moved to where a count finds more: the least P_all is climbed by the counts themselves.

The displaced poses of a count are draws around a pose, z of a standard normal distribution in units of the pose
uncertainty. Where everything held for a target says not only how often it did, but also where to go: the gradient of
a probability with respect to a shift of its mean is ``E[z; success]``, so that one count gives P_all of each target and
its slope in all six directions (the score function; design centring by it, Soin and Spence 1980, moves to the mean of
the draws that succeed). Slopes are taken of the probit of P_all, which is linear in the shift where one plane bounds
success, and a linear program finds the step, of limited length, that leaves the least of them largest, each compared
with what is aimed at.

The draws are the same at every pose, so counts of two poses differ by less than each of them scatters. A step is kept
if that least one rises and the pose still meets what is required of planned poses.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.special import ndtri

from ground.shared import Shared
from planner.camera.pose import moved
from planner.search.columns import Judge
from planner.search.evolution import triangular_factor
from planner.verify.joint_counts import DisplacedChecks, share_to_show
from planner.verify.simulate_setting import MODEL_TOLERANCE

# displaced poses of a step
_POSES = 500
# steps at most
_STEPS = 4
# length of the first step in each direction at most, in standard deviations of the pose
_FIRST_LENGTH = 1.0
# factor of this length after a step that is kept, and after another one
_LONGER = 1.5
_SHORTER = 0.4
# standard errors that a slope has to be from zero
_SIGNIFICANT = 3.0
# standard errors of the count that the least P_all has to be above what the first look of a count is to show
_TO_SPARE = 1.0


def surer_pose(
    judge: Judge, cam2world: NDArray[np.float64], stated: Mapping[str, float], seed: int
) -> NDArray[np.float64] | None:
    """Look near a pose for one from which each target has a P_all that a count can show.

    Parameters
    ----------
    judge : Judge
        Has the request.
    cam2world : array (4, 4)
        A pose that inspects the targets, but for P_all.
    stated : mapping of str to float
        The targets, and the probability that is stated of each. Counts have to come near to that, too.
    seed : int
        Of the displaced poses.

    Returns
    -------
    array (4, 4) or None
        The best pose found, if it is better than the given one; it inspects all targets. Its P_all is to be counted
        with other draws.
    """
    climb = _Climb(judge, stated, seed)
    best = cam2world
    held = climb.held(best)
    length = _FIRST_LENGTH
    for _ in range(_STEPS):
        excess = climb.excess(held).min()
        if excess >= 0.0:
            break
        pose = climb.step(best, held, length)
        rises = False
        if climb.inspects(pose):
            held_there = climb.held(pose)
            rises = bool(climb.excess(held_there).min() > excess)
        if rises:
            best = pose
            held = held_there
        length *= _LONGER if rises else _SHORTER
    return None if best is cam2world else best


def surer_pose_near(
    shared: Shared, cam2world: NDArray[np.float64], stated: Mapping[str, float], seed: int
) -> NDArray[np.float64] | None:
    """Return what `surer_pose` returns, as a task for any executor; ``shared`` holds the judge."""
    return surer_pose(shared.value, cam2world, stated, seed)


class _Climb:
    """Counts at poses with the same draws, and the steps between."""

    def __init__(self, judge: Judge, stated: Mapping[str, float], seed: int):
        self._judge = judge
        self._names = tuple(stated)
        self._seed = seed
        self._column = np.isin(judge.names, self._names)
        self._factor = triangular_factor(judge.problem.pose_uncertainty.covariance)
        half = np.random.default_rng(seed).standard_normal((_POSES // 2, 6))
        # each also the other way: the mean of the draws is zero
        self._normal = np.concatenate([half, -half])
        shown = share_to_show(judge.threshold, look=0)
        shown += _TO_SPARE * np.sqrt(shown * (1.0 - shown) / _POSES)
        supported = np.array(list(stated.values())) - 0.5 * MODEL_TOLERANCE
        self._goals = _probit(np.maximum(supported, shown), _POSES)

    def held(self, cam2world: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return in which displaced poses everything holds of which target; (n, k)."""
        checks = DisplacedChecks(self._judge.problem.at_pose(cam2world, self._names), self._names)
        displaced = moved(cam2world, self._normal @ self._factor.T, 1.0)
        return checks.held(cam2world, displaced, self._seed)

    def inspects(self, cam2world: NDArray[np.float64]) -> bool:
        """Tell whether a pose meets what is required of planned ones, for all targets."""
        return bool(self._judge(cam2world[None]).inspects[0, self._column].all())

    def excess(self, held: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return by how much the probit of each target's P_all is above what is aimed at; (k,)."""
        return _probit(held.mean(axis=0), len(held)) - self._goals

    def step(
        self, cam2world: NDArray[np.float64], held: NDArray[np.bool_], length: float
    ) -> NDArray[np.float64]:
        """Return the pose (4, 4) at the end of the best step, so long in each direction at most."""
        n = len(held)
        p_all = held.mean(axis=0)
        slope = (held - p_all).T @ self._normal / n
        # a slope that may be chance would only lead astray
        chance = np.sqrt(p_all * (1.0 - p_all) / n)
        slope[np.abs(slope) < _SIGNIFICANT * chance[:, None]] = 0.0
        slope /= np.exp(-0.5 * _probit(p_all, n) ** 2)[:, None] / np.sqrt(2.0 * np.pi)
        # the largest t that no excess is below after the step
        program = linprog(
            np.array([*np.zeros(6), -1.0]),
            A_ub=np.column_stack([-slope, np.ones(len(slope))]),
            b_ub=self.excess(held),
            bounds=[(-length, length)] * 6 + [(None, None)],
        )
        shift = np.zeros(6) if program.x is None else program.x[:6]
        return moved(cam2world, (self._factor @ shift)[None], 1.0)[0]


def _probit(p_all: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Return the probit of shares of n draws; of none and of all of them, that of half a draw from there."""
    return np.asarray(ndtri(np.clip(p_all, 0.5 / n, 1.0 - 0.5 / n)))

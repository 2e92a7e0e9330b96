"""Where the links are for joints, and all joints for a pose: branches within limits, each checked.

EAIK (Ostermeier, Külz and Althoff, 2025) solves arms whose axes intersect or are parallel in closed form, by the
subproblems of Elias and Wen. It knows no limits, takes axes at their word, and approximates where there is no solution.
All three are dealt with here.

Notation: F_k is the frame of joint k with its axis along z. F_0 is the base, F_k = F_{k-1} · A_k · Rz(q_k), and the tip
is F_6 · T.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from aspectgraph.exceptions import how_to_install
from ground.decorators import njit
from planner.exceptions import RobotError
from planner.robotcell.urdf import UrdfArm, about, compose, invert, to_axis

SIX = 6
"""Joints of an arm that has no more than it needs."""

_TURN = 2 * np.pi
_QUARTERS = (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi)
# angles of a URDF have nine digits; EAIK looks for parallel axes to more
_NOISE = 1e-8
_POSE = 1e-6
"""A branch is one if its pose is met to this, in rad and in metres."""
_SAME = 1e-4
"""Joints that differ by less, rad, are one branch: in singular joints a pose fixes no more digits."""
_AT_LIMIT = 1e-9
"""Joints beyond a limit by no more than this noise, rad, stand at it."""
_M = 1e-3
_OBLIQUE = np.array([[2.0, 3.0, 6.0], [-3.0, 6.0, -2.0], [6.0, 2.0, -3.0]]) / 7.0
_ASIDE = np.concatenate([_OBLIQUE, -_OBLIQUE])
"""Directions (6, 3) to the sides of a pose, not along the axes of any arm."""
_ALMOST = 2e-3
"""A pose is tried again from beside it if it is missed by less, in rad and in metres."""
_SHARP = 1e-9
"""Newton's method usually meets a pose to this, in rad and in metres."""
_CONVERGED = 1e-11
"""It ends at this, or after so many iterations, or after so many that shrink the squared error by less than this."""
_ITERATIONS = 50
_IDLE = 8
_SHRINKS = 0.9
_BOLD = 12
"""So many steps are taken whole where damped ones creep."""
_REGULAR = 1e-14
_LONGEST_STEP = 0.5
"""Longest step of a joint in one iteration, rad."""
_HALF_TURN = 1e-2
_FORK = 0.05
"""Where two branches meet, it starts from this far to both sides, rad."""
_IN_LINE = 1e-3
"""Axes are in line up to this angle, rad."""
_SINGULAR = 1e-6
"""Joints whose Jacobian in metres has a smaller determinant may be on a curve that leads to one pose."""
_FREE = 3e-5
"""Singular values up to this, in metres, leave a direction free."""
_SLIDES = 40
_THIN = 0.1
"""Of joints on a curve that leads to one pose, those are left out that are nearer to others, rad."""
_UNLIKE = 1e-3
"""Axes at a smaller angle, rad, have no point where they meet."""
_DRAWS = 64
_TESTED = 24
_REFOUND = 1e-5
"""Drawn joints count as found again up to this, rad."""


@dataclass(frozen=True)
class Chain:
    """The constant poses of an arm.

    Attributes
    ----------
    steps : array (k, 4, 4)
        A_k: the frame of joint k at zero in the frame of the joint before.
    tip : array (4, 4)
        T: the tip in the frame of the last joint.
    links : array (k + 1, 4, 4)
        The link's own frame in F_k.
    """

    steps: np.ndarray
    tip: np.ndarray
    links: np.ndarray

    @classmethod
    def of(cls, arm: UrdfArm) -> Chain:
        """Return the chain of an arm, its axes turned to z."""
        turns = [np.eye(4), *(to_axis(joint.axis) for joint in arm.joints)]
        backs = [turn.T for turn in turns]
        steps = [
            compose(compose(backs[k], joint.origin), turns[k + 1])
            for k, joint in enumerate(arm.joints)
        ]
        return cls(np.array(steps), compose(backs[-1], arm.tip), np.array(backs))

    def frames(self, q: np.ndarray) -> np.ndarray:
        """Return the frames F_0 … F_k of joints (n, k) in the base; (n, k + 1, 4, 4)."""
        return np.asarray(_frames(self.steps, np.cos(q), np.sin(q)))

    def tips(self, frames: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) of the tip."""
        return compose(frames[:, -1], self.tip)

    def jacobian(self, frames: np.ndarray) -> np.ndarray:
        """Return the tip's velocity per joint speed (n, 6, k): mm and rad in the base's axes."""
        axes = frames[:, 1:, :3, 2]
        levers = self.tips(frames)[:, None, :3, 3] - frames[:, 1:, :3, 3]
        rows = np.concatenate([np.cross(axes, levers), axes], axis=2)
        return np.swapaxes(rows, 1, 2)

    def reach_mm(self) -> np.ndarray:
        """Return how far from each joint's origin the tip can be (k,): the sum of the lengths behind it."""
        offsets = np.concatenate([self.steps[1:], self.tip[None]])[:, :3, 3]
        lengths = np.sqrt((offsets**2).sum(axis=1))
        return np.cumsum(lengths[::-1])[::-1]


@njit(error_model="numpy")
def _frames(steps: np.ndarray, cosines: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """Return the frames (n, k + 1, 4, 4) of joints with cosines and sines (n, k), for the constant steps (k, 4, 4)."""
    n, n_joints = cosines.shape
    frames = np.zeros((n, n_joints + 1, 4, 4))
    for row in range(n):
        for i in range(4):
            frames[row, 0, i, i] = 1.0
        for k in range(n_joints):
            before = frames[row, k]
            after = frames[row, k + 1]
            step = steps[k]
            c = cosines[row, k]
            s = sines[row, k]
            for i in range(4):
                for j in range(4):
                    total = 0.0
                    for m in range(4):
                        total += before[i, m] * step[m, j]
                    after[i, j] = total
                x = after[i, 0]
                y = after[i, 1]
                after[i, 0] = c * x + s * y
                after[i, 1] = c * y - s * x
    return frames


class NoClosedFormError(RobotError):
    """Six joints are near no arm with a closed form."""


class JointLimits:
    """The limits of an arm's joints.

    Parameters
    ----------
    lower, upper : array (k,)
        Limits of the joints, rad.
    """

    def __init__(self, lower: np.ndarray, upper: np.ndarray) -> None:
        self._lower = lower
        self._upper = upper

    def within_limits(self, q: np.ndarray) -> np.ndarray:
        """Return joints (m, k) at the turns nearest to zero within the limits; NaN where there is none."""
        near = q - _TURN * np.round(q / _TURN)
        up = np.ceil((self._lower - near - _AT_LIMIT) / _TURN)
        down = np.ceil((near - self._upper - _AT_LIMIT) / _TURN)
        moved = near + _TURN * (np.maximum(up, 0.0) - np.maximum(down, 0.0))
        clipped = np.clip(moved, self._lower, self._upper)
        return np.where(np.abs(clipped - moved) <= _AT_LIMIT, clipped, np.nan)

    def turns(self, q: np.ndarray) -> np.ndarray:
        """Return joints (t, k) that differ from (k,) by full turns, within the limits, the given ones first."""
        choices = []
        for angle, low, high in zip(q, self._lower, self._upper, strict=True):
            count = int(np.ceil((high - low) / _TURN)) + 1
            others = [angle + _TURN * turn for turn in range(-count, count + 1) if turn]
            choices.append([angle, *(turned for turned in others if low <= turned <= high)])
        return np.array(list(product(*choices)))


class Branches(JointLimits):
    """The solutions of an arm of six joints.

    EAIK solves an *exact* arm, whose axes are parallel, at right angles or meet to all digits. The exact arm nearest
    to the file's is solved, and Newton's method goes on from there on the file's own chain. At construction drawn
    joints must be found again.

    Parameters
    ----------
    chain : Chain
        The arm.
    lower, upper : array (6,)
        Limits of the joints, rad.

    Raises
    ------
    RobotError
        The extra is missing, no arm with a closed form is near, or drawn joints are not found again.
    """

    def __init__(self, chain: Chain, lower: np.ndarray, upper: np.ndarray) -> None:
        super().__init__(lower, upper)
        self._chain = chain
        # seen from the first joint, whose axis is z, however the base is turned
        self._to_first = invert(chain.steps[0])
        zero = chain.tips(chain.frames(np.zeros((1, SIX))))
        self._tip_turn = compose(self._to_first, zero)[0, :3, :3]
        q = self._drawn()
        most_refound = 0
        families = []
        for near in _NEAR:
            self._arm = _ExactArm(chain, near)
            self._near = near
            if self._arm.is_solved:
                refound = self._count_refound(q)
                if refound == len(q):
                    return
                most_refound = max(most_refound, refound)
            families.append(self._arm.family)
        if most_refound:
            rule = "must be an arm whose joints are found again from the poses they lead to"
            raise RobotError.of_rule("robot", rule, f"{most_refound} of {len(q)} drawn joints")
        rule = "must be an arm with a spherical wrist or three parallel axes"
        farthest = _NEAR[-1]
        hint = (
            f"axes may miss this by {1e3 * farthest.angle:g} mrad and {1e3 * farthest.length:g} mm"
        )
        raise NoClosedFormError.of_rule(
            "robot", rule, f"the unknown family {families[-1]}", hint=hint
        )

    def of(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return all branches of poses of the tip.

        Parameters
        ----------
        tips : array (n, 4, 4)
            Poses in the base, mm.

        Returns
        -------
        q : array (m, 6)
            Joints, rad, each at the turn nearest to zero that its limits allow; ordered by pose, then by joints. Where
            a whole curve of joints leads to a pose, those near zero stand for all.
        owner : array of int (m,)
            Number of each one's pose.
        """
        q, owner = self._solve(tips)
        q = self.within_limits(q)
        within = np.isfinite(q).all(axis=1)
        return firsts_in_order(q[within], owner[within], _SAME)

    def exist(self, tips: np.ndarray) -> np.ndarray:
        """Return for which poses (n, 4, 4) there are joints, whatever their limits; (n,) bool."""
        _, owner = self._solve(tips)
        return np.bincount(owner, minlength=len(tips)) > 0

    def _drawn(self) -> np.ndarray:
        """Return joints (n, 6) within limits for the self-test, none of them nearly singular."""
        low = np.maximum(self._lower, -_TURN)
        high = np.minimum(self._upper, _TURN)
        shares = np.random.default_rng(0).random((_DRAWS, SIX))
        q = low + shares * np.maximum(high - low, 0.0)
        singular = np.linalg.svd(self._jacobian(self._chain.frames(q)), compute_uv=False)[:, -1]
        # the least singular ones: a small arm has small singular values
        return q[np.argsort(-singular, kind="stable")[:_TESTED]]

    def _count_refound(self, q: np.ndarray) -> int:
        """Return how many of joints (n, 6) are found from the poses they lead to."""
        tips = self._chain.tips(self._chain.frames(q))
        if self._near.is_all_digits:
            branches, owner, is_flagged = self._closed_form(tips)
            met = ~is_flagged & (self._errors(branches, tips[owner]) <= _POSE)
            branches = branches[met]
            owner = owner[met]
        else:
            branches, owner = self._solve(tips)
        return len(np.unique(owner[_apart(branches, q[owner]) <= _REFOUND]))

    def _solve(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 6) that lead to poses, whatever their limits, and whose they are (m,)."""
        q, owner, is_flagged = self._closed_form(tips)
        frames = self._chain.frames(q)
        reached = self._chain.tips(frames)
        error = _distances(reached, tips[owner])
        met = ~is_flagged & (error <= _POSE) & self._near.is_all_digits
        is_start = ~met & (error <= self._near.start)
        double = np.flatnonzero(is_start & is_flagged)
        starts = np.concatenate([q[is_start], *self._forks(q[double], frames[double])])
        whose = np.concatenate([owner[is_start], owner[double], owner[double]])
        more, whose, almost = self._refined(starts, whose, tips)
        q_met = np.concatenate([q[met], more])
        met_by = np.concatenate([owner[met], whose])
        others = np.flatnonzero(~met & ~is_start)
        is_aimless = _is_aimless(
            frames[others], reached[others], tips[owner[others]], self._near.start
        )
        aimless = others[is_aimless]
        again = np.union1d(owner[aimless], np.setdiff1d(almost, met_by))
        if not len(again):
            return q_met, met_by
        starts, whose = self._beside(tips, again)
        # the last joint is arbitrary, too
        turned = (q[aimless] + quarter * np.eye(SIX)[-1] for quarter in _QUARTERS)
        starts = np.concatenate([starts, *turned])
        whose = np.concatenate([whose, np.tile(owner[aimless], len(_QUARTERS))])
        more, whose, _ = self._refined(starts, whose, tips)
        return np.concatenate([q_met, more]), np.concatenate([met_by, whose])

    def _closed_form(self, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what EAIK finds (m, 6), whose it is (m,), and which are flagged as no solutions (m,)."""
        targets = compose(self._to_first, tips)
        targets[:, :3, 3] *= _M
        targets[:, :3, :3] = np.einsum("nij,kj->nik", targets[:, :3, :3], self._tip_turn)
        solutions = [self._arm.solver.IK(pose) for pose in targets]
        joints = [np.asarray(each.Q, dtype=np.float64).reshape(-1, SIX) for each in solutions]
        flags = [np.asarray(each.is_LS, dtype=bool).reshape(-1) for each in solutions]
        owner = np.repeat(np.arange(len(tips)), [len(q) for q in joints])
        q = np.concatenate([np.empty((0, SIX)), *joints])
        return q * self._arm.signs, owner, np.concatenate([np.empty(0, dtype=bool), *flags])

    def _beside(self, tips: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 6) that lead beside some of the poses, and whose they are (m,).

        The closed form has none for a pose where a joint is arbitrary, but for those beside it: to each side others.
        """
        step = self._near.step
        turns = np.array([about(aside, step) for aside in _ASIDE])
        moved = np.repeat(tips[None, rows], len(_ASIDE), axis=0)
        moved[:, :, :3, :3] = np.einsum("aij,anjk->anik", turns, moved[:, :, :3, :3])
        moved[:, :, :3, 3] += step / _M * _ASIDE[:, None, ::-1]
        q, owner, _ = self._closed_form(moved.reshape(-1, 4, 4))
        whose = np.tile(rows, len(_ASIDE))[owner]
        near = self._errors(q, tips[whose]) <= self._near.start + 2 * step
        return q[near], whose[near]

    def _forks(self, q: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (m, 6) to both sides of ones that stand for two, where the exact arm is at its bound."""
        weakest = np.linalg.svd(self._jacobian(frames))[2][:, -1]
        return q + _FORK * weakest, q - _FORK * weakest

    def _refined(
        self, q: np.ndarray, owner: np.ndarray, tips: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the joints that Newton's method reaches from others, whose they are, and poses it almost reaches."""
        if not len(q):
            return q, owner, owner
        q = self._newton(q, tips[owner])
        error = self._errors(q, tips[owner])
        almost = np.unique(owner[error <= _ALMOST])
        least_error = np.full(len(tips), _POSE)
        np.minimum.at(least_error, owner, error)
        # where all joints nearby almost lead to a pose, the method creeps: the best of them stands for all
        met = error <= np.maximum(least_error[owner], _SHARP)
        q = q[met]
        owner = owner[met]
        jacobian = self._jacobian(self._chain.frames(q))
        is_singular = np.abs(np.linalg.det(jacobian)) <= _SINGULAR
        curved = np.flatnonzero(is_singular)
        moved = self._to_zero(q[curved], tips[owner[curved]])
        order = np.lexsort(((moved**2).sum(axis=1), owner[curved]))
        moved = moved[order]
        whose = owner[curved][order]
        first = _firsts(moved, whose, _THIN)
        q = np.concatenate([q[~is_singular], moved[first]])
        return q, np.concatenate([owner[~is_singular], whose[first]]), almost

    def _newton(self, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
        """Return joints (m, 6) moved to where they lead to poses, by Newton's method.

        Nearly singular joints lie in a narrow curved valley. Damped steps creep along it, whole ones cross it.
        """
        q = self._damped(q, tips)
        error = self._errors(q, tips)
        rows = np.flatnonzero((error > _SHARP) & (error <= _ALMOST))
        if len(rows):
            moved = q[rows]
            for _ in range(_BOLD):
                residuals, frames = self._residuals(moved, tips[rows])
                moved = moved + _damped_step(self._jacobian(frames), residuals, np.zeros(len(rows)))
            moved = self._damped(moved, tips[rows])
            better = self._errors(moved, tips[rows]) < error[rows]
            q[rows[better]] = moved[better]
        return q

    def _damped(self, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
        """Return joints (m, 6) nearer to where they lead to poses, by the method of Levenberg and Marquardt.

        The damping is the squared error: the method stays quadratic in singular joints (Yamashita and Fukushima, 2001).
        """
        q = q.copy()
        residuals, frames = self._residuals(q, tips)
        sizes = (residuals**2).sum(axis=1)
        damping = np.ones(len(q))
        idle = np.zeros(len(q), dtype=int)
        for _ in range(_ITERATIONS):
            rows = np.flatnonzero((sizes > _CONVERGED**2) & (idle < _IDLE))
            if not len(rows):
                break
            weight = damping[rows] * sizes[rows]
            moved = q[rows] + _damped_step(self._jacobian(frames[rows]), residuals[rows], weight)
            new_rest, new_frames = self._residuals(moved, tips[rows])
            new_sizes = (new_rest**2).sum(axis=1)
            better = new_sizes < sizes[rows]
            idle[rows] = np.where(new_sizes < _SHRINKS * sizes[rows], 0, idle[rows] + 1)
            damping[rows] *= np.where(better, 0.25, 8.0)
            taken = rows[better]
            q[taken] = moved[better]
            residuals[taken] = new_rest[better]
            frames[taken] = new_frames[better]
            sizes[taken] = new_sizes[better]
        return q

    def _to_zero(self, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
        """Return singular joints (m, 6) moved along the curve that leads to the same pose, towards zero.

        Where joints lead to their pose alone, as those of a stretched arm, they stay.
        """
        goal = np.clip(0.0, self._lower, self._upper)
        moved = q.copy()
        for _ in range(_SLIDES if len(q) else 0):
            residuals, frames = self._residuals(moved, tips)
            u, values, vt = np.linalg.svd(self._jacobian(frames))
            free = values <= _FREE
            inverse = np.where(free, 0.0, 1.0 / np.where(free, 1.0, values))
            # one product after the other: all in one take 36 times as many steps
            along = inverse * np.einsum("nkj,nk->nj", u, residuals)
            back = np.einsum("nji,nj->ni", vt, along)
            wish = np.einsum("nij,nj->ni", vt, goal - moved)
            slide = np.einsum("nji,nj->ni", vt, np.where(free, wish, 0.0))
            moved = moved + back + _capped(slide)
        moved = self._newton(moved, tips)
        nearer = ((moved - goal) ** 2).sum(axis=1) < ((q - goal) ** 2).sum(axis=1)
        nearer &= self._errors(moved, tips) <= _POSE
        return np.where(nearer[:, None], moved, q)

    def _jacobian(self, frames: np.ndarray) -> np.ndarray:
        """Return the Jacobian (n, 6, 6) in metres and rad."""
        jacobian = self._chain.jacobian(frames)
        jacobian[:, :3] *= _M
        return jacobian

    def _residuals(self, q: np.ndarray, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is missing to poses (n, 6), in metres and rad, and the frames (n, 7, 4, 4)."""
        frames = self._chain.frames(q)
        reached = self._chain.tips(frames)
        residuals = np.empty((len(q), 6))
        residuals[:, :3] = _M * (tips[:, :3, 3] - reached[:, :3, 3])
        turn = np.einsum("nij,nkj->nik", tips[:, :3, :3], reached[:, :3, :3])
        residuals[:, 3] = turn[:, 2, 1] - turn[:, 1, 2]
        residuals[:, 4] = turn[:, 0, 2] - turn[:, 2, 0]
        residuals[:, 5] = turn[:, 1, 0] - turn[:, 0, 1]
        # twice the sine of half the angle: it grows up to half a turn
        trace = np.einsum("nii->n", turn)
        residuals[:, 3:] /= np.sqrt(np.maximum(1.0 + trace, _HALF_TURN))[:, None]
        return residuals, frames

    def _errors(self, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
        """Return by how much joints (m, 6) miss poses (m, 4, 4), see `_distances`."""
        return _distances(self._chain.tips(self._chain.frames(q)), tips)


class _Nearness(NamedTuple):
    """How near an arm is to the exact one.

    Attributes
    ----------
    angle, length : float
        Axes that miss being parallel, at right angles or meeting by no more are taken for it, rad and metres.
    start : float
        Newton's method starts from joints that miss a pose by no more, in rad and in metres.
    step : float
        Poses beside a pose are moved by this, in rad and in metres.
    is_all_digits : bool
        Whether the closed form is that of the file's arm.
    """

    angle: float
    length: float
    start: float
    step: float
    is_all_digits: bool = False


_NEAR = (
    _Nearness(1e-7, 1e-7, 1e-5, 1e-3, is_all_digits=True),
    # lengths and angles of few digits
    _Nearness(1e-3, 1e-4, 0.02, 1e-2),
    # measured lengths and angles
    _Nearness(0.02, 0.01, 0.1, 2e-2),
)


class _ExactArm:
    """The arm with parallel and intersecting axes that is nearest to a chain, and its closed form.

    Attributes
    ----------
    solver : HPRobot
        EAIK's.
    signs : array (6,)
        -1 where its axis is turned round: EAIK takes parallel axes only if all point one way.
    is_solved : bool
        Whether there is a closed form.
    family : str
        What EAIK calls it.
    """

    def __init__(self, chain: Chain, near: _Nearness) -> None:
        frames = compose(invert(chain.steps[0]), chain.frames(np.zeros((1, 6))))
        axes = _along(_snapped(frames[0, 1:, :3, 2]), near.angle)
        points = _M * np.concatenate([frames[0, 1:, :3, 3], chain.tips(frames)[:, :3, 3]])
        points = _meeting(axes, points, near.length)
        self.signs = np.ones(SIX)
        for k in range(1, SIX):
            if axes[k] @ axes[k - 1] * self.signs[k - 1] < -1 + _NOISE:
                self.signs[k] = -1.0
        offsets = np.diff(points, axis=0, prepend=np.zeros((1, 3)))
        turned = axes * self.signs[:, None]
        self.solver = needed("eaik.IK_HP").HPRobot(turned, _snapped(offsets))
        self.is_solved = bool(self.solver.hasKnownDecomposition())
        self.family = str(self.solver.getKinematicFamily())


def _along(axes: np.ndarray, angle: float) -> np.ndarray:
    """Return unit vectors (6, 3) of which neighbours are parallel or at right angles if they nearly are."""
    result = axes.copy()
    for k in range(1, len(axes)):
        cosine = float(result[k] @ result[k - 1])
        across = result[k] - cosine * result[k - 1]
        sine = float(np.sqrt(across @ across))
        if sine <= angle:
            result[k] = np.sign(cosine) * result[k - 1]
        elif abs(cosine) <= angle:
            result[k] = across / sine
    return result


def _meeting(axes: np.ndarray, points: np.ndarray, length: float) -> np.ndarray:
    """Return points (7, 3) of axes (6, 3) and of the tip, where axes that nearly meet do: a wrist in one point."""
    result = points.copy()
    across = np.eye(3) - np.einsum("ki,kj->kij", axes[3:], axes[3:])
    total = across.sum(axis=0)
    is_wrist = False
    if np.linalg.det(total) > _UNLIKE:
        centre = np.linalg.solve(total, np.einsum("kij,kj->i", across, points[3:6]))
        shifts = np.einsum("kij,kj->ki", across, centre - points[3:6])
        is_wrist = bool(np.sqrt((shifts**2).sum(axis=1)).max() <= length)
        if is_wrist:
            result[3:6] = centre
    for k in range(3 if is_wrist else 5):
        normal = np.cross(axes[k], axes[k + 1])
        size = float(np.sqrt(normal @ normal))
        if size > _UNLIKE:
            gap = float(normal @ (result[k + 1] - result[k])) / size
            if abs(gap) <= length:
                # what comes behind moves along, and keeps its own meetings
                result[k + 1 : 6] -= gap * normal / size
    return result


def _distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the largest difference of poses (m, 4, 4), in metres and in the numbers of rotations (m,)."""
    error = np.abs(first - second)
    error[:, :3, 3] *= _M
    return error.max(axis=(1, 2), initial=0.0)


def _is_aimless(
    frames: np.ndarray, reached: np.ndarray, tips: np.ndarray, near: float
) -> np.ndarray:
    """Return in which frames (m, 7, 4, 4) a joint is arbitrary, so that the closed form chose a wrong one.

    Either the first and the last axis of the wrist are in line, or the position is that of the pose.
    """
    across = np.cross(frames[:, 4, :3, 2], frames[:, 6, :3, 2])
    in_line = (across**2).sum(axis=1) <= max(near, _IN_LINE) ** 2
    apart = _M * np.abs(reached[:, :3, 3] - tips[:, :3, 3]).max(axis=1, initial=0.0)
    return in_line | (apart <= near)


def _damped_step(jacobian: np.ndarray, rest: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Return steps (n, 6) of joints: the least squares of what is missing and of the damped step."""
    normal = np.einsum("nji,njk->nik", jacobian, jacobian)
    diagonal = np.arange(SIX)
    normal[:, diagonal, diagonal] += (damping + _REGULAR)[:, None]
    gradient = np.einsum("nji,nj->ni", jacobian, rest)
    return _capped(np.linalg.solve(normal, gradient[:, :, None])[:, :, 0])


def _capped(steps: np.ndarray) -> np.ndarray:
    """Return steps (n, 6) shortened to the longest that one iteration takes."""
    longest = np.abs(steps).max(axis=1, initial=0.0)
    return steps * (_LONGEST_STEP / np.maximum(longest, _LONGEST_STEP))[:, None]


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the largest difference of joints (n, 6), whole turns aside."""
    turned = np.abs(first - second)
    return np.abs(turned - _TURN * np.round(turned / _TURN)).max(axis=1, initial=0.0)


def firsts_in_order(q: np.ndarray, owner: np.ndarray, same: float) -> tuple[np.ndarray, np.ndarray]:
    """Return joints (m, k) and whose they are (m,), by owner and then by joints, without what repeats earlier ones.

    Joints of one owner repeat others if no angle differs by more than `same`, rad.
    """
    # noise in the last digits must not decide the order
    keys = np.round(q, 6)
    order = np.lexsort((*keys.T[::-1], owner))
    q = q[order]
    owner = owner[order]
    first = _firsts(q, owner, same)
    return q[first], owner[first]


def _firsts(q: np.ndarray, owner: np.ndarray, same: float) -> np.ndarray:
    """Return which joints (m, k), sorted by owner, are the first of all that differ by no more for a pose."""
    first = np.ones(len(q), dtype=bool)
    for step in range(1, int(np.bincount(owner).max(initial=0))):
        rows = np.flatnonzero(owner[step:] == owner[:-step])
        first[rows[_apart(q[rows + step], q[rows]) <= same] + step] = False
    return first


@cache
def needed(module: str) -> Any:
    """Return a module of the extra, or raise `RobotError` that says how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise RobotError(f"a cell needs the extra robot; {how_to_install('robot')}.") from None


def _snapped(numbers: np.ndarray) -> np.ndarray:
    """Return numbers without the noise of the file's digits: those about 0 and 1 are 0 and 1."""
    whole = np.round(numbers)
    return np.where(np.abs(numbers - whole) < _NOISE, whole, numbers)

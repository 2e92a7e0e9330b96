"""Candidate poses: drawn from the domains, then improved where the cover would profit.

Column generation (Gilmore & Gomory 1961): the linear relaxation of the cover over the columns found so far prices each
entity; a pose whose inspected entities are worth more than 1 together improves the cover. Such poses are looked for by
random perturbation of the best ones.
"""

from __future__ import annotations

import hashlib

import numpy as np

from planner.columns import ColumnPool, Judge
from planner.cover import fractional_cover
from planner.pose import look_at
from planner.sampling import ViewpointSampler

_AXES_PER_VIEWPOINT = 6
_PARENTS = 64
_CHILDREN = 24


def column_seed(seed: int, names) -> int:
    """Derive the seed of work on a set of names from the plan's seed and the set, whatever the order of the work."""
    text = "\x1f".join([str(seed), *sorted(names)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "big")


def entity_poses(judge: Judge, name: str, n_viewpoints: int, seed: int) -> np.ndarray:
    """Draw poses that look at an entity and at what else can be seen from there.

    Parameters
    ----------
    judge : Judge
    name : str
        The entity.
    n_viewpoints : int
        Viewpoints drawn uniformly from where the entity is observable and can be in focus.
    seed : int
        The plan's seed.

    Returns
    -------
    array (n, 4, 4)
        Poses; none if no such viewpoint was found.
    """
    rng = np.random.default_rng(column_seed(seed, [name]))
    own = judge.names.index(name)
    sampler = ViewpointSampler(judge.space.covering_cells([name]), judge.ends[own : own + 1], judge.camera)
    viewpoints = sampler.sample(n_viewpoints, rng)
    if not len(viewpoints):
        return np.zeros((0, 4, 4))
    viewpoints = np.repeat(viewpoints, _AXES_PER_VIEWPOINT, axis=0)
    return look_at(viewpoints, _targets(judge, viewpoints, own, rng), roll=rng.uniform(-np.pi, np.pi, len(viewpoints)))


def _targets(judge: Judge, viewpoints: np.ndarray, own: int, rng) -> np.ndarray:
    """Choose points to look at: the entity's middle, or the middle between it and another observable entity near it."""
    middles = judge.ends.mean(axis=1)
    observable = judge.space.observable(viewpoints, judge.names)
    width = 2 * judge.camera.focus_distance_mm * np.tan(judge.camera.half_diagonal_rad)
    near = np.linalg.norm(middles - middles[own], axis=1) < width
    weights = (observable & near) + 1e-12
    cumulative = np.cumsum(weights / weights.sum(axis=1, keepdims=True), axis=1)
    other = np.minimum((rng.random((len(viewpoints), 1)) > cumulative).sum(axis=1), len(middles) - 1)
    share = rng.uniform(0.0, 1.0, (len(viewpoints), 1))
    share[::_AXES_PER_VIEWPOINT] = 0.0
    return middles[own] + share * (middles[other] - middles[own])


def price_poses(judge: Judge, pool: ColumnPool, near: ColumnPool, seed: int, rounds: int, report=None) -> None:
    """Improve both pools by column generation until no better pose is found a few times in a row.

    Parameters
    ----------
    judge : Judge
    pool : ColumnPool
        Realised columns; changed in place.
    near : ColumnPool
        Optimistic columns; changed in place.
    seed : int
        The plan's seed.
    rounds : int
        Rounds at most.
    report : callable, optional
        Called with the number of rounds done.
    """
    covered = pool.membership.any(axis=0)
    if not covered.any():
        return
    rng = np.random.default_rng(column_seed(seed, ["pricing"]))
    value, idle = np.inf, 0
    for done in range(rounds):
        new_value, weights = fractional_cover(pool.membership[:, covered])
        prices = np.zeros(len(covered))
        prices[covered] = weights
        idle = idle + 1 if new_value > value - 1e-6 else 0
        value = new_value
        if idle >= 12 or value <= 1 + 1e-9:
            break
        _improve(judge, pool, near, prices, rng)
        if report is not None:
            report(done + 1)


def _improve(judge: Judge, pool: ColumnPool, near: ColumnPool, prices: np.ndarray, rng) -> None:
    parents = _choose_parents(pool, near, prices, rng)
    children = perturbed(np.repeat(parents, _CHILDREN, axis=0), judge.camera.focus_distance_mm, rng)
    judged = judge(children, worthwhile=lambda nearly: nearly @ prices > 1.0 - 0.05)
    pool.add(judged.inspects, children, judged.probability)
    near.add(judged.nearly, children, judged.probability)


def _choose_parents(pool: ColumnPool, near: ColumnPool, prices: np.ndarray, rng) -> np.ndarray:
    """Take the poses worth most, by what they inspect and by what they nearly inspect, and some at random."""
    third = _PARENTS // 3
    by_worth = pool.poses[np.argsort(-(pool.membership @ prices), kind="stable")[:third]]
    by_hope = near.poses[np.argsort(-(near.membership @ prices), kind="stable")[:third]]
    anyone = pool.poses[rng.integers(len(pool), size=third)]
    return np.concatenate([by_worth, by_hope, anyone])


def perturbed(cam2world: np.ndarray, distance_mm: float, rng) -> np.ndarray:
    """Perturb poses (n, 4, 4): swing about the point in focus, shift across the view and along it, turn, roll.

    Every pose draws its own scale, so that both far and fine changes are tried.
    """
    n = len(cam2world)
    scale = 10.0 ** rng.uniform(-2.3, 0.0, (n, 1))
    shift = rng.normal(size=(n, 3)) * scale * distance_mm * [0.3, 0.3, 0.2]
    pivot = cam2world[:, :3, 3] + distance_mm * cam2world[:, :3, 2]
    swing = rng.normal(size=(n, 2)) * scale * 0.6 * (rng.random((n, 1)) < 0.6)
    roll = np.where(rng.random(n) < 0.3, rng.uniform(-np.pi, np.pi, n), rng.normal(size=n) * scale[:, 0])
    # looking along z from the origin is the identity, so this is the turn in the camera's own axes
    local = look_at(np.zeros((n, 3)), [0.0, 0.0, 1.0], pan=swing[:, 0], tilt=swing[:, 1], roll=roll)
    moved = cam2world.copy()
    moved[:, :3, :3] = cam2world[:, :3, :3] @ local[:, :3, :3]
    moved[:, :3, 3] = pivot - distance_mm * moved[:, :3, 2]
    moved[:, :3, 3] += np.einsum("nij,nj->ni", moved[:, :3, :3], shift)
    return moved



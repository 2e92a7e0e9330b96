"""Candidate poses: drawn from the domains, then improved where the cover would profit.

Column generation (Gilmore & Gomory 1961): the linear relaxation of the cover over the columns found so far prices each
entity; a pose whose inspected entities are worth more than 1 together improves the cover. Such poses are looked for by
random perturbation of the best ones.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np

from planner.callbacks import NOBODY, Callbacks, Checkpoint
from planner.camera.pose import look_at
from planner.cover.few_columns import exchange_columns, fractional_cover
from planner.executors import Shared, in_order
from planner.request.reach import cells_of
from planner.search.first_poses import ViewpointSampler
from planner.search.judge import ColumnPool, Judge, Judgement, Steady, perturbed

# viewing directions for each drawn viewpoint. The first looks at the entity itself.
_AXES_PER_VIEWPOINT = 6
# A round starts from up to one and a half times this number of poses. A quarter of the number is
# drawn from the pool, and a quarter is the best of the pool by price. Up to half nearly inspect
# a set that would improve the cover. Up to half are the best of the round before.
_PARENTS = 64
# number of perturbations of every parent
_CHILDREN = 24
# Poses evaluated at a time, in every process, because the last digits depend on it
_BATCH = 768
# rounds between two checks of the relaxation
_ROUNDS_PER_CHECK = 10
# the search ends after this many checks with too little gain
_CHECKS = 5
# least sufficient gain, as a share of the relaxation's value
_LEAST_GAIN = 2e-3
# steps of the exchange search for a cover that would end the search
_LAST_EXCHANGES = 300
# at first, this many times as many directions look at the whole part as at an entity
_WHOLE = 16
# the search improves a pose for an entity only if it nearly inspects it to this degree (1:
# inspected)
_PROMISING = 0.3
# Price of an entity without a column. It exceeds the weight of a column, because a column of its
# own is worth a setting.
_UNCOVERED = 2.0


def derive_seed(seed: int, labels: Iterable[str]) -> int:
    """Derive the seed of a piece of work from the plan's seed and a set of labels, whatever the order of the work."""
    text = "\x1f".join([str(seed), *sorted(labels)])
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
    rng = np.random.default_rng(derive_seed(seed, [name]))
    witnesses = np.flatnonzero(judge.request.owner == judge.names.index(name)).tolist()
    # as many viewpoints altogether, whichever witness they look at
    each = -(-n_viewpoints // len(witnesses))
    poses = [_witness_poses(judge, own, each, rng) for own in witnesses]
    return np.concatenate(poses)


def _witness_poses(
    judge: Judge, own: int, n_viewpoints: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw poses that look at one witness, a column of the single request."""
    single = judge.single
    cells = cells_of(single.space, [single.names[own]])
    sampler = ViewpointSampler(cells, single.ends[own : own + 1], judge.camera)
    viewpoints = sampler.sample(n_viewpoints, rng)
    if not len(viewpoints):
        return np.zeros((0, 4, 4))
    viewpoints = np.repeat(viewpoints, _AXES_PER_VIEWPOINT, axis=0)
    return look_at(
        viewpoints,
        _targets(judge, viewpoints, own, rng),
        roll=rng.uniform(-np.pi, np.pi, len(viewpoints)),
    )


def first_poses(judge: Judge, n_directions: int, seed: int) -> np.ndarray:
    """Draw poses that look at the middle of every entity from the focus distance, and at the whole part, from anywhere.

    They take no regions to draw, so most of them see nothing; but they come at once.

    Parameters
    ----------
    judge : Judge
    n_directions : int
        Poses for every entity; as many times as many as `Pricing.whole` says for the part.
    seed : int
        The plan's seed.

    Returns
    -------
    array (n, 4, 4)
        Those in the workspace.
    """
    rng = np.random.default_rng(derive_seed(seed, ["first"]))
    low, high = np.asarray(judge.space.solid.bounds, dtype=float)
    radius = float(np.linalg.norm(high - low)) / 2
    (nearest, farthest) = judge.camera.depth_of_field_mm
    focus = judge.camera.focus_distance_mm
    # as close as all of the part is in focus, if it ever is
    whole = nearest + radius if nearest + 2 * radius <= farthest else focus
    targets = np.concatenate(
        [judge.ends.mean(axis=1), np.repeat([(low + high) / 2], _WHOLE, axis=0)]
    )
    distances = np.repeat(
        np.append(np.full(len(judge.ends), focus), np.full(_WHOLE, whole)), n_directions
    )
    targets = np.repeat(targets, n_directions, axis=0)
    away = rng.normal(size=targets.shape)
    positions = targets + (distances / np.linalg.norm(away, axis=1))[:, None] * away
    low, high = np.asarray(judge.space.workspace, dtype=float)
    inside = ((positions >= low) & (positions <= high)).all(axis=1)
    return look_at(
        positions[inside], targets[inside], roll=rng.uniform(-np.pi, np.pi, int(inside.sum()))
    )


def judged_poses(
    shared: Shared, name: str, n_viewpoints: int, seed: int
) -> tuple[np.ndarray, Judgement]:
    """Draw poses for an entity and judge them: `entity_poses` as a task; ``shared`` holds the judge."""
    poses = entity_poses(shared.value, name, n_viewpoints, seed)
    return poses, shared.value(poses)


def _judged(shared: Shared, poses: np.ndarray, prices: np.ndarray) -> Judgement:
    return shared.value(poses, prices)


def _targets(
    judge: Judge, viewpoints: np.ndarray, own: int, rng: np.random.Generator
) -> np.ndarray:
    """Choose points to look at: the entity's middle, or a point between it and the middle of another one near it."""
    middles = judge.single.ends.mean(axis=1)
    width = 2 * judge.camera.focus_distance_mm * np.tan(judge.camera.half_diagonal_rad)
    near = np.flatnonzero(np.linalg.norm(middles - middles[own], axis=1) < width)
    other = rng.choice(near, len(viewpoints))
    share = rng.uniform(0.0, 1.0, (len(viewpoints), 1))
    share[::_AXES_PER_VIEWPOINT] = 0.0
    return middles[own] + share * (middles[other] - middles[own])


class Pools(NamedTuple):
    """Columns found so far.

    Attributes
    ----------
    realised : ColumnPool
        What poses inspect.
    near : ColumnPool
        Optimistic columns: what they nearly inspect.
    """

    realised: ColumnPool
    near: ColumnPool

    def add(self, poses: np.ndarray, judged: Judgement, steady: Steady | None = None) -> None:
        """Add poses (n, 4, 4) as judged; what is not steady, see `ColumnPool.add`, only to the near columns."""
        self.realised.add(judged.inspects, poses, judged.probability, steady)
        self.near.add(judged.nearly, poses, judged.probability)

    def to_dict(self) -> dict[str, Any]:
        """Return the arrays, for `from_dict`."""
        return {"realised": self.realised.to_dict(), "near": self.near.to_dict()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Pools:
        """Build from the result of `to_dict`; other keys do not matter."""
        return cls(*(ColumnPool.from_dict(data[name]) for name in cls._fields))


class WarmStart(NamedTuple):
    """What column generation begins with.

    Attributes
    ----------
    seed_poses : array (m, 4, 4), optional
        Poses to breed from first; they join the pools.
    coverable : array of bool (k,), optional
        Targets that the cover may come to contain. The search also looks for those of them that no pose inspects yet.
        Default: the targets that are inspected at the beginning.
    """

    seed_poses: np.ndarray | None = None
    coverable: np.ndarray | None = None


def price_poses(
    shared: Shared,
    pools: Pools,
    seed: int,
    rounds: int,
    executor: Executor | None = None,
    callbacks: Callbacks = NOBODY,
    warm_start: WarmStart | None = None,
    checkpoint: Checkpoint | None = None,
) -> None:
    """Improve both pools by column generation.

    Parameters
    ----------
    shared : Shared of Judge
    pools : Pools
        Changed in place.
    seed : int
        The plan's seed.
    rounds : int
        Rounds at most; fewer if more are not worth it, or one column covers everything.
    executor : concurrent.futures.Executor, optional
        Judges poses; the result does not depend on it.
    callbacks : Callbacks
        Progress is reported to them.
    warm_start : WarmStart, optional
        Poses to begin with, and targets to look for.
    checkpoint : Checkpoint, optional
        Keeps after each round how far this has got. If it holds an entry, this goes on from there, with the pools of
        then.
    """
    parents, coverable = warm_start or WarmStart()
    breed = pools.realised.poses[:0] if parents is None else parents[:_PARENTS]
    if parents is not None:
        pools.add(parents, shared.value(parents), shared.value.steady)
    rng = np.random.default_rng(derive_seed(seed, ["pricing"]))
    covered = pools.realised.inspected
    values: list[float] = []
    first = 0
    prices = np.zeros(len(covered))
    checkpoint = checkpoint or Checkpoint()
    if (kept := checkpoint.get("pricing")) is not None:
        first, breed, values, prices, covered = (
            kept[k] for k in ("done", "breed", "values", "prices", "covered")
        )
        rng.bit_generator.state = kept["rng"]
    for done in range(first, rounds):
        if coverable is not None and (now := pools.realised.inspected).sum() > covered.sum():
            # a cover of more is another one: its relaxation is not compared with those before
            covered = now
            values = []
        missing = np.zeros(len(covered), dtype=bool)
        if coverable is not None:
            missing = coverable & ~covered
        membership = pools.realised.membership[:, covered]
        if not len(pools.near) or (
            not missing.any() and (not covered.any() or membership.all(axis=1).any())
        ):
            break
        if done % _ROUNDS_PER_CHECK == 0 and covered.any():
            values = [*values, fractional_cover(membership)[0]]
            if _is_settled(values, membership, rounds - done):
                break
        # the optimal prices are seldom unique: other ones every round keep the search from staring at one corner
        bias = 1.0 + 0.5 * rng.random(int(covered.sum()))
        guess = prices[covered] if done else None
        prices = np.zeros(len(covered))
        prices[covered] = fractional_cover(membership, bias, guess)[1]
        prices[missing] = _UNCOVERED
        breed = _improve(shared, pools, breed, prices, rng, executor)
        so_far = {
            "done": done + 1,
            "breed": breed,
            "values": values,
            "prices": prices,
            "covered": covered,
        }
        checkpoint.put("pricing", {**so_far, "rng": rng.bit_generator.state})
        callbacks.report(done + 1, rounds, "column generation")
    callbacks.report(rounds, rounds, "column generation")


def _is_settled(values: list[float], membership: np.ndarray, left: int) -> bool:
    """Tell whether more columns are not worth it: the relaxation's value no longer falls, or too slowly.

    Too slowly means that, with the gain of late, it would not get to the next whole number in the rounds that are left,
    and a cover of as few columns as the value allows is there already.
    """
    if len(values) <= _CHECKS:
        return False
    gain = values[-1 - _CHECKS] - values[-1]
    if gain <= _LEAST_GAIN * values[-1]:
        return True
    fewest = int(np.ceil(values[-1] - 1e-6))
    hopeless = values[-1] - gain * left / (_CHECKS * _ROUNDS_PER_CHECK) > fewest - 1
    return hopeless and not exchange_columns(membership, fewest, steps=_LAST_EXCHANGES).missing


def _improve(
    shared: Shared,
    pools: Pools,
    breed: Any,
    prices: np.ndarray,
    rng: np.random.Generator,
    executor: Executor | None,
) -> np.ndarray:
    """Breed from the most promising poses; return the next parents."""
    pool, near = pools
    at_random = pool.poses[rng.integers(len(pool), size=_PARENTS // 4)] if len(pool) else pool.poses
    worthy = pool.poses[np.argsort(-(pool.membership @ prices), kind="stable")[: _PARENTS // 4]]
    # what is nearly inspected and worth more than 1 would improve the cover if only the pose were put right
    rows = np.flatnonzero(near.membership @ prices > 1.0)
    hopeful = near.poses[rows[rng.permutation(len(rows))[: _PARENTS // 2]]]
    parents = np.concatenate([breed, at_random, worthy, hopeful])
    children = perturbed(
        np.repeat(parents, _CHILDREN, axis=0), shared.value.camera.focus_distance_mm, rng
    )
    # batches of one size, whoever judges them: the last digits must not depend on the executor
    batches = [(shared, children[i : i + _BATCH], prices) for i in range(0, len(children), _BATCH)]
    judged = Judgement.joined(list(in_order(executor, _judged, batches)))
    pools.add(children, judged, shared.value.steady)
    return children[_champions(judged.promise, prices, rng)]


def _champions(promise: np.ndarray, prices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Choose poses of much promised worth, each for another entity, so that the search stays spread over the part."""
    worth = promise @ prices
    entities = rng.permutation(np.flatnonzero(prices > 0))[: _PARENTS // 2]
    best = [int(np.argmax(np.where(promise[:, e] > _PROMISING, worth, -1.0))) for e in entities]
    return np.unique(best)

"""A proven lower bound on the number of sensor settings, by subdividing the space of poses.

Notation
--------
node       a box of positions (centre c, half sizes h) times a patch of viewing directions times an interval of rolls
S(node)    its optimistic set: every entity that *may* be inspected by *some* pose of the node; where S contains two
           entities that exclude each other (`planner.bound.node_sets`), the node is split into two with the same
           poses, one without the first entity, one without all that it excludes
y          weights of the entities, y >= 0

Every pose lies in some leaf of the subdivision, so what it inspects is part of that leaf's S, and no plan has fewer
settings than a cover by leaves' sets has columns. What a clique of entities that exclude each other proves
(`planner.bound.lower_bound`) is known at once. For each larger number of settings, the leaves of a cover by fewer are
split, some rounds long: quick where pairs that exclude each other decide. If nothing in any leaf's S weighs more than
1, at least sum(y) settings are needed (linear programming duality), and only leaves of weight at least 1 - (K - sum(y))
can be in a cover of K columns (reduced-cost fixing). Where this gets no further, weights alone go on: those of the
columns that are known to be realisable, all leaves that weigh too much being split; of entities that exclude each other
at a leaf's poses only one counts. In the end, boxes about the point looked at take over (`planner.bound.dual_bound`),
which are searched depth first and need no memory; what is visible together from where is found beforehand
(`planner.bound.boxes.viewpoint_tree`).

S(node) uses necessary conditions only: visibility (the box meets a cell of the entity's region), distance and depth
(focus), the rectangle of the sensor, the resolution, and the length of image without which quantization alone keeps
the probability below the threshold (`planner.bound.pose_space`). All slack that a node's size causes is added. So the
bound holds for any search.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.bound.boxes.view import Cells, entity_cells
from planner.bound.dual_bound import LinearBound
from planner.bound.node_sets import find_conflicts
from planner.bound.pose_space import PoseSpace, WitnessSets
from planner.bound.pose_tree import PoseTree, TargetLeaves
from planner.callbacks import NOBODY, Callbacks, Checkpoint
from planner.cover.few_columns import fractional_cover
from planner.cover.set_cover import cover_within, distinct_rows, maximal_columns
from planner.effort import Effort
from planner.executors import Shared, in_order
from planner.request.request import Request

# largest number of nodes with boxes of positions. Proofs from pairs that exclude each other need
# few.
_TREE_NODES = 32_000
# the tree does not split nodes smaller than this angle, seen from the camera
_FINEST_RAD = 2e-3
# largest number of nodes split between two checks of whether they suffice
_BATCH = 6000
# largest number of sets of an integer cover. With more, it proves nothing.
_COVER_COLUMNS = 4000
# largest number of branch-and-bound nodes of one integer cover
_COVER_NODES = 2000
# for each number of settings, each of this many first rounds has an integer cover
_COVER_ROUNDS = 20
# after that, one round in this many has one
_ROUNDS_PER_COVER = 10
# largest number of linear programs. Then all weights are divided by that of the heaviest leaf.
_DUAL_ROUNDS = 60
# A leaf may weigh this much more than 1
_TOLERANCE = 1e-7
# leaves checked in a round, those that weigh most
_VIOLATED = 2000
# constraints added in a round
_ADDED = 150
# keep only constraints of leaves that weigh more than this for the next time
_KEPT_WEIGHT = 0.5

# Entities of which no two can be inspected together: a bound without any search.


# greedy cliques from every entity, this many times
_ROUNDS = 5
# the first time by degree, then with so much chance in it
_CHANCE = 1.5


def large_clique(conflict: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return entities that exclude each other pairwise, as many as a greedy search finds.

    No setting inspects two of them, so each needs one of its own.

    Parameters
    ----------
    conflict : array of bool (e, e)
        Symmetric, false on the diagonal.

    Returns
    -------
    array of int, ascending
    """
    conflict = np.asarray(conflict, dtype=bool)
    rng = np.random.default_rng(0)
    best = np.zeros(0, dtype=int)
    for trial in range(_ROUNDS * len(conflict)):
        clique = [trial % len(conflict)]
        left = np.flatnonzero(conflict[trial % len(conflict)])
        while len(left) and len(clique) + len(left) > len(best):
            # the one that leaves most to choose from
            leaves = conflict[np.ix_(left, left)].sum(axis=1) + _CHANCE * rng.random(len(left)) * (
                trial >= len(conflict)
            )
            chosen = left[np.argmax(leaves)]
            clique.append(int(chosen))
            left = left[conflict[chosen, left]]
        if len(clique) > len(best):
            best = np.sort(clique)
    return best


# of what is told while the tree of poses grows
_GROWING = "growing"
# for rounding sums of weights
_SLACK = 1e-6


def lower_bound(
    request: Request,
    n_settings: int,
    columns: NDArray[np.bool_],
    *,
    effort: Effort,
    improve: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None,
    checkpoint: Checkpoint | None = None,
    executor: Executor | None = None,
    callbacks: Callbacks = NOBODY,
) -> tuple[int, str, NDArray[np.float64] | None]:
    """Prove how many settings are needed at least.

    Parameters
    ----------
    request : Request
        The request for the entities to be covered: visibility, camera and constraints.
    n_settings : int
        Size of the cover that is known; the proof stops when it gets there.
    columns : array of bool (c, e)
        Columns known to be realisable; they start the weights.
    effort : Effort
        Boxes of poses, at most, and how they are searched.
    improve : callable, optional
        Gets poses worth knowing, see `planner.bound.dual_bound.LinearBound`.
    checkpoint : Checkpoint, optional
        Keeps how far the proof has got. The proof goes on from its entries, if it has some for the same arguments, and
        proves the same.
    executor : concurrent.futures.Executor, optional
        Computes the cells of entities' regions.
    callbacks : Callbacks
        Progress, and every number of settings that is proven, are reported to them.

    Returns
    -------
    bound : int
        No plan for these entities has fewer settings.
    proof : str
        What it rests on, in one sentence.
    weights : array (e,) or None
        Weights of the entities of which no pose inspects more than 1 together, where such weights prove it.
    """
    if n_settings <= 1:
        one = "Fewer settings than one inspect nothing."
        return n_settings, one if n_settings else "No entity is inspected.", None
    checkpoint = checkpoint or Checkpoint()
    witnesses = WitnessSets.of(request)
    single = request.single
    entity_idx = np.arange(len(single.names))
    regions = _regions(single, entity_idx, executor)
    first = checkpoint.get("covers")
    if first is None:
        grown = checkpoint.get(_GROWING)
        conflict = (
            find_conflicts(single, entity_idx, witnesses.of_columns(columns), regions)
            if grown is None
            else grown["conflict"]
        )
        tree = PoseTree(single, entity_idx, regions, conflict, witnesses.one_each(conflict))
        # a pair excludes each other for a reason of its own; so do the pairs of a clique
        alone = max(1, len(large_clique(witnesses.targets_apart(conflict))))
        callbacks.bound(min(alone, n_settings))
        growing = _Growing(checkpoint, conflict)
        leaves = TargetLeaves(tree, witnesses)
        boxes = effort.boxes_for(columns.shape[1])
        proven, weights = _by_covers(
            leaves, columns, (alone, n_settings), growing, boxes, callbacks
        )
        first = {"conflict": conflict, "weights": weights, "bound": proven}
        first |= {"made": tree.made, "alone": alone}
    checkpoint.put("covers", first)
    checkpoint.put(_GROWING, None)
    callbacks.bound(first["bound"], first["weights"])
    conflict = witnesses.one_each(first["conflict"])
    space = PoseSpace(single, entity_idx, regions, conflict, witnesses)
    linear = LinearBound(space, columns, improve, checkpoint, callbacks)
    boxes = effort.boxes_for(len(request.names))
    bound = linear.raise_from(first["bound"], n_settings, max_nodes=max(0, boxes - first["made"]))
    callbacks.report(boxes, boxes, "lower bound")
    if bound <= first["alone"]:
        return bound, exclusion_proof(request, bound), None
    apart = int(witnesses.targets_apart(first["conflict"]).sum()) // 2
    weights = first["weights"] if bound == first["bound"] else linear.weights
    return bound, _proof(first["made"] + linear.made, apart, _items(request)), weights


def exclusive_entities(
    request: Request,
    entity_idx: NDArray[np.int_],
    columns: NDArray[np.bool_],
    executor: Executor | None = None,
) -> NDArray[np.int_]:
    """Find entities of which no two can be inspected together: a bound that takes seconds.

    Parameters
    ----------
    request : Request
        The request.
    entity_idx : array of int (e,)
        Entities among which they are looked for, as columns of the request.
    columns : array of bool (c, e)
        Columns known to be realisable: their pairs are not asked about.
    executor : concurrent.futures.Executor, optional
        Computes the cells of entities' regions.

    Returns
    -------
    array of int (n,)
        Columns of the request, ascending. Whatever inspects all of them needs n settings; `exclusion_proof` says why.
    """
    some = request.restricted_to([request.names[i] for i in entity_idx])
    witnesses = WitnessSets.of(some)
    single = some.single
    every = np.arange(len(single.names))
    regions = _regions(single, every, executor)
    known = witnesses.of_columns(columns)
    conflict = find_conflicts(single, every, known, regions)
    return entity_idx[large_clique(witnesses.targets_apart(conflict))]


def exclusion_proof(request: Request, n: int) -> str:
    """Say what a bound of so many entities that exclude each other rests on."""
    return _proof_of_clique(n, _items(request))


def _regions(request: Request, entity_idx: NDArray[np.int_], executor: Executor | None) -> Cells:
    """Return the cells of entities' regions."""
    shared = Shared(request)
    return Cells.joined(
        in_order(executor, entity_cells, [(shared, request.names[i]) for i in entity_idx])
    )


def _items(request: Request) -> str:
    edges = all(target.in_image for target in request.targets)
    return "edges" if edges else "items"


def _by_covers(
    tree: TargetLeaves,
    columns: NDArray[np.bool_],
    between: tuple[int, int],
    growing: _Growing,
    max_nodes: int,
    callbacks: Callbacks,
) -> tuple[int, NDArray[np.float64] | None]:
    """Return how many settings covers by leaves' sets prove; the tree is grown as far as they need it.

    ``between`` is the bound that is proven already, and the one that is aimed at in the end. Returned are also weights
    that prove it, if there are some: what a search of covers proves, weights may not.
    """
    weights = _Weights(np.asarray(columns, dtype=bool))
    known, n_settings = between
    guide = fractional_cover(columns)[1]
    target, rounds = growing.resume(tree, weights) or (known + 1, 0)
    while target <= n_settings and tree.made < min(_TREE_NODES, max_nodes):
        growing.tell(tree, weights, target, rounds)
        rounds += 1
        sets_first = rounds <= _COVER_ROUNDS or rounds % _ROUNDS_PER_COVER == 0
        y = weights.solve(tree.sets) if sets_first else guide
        find = _to_split if sets_first else _above
        heavy = find(tree, y, target)
        if heavy is None:
            weights.proving = _proving(y, target, sets_first)
            callbacks.bound(target, weights.proving)
            target = target + 1
            rounds = 0
            continue
        if not heavy.size:
            break
        tree.split(heavy, sets_first)
        callbacks.report(min(tree.made, max_nodes), max_nodes, "lower bound")
    return min(target - 1, n_settings), weights.proving


def _proving(y: NDArray[np.float64], target: int, sets_first: bool) -> NDArray[np.float64] | None:
    """Return weights of which no leaf has more than 1, if it was weights that proved so many settings."""
    if not sets_first:
        return y / _limit(y, target)
    return y if float(y.sum()) > target - 1 + _SLACK else None


def _limit(y: NDArray[np.float64], target: int) -> float:
    """Return what no leaf may weigh for weights to prove so many settings."""
    return float(y.sum()) / (target - 1) - _SLACK


class _Growing:
    """Tells how far covers by leaves' sets have got, and goes on from there another time.

    Parameters
    ----------
    checkpoint : Checkpoint
    conflict : array of bool (e, e)
        Pairs that exclude each other: they take long to find, too.
    """

    def __init__(self, checkpoint: Checkpoint, conflict: NDArray[np.bool_]):
        self._checkpoint = checkpoint
        self._conflict = conflict

    def tell(self, tree: TargetLeaves, weights: _Weights, target: int, rounds: int) -> None:
        """Tell where a round begins."""
        rest = {"tree": tree.to_dict(), "rows": weights.rows, "target": target, "rounds": rounds}
        kept = {"conflict": self._conflict, "proving": weights.proving}
        self._checkpoint.put(_GROWING, {**kept, **rest})

    def resume(self, tree: TargetLeaves, weights: _Weights) -> tuple[int, int] | None:
        """Return the number of settings aimed at, and the rounds done, if this was told before."""
        grown = self._checkpoint.get(_GROWING)
        if grown is None:
            return None
        tree.regrow(grown["tree"])
        weights.rows = grown["rows"]
        weights.proving = grown["proving"]
        return grown["target"], grown["rounds"]


def _proof_of_clique(n: int, what: str) -> str:
    """Say what a bound rests on that needs no search."""
    if n == 1:
        return "Fewer settings than one inspect nothing."
    return (
        f"Of {n} {what} no two can be inspected together, as no viewpoint meets the necessary conditions (visibility, "
        "focus, sensor size, length of the image) for both, so each needs a setting of its own."
    )


def _proof(boxes: int, pairs: int, what: str = "edges") -> str:
    """Say what a bound rests on."""
    checked = "1 box of camera poses was" if boxes == 1 else f"{boxes} boxes of camera poses were"
    excluded = f"1 pair of {what} was" if pairs == 1 else f"{pairs or 'no'} pairs of {what} were"
    return (
        f"Covering by optimistic columns: {checked} checked against necessary conditions (visibility, focus, sensor "
        f"size, length of the image), and {excluded} found to exclude each other."
    )


def _to_split(tree: TargetLeaves, y: NDArray[np.float64], target: int) -> NDArray[np.int_] | None:
    """Choose the nodes to split to prove ``target``; none if nothing is left to split, None if it is proven."""
    weight = tree.sets @ y
    splittable = tree.size > _FINEST_RAD
    # what a cover with fewer settings may waste
    spare = target - 1 - float(y.sum())
    if spare < -_SLACK:
        return None
    usable = np.flatnonzero(weight >= 1.0 - spare - _SLACK)
    first, of_distinct = distinct_rows(tree.sets[usable])
    distinct = tree.sets[usable[first]]
    heaviest = np.argsort(-(distinct @ y), kind="stable")[: 4 * _COVER_COLUMNS]
    kept = heaviest[maximal_columns(distinct[heaviest])][:_COVER_COLUMNS]
    exhaustive = len(distinct) <= 4 * _COVER_COLUMNS and len(kept) < _COVER_COLUMNS
    if not distinct[kept].any(axis=0).all():
        return None if exhaustive else _heaviest(usable[splittable[usable]], weight)
    chosen, decided = cover_within(distinct[kept], target - 1, node_limit=_COVER_NODES)
    if exhaustive and chosen is None and decided:
        return None
    if chosen is None:
        return _heaviest(usable[splittable[usable]], weight)
    nodes = usable[np.isin(of_distinct, kept[chosen])]
    return nodes[splittable[nodes]][:_BATCH]


def _above(tree: TargetLeaves, y: NDArray[np.float64], target: int) -> NDArray[np.int_] | None:
    """Choose the nodes that weigh too much for the weights to prove ``target``, the heaviest first; None if none do."""
    limit = _limit(y, target)
    nodes = np.flatnonzero(tree.sets @ y > limit)
    weight = tree.weights(nodes, y)
    nodes = nodes[weight > limit]
    weight = weight[weight > limit]
    if not nodes.size:
        return None
    fine = tree.size[nodes] > _FINEST_RAD
    return nodes[fine][np.argsort(-weight[fine], kind="stable")[:_BATCH]]


def _heaviest(nodes: NDArray[np.int_], weight: NDArray[np.float64]) -> NDArray[np.int_]:
    return nodes[np.argsort(-weight[nodes], kind="stable")[:_BATCH]]


class _Weights:
    """The dual of the fractional cover over all leaves, by constraint generation."""

    def __init__(self, columns: NDArray[np.bool_]):
        self._columns = columns[distinct_rows(columns)[0]]
        self.rows = self._columns[:0]
        # those that prove the present bound, if it is weights that prove it
        self.proving: NDArray[np.float64] | None = None

    def solve(self, sets: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the weights y (e,) of largest sum such that no leaf and no known column weighs more than 1."""
        self._forget(sets)
        for _ in range(_DUAL_ROUNDS):
            y = self._solve()
            weight = sets @ y
            violated = np.flatnonzero(weight > 1.0 + _TOLERANCE)
            if not violated.size:
                break
            worst = violated[np.argsort(-weight[violated], kind="stable")[:_VIOLATED]]
            new = sets[worst[distinct_rows(sets[worst])[0]]]
            new = new[np.argsort(-(new @ y), kind="stable")[:_ADDED]]
            self.rows = np.concatenate([self.rows, new])
        self.rows = self.rows[self.rows @ y > _KEPT_WEIGHT]
        return y / max(1.0, float((sets @ y).max(initial=0.0)))

    def _solve(self) -> NDArray[np.float64]:
        rows = np.concatenate([self._columns, self.rows])
        result = linprog(
            -np.ones(rows.shape[1]),
            A_ub=csr_matrix(rows.astype(float)),
            b_ub=np.ones(len(rows)),
            bounds=(0.0, 1.0),
        )
        return np.clip(result.x, 0.0, None)

    def _forget(self, sets: NDArray[np.bool_]) -> None:
        """Drop the sets of leaves that have been split since: they would hold the weights down for ever."""
        if len(self.rows):
            present = {row.tobytes() for row in np.packbits(sets, axis=1)}
            self.rows = self.rows[
                [row.tobytes() in present for row in np.packbits(self.rows, axis=1)]
            ]

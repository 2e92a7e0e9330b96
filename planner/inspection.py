"""The whole inspection: as few sensor settings as possible, every entity measured with the required probability.

The way
-------
1. Candidate poses are drawn from the domains and improved (`planner.columns.candidates`). Each gives a column: what it
   inspects; and an optimistic one: what it nearly inspects.
2. A lower bound is proven (`planner.bound.lower_bound`). On the way it meets poses that inspect more than the
   candidates do; they join them.
3. Sets of entities that would save a setting, and that some pose nearly inspects, are chosen
   (`planner.cover.few_columns`). The genetic algorithm tries to realise them; one that misses is refuted, with
   everything that contains it, and replaced by the largest part it reached. Choose again, until none is left or enough
   were tried.
4. Every chosen column gets its own run of the genetic algorithm, for the best probabilities.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from planner.bound.lower_bound import lower_bound
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.columns.candidates import Pools, column_seed, judged_poses, price_poses
from planner.columns.judge import Judge
from planner.columns.pool import ColumnPool
from planner.columns.realise_column import best_supported, realise, reason_for, without_contradicted
from planner.cover.few_columns import few_columns, sets_to_realise
from planner.exceptions import RequestError
from planner.executors import Shared, in_order
from planner.ledger import Ledger
from planner.plan import InspectionPlan
from planner.progress import labelled, report
from planner.request.constraints import Requirements
from planner.request.defaults import check_fraction, check_seed, corner_margin_px, default_workspace, position_margin_mm
from planner.request.effort import Effort
from planner.request.reach import reach_name
from planner.resume import PlanningState
from planner.travel import travel_order

# rounds of column generation from poses that the proof of the lower bound has come across; more while columns are few
_JOINED_ROUNDS, _JOINED_ROUNDS_MOST, _JOINED_COLUMNS = 5, 25, 20_000
# of `Effort.cover_nodes`, for each cover while optimistic columns are tried
_REFUTING_SHARE = 0.1


def plan_inspection(
    solid,
    entities,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    probability: float = 0.9,
    rng: int | np.random.Generator = 0,
    workspace=None,
    stand_off_mm: float = 50.0,
    min_length_px: float = 20.0,
    field_margin_px: float | None = None,
    visibility_radius_mm: float | None = None,
    reach=None,
    space=None,
    effort: Effort | None = None,
    state=None,
    executor=None,
    progress=None,
) -> InspectionPlan:
    """Plan the inspection of entities of a part.

    **Guarantee.** Every entity is inspected by some setting with at least ``probability`` and all constraints met, or
    is listed as uninspectable with the reason. The number of settings is at least ``lower_bound``, which is proven. The
    plan depends on the request and the seed, not on the executor or on interruptions.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping
        Name to edge id or to two end points.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    accuracy : float
        Required accuracy A in (0, 1).
    probability : float
        Required probability of it, in (0, 1).
    rng : int or numpy.random.Generator
        Seed; a generator is asked for one.
    workspace : array_like (2, 3), optional
        Opposite corners of the box the camera may be in, mm. Default: as far around the part as the lens focuses.
    stand_off_mm, min_length_px : float
        Constraints, see `plan_setting`.
    field_margin_px : float, optional
        Strip along the sensor's sides to keep free. Default: four standard deviations of how far the pose uncertainty
        moves an image point, in the corner where that is farthest, at most a quarter of the smaller side.
    visibility_radius_mm : float, optional
        As in `plan_setting`.
    reach : Region or callable, optional
        As in `plan_setting`.
    space : VisibilityRegions or EntityAspectGraph, optional
        Visibility computed before, for these entities and this workspace.
    effort : Effort, optional
        How long to search.
    state : path, optional
        File to resume from, if it exists, and to keep results in while planning. It stays when the plan is done, and
        the same call then returns the plan at once: delete it when the plan is written. If it can no longer be saved,
        a warning says so and the planning goes on.
    executor : concurrent.futures.Executor, optional
        Runs the per-entity and per-column work.
    progress : callable, optional
        ``progress(done, total, label)``; an exception it raises cancels the work.

    Returns
    -------
    InspectionPlan
        Settings, bound and what cannot be inspected.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    PlanFileError
        If the state file belongs to another request, or another version of the program.
    OutputError
        If the state file cannot be written.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Camera, Effort, PoseUncertainty, plan_inspection
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> rims = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> effort = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)
    >>> plan = plan_inspection(block, rims, camera, uncertainty, accuracy=0.95, effort=effort)
    >>> plan.complete, len(plan.settings), plan.lower_bound
    (True, 1, 1)
    """
    check_fraction("accuracy", accuracy)
    check_fraction("probability", probability)
    seed = check_seed(rng)
    if not entities:
        raise RequestError("entities must hold at least one entity. Got none.")
    if space is None:
        from aspectgraph import compute_regions

        box = default_workspace(solid, camera) if workspace is None else workspace
        space = compute_regions(
            solid, entities, workspace=box, executor=executor, progress=labelled(progress, "visible regions")
        )
    if field_margin_px is None:
        field_margin_px = corner_margin_px(camera, pose_uncertainty)
    if visibility_radius_mm is None:
        visibility_radius_mm = position_margin_mm(pose_uncertainty)
    requirements = Requirements(min_length_px, field_margin_px, "exact", stand_off_mm, reach, visibility_radius_mm)
    judge = Judge(space, space.entity_names, camera, pose_uncertainty, accuracy, probability, requirements)
    effort = effort or Effort()
    memo = PlanningState(_request(judge, pose_uncertainty, seed, effort), state)
    if memo.plan is not None:
        return memo.plan
    try:
        memo.finish(_Work(judge, pose_uncertainty, seed, memo, effort, executor, progress).plan())
    finally:
        memo.save()
    return memo.plan


def _request(judge: Judge, pose_uncertainty: PoseUncertainty, seed: int, effort: Effort) -> dict:
    """Return what the plan depends on."""
    need = judge.requirements
    return {
        "vertices": np.round(judge.space.solid.vertices, 6).tolist(),
        "entities": {name: ends.tolist() for name, ends in zip(judge.names, judge.ends, strict=True)},
        "workspace": np.asarray(judge.space.workspace, dtype=float).tolist(),
        "camera": judge.camera.to_dict(),
        "pose_uncertainty": pose_uncertainty.to_dict(),
        "limits": [
            judge.accuracy,
            judge.threshold,
            need.min_length_px,
            need.field_margin_px,
            need.stand_off_mm,
            need.visibility_radius_mm,
        ],
        "reach": reach_name(need.reach),
        "seed": seed,
        "effort": asdict(effort),
    }


class _Work:
    """One planning run: the pools of columns, and the steps that fill them."""

    def __init__(self, judge, pose_uncertainty, seed, memo, effort, executor, progress):
        self.judge, self.shared = judge, Shared(judge)
        self.pose_uncertainty, self.seed, self.memo = pose_uncertainty, seed, memo
        self.effort, self.executor, self.progress = effort, executor, progress
        self.names = judge.names
        self.pools = Pools(ColumnPool(len(self.names)), ColumnPool(len(self.names)))
        self.uninspectable: dict[str, str] = {}
        self.refuted, self.runs = np.zeros((0, len(self.names)), dtype=bool), 0

    @property
    def pool(self) -> ColumnPool:
        """Columns that poses inspect."""
        return self.pools.realised

    def plan(self) -> InspectionPlan:
        """Do all steps."""
        self._find_columns()
        bound, proof = self._bound()
        inspected = self.pool.membership.any(axis=0)
        self._refute(inspected, bound)
        settings = self._settle(inspected)
        # a later run may have come across a view of one that had none of its own
        seen = set().union(*(setting.entities for setting in settings))
        uninspectable = {name: reason for name, reason in self.uninspectable.items() if name not in seen}
        order = travel_order(np.array([s.cam2world for s in settings]).reshape(-1, 4, 4))
        return InspectionPlan(
            settings=tuple(settings[i] for i in order),
            lower_bound=bound,
            bound_proof=proof,
            uninspectable=uninspectable,
            entities=dict(zip(self.names, self.judge.ends, strict=True)),
            camera=self.judge.camera,
            pose_uncertainty=self.pose_uncertainty,
            accuracy=self.judge.accuracy,
            probability=self.judge.threshold,
            workspace=np.asarray(self.judge.space.workspace, dtype=float),
            part=self.judge.space.solid.name,
            seed=self.seed,
        )

    def _keep(self, step: str, values: dict) -> None:
        """Take a checkpoint: all that the steps from here on depend on."""
        self.memo.keep(step, {"pools": self.pools.to_dict(), "uninspectable": dict(self.uninspectable), **values})

    def _find_columns(self) -> None:
        """Fill the pools, or go on from the checkpoint."""
        last = self.memo.last()
        if last is None:
            self._sample()
            self._keep("candidate poses", {})
        else:
            self.pools, self.uninspectable = Pools.from_dict(last["pools"]), last["uninspectable"]
        if last is None or last["step"] == "candidate poses":
            # before the columns are improved, so that others can join what is hard to inspect
            self.uninspectable = self._try_alone()
        if last is None or last["step"] != "lower bound":
            self._price(last)

    def _sample(self) -> None:
        """Fill the pools from viewpoints of every entity."""
        arguments = [(self.shared, name, self.effort.viewpoints, self.seed) for name in self.names]
        for k, (poses, judged) in enumerate(in_order(self.executor, judged_poses, arguments)):
            self.pools.add(poses, judged)
            report(self.progress, k + 1, len(self.names), "candidate poses")

    def _price(self, last: dict | None) -> None:
        """Improve the pools by column generation."""
        step = "column generation"
        ledger = Ledger(kept=_entries(last, step), keep=lambda told: self._keep(step, {"entries": told}))
        rounds = self.effort.pricing_rounds
        price_poses(self.shared, self.pools, self.seed, rounds, self.executor, self.progress, ledger=ledger)

    def _try_alone(self) -> dict[str, str]:
        """Give entities that no pose inspects a run of their own; return the reasons of those that fail."""
        missing = [name for i, name in enumerate(self.names) if not self.pool.membership[:, i].any()]
        reasons = {}
        for name, outcome in zip(missing, self._realise([(name,) for name in missing]), strict=True):
            if name not in self._accept(outcome):
                reasons[name] = reason_for(outcome, self.judge.threshold)
        return reasons

    def _refute(self, inspected: np.ndarray, bound: int) -> None:
        """Try to do with fewer settings, not below the bound, by optimistic columns; refute what cannot be realised."""
        left, enough, rng = self.effort.refutations, None, self._rng("refutation")
        nodes = self._nodes(_REFUTING_SHARE)
        while left > 0 and inspected.any():
            realised = self.pool.membership[:, inspected]
            if enough is None:
                enough = len(few_columns(realised, nodes, rng))
            if enough <= max(bound, 1):
                return
            near, refuted = self.pools.near.membership[:, inspected], self.refuted[:, inspected]
            sets = sets_to_realise(realised, near, refuted, enough, nodes, rng)[:left]
            if not sets:
                return
            left -= len(sets)
            wanted = [tuple(np.array(self.names)[inspected][one].tolist()) for one in sets]
            for names, outcome in zip(wanted, self._realise(wanted), strict=True):
                reached = self._accept(outcome)
                enough = None if reached else enough
                if set(names) - set(reached):
                    self.refuted = np.vstack([self.refuted, np.isin(self.names, names)])

    def _nodes(self, share: float = 1.0) -> int:
        return int(share * self.effort.cover_nodes)

    def _rng(self, purpose: str) -> np.random.Generator:
        return np.random.default_rng(column_seed(self.seed, [purpose]))

    def _settle(self, inspected: np.ndarray) -> list:
        """Choose the final cover and give every column in it the best pose that simulation supports."""
        chosen = few_columns(
            self.pool.membership[:, inspected], self._nodes(), self._rng("settings"), self.pool.quality
        )
        sets = [tuple(np.array(self.names)[self.pool.membership[c]].tolist()) for c in chosen]
        settings = []
        for c, names, outcome in zip(chosen, sets, self._realise(sets), strict=True):
            seed = column_seed(self.seed, names)
            options = [self.judge.setting(self.pool.poses[c], names, "candidate pose", seed=seed)]
            if not isinstance(outcome, str) and self._holds(outcome, names):
                options.insert(outcome.fitness < options[0].fitness - 1e-6, outcome)
            settings.append(best_supported(self.judge, self.pose_uncertainty, options, seed))
        return without_contradicted(self.judge, self.pose_uncertainty, settings, self.seed)

    def _holds(self, setting, names) -> bool:
        """Judge a setting anew: whether it inspects all these entities."""
        return bool(self.judge(setting.cam2world[None]).inspects[0, np.isin(self.names, names)].all())

    def _accept(self, outcome) -> tuple[str, ...]:
        """Add what a run achieved to the pool; return the entities it inspects."""
        if isinstance(outcome, str):
            return ()
        pose = outcome.cam2world[None]
        judged = self.judge(pose)
        self.pool.add(judged.inspects, pose, judged.probability)
        return tuple(np.array(self.names)[judged.inspects[0]].tolist())

    def _realise(self, sets: list[tuple[str, ...]]) -> list:
        """Run the genetic algorithm for sets of entities not tried before; return all outcomes in order."""
        todo = [names for names in dict.fromkeys(sets) if self.memo.get(names) is None]
        done, self.runs = self.runs, self.runs + len(todo)
        arguments = [
            (self.shared, self.pose_uncertainty, names, column_seed(self.seed, names), self._start(names))
            for names in todo
        ]
        for names, outcome in zip(todo, in_order(self.executor, realise, arguments), strict=True):
            self.memo.put(names, outcome)
            done += 1
            report(self.progress, done, self.runs, "genetic algorithm")
        return [self.memo.get(names) for names in sets]

    def _start(self, names) -> np.ndarray | None:
        """Return the candidate pose (1, 4, 4) that inspects, or nearly inspects, a set of entities."""
        for pool in self.pools:
            best = pool.best_containing(np.isin(self.names, names))
            if best is not None:
                return pool.poses[best : best + 1]
        return None

    def _bound(self) -> tuple[int, str]:
        """Prove a lower bound; poses that the proof comes across join the pools."""
        last, step = self.memo.last(), "lower bound"
        entries = _entries(last, step)
        values = self._known() if entries is None else {name: last[name] for name in ("known", "inspected", "joined")}
        inspected = values["inspected"]

        def improve(poses: np.ndarray) -> np.ndarray:
            values["joined"] += 1
            seed = column_seed(self.seed, ["joined", str(values["joined"])])
            rounds = min(max(_JOINED_ROUNDS, _JOINED_COLUMNS // max(1, len(self.pool))), _JOINED_ROUNDS_MOST)
            price_poses(self.shared, self.pools, seed, rounds, self.executor, parents=poses)
            return self.pool.membership[:, inspected]

        ledger = Ledger(improve, entries, lambda told: self._keep(step, {**values, "entries": told}))
        proven = ledger("proven")
        if proven is None:
            idx, most = np.flatnonzero(inspected), self.effort.bound_nodes
            workers = {"executor": self.executor, "progress": self.progress}
            columns = self.pool.membership[:, inspected]
            proven = lower_bound(self.judge, idx, values["known"], columns, max_nodes=most, ledger=ledger, **workers)
            self._keep(step, {**values, "entries": {"proven": list(proven)}})
        return tuple(proven)

    def _known(self) -> dict:
        """Return what a proof needs to know: which entities are to be covered, and in how many settings they can be."""
        inspected = self.pool.membership.any(axis=0)
        known = 0
        if inspected.any():
            known = len(
                few_columns(self.pool.membership[:, inspected], self._nodes(_REFUTING_SHARE), self._rng("known"))
            )
        return {"inspected": inspected, "known": known, "joined": 0}


def _entries(last: dict | None, step: str) -> dict | None:
    """Return a ledger's entries in the checkpoint if it was taken in this step."""
    return last["entries"] if last is not None and last["step"] == step else None

"""Lamps for all settings of a plan: which of a cell's, the ring on the camera, or as few as possible to be placed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

from aspectgraph.light import LightRegions
from aspectgraph.solid.solid import RayScene
from planner.cover import maximal_columns, min_cover
from planner.light.area_light import AreaLight, shown_of_plan
from planner.light.corner_light import LampSets, fewest_together, sites_of
from planner.light.light_plan import LightPlan, LitImage, eyes_of, with_exposures
from planner.light.lighting import UNREAD, LampSpace, Lighting, Served
from planner.progress import Progress, TimeLeft, report
from planner.request.reads import Reads
from planner.verify.simulate_setting import Planned

if TYPE_CHECKING:
    from aspectgraph import Solid


# The fewest lamps for sets of pairs, with a proof: columns from places that were found, and sets
# proven impossible.
#
# A *job* is what one lamp has to show at once: all of a setting, or one entity where no lamp
# shows all. A set of jobs is *realised* by a place that does them all, and *refuted* where no
# place of the space can, as the exact regions have no cell there. Both pass to subsets and
# supersets. The smallest cover by sets that are not refuted bounds the number from below; its
# sets are decided one after the other until it is realised, or too many were tried.


Jobs = frozenset[int]
Decide = Callable[[Jobs], bool]
"""Looks for a place that does some jobs at once, and adds it; returns whether it is proven that there is none."""

# beyond so many jobs the sets are not listed: the jobs are shared out among ever more lamps instead
_MOST_LISTED = 14
_MOST_DECISIONS = 300
SURE_RESERVE = 0.1
"""Of lamps that do the same, one is preferred that shows so much more of the part's edges than its images need.

Where surfaces deviate by several pixels, fewer edges are found than of the part as designed. Of ten sheets that did,
two were not registered under a lamp that showed 0.02 more.
"""
_NODES = 20_000


@dataclass
class LampSearch:
    """What is known of sets of jobs."""

    n: int
    columns: Callable[[], NDArray[np.bool_]]
    decide: Decide
    may_go_on: Callable[[], bool] = lambda: True
    refuted: set[Jobs] = field(default_factory=set)
    tried: set[Jobs] = field(default_factory=set)

    def bound(self) -> int:
        """Decide sets until the bound is reached by the columns, can no longer be raised, or time is up; return it."""
        for i, j in combinations(range(self.n), 2):
            self._try(frozenset((i, j)))
        if self.n > _MOST_LISTED:
            return self._shared_out()
        while True:
            open_sets = self._optimistic()
            cover = min_cover(open_sets)
            chosen = [frozenset(np.flatnonzero(open_sets[c]).tolist()) for c in cover.chosen]
            new = [jobs for jobs in chosen if not self._realised(jobs) and jobs not in self.tried]
            if not new or not self._has_more:
                return cover.lower_bound
            for jobs in new:
                self._try(jobs)

    def _shared_out(self) -> int:
        """Raise the bound from jobs that exclude each other as long as no way to share out jobs is left."""
        bound = self._clique()
        while bound < len(min_cover(self.columns()).chosen):
            groups = self._sharing(bound)
            if groups is None:
                bound += 1
                continue
            new = [jobs for jobs in groups if not self._realised(jobs) and jobs not in self.tried]
            if not new or not self._has_more:
                break
            for jobs in new:
                self._try(jobs)
        return bound

    def _sharing(self, n_lamps: int) -> list[Jobs] | None:
        """Share out the jobs among lamps so that no lamp has a refuted set; None if that is proven impossible.

        An integer programme in x[job, lamp]: every job has a lamp, and of every refuted set a lamp lacks a job. The
        first jobs take the first lamps, as lamps are alike. If it is undecided, nothing is shared out.
        """
        n = self.n * n_lamps
        place = np.arange(n).reshape(self.n, n_lamps)
        rows = []
        upper = []
        for jobs in sorted(self.refuted, key=sorted):
            for lamp in range(n_lamps):
                row = np.zeros(n)
                row[place[sorted(jobs), lamp]] = 1
                rows.append(row)
                upper.append(len(jobs) - 1)
        each = np.zeros((self.n, n))
        for job in range(self.n):
            each[job, place[job]] = 1
        free = np.ones((self.n, n_lamps))
        free[np.arange(n_lamps) > np.arange(self.n)[:, None]] = 0
        limits = [LinearConstraint(csr_matrix(each), 1, 1)]
        if rows:
            limits.append(LinearConstraint(csr_matrix(np.array(rows)), -np.inf, upper))
        solution = milp(
            np.zeros(n),
            integrality=np.ones(n),
            bounds=Bounds(0, free.ravel()),
            constraints=limits,
            options={"node_limit": _NODES},
        )
        if solution.x is None:
            return None if solution.status == 2 else []
        lamps = solution.x.reshape(self.n, n_lamps) > 0.5
        return [frozenset(np.flatnonzero(column).tolist()) for column in lamps.T if column.any()]

    @property
    def _has_more(self) -> bool:
        return len(self.tried) < _MOST_DECISIONS and self.may_go_on()

    def _realised(self, jobs: Jobs) -> bool:
        return bool(self.columns()[:, sorted(jobs)].all(axis=1).any())

    def _try(self, jobs: Jobs) -> None:
        if jobs in self.tried or not self._has_more or self._realised(jobs):
            return
        self.tried.add(jobs)
        if self.decide(jobs):
            self.refuted.add(jobs)

    def _optimistic(self) -> NDArray[np.bool_]:
        """Return the largest sets of jobs that are not refuted, as rows."""
        sets = (np.arange(1, 1 << self.n)[:, None] >> np.arange(self.n)) & 1 == 1
        for jobs in self.refuted:
            sets = sets[~sets[:, sorted(jobs)].all(axis=1)]
        return np.asarray(sets[maximal_columns(sets)])

    def _clique(self) -> int:
        """Return how many jobs were found of which no two can be done at once."""
        best = 1
        for first in range(self.n):
            apart = [first]
            for job in range(self.n):
                if all(frozenset((job, other)) in self.refuted for other in apart):
                    apart.append(job)
            best = max(best, len(apart))
        return best


_FIRST_PLACES = 3000
# of lamps that are on together, as all their pairs are tried
_TOGETHER_PLACES = 300
# what else keeps an edge from being shown
_SHADOW = ", or a shadow next to it"
_MIRRORED = ", or mirrored by the metal next to it"


def chosen_lamps(
    lighting: Lighting,
    plan: Planned,
    solid: Solid,
    progress: Progress | None = None,
    also: ArrayLike = (),
    reads: Reads | None = None,
    executor: Executor | None = None,
    deadline: float = math.inf,
) -> LightPlan:
    """Choose lamps that light all targets of a plan, in every setting, and under which measuring finds enough of each.

    Parameters
    ----------
    lighting : Lighting
        The lamps to choose among.
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    progress : callable, optional
        ``progress(done, total, label)``.
    also : array_like (n, 3)
        Places to try besides, mm, where lamps are placed.
    reads : Reads, optional
        What measuring will find. Default: it is not checked, so contrast alone decides.
    executor : concurrent.futures.Executor, optional
        Computes light regions in parallel. The result does not depend on it.
    deadline : float
        Time, as `time.time` gives it, from which on the number of lamps is lowered no more, and its bound not raised.

    Raises
    ------
    TimeIsUpError
        If the light regions are not complete by then.
    """
    lighting = lighting.on_part(solid, plan.camera)
    if lighting.area is not None:
        return _by_area(lighting, lighting.area, plan, solid, reads)
    served = lighting.served(plan, solid, progress, reads, executor, deadline)
    light = _chosen(lighting, served, plan, also, TimeLeft(deadline), progress)
    return with_exposures(light, plan, served.scene)


def _by_area(
    lighting: Lighting, area: AreaLight, plan: Planned, solid: Solid, reads: Reads | None
) -> LightPlan:
    """What a light with an area shows; there is nothing to choose."""
    area.check_part(solid)
    scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
    shown = shown_of_plan(area, plan, solid, scene, lighting.limits, reads)
    images = [
        (LitImage((), setting.contrast, setting.silhouettes),) if setting.contrast else ()
        for setting in shown
    ]
    light = LightPlan(
        area.kind,
        lighting.contrast,
        lighting.step,
        lighting.ground,
        np.empty((0, 3)),
        tuple(images),
        tuple(setting.unlit for setting in shown),
        0,
        f"Every image is taken with {area}.",
        area=area,
    )
    return with_exposures(light, plan, scene)


def _chosen(
    lighting: Lighting,
    served: Served,
    plan: Planned,
    also: ArrayLike,
    time_left: TimeLeft,
    progress: Progress | None,
) -> LightPlan:
    places = lighting.given
    work = _Work(served, len(plan.settings), lighting.ground)
    if places is None:
        return _ring(work, eyes_of(plan))
    if lighting.together:
        return _all_on(work, places)
    if isinstance(places, np.ndarray):
        served.keep(places)
        return _fixed(work)
    served.add(np.reshape(np.asarray(also, dtype=np.float64), (-1, 3)))
    return _placed(work, places, time_left, progress)


@dataclass
class _Work:
    """What is served, and in how many settings."""

    served: Served
    n_settings: int
    ground: str

    def jobs(self, shown: NDArray[np.bool_]) -> list[tuple[int, ...]]:
        """Return the pairs each lamp has to show at once: all of a setting where some place does, else each alone."""
        result: list[tuple[int, ...]] = []
        for k in range(self.n_settings):
            pairs = [
                i
                for i, pair in enumerate(self.served.pairs)
                if pair.setting == k and shown[:, i].any()
            ]
            together = bool(pairs) and bool(shown[:, pairs].all(axis=1).any())
            result += [tuple(pairs)] if together else [(i,) for i in pairs]
        return result

    def image(
        self, lamps: Sequence[int], pairs: Sequence[int], contrast: NDArray[np.float64]
    ) -> LitImage:
        """Return an image of some pairs under lamps, with contrasts (pairs,) of all."""
        shown = [self.served.pairs[i] for i in pairs]
        values = {pair.name: float(contrast[i]) for i, pair in zip(pairs, shown, strict=True)}
        return LitImage(tuple(lamps), values, tuple(pair.name for pair in shown if pair.silhouette))

    def result(
        self, kind: str, chosen: Sequence[int], images: Any, bound: int, proof: str, reasons: Any
    ) -> LightPlan:
        """Return the plan of lamps; ``images`` (setting, place, pairs), ``reasons`` by pair."""
        served = self.served
        number = {place: i for i, place in enumerate(chosen)}
        shots: list[list[LitImage]] = [[] for _ in range(self.n_settings)]
        for setting, place, pairs in images:
            shots[setting].append(self.image((number[place],), pairs, served.contrast[place]))
        places = served.places[list(chosen)]
        return self.plan(kind, places, shots, bound, proof, reasons).numbered_by_use()

    def plan(
        self,
        kind: str,
        places: NDArray[np.float64],
        shots: Sequence[Sequence[LitImage]],
        bound: int,
        proof: str,
        reasons: Mapping[int, str],
    ) -> LightPlan:
        """Return the plan of lamps at places, ``shots`` by setting, ``reasons`` by pair."""
        served = self.served
        unlit: list[dict[str, str]] = [{} for _ in range(self.n_settings)]
        for i, reason in reasons.items():
            unlit[served.pairs[i].setting][served.pairs[i].name] = reason
        return LightPlan(
            kind,
            served.least_contrast,
            served.least_step,
            self.ground,
            places,
            tuple(map(tuple, shots)),
            tuple(unlit),
            bound,
            proof,
        )


def _ring(work: _Work, eyes: NDArray[np.float64]) -> LightPlan:
    """The lamp of each setting is at its camera."""
    served = work.served
    served.keep_own(eyes)
    by_setting = [
        [i for i, pair in enumerate(served.pairs) if pair.setting == k]
        for k in range(work.n_settings)
    ]
    lit = [[i for i in pairs if served.contrast[k, i] > 0] for k, pairs in enumerate(by_setting)]
    dark = {
        i: _why_not_by_ring(served, i)
        for pairs, shown in zip(by_setting, lit, strict=True)
        for i in pairs
        if i not in shown
    }
    images = [(k, k, pairs) for k, pairs in enumerate(lit) if pairs]
    proof = "A ring light moves with the camera: each setting has its own."
    return work.result("ring", range(len(eyes)), images, len(eyes), proof, dark)


def _why_not_by_ring(served: Served, i: int) -> str:
    """Say why the lamp on the camera does not show a pair, or why it is not read."""
    if why := served.why_unread(i):
        return f"{why}."
    if text := served.unread_text(i):
        return f"the ring light shows it, but {text}."
    text = "gives it too little contrast or light"
    text += " against its background" if served.pairs[i].backdrops else ""
    text += ", or shows no other line at an end" if served.needs_corners(i) else ""
    text += ", or casts a shadow next to it" if served.clear_beside(i) else ""
    return f"the ring light, at the camera or nearby, {text}."


def _fixed(work: _Work) -> LightPlan:
    """The fewest of the given lamps."""
    served = work.served
    shown = served.contrast > 0
    dark = {i: _why_dark(served, i) for i in range(len(served.pairs)) if not shown[:, i].any()}
    jobs = work.jobs(shown)
    chosen, images, bound = _covered(served, jobs)
    proof = (
        "The program tried every given lamp in every setting. Integer programming then found the "
        "smallest number of lamps."
    )
    return work.result("fixed", chosen, images, bound, proof, dark)


def _placed(
    work: _Work, space: LampSpace, time_left: TimeLeft, progress: Progress | None
) -> LightPlan:
    """As few places as possible."""
    served = work.served
    served.add(space.places(_FIRST_PLACES))
    # no lamp changes what the camera sees of these
    dark = {i: f"{why}." for i in range(len(served.pairs)) if (why := served.why_unread(i))}
    for k in range(work.n_settings):
        pairs = [i for i, pair in enumerate(served.pairs) if pair.setting == k and i not in dark]
        if pairs and not (served.contrast[:, pairs] > 0).all(axis=1).any():
            served.search(space, pairs)
    for i in range(len(served.pairs)):
        if i not in dark and not (served.contrast[:, i] > 0).any():
            none = time_left.seconds > 0 and served.search(space, [i])
            if not (served.contrast[:, i] > 0).any():
                dark[i] = _why_no_place(served, i, space, is_proven=none)
    for k in {served.pairs[i].setting for i in dark}:
        others = [i for i, pair in enumerate(served.pairs) if pair.setting == k and i not in dark]
        if others and not (served.contrast[:, others] > 0).all(axis=1).any():
            served.search(space, others)
    jobs = work.jobs(served.contrast > 0)

    def decide(numbers: Jobs) -> bool:
        report(progress, len(search.tried), _MOST_DECISIONS, "fewest lamps")
        return served.search(space, [i for j in numbers for i in jobs[j]])

    search = LampSearch(
        len(jobs), lambda: _columns(served, jobs), decide, lambda: time_left.seconds > 0
    )
    bound = search.bound() if len(jobs) > 1 else len(jobs)
    chosen, images, _ = _covered(served, jobs)
    proof = (
        f"The program intersected the exact light regions of sets of settings with {space}. Where no cell is left, "
        "no lamp serves the set. A smaller number of the remaining sets does not cover all settings."
    )
    return work.result("placed", chosen, images, bound, proof, dark)


def _why_no_place(served: Served, i: int, space: LampSpace, *, is_proven: bool) -> str:
    """Say that no lamp of a space shows a pair, or that none was found."""
    lights = "lights its visible face" if served.pairs[i].silhouette else "lights all of it"
    start = "no position in" if is_proven else "no position found in"
    beside = ", and another line at each end" if served.needs_corners(i) else ""
    beside += ", and no shadow next to it" if served.clear_beside(i) else ""
    beside += served.read_text()
    return f"{start} {space} {lights} with enough contrast and step{beside}."


def _all_on(work: _Work, given: LampSpace | NDArray[np.float64]) -> LightPlan:
    """The fewest lamps that show all when they are on together."""
    served = work.served
    every = range(len(work.served.pairs))
    fixed = isinstance(given, np.ndarray)
    if isinstance(given, np.ndarray):
        served.keep(given)
    else:
        served.add(given.places(_TOGETHER_PLACES))
        served.search(given, list(every))
    # those that show most alone first, where there are too many
    order = np.argsort(-(served.contrast > 0).sum(axis=1), kind="stable")
    places = served.places if fixed else served.places[np.sort(order[:_TOGETHER_PLACES])]
    sets = LampSets(
        served.scene,
        sites_of(served.light, served.pairs),
        places,
        served.offsets,
        served.corners_under,
    )
    fewest = fewest_together(sets, served.least_contrast, served.least_step)
    lit = [i for i in every if fewest.contrast[i] > 0]
    which = "of the given lamps" if fixed else f"of {len(places)} positions in {given}"
    dark = {
        i: f"of the sets tried {which}, the one that shows the most targets does not show it."
        for i in every
        if i not in lit
    }
    n = len(fewest.chosen)
    bound = min(n, fewest.listed + 1)
    proof = f"All sets of fewer than {min(n, fewest.listed + 1)} {which} were tried."
    if not isinstance(given, np.ndarray):
        alone = n > 1 and served.search(given, lit)
        bound = min(n, 1 + alone)
        proof = "At least one lamp is needed."
        if alone:
            proof = (
                f"No single lamp in {given} gives all targets enough contrast: "
                "their exact light regions have no common cell there."
            )
    shots: list[list[LitImage]] = [[] for _ in range(work.n_settings)]
    for k in range(work.n_settings):
        if pairs := [i for i in lit if served.pairs[i].setting == k]:
            shots[k].append(work.image(range(n), pairs, fewest.contrast))
    kind = "fixed" if fixed else "placed"
    return replace(
        work.plan(kind, places[list(fewest.chosen)], shots, bound, proof, dark), together=True
    )


def _columns(served: Served, jobs: Sequence[tuple[int, ...]]) -> NDArray[np.bool_]:
    """Return which places (n, jobs) do which jobs."""
    shown = served.contrast > 0
    return (
        np.array([shown[:, list(pairs)].all(axis=1) for pairs in jobs])
        .reshape(len(jobs), len(shown))
        .T
    )


def _covered(served: Served, jobs: Sequence[tuple[int, ...]]) -> tuple[list[int], list[Any], int]:
    """Return the fewest places, the images (setting, place, pairs), and the bound among these places."""
    if not jobs:
        return [], [], 0
    columns = _columns(served, jobs)
    # whether images of what a place shows are surely registered, and then its step, at worst
    is_shown = served.contrast > 0
    is_sure = served.reserve >= SURE_RESERVE
    worst = np.where(is_shown, served.step, 1.0).min(axis=1)
    worst = ((is_sure | ~is_shown).all(axis=1) + worst) / 2
    order = np.argsort(-worst, kind="stable")
    _, first = np.unique(columns[order], axis=0, return_index=True)
    distinct = np.sort(order[first])
    cover = min_cover(columns[distinct], worst[distinct])
    chosen = [int(distinct[c]) for c in cover.chosen]
    images: dict[tuple[int, int], list[int]] = {}
    for pairs in jobs:
        values = served.contrast[np.ix_(chosen, list(pairs))].min(axis=1)
        values += (values > 0) & is_sure[np.ix_(chosen, list(pairs))].all(axis=1)
        setting = served.pairs[pairs[0]].setting
        # a lamp that is on in the setting anyway takes no further image
        on = np.array([(setting, place) in images for place in chosen])
        best = int(np.argmax(values + 3.0 * (on & (values > 0))))
        images.setdefault((setting, chosen[best]), []).extend(pairs)
    return (
        chosen,
        [(setting, place, pairs) for (setting, place), pairs in images.items()],
        cover.lower_bound,
    )


def _why_dark(served: Served, i: int) -> str:
    """Say why no given lamp shows a pair: how many light it too evenly, too weakly, or not all of it."""
    if why := served.why_unread(i):
        return f"{why}."
    pair = served.pairs[i]
    n = len(served.places)
    is_lit = served.reserve[:, i] >= UNREAD
    unread = served.unread_text(i)
    has_formula = served.light is not None and bool(pair.regions)
    if unread and (is_lit.all() or not has_formula):
        lamps = "the lamp shows" if n == 1 else f"{is_lit.sum()} of {n} lamps show"
        return f"{lamps} it, but {unread}."
    if served.light is None or not pair.regions:
        return "its background is equally bright."
    entities = [served.light.entities[name] for name in pair.regions]
    raw = np.array([_formula(served.light, entity.name, served.places) for entity in entities]).min(
        axis=0
    )
    steps = np.array([served.steps(entity.name, served.places) for entity in entities]).min(axis=0)
    even = raw < served.least_contrast
    weak = ~even & (steps < served.least_step)
    behind = ", or no contrast with its background" if pair.backdrops else ""
    behind += ", or no other line at an end" if served.needs_corners(i) else ""
    behind += _SHADOW if served.clear_beside(i) else ""
    behind += _MIRRORED if served.glare is not None else ""
    start = f"none of {n} lamps shows it" if n > 1 else "the lamp does not show it"
    counts = (
        (even.sum(), f"with a contrast under {served.least_contrast:g}"),
        (weak.sum(), f"with a step under {served.least_step:g}"),
        (n - (even | weak | is_lit).sum(), f"not lighting all of it{behind}"),
        (is_lit.sum(), f"under which {unread}"),
    )
    return f"{start}: {', '.join(f'{k} {why}' for k, why in counts if k)}."


def _formula(light: LightRegions, name: str, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the contrast of an entity, without shadows."""
    from aspectgraph.light import face_contrast

    return np.abs(
        face_contrast(light.solid, light.entities[name], places, light.silhouettes.get(name, {}))
    )

"""A plan checked by simulation as a whole, and the verdict."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from errors.checks import below_one
from ground.convert import STATED, Meta, from_plain, to_plain
from ground.short_repr import count
from planner.argument_kinds import check_callable, check_count, check_kinds, suggests_names
from planner.camera.camera import Camera
from planner.detectability.conditions import Detectability
from planner.detectability.image_check import ImageCheck, Scanned
from planner.exceptions import PlanFileError
from planner.executors import checked_by
from planner.plan_file import Count, Draws, Fraction
from planner.progress import Progress, TimeIsUpError, TimeLeft, report
from planner.request.camera_limits import check_seed
from planner.request.part_entities import parts_of
from planner.request.targets import EdgeTarget, Target, targets_of
from planner.verify.simulate_setting import (
    CONTRADICTED,
    UNSTATED,
    VERDICTS,
    Planned,
    SuccessRate,
    displaced_poses,
    simulate_setting,
)
from planner.verify.simulate_split import simulate_split

if TYPE_CHECKING:
    from aspectgraph import Solid


# In how many images of displaced cameras targets of a plan meet the conditions for showing that
# it was made with.
#
# A plan meets the conditions for showing at its planned poses. This counts how often they are met
# from displaced poses, too: a line that is 5 px away in the planned image may be 4 px away in a
# real one.


MOST_POSES = 200
"""Displaced poses per setting at most: each one takes rays for every line near an edge."""


@dataclass(frozen=True)
class ShownImages:
    """How often targets meet the conditions for showing.

    Attributes
    ----------
    counts : tuple of dict of str to int
        Per setting, in how many images each target does.
    n : int
        Images, that is displaced poses, per setting.
    """

    counts: Annotated[
        tuple[Annotated[Mapping[str, Count], Meta(title="must map names to counts")], ...],
        Meta(title="must be an array with one object per setting"),
    ]
    n: Draws


def count_shown(
    plan: Planned, solid: Solid, n: int, seed: int | None, progress: Progress | None = None
) -> ShownImages | None:
    """Count in how many images of displaced cameras the edges of a plan meet the conditions for showing.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    n : int
        Displaced poses per setting; at most `MOST_POSES` are drawn.
    seed : int or None
        With an integer, setting i uses the seed (seed, i, 1).
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    ShownImages or None
        None if the plan asks for no such condition, or has no settings that measure edges.

    Raises
    ------
    RequestError
        If the part lacks an edge of the plan.
    """
    required = {
        name: plan.requirements.get(name, 0.0) for name in ("separation_px", "min_corner_deg")
    }
    edges_only = required["separation_px"] == 0.0
    measured = [
        [name for name in item.entities if plan.targets[name].in_image or not edges_only]
        for item in plan.settings
    ]
    if not any(required.values()) or not any(measured):
        return None
    showing = Detectability(required["separation_px"], 0.0, required["min_corner_deg"])
    counts = []
    n = min(n, MOST_POSES)
    for k, (setting, targets) in enumerate(zip(plan.settings, measured, strict=True)):
        rng = np.random.default_rng(None if seed is None else [seed, k, 1])
        poses = displaced_poses(np.asarray(setting.cam2world), plan.pose_uncertainty, n, rng)
        image = _image_check(
            solid,
            targets_of(plan.targets, setting),
            targets,
            plan.camera,
            showing,
            only_outlines=only_outlines_of(plan),
        )
        hits = image.shown(poses, np.ones((n, len(targets)), bool)).sum(axis=0)
        counts.append(dict(zip(targets, hits.tolist(), strict=True)))
        report(progress, k + 1, len(plan.settings), "displaced images")
    return ShownImages(tuple(counts), n)


def only_outlines_of(plan: Any) -> bool:
    """Return whether only outlines make lines in the images of a plan, by its light or by the one it was asked for."""
    light = getattr(plan, "light", None)
    if light is not None:
        return light.area is not None and bool(light.area.only_outlines)
    lighting = getattr(getattr(plan, "request", None), "lighting", None)
    area = None if lighting is None else lighting.area
    return area is not None and bool(area.only_outlines)


def _image_check(
    solid: Solid,
    targets: Mapping[str, Target],
    names: list[str],
    camera: Camera,
    showing: Detectability,
    *,
    only_outlines: bool,
) -> ImageCheck:
    """Return a check of what targets of a plan need in an image."""
    edge_ids: list[tuple[int, ...] | None] = []
    ends = np.zeros((len(names), 2, 3))
    scanned: list[list[Scanned]] = []
    for k, name in enumerate(names):
        target = targets[name]
        entities = parts_of(target, solid, name)
        if isinstance(target, EdgeTarget):
            ends[k] = target.ends
            edge_ids.append(entities[0].edge_ids)
            scanned.append([])
        else:
            edge_ids.append(None)
            scanned.append(
                [
                    Scanned.of(entity.edge_ids, geometry)
                    for entity, geometry in zip(entities, target.geometry, strict=True)
                ]
            )
    return ImageCheck(solid, edge_ids, ends, camera, showing, scanned, only_outlines=only_outlines)


_CONFIDENCE = 0.99


def promises_too_much(rate: SuccessRate) -> bool:
    """Tell whether the predicted probability is above the whole interval by more than the model's tolerance."""
    return rate.verdict == CONTRADICTED


@dataclass(frozen=True, repr=False)
class SimulationResult:
    """Result of a simulation: how often each setting measured each entity accurately.

    Attributes
    ----------
    rates : tuple of dict of str to SuccessRate
        Per setting, in the plan's order. The intervals hold all together with at least ``confidence`` (Bonferroni).
    n : int
        Displaced poses per setting.
    seed : int or None
        Seed that reproduces the simulation.
    confidence : float
        Probability that every interval contains the true probability of success.
    shown : ShownImages or None
        Number of images of displaced cameras in which software can find the edges. None if the plan
        sets no conditions on the image, or the call had no part.
    split : dict of str to SuccessRate
        Of each dimension whose entities two settings measure, how often both together give it accurately.
    """

    rates: Annotated[
        tuple[Annotated[Mapping[str, SuccessRate], Meta(title="must map names to rates")], ...],
        Meta(title="must be an array with one object per setting"),
    ]
    n: Draws
    seed: Count | None
    confidence: Fraction
    shown: Annotated[ShownImages | None, STATED] = None
    split: Annotated[Mapping[str, SuccessRate], Meta(title="must map names to rates")] = field(
        default_factory=dict
    )

    def __repr__(self) -> str:
        """Return a one-line summary."""
        counts = ", ".join(f"{n} {verdict}" for verdict, n in self.verdicts.items() if n)
        size = f"{count(len(self.rates), 'setting')}, {count(self.n, 'pose')} each"
        return f"<SimulationResult: {size}: {counts or 'nothing to check'}>"

    @property
    def all_rates(self) -> list[SuccessRate]:
        """The rates of all settings, and of what two settings measure together."""
        return [*(rate for rates in self.rates for rate in rates.values()), *self.split.values()]

    @property
    def broken(self) -> tuple[tuple[int, str], ...]:
        """Setting index and entity of each prediction that is too high."""
        return tuple(
            (k, name)
            for k, rates in enumerate(self.rates)
            for name, rate in rates.items()
            if promises_too_much(rate)
        )

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of predictions per verdict; see `SuccessRate.verdict`."""
        all_verdicts = [rate.verdict for rate in self.all_rates]
        return {verdict: all_verdicts.count(verdict) for verdict in VERDICTS}

    @property
    def confirmed(self) -> bool:
        """Whether every setting states its probabilities and none is contradicted.

        It is true for a plan without settings.
        """
        kinds = self.verdicts
        return not kinds[CONTRADICTED] and not kinds[UNSTATED]

    @property
    def worst_difference(self) -> float:
        """Largest absolute difference between a prediction and its frequency; 0 without settings."""
        return max(
            (abs(rate.predicted - rate.frequency) for rate in self.all_rates),
            default=0.0,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain Python values, ready for JSON.

        Returns
        -------
        dict
            Field names and values; each rate is a dict of its own fields.
        """
        rates = tuple(
            {
                name: replace(rate, predicted=below_one(rate.predicted))
                for name, rate in setting.items()
            }
            for setting in self.rates
        )
        split = {
            name: replace(rate, predicted=below_one(rate.predicted))
            for name, rate in self.split.items()
        }
        return to_plain(replace(self, rates=rates, split=split))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> SimulationResult:
        """Build a result from the output of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        SimulationResult
            Equal to the one written.
        """
        return from_plain(cls, data, PlanFileError)


@suggests_names
def simulate_plan(
    plan: Planned,
    n: int = 10_000,
    rng: int = 0,
    progress: Progress | None = None,
    solid: Solid | None = None,
) -> SimulationResult:
    """Simulate a plan: measure every entity of every setting from n displaced poses.

    Parameters
    ----------
    plan : InspectionPlan
        The plan to check.
    n : int
        Displaced poses per setting.
    rng : int or numpy.random.Generator
        Seed. With an integer, setting i uses the seed (rng, i), so that settings are independent of
        each other.
    progress : callable, optional
        ``progress(done, total, label)``.
    solid : Solid, optional
        The plan's part. With it, the simulation also counts the images of displaced cameras in
        which edges meet the conditions on the image (`planner.verify.simulate_plan`).

    Returns
    -------
    SimulationResult
        Frequency of success and its confidence interval, per setting and entity.

    Raises
    ------
    RequestError
        If ``plan`` is none, ``n`` or ``rng`` breaks its rule, or the part lacks an edge of the
        plan.

    Examples
    --------
    >>> from planner import read_plan, simulate_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> result = simulate_plan(plan, 500)
    >>> result.confirmed, result.n
    (True, 500)
    """
    if not hasattr(plan, "settings"):
        check_kinds(plan=(plan, "InspectionPlan"))
    check_count("n", n, 1)
    check_callable("progress", progress)
    seed = None if isinstance(rng, np.random.Generator) else check_seed(rng)
    pairs: Mapping[str, Any] = getattr(plan, "split", {})
    intervals = max(1, sum(len(setting.entities) for setting in plan.settings) + len(pairs))
    confidence = 1.0 - (1.0 - _CONFIDENCE) / intervals
    rates = []
    for k, setting in enumerate(plan.settings):
        result = simulate_setting(
            setting,
            targets_of(plan.targets, setting),
            plan.camera,
            plan.pose_uncertainty,
            accuracy=plan.accuracy,
            n=n,
            rng=rng if seed is None else np.random.default_rng([seed, k]),
            confidence=confidence,
        )
        rates.append(result)
        report(progress, k + 1, len(plan.settings), "simulation")
    shown = None if solid is None else count_shown(plan, solid, n, seed, progress)
    split = {
        name: simulate_split(plan, name, n, _seed_of(rng, seed, k), confidence)
        for k, name in enumerate(pairs)
    }
    return SimulationResult(tuple(rates), n, seed, _CONFIDENCE, shown, split)


def _seed_of(rng: Any, seed: int | None, number: int) -> list[int]:
    """Return the seed of a target that two settings measure."""
    first = int(rng.integers(2**31)) if seed is None else seed
    return [first, 2, number]


# A simulation that ends in time: with as many displaced poses as fit, or not at all.


_LONGER = "A longer --time-limit"
NOT_SIMULATED = (
    f"The plan was not simulated: the time limit left no time. {_LONGER} simulates it, and so does "
    "'aspectgraph simulate'."
)
NOT_COUNTED = (
    "The images of displaced cameras were not checked: the time limit left no time. "
    f"{_LONGER} checks them."
)
# poses that are tried to see how long one takes
_TRIED = 400
# fewer tell little about a probability of 0.9
_FEWEST = 200
# of the time that is left, for poses; the images of displaced cameras have the rest
_SHARE = 0.7


def simulate_in_time(
    plan: Planned,
    n: int,
    seed: int,
    progress: Progress | None,
    solid: Solid,
    time_left: TimeLeft,
) -> tuple[SimulationResult | None, list[str]]:
    """Simulate a plan with as many displaced poses as there is time for.

    Parameters
    ----------
    plan : InspectionPlan
        The plan to check.
    n : int
        Displaced poses per setting, if there is time for all. 0: no simulation.
    seed : int
        As `simulate_plan` takes it.
    progress : callable or None
        ``progress(done, total, label)``.
    solid : Solid
        The plan's part.
    time_left : TimeLeft
        The simulation ends by then.

    Returns
    -------
    SimulationResult or None
        None if there was no time for it, or none is wanted.
    list of str
        Sentences on what was left out.
    """
    if n == 0:
        return None, []
    if time_left.seconds == float("inf"):
        return simulate_plan(plan, n, rng=seed, progress=progress, solid=solid), []
    fitting = _fitting(plan, n, seed, time_left.seconds)
    if not fitting:
        return None, [NOT_SIMULATED]

    def shown(done: int, total: int, label: str) -> None:
        report(progress, done, total, label)
        if done < total:
            time_left.check()

    try:
        result = simulate_plan(plan, fitting, rng=seed, progress=shown)
    except TimeIsUpError:
        return None, [NOT_SIMULATED]
    notes = [] if fitting == n else [_fewer_sentence(fitting, n)]
    try:
        time_left.check()
        # a setting with many rims takes seconds
        with checked_by(lambda: time_left.check):
            images = count_shown(plan, solid, fitting, seed, shown)
        return replace(result, shown=images), notes
    except TimeIsUpError:
        return result, [*notes, NOT_COUNTED]


def _fewer_sentence(fitting: int, n: int) -> str:
    return (
        f"The simulation used {fitting} instead of {n} displaced poses per setting: the time limit left no time for "
        f"more. {_LONGER} brings all."
    )


def _fitting(plan: Planned, n: int, seed: int, seconds: float) -> int:
    """Return how many poses per setting there is time for; 0 for too few.

    The setting with the most targets is simulated with some poses; the time grows with poses and targets.
    """
    sizes = [len(setting.entities) for setting in plan.settings]
    if not sizes:
        return n
    largest: Any = plan.settings[int(np.argmax(sizes))]
    tried = min(n, _TRIED)
    begun = time.monotonic()
    simulate_setting(
        largest,
        targets_of(plan.targets, largest),
        plan.camera,
        plan.pose_uncertainty,
        accuracy=plan.accuracy,
        n=tried,
        rng=np.random.default_rng(seed),
    )
    each = (time.monotonic() - begun) / tried / max(sizes) * sum(sizes)
    fitting = int(_SHARE * seconds / max(each, 1e-12))
    if fitting >= n:
        return n
    # in round numbers, unless there are few
    fitting = fitting // 100 * 100
    return fitting if fitting >= min(n, _FEWEST) else 0

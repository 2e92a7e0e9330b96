"""A simulation that ends in time: with as many displaced poses as fit, or not at all."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.progress import Progress, report
from planner.progress.time_left import TimeIsUpError, TimeLeft
from planner.verify.shown_images import count_shown
from planner.verify.simulate_plan import SimulationResult, simulate_plan
from planner.verify.simulate_setting import simulate_setting
from planner.wanted.planned import targets_of

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.verify.simulated import Planned

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
        Displaced poses per setting, if there is time for all.
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
        None if there was no time for it.
    list of str
        Sentences on what was left out.
    """
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
        found = simulate_plan(plan, fitting, rng=seed, progress=shown)
    except TimeIsUpError:
        return None, [NOT_SIMULATED]
    notes = [] if fitting == n else [_fewer_sentence(fitting, n)]
    try:
        time_left.check()
        return replace(found, shown=count_shown(plan, solid, fitting, seed, shown)), notes
    except TimeIsUpError:
        return found, [*notes, NOT_COUNTED]


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
    most: Any = plan.settings[int(np.argmax(sizes))]
    tried = min(n, _TRIED)
    begun = time.monotonic()
    simulate_setting(
        most,
        targets_of(plan.targets, most),
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

"""A plan checked by simulation as a whole, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errors.formatting import below_one
from planner.argument_kinds import check_kinds
from planner.progress import Progress, report
from planner.verify.shown_images import ShownImages, count_shown
from planner.verify.simulate_setting import (
    CONTRADICTED,
    UNSTATED,
    VERDICTS,
    SuccessRate,
    simulate_setting,
)
from planner.verify.simulated import Planned
from planner.wanted.planned import targets_of

if TYPE_CHECKING:
    from aspectgraph import Solid

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
    """

    rates: tuple[dict[str, SuccessRate], ...]
    n: int
    seed: int | None
    confidence: float
    shown: ShownImages | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        found = ", ".join(f"{count} {verdict}" for verdict, count in self.verdicts.items() if count)
        return f"<SimulationResult: {len(self.rates)} settings, {self.n} poses each: {found or 'nothing to check'}>"

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
        found = [rate.verdict for rates in self.rates for rate in rates.values()]
        return {verdict: found.count(verdict) for verdict in VERDICTS}

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
            (abs(r.predicted - r.frequency) for rates in self.rates for r in rates.values()),
            default=0.0,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain Python values, ready for JSON.

        Returns
        -------
        dict
            Field names and values; each rate is a dict of its own fields.
        """
        rates = [
            {
                name: {**asdict(rate), "predicted": below_one(rate.predicted)}
                for name, rate in setting.items()
            }
            for setting in self.rates
        ]
        shown = None if self.shown is None else self.shown.to_dict()
        return {
            "rates": rates,
            "n": self.n,
            "seed": self.seed,
            "confidence": self.confidence,
            "shown": shown,
        }

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
        rates = tuple(
            {name: SuccessRate(**rate) for name, rate in setting.items()}
            for setting in data["rates"]
        )
        # files of earlier programs do not tell
        shown = data.get("shown")
        counted = None if shown is None else ShownImages.from_dict(shown)
        return cls(rates, data["n"], data["seed"], data["confidence"], counted)


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
        which edges meet the conditions on the image (`planner.verify.shown_images`).

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
    seed = rng if isinstance(rng, int) else None
    intervals = max(1, sum(len(setting.entities) for setting in plan.settings))
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
            confidence=1.0 - (1.0 - _CONFIDENCE) / intervals,
        )
        rates.append(result)
        report(progress, k + 1, len(plan.settings), "simulation")
    shown = None if solid is None else count_shown(plan, solid, n, seed, progress)
    return SimulationResult(tuple(rates), n, seed, _CONFIDENCE, shown)

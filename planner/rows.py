"""What a plan measures, from where and how sure: a row per setting and entity, as values, as CSV and as a table.

There is one such list: `InspectionPlan.rows`, the file beside a report and the report's own tables are made of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, NamedTuple

from errors.checks import frequency_text, probability_text
from errors.measurands.geometry import is_short
from planner.request.targets import targets_of
from planner.sensor_setting import Foreseen
from planner.verify.setting_record import described, search_windows_px
from planner.verify.simulate_setting import (
    CONFIRMED,
    CONTRADICTED,
    TOLERATED,
    UNSTATED,
    SuccessRate,
)

# What is measured from where and how sure: a row per setting and entity, with the warnings it
# deserves.


WARN_BELOW_PX = 2.0
"""A row warns of a smaller permitted error: there one part may be measured more or less often than P says."""

LARGE_DIFFERENCE = 0.02
"""A row warns of a simulated frequency that differs from the stated probability by more than this, even if it is
better."""


class WarningKind(Enum):
    """What a measurement warns of; the value is what a report says of many."""

    FEW_PIXELS = "tolerance under two pixels"
    DIFFERS = "simulation differs from the stated probability"
    BETTER = "simulation is better than the stated probability"
    LINE = "another line within the search window"
    UNSHOWN = "image conditions not met from some displaced poses"
    UNLIT = "not visible under any lamp"


class Warned(NamedTuple):
    """What to look at: a kind, and a sentence."""

    kind: WarningKind
    text: str


@dataclass(frozen=True)
class Row:
    """One entity or dimension, measured from one setting.

    Attributes
    ----------
    setting : int
        Number of the setting, from 1.
    name : str
        The entity or dimension.
    kind : str
        The dimension's kind; ``"length"`` of an edge.
    nominal, permitted_error : float
        In `unit`.
    unit : str
        "mm" or "deg".
    permitted_error_px : float or None
        The permitted error in the image; None of an angle.
    probability : float
        P as stated, given that the image shows the target.
    p_all : float or None
        P_all as stated; None in a plan that did not count it.
    entities : tuple of str
        Ids of the entities that measure it here.
    foreseen : Foreseen or None
        The U that `measure` will state; None of a length, and where the plan does not hold it.
    rate : SuccessRate or None
        What simulation gave.
    standard_uncertainty : float
        u in `unit`.
    budget : dict of str to float
        Variance by source, `unit` squared; empty where it is none, of short arcs.
    search_window_px : float
        Within how many pixels of its prediction it is to be looked for in the image.
    warnings : tuple of Warned
        What to look at.
    """

    setting: int
    name: str
    kind: str
    nominal: float
    unit: str
    permitted_error: float
    permitted_error_px: float | None
    probability: float
    rate: SuccessRate | None
    standard_uncertainty: float
    search_window_px: float
    budget: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[Warned, ...] = ()
    p_all: float | None = None
    entities: tuple[str, ...] = ()
    foreseen: Foreseen | None = None

    @property
    def promise(self) -> float:
        """P_all, or P where that was not counted."""
        return self.probability if self.p_all is None else self.p_all


def measured_rows(plan: Any) -> list[list[Row]]:
    """Return the rows of each setting, in the order of its entities.

    Parameters
    ----------
    plan : InspectionPlan
        With or without the result of its simulation.

    Returns
    -------
    list of list of Row
        One list per setting.
    """
    return [_setting_rows(plan, k, setting) for k, setting in enumerate(plan.settings)]


def _setting_rows(plan: Any, k: int, setting: Any) -> list[Row]:
    rates = plan.simulation.rates[k] if plan.simulation is not None else {}
    images = plan.simulation.shown if plan.simulation is not None else None
    windows = search_windows_px(plan, setting)
    foreseen = _foreseen_of(plan, k)
    rows = []
    targets = targets_of(plan.targets, setting)
    predictions = described(plan, setting)
    for name in setting.entities:
        target = targets[name]
        predicted = predictions[name]
        permitted_px = target.permitted_error_px(setting.cam2world, plan.camera)
        rate = rates.get(name)
        probability = setting.probability[name]
        # without whole pixels there is no grid to be wary of
        coarse = permitted_px if target.localisation.model == "rounding" else None
        warnings = _warnings(coarse, probability, rate)
        if name in setting.lines_in_window_px:
            warnings += (
                Warned(
                    WarningKind.LINE, line_warning(setting.lines_in_window_px[name], windows[name])
                ),
            )
        if images is not None and images.counts[k].get(name, images.n) < images.n:
            warnings += (
                Warned(WarningKind.UNSHOWN, unshown_warning(images.counts[k][name], images.n)),
            )
        if plan.light is not None and name in plan.light.unlit[k]:
            warnings = (
                Warned(
                    WarningKind.UNLIT, f"not visible under any lamp: {plan.light.unlit[k][name]}"
                ),
                *warnings,
            )
        # the quantiles of a short arc are no variance
        has_variance = not any(map(is_short, target.geometry))
        row = Row(
            setting=k + 1,
            name=name,
            kind=target.kind,
            nominal=target.nominal,
            unit=target.unit,
            permitted_error=target.permitted_error,
            permitted_error_px=permitted_px,
            probability=probability,
            rate=rate,
            standard_uncertainty=predicted.standard_uncertainty,
            search_window_px=windows[name],
            budget=dict(predicted.budget) if has_variance else {},
            warnings=warnings,
            p_all=setting.p_all.get(name),
            entities=target.entities,
            foreseen=foreseen.get(name),
        )
        rows.append(row)
    return rows


def _foreseen_of(plan: Any, k: int) -> dict[str, Foreseen]:
    """Return by name what `measure` will state of a setting."""
    named = {}
    for row in plan.foreseen:
        if row.setting == k:
            named[row.name] = row
    return named


def split_rows(plan: Any) -> list[Row]:
    """Return a row of each dimension whose two ends different settings measure: the value that both give.

    Parameters
    ----------
    plan : InspectionPlan
        With or without the result of its simulation.

    Returns
    -------
    list of Row
        The setting is that of the first end.
    """
    rates = plan.simulation.split if plan.simulation is not None else {}
    rows = []
    for name, value in plan.split.items():
        first = plan.ends[name][0]
        setting = plan.settings[first]
        target = targets_of(plan.targets, replace(setting, ends={}))[name]
        rows.append(
            Row(
                setting=first + 1,
                name=name,
                kind=target.kind,
                nominal=target.nominal,
                unit=target.unit,
                permitted_error=target.permitted_error,
                permitted_error_px=target.permitted_error_px(setting.cam2world, plan.camera),
                probability=value.probability,
                rate=rates.get(name),
                standard_uncertainty=value.standard_uncertainty,
                search_window_px=0.0,
                p_all=value.p_all,
                entities=target.entities,
            )
        )
    return rows


def line_warning(line_px: float, window_px: float) -> str:
    """Return what to look at where another visible line lies in a search window.

    Parameters
    ----------
    line_px : float
        How near it comes to the edge, px.
    window_px : float
        Half the width of the window, px.
    """
    return (
        f"another visible line comes within {line_px:.3g} px; a detector that searches ±{window_px:.3g} px may "
        "confuse the two"
    )


def unshown_warning(shown: int, n: int) -> str:
    """Return what to look at where an edge meets the conditions for showing in only some images of displaced cameras.

    Parameters
    ----------
    shown, n : int
        In so many of so many images.
    """
    return f"meets the image conditions from only {shown} of {n} displaced poses"


def few_pixels_warning(permitted_px: float) -> str:
    """Return what to look at where the permitted error is less than two pixels.

    Parameters
    ----------
    permitted_px : float
        The permitted error in the image, px.
    """
    return (
        f"tolerance of {permitted_px:.2g} px, under two pixels: P is the mean over parts whose edges end anywhere on "
        "the pixel grid, and may be lower for one part"
    )


def _warnings(px: float | None, probability: float, rate: SuccessRate | None) -> tuple[Warned, ...]:
    warnings = []
    if px is not None and px < WARN_BELOW_PX:
        warnings.append(Warned(WarningKind.FEW_PIXELS, few_pixels_warning(px)))
    if rate is not None:
        off = rate.frequency - probability
        drawn = frequency_text(rate.successes, rate.n)
        if rate.verdict in (CONTRADICTED, TOLERATED, UNSTATED):
            text = f"simulation gives {drawn} instead of {probability_text(probability)}: {rate.verdict}"
            warnings.append(Warned(WarningKind.DIFFERS, text))
        elif rate.verdict != CONFIRMED and abs(off) > LARGE_DIFFERENCE:
            warnings.append(
                Warned(
                    WarningKind.BETTER, f"simulation gives {drawn}, {off:.2g} better than stated"
                )
            )
    return tuple(warnings)

"""The section of the report about dimensions: uncertainty, tolerance and acceptance limits of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

from errors.formatting import interval_text, probability_text
from errors.measurands import Localisation, acceptance_limits, uncertainty_ratio
from errors.measurands.fitted import is_short
from planner.report.tables import (
    COLOURS,
    cells,
    heads,
    promise_name,
    setting_link,
    source_text,
    unbroken,
)
from planner.report.wording import features_cell, surfaces_sources
from planner.verify.measurements import Measurement, measurements
from planner.wanted.words.tolerance_texts import deviation_text

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.wanted.planned import PlannedDimension

# before and after P_all, or P where that was not counted
_FIRST = ("Dimension", "Nominal, tolerance", "U (k = 2)", "U/T", "Permitted error", "Setting")
_LAST = ("u", "Budget of the variance", "Accept between", "Binding")


def dimension_section(plan: InspectionPlan) -> str:
    """Return the section about dimensions as HTML; nothing for a plan without them.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.

    Returns
    -------
    str
        A heading, a table with a row per dimension and setting, and what its columns mean.
    """
    rows = [
        _row(plan, k, name, one)
        for k, setting in enumerate(plan.settings)
        for name, one in measurements(plan, setting).items()
    ]
    if not rows:
        return ""
    names = [*_FIRST, promise_name(plan), *_LAST]
    order = list(plan.entities)
    rows.sort(key=lambda row: order.index(row[0]))
    return (
        '<h3 id="tolerances">Dimensions and their tolerances</h3>'
        f'<div class="scroll"><table id="dimensions" class="stack">{heads(names)}<tbody>'
        f"{''.join(html for _, html in rows)}</tbody></table></div>"
        + "".join(f'<p class="note">{escape(text)}</p>' for text in _notes(plan))
    )


def budget_percents(budget: Mapping[str, float]) -> dict[str, float]:
    """Return the share of each source in percent with one decimal; they sum to 100 exactly.

    Parameters
    ----------
    budget : mapping of str to float
        Variances.

    Returns
    -------
    dict of str to float
        Rounded by largest remainders; all 0 if there is no variance.
    """
    total = math.fsum(budget.values())
    if not (total > 0 and math.isfinite(total)):
        return dict.fromkeys(budget, 0.0)
    exact = {name: 1000 * value / total for name, value in budget.items()}
    tenths = {name: math.floor(value) for name, value in exact.items()}
    for name in sorted(exact, key=lambda key: tenths[key] - exact[key])[
        : 1000 - sum(tenths.values())
    ]:
        tenths[name] += 1
    return {name: value / 10 for name, value in tenths.items()}


def localisation_text(how: Localisation) -> str:
    """Return a localisation model in words.

    Parameters
    ----------
    how : Localisation
        The model.

    Returns
    -------
    str
        Its name and its numbers.
    """
    if how.model == "rounding":
        return f"rounding (every point on a whole pixel, {how.points} points per line or circle)"
    if how.model == "gaussian":
        common = f"; {how.floor_px:g} px common to all of them" if how.floor_px else ""
        return (
            f"gaussian (standard deviation {how.sigma_px:g} px, {how.points} points per line or "
            f"circle{common})"
        )
    return (
        f"fit (standard deviation {how.sigma_px:g} px, one independent point per {how.correlation_px:g} px of the "
        f"image, no better than {how.floor_px:g} px)"
    )


def _row(plan: InspectionPlan, k: int, name: str, one: Measurement) -> tuple[str, str]:
    chosen = plan.settings[k].witness.get(name, 0)
    dimension = plan.dimensions[name].choosing(chosen)
    unit = dimension.unit
    ratio = "none stated"
    if dimension.tolerance is not None:
        ratio = f"<b>{uncertainty_ratio(one.expanded_uncertainty, dimension.tolerance):.3f}</b>"
    values = {
        "": f"{escape(name)}<br> <span class='note'>{escape(_what(dimension))}</span>",
        "Nominal, tolerance": _nominal(dimension),
        "U (k = 2)": unbroken(f"{one.expanded_uncertainty:.3g} {unit}"),
        "U/T": ratio,
        "Permitted error": _permitted(dimension, one),
        "Setting": setting_link(k + 1),
        promise_name(plan): _probability(plan, k, name),
        "u": f"{one.standard_uncertainty:.3g}",
        "Budget of the variance": _budget(dimension, one),
        "Accept between": _accepted(dimension, one),
        "Binding": escape(one.binding),
    }
    return name, cells(values)


def _what(dimension: PlannedDimension) -> str:
    """Return what a dimension is, and on how many of its features it is measured if not on all."""
    what = f"{dimension.kind.replace('_', ' ')} of {', '.join(dimension.entities)}"
    features = features_cell(dimension)
    return f"{what}; {features}" if features else what


def _permitted(dimension: PlannedDimension, one: Measurement) -> str:
    """Return the permitted error, in the image too, and its share of the tolerance."""
    lines = [unbroken(f"±{dimension.permitted_error:.4g} {dimension.unit}")]
    if one.permitted_error_px is not None:
        lines.append(unbroken(f"{one.permitted_error_px:.3g} px"))
    if dimension.share_text:
        lines.append(f"<span class='note'>{unbroken(dimension.share_text)}</span>")
    return "<br> ".join(lines)


def _nominal(dimension: PlannedDimension) -> str:
    text = f"{dimension.nominal:.6g} {dimension.unit}"
    if dimension.tolerance is None:
        return text
    lower, upper = dimension.tolerance
    # pages too narrow for a table show no breaks
    return f"{text}<br> {deviation_text(upper)}<br> {deviation_text(lower)}"


def _probability(plan: InspectionPlan, k: int, name: str) -> str:
    setting = plan.settings[k]
    text = probability_text(setting.promise[name], plan.probability)
    if setting.p_all:
        alone = probability_text(setting.probability[name], plan.probability)
        text = f"{text}<br> <span class='note'>{unbroken(f'P {alone}')}</span>"
    rates = plan.simulation.rates[k] if plan.simulation is not None else {}
    if name not in rates:
        return text
    rate = rates[name]
    return f"{text}<br> <span class='note'>simulated {interval_text(rate.low, rate.high)}</span>"


def _budget(dimension: PlannedDimension, one: Measurement) -> str:
    if any(map(is_short, dimension.geometry)):
        return "short arc: quantiles, no variance"
    percents = budget_percents(one.budget)
    bars = "".join(
        f'<i style="display:inline-block;height:9px;width:{max(0.0, 1.2 * value):.1f}px;background:{COLOURS[source]}">'
        "</i>"
        for source, value in percents.items()
    )
    texts = "<br> ".join(
        unbroken(f"{source_text(source)} {value:.1f} %") for source, value in percents.items()
    )
    return f'<span style="white-space:nowrap">{bars}</span><br> <span class="note">{texts}</span>'


def _accepted(dimension: PlannedDimension, one: Measurement) -> str:
    if dimension.tolerance is None:
        return "no tolerance stated"
    limits = acceptance_limits(dimension.tolerance, one.expanded_uncertainty)
    if limits is None:
        return '<span class="bad">nothing: U takes the whole tolerance</span>'
    low = dimension.nominal + limits[0]
    high = dimension.nominal + limits[1]
    return f"{low:.6g} and {unbroken(f'{high:.6g} {dimension.unit}')}"


def _images_text(plan: InspectionPlan) -> list[str]:
    """Say where the errors come from that all points of an entity share, and what rendered images gave."""
    floors = {one.localisation.common_px for one in plan.dimensions.values()}
    if not any((*floors, *(one.surfaces_mm for one in plan.dimensions.values()))):
        return []
    surfaces = " or ".join(surfaces_sources(plan.dimensions.values()))
    return [
        f"All points of an edge or rim share an error of {_several(floors)} px across it, the localisation floor. In "
        "30 path-traced images of a test part it was 0.02 to 0.10 px over a whole rim and up to 0.04 px over a line. "
        f"The faces of the part lie off their position by {surfaces}. Both are standard "
        "deviations and do not average out.",
    ]


def _several(values: set[float]) -> str:
    return " or ".join(f"{value:g}" for value in sorted(values))


def _notes(plan: InspectionPlan) -> list[str]:
    models = list(
        dict.fromkeys(localisation_text(one.localisation) for one in plan.dimensions.values())
    )
    rounded = any(one.localisation.model == "rounding" for one in plan.dimensions.values())
    return [
        f"Localisation of points in the image: {'; '.join(models)}."
        + (
            " The model assumes that points of one line or circle on whole pixels have independent errors."
            if rounded
            else ""
        ),
        *_images_text(plan),
        "u is the standard uncertainty of the measured value, and U = 2u. Of an arc of less than half a circle, u and "
        "U are half the widths of the intervals that hold 68.27 and 95.45 % of the errors. The sources of the "
        "budget sum to u². T is the whole width of the tolerance. Accept a part if its measured value lies between "
        "the limits: the tolerance less a guard band of U on either side (ISO 14253-1).",
        "The permitted error in px is the one in mm at the scale of the image, at the mean depth of the targets and "
        "square to the optical axis. Binding names what has the smallest share of its margin left: probability, focus "
        "or field of view.",
    ]

"""What a report says of one setting: a table of probabilities, and which constraint fixes the pose."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from planner.report.binding import nearest_limits
from planner.report.tables import budget_bar, permitted
from planner.rows.measured import Row
from planner.verify.simulate_setting import CONFIRMED, CONSERVATIVE, CONTRADICTED, TOLERATED, UNSTATED

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting
    from planner.verify.simulate_setting import SuccessRate

_STYLES = {CONFIRMED: "good", CONSERVATIVE: "good", TOLERATED: "note", CONTRADICTED: "bad", UNSTATED: "bad"}


def setting_table(plan: InspectionPlan, told: Sequence[Row], noun: str) -> str:
    """Return the table of a setting: permitted error, budget, probability, what simulation gave, and warnings.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    told : sequence of Row
        The rows of the setting.
    noun : str
        What an item is called.
    """
    simulated = any(one.rate is not None for one in told)
    rows = []
    for one in told:
        row = f'<td>{escape(one.name)}</td><td class="n">{_value(plan, one.name)}</td>'
        row += f'<td class="n">{permitted(one)}</td><td>{budget_bar(one)}</td>'
        counted = (
            ' title="counted on the pixel grid: the tolerance is under two pixels"' if one.name in plan.on_grid else ""
        )
        row += f'<td class="n"{counted}>{one.probability:.4f}{" *" if counted else ""}</td>'
        if one.rate is not None:
            row += _rate_cells(one.rate, plan.probability)
        rows.append(f"<tr>{row}</tr>")
        if one.warnings:
            rows.append(f'<tr class="warning"><td colspan="8">{escape("; ".join(one.warnings))}</td></tr>')
    what = "Nominal" if plan.dimensions else "Length (mm)"
    head = f'<th>{noun.capitalize()}</th><th class="n">{what}</th>'
    head += '<th class="n">Permitted error</th><th>Budget</th><th class="n">P</th>'
    if simulated:
        head += '<th class="n">Simulated</th><th>Interval</th><th></th>'
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"


def binding_sentence(plan: InspectionPlan, setting: SensorSetting) -> str:
    """Say which constraint fixes the pose, and what comes next."""
    first, *rest = nearest_limits(plan, setting)
    told = f"Nearest to its limit: {first.name}, with {100 * first.share:.3g} % of its room left; {first.meaning}."
    return told + (f" Next: {', '.join(f'{one.name} {100 * one.share:.3g} %' for one in rest)}." if rest else "")


def _value(plan: InspectionPlan, name: str) -> str:
    """Return what an item measures, with the unit where units differ."""
    length = np.linalg.norm(plan.entities[name][1] - plan.entities[name][0])
    if not plan.dimensions:
        return f"{length:.3f}"
    one = plan.dimensions.get(name)
    return f"length {length:.3f} mm" if one is None else f"{one.kind.replace('_', ' ')} {one.nominal:.3f} {one.unit}"


def _rate_cells(rate: SuccessRate, threshold: float) -> str:
    """Return the simulated frequency, and the interval as numbers and as a bar with the prediction marked."""
    low_end = min(threshold, rate.low, rate.predicted) - 0.02

    def place(value: float) -> float:
        return 100 * (value - low_end) / (1.0 - low_end)

    width = max(place(rate.high) - place(rate.low), 1.5)
    bar = (
        f'<span class="bar"><i style="left:{place(rate.low):.1f}%;width:{width:.1f}%"></i>'
        f'<u style="left:calc({place(rate.predicted):.1f}% - 1px)"></u></span>'
    )
    told = f'<span class="{_STYLES[rate.verdict]}">{escape(rate.verdict)}</span>'
    return f'<td class="n">{rate.frequency:.4f}</td><td>{rate.low:.4f} to {rate.high:.4f}{bar}</td><td>{told}</td>'

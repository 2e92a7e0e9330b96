"""What a report says of one setting: a table of probabilities, and which constraint fixes the pose."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from errors.formatting import frequency_text, interval_text, probability_text
from planner.camera.pose import world_to_cam
from planner.report.binding import LimitShare, nearest_limits
from planner.report.tables import budget_bar, cells, heads, permitted, warned
from planner.request.focus_reserve import SIGMAS, sigmas_left
from planner.rows.measured_rows import Row
from planner.verify.simulate_setting import (
    CONFIRMED,
    CONSERVATIVE,
    CONTRADICTED,
    TOLERATED,
    UNSTATED,
)

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting
    from planner.verify.simulate_setting import SuccessRate

# margins are kept up to the rounding of a search that ends at them
_ROUNDING = 1e-3
_STYLES = {
    CONFIRMED: "good",
    CONSERVATIVE: "good",
    TOLERATED: "note",
    CONTRADICTED: "bad",
    UNSTATED: "bad",
}


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
    what = "Nominal" if plan.dimensions else "Length (mm)"
    names = [noun.capitalize(), f"n:{what}", "n:Permitted error", "Budget", "n:P"]
    names += ["n:Simulated", "Interval", ""] if simulated else []
    rows = "".join(_rows(plan, one, what) for one in told)
    windows = ", ".join(f"{one.name} ±{one.search_window_px:.3g} px" for one in told)
    note = f'<p class="note">Search windows: {escape(windows)}.</p>'
    return f'<table class="stack">{heads(names)}<tbody>{rows}</tbody></table>{note}'


def _rows(plan: InspectionPlan, one: Row, what: str) -> str:
    """Return the row of an item, and that of what it warns of."""
    probability = probability_text(one.probability, plan.probability)
    values = {
        "": escape(one.name),
        f"n:{what}": _value(plan, one.name),
        "n:Permitted error": permitted(one),
        "Budget": budget_bar(one),
        "n:P": probability,
        **({} if one.rate is None else _rate(one.rate, plan.probability)),
    }
    below = (
        f'<tr class="warning"><td colspan="8">{escape(warned(one))}</td></tr>'
        if one.warnings
        else ""
    )
    return cells(values) + below


def binding_sentence(plan: InspectionPlan, setting: SensorSetting) -> str:
    """Say which constraint fixes the pose, and what comes next."""
    first, *rest = nearest_limits(plan, setting)
    told = f"Nearest to its limit: {first.name}, with {_share(first)} of its room left; {first.meaning}."
    return told + (
        f" Next: {', '.join(f'{one.name} {_share(one)}' for one in rest)}." if rest else ""
    )


def _share(one: LimitShare) -> str:
    """Return a share in percent; further digits of what is as good as nothing say nothing."""
    return "less than 0.01 %" if 0 <= one.share < 1e-4 else f"{100 * one.share:.3g} %"


def may_be_unsharp(plan: InspectionPlan, setting: SensorSetting) -> bool:
    """Say if a point is less than three standard deviations of its depth from a limit of the depth of field.

    Parameters
    ----------
    plan : InspectionPlan
        Gives camera and uncertainty of the pose.
    setting : SensorSetting
        One of its settings.
    """
    return bool(_focus_sigmas(plan, setting) < SIGMAS - _ROUNDING)


def focus_note(plan: InspectionPlan, setting: SensorSetting) -> str:
    """Say so where displaced poses may be out of focus.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    setting : SensorSetting
        One of its settings.
    """
    if not may_be_unsharp(plan, setting):
        return ""
    return (
        f"Focus: a point that is measured is only {_focus_sigmas(plan, setting):.2g} standard deviations of its depth "
        "from a limit of the depth of field, so images from displaced poses may be less sharp than is asked for."
    )


def _focus_sigmas(plan: InspectionPlan, setting: SensorSetting) -> float:
    """Return how many standard deviations of its own depth the least sure point is from a limit of focus."""
    points = [plan.targets[name].points for name in setting.entities]
    local = world_to_cam(np.concatenate(points), setting.cam2world)
    return sigmas_left(local, plan.camera, plan.pose_uncertainty)


def _value(plan: InspectionPlan, name: str) -> str:
    """Return what an item measures, with the unit where units differ."""
    target = plan.targets[name]
    return target.value_text if plan.dimensions else f"{target.nominal:.3f}"


def _rate(rate: SuccessRate, threshold: float) -> dict[str, str]:
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
    interval = f"{interval_text(rate.low, rate.high)}{bar}"
    return {
        "n:Simulated": frequency_text(rate.successes, rate.n),
        "Interval": interval,
        "Verdict": told,
    }

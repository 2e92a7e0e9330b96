"""One setting in a report: numbers of its camera, a table of its measurements, and the binding constraint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from errors.formatting import frequency_text, interval_text, percent_text
from planner.camera.pose import world_to_cam
from planner.report.binding import LimitShare, nearest_limits
from planner.report.tables import Promised, budget_bar, cells, heads, permitted, warned
from planner.request.focus_reserve import SIGMAS, sigmas_left
from planner.rows.measured_rows import Row
from planner.verify.simulate_setting import (
    CONFIRMED,
    CONSERVATIVE,
    CONTRADICTED,
    TOLERATED,
    UNSTATED,
)
from planner.wanted.planned import targets_of, words_of
from planner.wanted.words.target_words import TargetWords

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting
    from planner.verify.simulate_setting import SuccessRate
    from planner.wanted.planned import PlannedTarget

# margins are kept up to the rounding of a search that ends at them
_ROUNDING = 1e-3
_STYLES = {
    CONFIRMED: "good",
    CONSERVATIVE: "good",
    TOLERATED: "note",
    CONTRADICTED: "bad",
    UNSTATED: "bad",
}


class Stance(NamedTuple):
    """How a camera stands to its targets.

    Attributes
    ----------
    distance_mm : float
        Working distance: mean depth of the targets along the optical axis, from the front nodal point.
    tilt_deg : float
        Angle between the optical axis and the part's z axis, 0 to 90 degrees.
    um_per_px : float
        Size of a pixel at that distance, square to the optical axis; the larger of both sides, um.
    """

    distance_mm: float
    tilt_deg: float
    um_per_px: float

    @property
    def text(self) -> str:
        """The three numbers in words."""
        return (
            f"working distance {self.distance_mm:.0f} mm, tilt {self.tilt_deg:.1f}°, "
            f"{self.um_per_px:.3g} µm/px"
        )


def stance(plan: InspectionPlan, setting: SensorSetting) -> Stance:
    """Return how the camera of a setting stands to its targets.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the camera and the targets.
    setting : SensorSetting
        One of its settings.
    """
    camera = plan.camera
    distance = float(world_to_cam(_points(plan, setting), setting.cam2world)[:, 2].mean())
    upright = min(abs(float(setting.cam2world[2, 2])), 1.0)
    pixel = max(camera.pixel_pitch_mm) * distance / camera.image_distance_mm
    return Stance(distance, math.degrees(math.acos(upright)), 1000 * pixel)


def setting_table(plan: InspectionPlan, measured: Sequence[Row]) -> str:
    """Return the table of a setting: permitted error, budget, probability, simulation and warnings.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    measured : sequence of Row
        The rows of the setting.
    """
    simulated = any(one.rate is not None for one in measured)
    promised = Promised(
        plan, [one.promise for one in measured], [one.probability for one in measured]
    )
    words = words_of(plan.targets)
    names = [
        words.nouns[0].capitalize(),
        f"n:{words.value_head}",
        "n:Permitted error",
        "Budget",
        *promised.heads,
    ]
    names += ["n:Simulated", "Interval", ""] if simulated else []
    rows = "".join(_rows(plan, one, words, promised) for one in measured)
    windows = ", ".join(f"{one.name} ±{one.search_window_px:.3g} px" for one in measured)
    sentence = promised.sentence(len(measured))
    note = f'<p class="note">{escape(sentence)} Search windows: {escape(windows)}.</p>'
    return f'<table class="stack">{heads(names)}<tbody>{rows}</tbody></table>{note}'


def _rows(plan: InspectionPlan, one: Row, words: TargetWords, promised: Promised) -> str:
    """Return the row of a target, and the one of its warnings."""
    target = plan.targets[one.name]
    values = {
        "": escape(one.name),
        f"n:{words.value_head}": words.value.format(target) + _by(one, target),
        "n:Permitted error": permitted(one, target),
        "Budget": budget_bar(one),
        **promised.cells(one.promise, one.probability),
        **({} if one.rate is None else _rate(one.rate, plan.probability)),
    }
    below = (
        f'<tr class="warning"><td colspan="8">{escape(warned(one))}</td></tr>'
        if one.warnings
        else ""
    )
    return cells(values) + below


def _by(one: Row, target: PlannedTarget) -> str:
    """Say by which entities a target is measured, where others could, too."""
    if len(target.ways) == 1:
        return ""
    text = f"by {', '.join(one.entities)}, one of {len(target.ways)} ways"
    return f'<br><span class="note">{escape(text)}</span>'


def passed_over_sentence(setting: SensorSetting) -> str:
    """Say why targets are not measured by their other entities in a setting; empty if there are none."""
    parts = [
        f"{name} by {entities}: {why}"
        for name, others in setting.passed_over.items()
        for entities, why in others.items()
    ]
    return f"Other ways to measure, not used here: {'; '.join(parts)}." if parts else ""


def binding_sentence(plan: InspectionPlan, setting: SensorSetting) -> str:
    """Say which constraint fixes the pose, and what comes next."""
    first, *rest = nearest_limits(plan, setting)
    text = f"Tightest constraint: {first.name}, with {_share(first)} of its margin left: {first.meaning}."
    return text + (
        f" Next: {', '.join(f'{one.name} {_share(one)}' for one in rest)}." if rest else ""
    )


def _share(one: LimitShare) -> str:
    """Return a share in percent; a share close to 0 without its digits."""
    return "less than 0.01 %" if 0 <= one.share < 1e-4 else percent_text(one.share)


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
    """Return a warning if displaced poses may be out of focus; otherwise nothing.

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
        f"Focus: a measured point is only {_focus_sigmas(plan, setting):.2g} standard deviations of its depth from a "
        "limit of the depth of field. Images from displaced poses may be less sharp than required."
    )


def _focus_sigmas(plan: InspectionPlan, setting: SensorSetting) -> float:
    """Return how many standard deviations of its own depth the least sure point is from a limit of focus."""
    local = world_to_cam(_points(plan, setting), setting.cam2world)
    return sigmas_left(local, plan.camera, plan.pose_uncertainty)


def _points(plan: InspectionPlan, setting: SensorSetting) -> np.ndarray:
    """Return the points (n, 3) that a setting measures, mm."""
    targets = targets_of(plan.targets, setting)
    return np.concatenate([targets[name].points for name in setting.entities])


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
    word = f'<span class="{_STYLES[rate.verdict]}">{escape(rate.verdict)}</span>'
    interval = f"{interval_text(rate.low, rate.high)}{bar}"
    return {
        "n:Simulated": frequency_text(rate.successes, rate.n),
        "Interval": interval,
        "Verdict": word,
    }

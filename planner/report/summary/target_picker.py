"""Choosing a target in the 3-D view: what each setting measures of it, and by which witness."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.report.figure import color_of
from planner.report.outlines import lines_of, polylines
from planner.report.wording import count
from planner.wanted.planned import PlannedDimension, words_of

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting

# digits behind the point, mm
_DIGITS = 3


class TargetPicker(NamedTuple):
    """What a page needs to choose targets.

    Attributes
    ----------
    html : str
        The list to choose from; empty if nothing is measured.
    data : str
        JSON of what each entry shows, by its value in the list.
    """

    html: str
    data: str


def target_picker(plan: InspectionPlan) -> TargetPicker:
    """Return a list of the targets of each setting, and what is shown of each.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    shown: dict[str, dict[str, Any]] = {}
    groups = []
    for k, setting in enumerate(plan.settings):
        values = {f"{k + 1}:{i}": name for i, name in enumerate(setting.entities)}
        shown |= {value: _shown(plan, k, name) for value, name in values.items()}
        groups.append(_group(f"Setting {k + 1}", values))
    if plan.uninspectable:
        missing = {f"none:{i}": name for i, name in enumerate(plan.uninspectable)}
        shown |= {value: _not_inspected(plan, name) for value, name in missing.items()}
        groups.append(_group("Not inspected", missing))
    if not groups:
        return TargetPicker("", "{}")
    one, several = words_of(plan.targets).nouns
    html = (
        f'<p class="pick"><label for="target">{escape(one.capitalize())} to show</label> '
        f'<select id="target"><option value="">All {escape(several)}</option>{"".join(groups)}</select></p>'
        '<p id="ways" class="note" aria-live="polite"></p>'
    )
    # no text of a plan may end the script
    return TargetPicker(html, json.dumps(shown, sort_keys=True).replace("<", "\\u003c"))


def _group(label: str, names: dict[str, str]) -> str:
    options = "".join(
        f'<option value="{value}">{escape(name)}</option>' for value, name in names.items()
    )
    return f'<optgroup label="{label}">{options}</optgroup>'


def _shown(plan: InspectionPlan, k: int, name: str) -> dict[str, Any]:
    """Return the lines by which a setting measures a target, those of its other witnesses, and what to say."""
    setting = plan.settings[k]
    target = plan.targets[name]
    others: list[NDArray[np.float64]] = []
    if isinstance(target, PlannedDimension):
        used = setting.witness.get(name, 0)
        others = [
            line
            for i, way in enumerate(target.witnesses)
            if i != used
            for line in lines_of(way.geometry)
        ]
    return {
        "color": color_of(k),
        "lines": _rounded(polylines(plan, name, setting)),
        "others": _rounded(others),
        "setting": k + 1,
        "text": _text(plan, k, name),
    }


def _not_inspected(plan: InspectionPlan, name: str) -> dict[str, Any]:
    return {
        "color": "#c0152f",
        "lines": _rounded(polylines(plan, name)),
        "others": [],
        "setting": None,
        "text": f"{name} is not inspected: {plan.uninspectable[name]}",
    }


def _text(plan: InspectionPlan, k: int, name: str) -> str:
    """Say by which witness a setting measures a target, why by no other, and which settings measure it, too."""
    setting = plan.settings[k]
    target = plan.targets[name]
    text = f"Setting {k + 1} measures {name}"
    if isinstance(target, PlannedDimension):
        used = target.choosing(setting.witness.get(name, 0))
        text += f" by {' and '.join(used.entities)}"
        if len(target.ways) > 1:
            text += f", one of {count(len(target.ways), 'way')}{_passed_over(setting, name)}"
    others = [str(i + 1) for i, one in enumerate(plan.settings) if i != k and name in one.entities]
    too = f" Measured in setting {' and '.join(others)}, too." if others else ""
    return f"{text}.{too}"


def _passed_over(setting: SensorSetting, name: str) -> str:
    over = setting.passed_over.get(name, {})
    parts = [f"{entities}: {reason}" for entities, reason in over.items()]
    return f". Not used: {'; '.join(parts)}" if parts else ""


def _rounded(lines: Iterable[Sequence[Any] | NDArray[np.float64]]) -> list[list[list[float]]]:
    return [np.round(np.asarray(line, dtype=np.float64), _DIGITS).tolist() for line in lines]

"""Tables of a report as HTML: results by target, and poses for the robot's programmer."""

from __future__ import annotations

import base64
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from errors.formatting import (
    frequency_text,
    interval_text,
    is_nearly_one,
    percent_text,
    probability_text,
)
from errors.measurands.measurand import SOURCES
from planner.camera.pose import world_to_cam
from planner.report.wording import names_by_reason
from planner.request.camera_limits import (
    SIGMAS,
    FocusReserve,
    probability_share,
    rooms,
    shares,
    sigmas_left,
)
from planner.request.targets import targets_of, words_of
from planner.request.words import TargetWords
from planner.rows import Row
from planner.sensor_setting import ReasonKind, kind_of
from planner.verify.simulate_setting import (
    CONFIRMED,
    CONSERVATIVE,
    CONTRADICTED,
    TOLERATED,
    UNSTATED,
)

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.request.targets import Target
    from planner.rows import WarningKind
    from planner.sensor_setting import SensorSetting
    from planner.verify.simulate_setting import SuccessRate


COLOURS = {
    "translation": "#56b4e9",
    "rotation": "#d58a00",
    "localisation": "#7a8794",
    "localisation_floor": "#3d454d",
    "surfaces": "#009e73",
}
"""Of the sources of variance, in every bar."""


def promise_name(plan: InspectionPlan) -> str:
    """Return "P_all", or "P" of a plan that did not count it."""
    return "P_all" if any(setting.p_all for setting in plan.settings) else "P"


class Promised:
    """How tables show what is promised of targets: in columns, or in a sentence where it is the same for all.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    promises : iterable of float
        P_all of each row of a table, or P where that was not counted.
    probabilities : iterable of float
        P of each row.
    """

    def __init__(
        self, plan: InspectionPlan, promises: Iterable[float], probabilities: Iterable[float]
    ):
        self._required = plan.probability
        self.name = promise_name(plan)
        texts = {self.text(value) for value in promises}
        self._own = len(texts) > 1
        self._least = min(texts) if texts else ""
        # beside P_all
        self._error = self.name == "P_all" and not all(
            is_nearly_one(value, self._required) for value in probabilities
        )

    def text(self, value: float) -> str:
        """Return a probability."""
        return probability_text(value, self._required)

    @property
    def heads(self) -> list[str]:
        """Heads of the columns."""
        return [*([f"n:{self.name}"] if self._own else []), *(["n:P"] if self._error else [])]

    def cells(self, promise: float, probability: float) -> dict[str, str]:
        """Return the cells of a row, by head."""
        values = (promise, probability) if self._own else (probability,)
        return {head: self.text(value) for head, value in zip(self.heads, values, strict=False)}

    def sentence(self, n: int) -> str:
        """Say what is the same for all n rows; nothing if a column shows it."""
        if self._own or not n:
            return ""
        return f"{self.name} is {self._least} for {'each target' if n > 1 else 'the target'}."


def results(plan: InspectionPlan, rows: Sequence[Sequence[Row]], noun: str) -> str:
    """Return a table with a row per target: its setting with the largest promise, in the order of the request."""
    best: dict[str, Row] = {}
    for row in (row for setting in rows for row in setting):
        if row.name not in best or row.promise > best[row.name].promise:
            best[row.name] = row
    if not best:
        return ""
    where = {
        name: [row.setting for setting in rows for row in setting if row.name == name]
        for name in best
    }
    promised = Promised(
        plan,
        [row.promise for row in best.values()],
        [row.probability for row in best.values()],
    )
    lines = [
        _result(plan, best[name], where[name], promised) for name in plan.entities if name in best
    ]
    names = [noun.capitalize(), "What", "n:Nominal", "n:Permitted error", "n:U (k = 2)"]
    names += ["n:U / permitted", "Setting", *promised.heads, "Budget of the variance"]
    legend = " ".join(
        f'<span class="source"><i style="background:{COLOURS[s]}"></i>{source_text(s)}</span>'
        for s in SOURCES
    )
    return (
        f'<div class="scroll"><table class="stack results">{heads(names)}<tbody>{"".join(lines)}</tbody>'
        f'</table></div><p class="note">{legend} &nbsp; U = 2u, where u is the standard uncertainty of the measured '
        f"value. U / permitted is the share of the permitted error that U takes. "
        f"Values are those of the setting with the largest {promised.name}. "
        f"{escape(promised.sentence(len(best)))}</p>"
    )


def _result(plan: InspectionPlan, row: Row, where: Sequence[int], promised: Promised) -> str:
    links = ", ".join(map(setting_link, where))
    expanded = 2 * row.standard_uncertainty
    mark = f' <span class="bad" title="{escape(warned(row))}">!</span>' if row.warnings else ""
    return cells(
        {
            "": f"{escape(row.name)}{mark}",
            "What": escape(row.kind.replace("_", " ")),
            "n:Nominal": f"{row.nominal:.6g} {row.unit}",
            "n:Permitted error": permitted(row, plan.targets[row.name]),
            "n:U": f"{expanded:.3g} {row.unit}",
            "n:U / permitted": _percent(expanded / row.permitted_error),
            "Setting": links,
            **promised.cells(row.promise, row.probability),
            "Budget": budget_bar(row),
        }
    )


def _percent(share: float) -> str:
    """Return a share in percent with two digits, or all that stand before the point."""
    text = f"{100 * share:.2g}" if share < 0.995 else f"{100 * share:.0f}"
    return f"{text} %"


def unbroken(text: str) -> str:
    """Return a text whose words stay on one line, such as a number and its unit.

    Parameters
    ----------
    text : str
        Without markup.
    """
    return escape(text).replace(" ", "&nbsp;")


def heads(names: Sequence[str]) -> str:
    """Return the head of a table; names of columns of numbers start with ``n:``."""
    texts = "".join(f"<th{_kind(name)}>{_plain(name)}</th>" for name in names)
    return f"<thead><tr>{texts}</tr></thead>"


def cells(values: Mapping[str, str]) -> str:
    """Return a row of a table from HTML by column; each cell knows its column, for pages too narrow for a head."""
    told = "".join(
        f'<td{_kind(name)} data-label="{escape(_plain(name))}">{value}</td>'
        for name, value in values.items()
    )
    return f"<tr>{told}</tr>"


def _kind(name: str) -> str:
    return ' class="n"' if name.startswith("n:") else ""


def _plain(name: str) -> str:
    return name.removeprefix("n:")


def warned(row: Row) -> str:
    """Return what a row warns of, in one line."""
    return "; ".join(warning.text for warning in row.warnings)


def permitted(row: Row, target: Target) -> str:
    """Return the permitted error, its size in the image, and its share of the tolerance if there is one."""
    more = [] if row.permitted_error_px is None else [f"{row.permitted_error_px:.3g} px"]
    more += [target.share_text] if target.share_text else []
    text = f"±{row.permitted_error:.3g} {row.unit}"
    return f"{text} ({', '.join(more)})" if more else text


def source_text(source: str) -> str:
    """Return a source of variance in words."""
    return source.replace("_", " ")


def budget_bar(row: Row) -> str:
    """Return a bar with the share of each source of variance; its title has the numbers."""
    total = sum(row.budget.values())
    if not total > 0:
        return ""
    shares = {source: 100 * row.budget.get(source, 0.0) / total for source in SOURCES}
    title = ", ".join(f"{source_text(source)} {share:.0f} %" for source, share in shares.items())
    parts = "".join(
        f'<i style="width:{share:.1f}%;background:{COLOURS[s]}"></i>' for s, share in shares.items()
    )
    return f'<span class="budget" title="{title}">{parts}</span>'


def robot(plan: InspectionPlan) -> str:
    """Return the poses in the order of travel: front nodal point, quaternion, and roll, pitch, yaw."""
    if not plan.settings:
        return ""
    return arm(plan) + _poses(plan)


def arm(plan: InspectionPlan) -> str:
    """Return how the robot stands in each setting of a plan for a cell; nothing of another plan."""
    if not plan.cell:
        return ""
    body = []
    turns = any(setting.angle_deg is not None for setting in plan.settings)
    for k, setting in enumerate(plan.settings, start=1):
        if not setting.fixturing:
            continue
        cells = [f"<td>{escape(setting.fixturing)}</td>"]
        if turns:
            angle = "" if setting.angle_deg is None else f"{setting.angle_deg:g}"
            cells.append(f"<td class=n>{angle}</td>")
        cells += [f"<td class=n>{np.degrees(angle) + 0.0:.2f}</td>" for angle in setting.joints]
        cells.append(f"<td class=n>{setting.arm['clearance_robot_mm']:.1f}</td>")
        cells.append(f"<td>{escape(setting.arm.get('closest', ''))}</td>")
        cells.append(f"<td class=n>{np.degrees(setting.arm['to_limit_rad']):.0f}</td>")
        cells.append(f"<td class=n>{setting.arm['singular_value']:.2f}</td>")
        body.append(f"<tr><td>{setting_link(k)}</td>{''.join(cells)}</tr>")
    joints = "".join(f'<th class="n">Joint {k} (°)</th>' for k in range(1, 7))
    table = "<th class=n>Turntable (°)</th>" if turns else ""
    head = (
        f"<th>Setting</th><th>Part lies</th>{table}{joints}<th class=n>Clearance (mm)</th><th>between</th>"
        "<th class=n>To limit (°)</th><th class=n>Singular value</th>"
    )
    return (
        f'<div class="scroll"><table class="arm"><thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table>'
        f"</div><p class='note'>{escape(plan.cell['robot'])} reaches these settings. The clearance is the distance of "
        "arm or camera from the nearest object, or of two links nearer than 5 mm. The limit is that of the nearest "
        "joint. At a singular value of 0 "
        "joints turn fast for a slow camera. Its lengths are divided by 500 mm.</p>"
    )


def _poses(plan: InspectionPlan) -> str:
    body = []
    for k, setting in enumerate(plan.settings, start=1):
        turn = Rotation.from_matrix(setting.cam2world[:3, :3])
        cells = [
            *(f"{c:.3f}" for c in setting.position),
            *(f"{c:.6f}" for c in turn.as_quat(canonical=True)),
        ]
        with warnings.catch_warnings():
            # of two angles about one axis, one is 0 then
            warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
            cells += [f"{c:.3f}" for c in turn.as_euler("xyz", degrees=True)]
        body.append(
            f"<tr><td>{setting_link(k)}</td>{''.join(f'<td class=n>{cell}</td>' for cell in cells)}</tr>"
        )
    names = ("x (mm)", "y (mm)", "z (mm)", "qx", "qy", "qz", "qw", "Rx (°)", "Ry (°)", "Rz (°)")
    head = "<th>Setting</th>" + "".join(f'<th class="n">{name}</th>' for name in names)
    return (
        f'<div class="scroll"><table class="poses"><thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table>'
        "</div><p class='note'>Poses are camera to part: x, y, z are the front nodal point in the part's frame. The "
        "quaternion has w last. Rx, Ry, Rz are rotations about the fixed axes x, y, z, in this order. The camera looks "
        "along its own z axis; x points right and y down in the image. The same poses are in "
        "<code>poses_opencv.json</code>, <code>poses_ros.yaml</code>, <code>transforms.json</code>, "
        "<code>poses_open3d.json</code> and <code>colmap/</code> next to this file.</p>"
    )


def download(text: str, name: str, label: str) -> str:
    """Return a link that saves a text; it needs nothing outside the page."""
    data = base64.b64encode(text.encode()).decode()
    return f'<a download="{escape(name)}" href="data:text/csv;charset=utf-8;base64,{data}">{escape(label)}</a>'


def setting_link(number: int) -> str:
    """Return a link to a setting, counted from 1."""
    return f'<a href="#setting-{number}">{number}</a>'


# Which constraint fixes the pose of a setting: how near each is to its limit, on one scale.


_MEANS = {
    "focus": "the depth of field fixes the distance",
    "field of view": "a target is close to the side of the sensor",
    "resolution": "farther away, the image of an edge would be too short",
    "workspace": "the camera is at a wall of its workspace",
    "clearance": "the camera is as close to the part as it may be",
    "separation": "another line is close to an edge in the image",
    "corner": "the lines at the end of an edge meet at a small angle in the image",
    "probability": "the required probability fixes the pose",
}


class LimitShare(NamedTuple):
    """How near a setting is to a constraint.

    Attributes
    ----------
    name : str
        The constraint in words.
    share : float
        Share of its room that is left; 0: at its limit.
    meaning : str
        What a small share means.
    key : str or None
        Its margin's key in the setting's margins; None of the probability, which is no margin.
    """

    name: str
    share: float
    meaning: str
    key: str | None = None


def nearest_limits(plan: InspectionPlan, setting: SensorSetting) -> list[LimitShare]:
    """Return constraints by what they leave, the one that binds first.

    The rooms are those of `planner.request.camera_limits`. What is met or missed without a number,
    such as visibility, is not among them.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the request.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    list of LimitShare
        Those the plan knows enough of.
    """
    reserve_mm = 0.0
    if plan.requirements.get("focus_sigmas", 0.0) > 0.0:
        reserve_mm = FocusReserve.of(plan.camera, plan.pose_uncertainty).on_axis_mm
    room = rooms(plan.camera, plan.workspace, plan.requirements, reserve_mm)
    least = probability_share(min(setting.promise.values()), plan.probability)
    found = [LimitShare("probability", float(least), _MEANS["probability"])]
    finite = {key: margin for key, margin in setting.margins.items() if np.isfinite(margin)}
    for key, share in shares(finite, room).items():
        name = key.rpartition("_")[0].replace("_", " ")
        found.append(LimitShare(name, float(share), _MEANS[name], key))
    return sorted(found, key=lambda one: one.share)


# One setting in a report: numbers of its camera, a table of its measurements, and the binding
# constraint.


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


def _by(one: Row, target: Target) -> str:
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


# What a reader should look at first: targets that are not inspected, and warnings.


FEW = 6
"""Up to this many warnings of a kind, or targets without a setting, are listed one by one at the head of the page."""


def attention(rows: Sequence[Sequence[Row]], unsharp: Sequence[int] = ()) -> str:
    """Return all warnings, by kind; nothing if there are none.

    Parameters
    ----------
    rows : sequence of sequence of Row
        The rows of each setting.
    unsharp : sequence of int
        Settings, from 1, in which displaced poses may be out of focus, see `may_be_unsharp`.
    """
    kinds: dict[WarningKind, list[tuple[Row, str]]] = {}
    for row in (row for setting in rows for row in setting):
        for warning in row.warnings:
            kinds.setdefault(warning.kind, []).append((row, warning.text))
    told = [line for kind, found in kinds.items() for line in _kind_of_attention(kind, found)]
    if unsharp:
        which = ", ".join(map(setting_link, unsharp))
        told.append(
            f"<b>Narrow margin of focus</b> in setting{'s' * (len(unsharp) > 1)} {which}: a point is less than "
            "three standard deviations of its depth from a limit. --focus-margin-mm sets a larger margin"
        )
    if not told:
        return ""
    lines = "".join(f"<li>{one}</li>" for one in told)
    return f'<h2 id="look">Worth a look</h2><ul class="warnings">{lines}</ul>'


def _kind_of_attention(kind: WarningKind, found: Sequence[tuple[Row, str]]) -> list[str]:
    """Return a line per warning if they are few, else one for all."""
    if len(found) <= FEW:
        return [
            f"<b>{escape(row.name)}</b> (setting {setting_link(row.setting)}): {escape(t)}"
            for row, t in found
        ]
    settings: dict[str, list[int]] = {}
    for row, _ in found:
        settings.setdefault(row.name, []).append(row.setting)
    names = ", ".join(
        f"{escape(name)} ({', '.join(map(setting_link, where))})"
        for name, where in settings.items()
    )
    return [f"<b>{escape(kind.value)}</b> in {len(found)} measurements: {names}"]


def not_inspected(reasons: Mapping[str, str], noun: str) -> str:
    """Return what is in no setting: each with its reason, or of many their number and names by kind of reason.

    Parameters
    ----------
    reasons : mapping of str to str
        By name; a `Reason` has a kind.
    noun : str
        What a target is called.
    """
    if not reasons:
        return ""
    head = '<h2 class="bad">Not inspected</h2>'
    if len(reasons) <= FEW:
        return head + _table(reasons, noun)
    kinds: dict[ReasonKind, list[str]] = {}
    for name, why in reasons.items():
        kinds.setdefault(kind_of(why), []).append(name)
    lines = "".join(
        f"<li><b>{escape(kind.words)}</b> ({len(names)}): {escape(', '.join(names))}</li>"
        for kind, names in kinds.items()
    )
    told = '<p class="note"><a href="#reasons">See the reason of each.</a></p>'
    return f'{head}{told}<ul class="warnings">{lines}</ul>'


def reasons_section(reasons: Mapping[str, str], noun: str) -> str:
    """Return why each is not inspected, if the head of the page only counts them; otherwise nothing.

    Parameters
    ----------
    reasons : mapping of str to str
        By name.
    noun : str
        What an item is called.
    """
    if len(reasons) <= FEW:
        return ""
    return f'<h2 id="reasons">Reasons for targets not inspected</h2>{_table(reasons, noun)}'


def _table(reasons: Mapping[str, str], noun: str) -> str:
    rows = "".join(
        f"<tr><td>{', '.join(map(unbroken, names))}</td><td>{escape(why)}</td></tr>"
        for why, names in names_by_reason(reasons).items()
    )
    head = f"<thead><tr><th>{noun.capitalize()}</th><th>Reason</th></tr></thead>"
    return f'<div class="scroll"><table>{head}<tbody>{rows}</tbody></table></div>'

"""Tables of a report: results by target, poses for the robot's programmer, and what deserves a look."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from errors.checks import (
    frequency_text,
    interval_text,
    is_nearly_one,
    percent_text,
    probability_text,
)
from errors.measurands.measurand import SOURCES
from planner.camera.pose import world_to_cam
from planner.report.wording import entities_words, entity_words, names_by_reason
from planner.request.camera_limits import (
    SIGMAS,
    FocusReserve,
    probability_share,
    rooms,
    shares,
    sigmas_left,
)
from planner.request.targets import targets_of, words_of
from planner.request.words import amount_text
from planner.rows import Row, split_rows
from planner.sensor_setting import kind_of
from planner.text_table import Column, Table, digits_text
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
    "edge_state": "#cc79a7",
}
"""Of the sources of variance, in every bar."""


class CellLine(NamedTuple):
    """A line of a cell, its class in the page, and the label of a cell that it begins where rows are stacked."""

    text: str
    style: str = ""
    label: str = ""


class Share(NamedTuple):
    """What a source contributes to a variance: its name in words, percent, and its colour."""

    source: str
    percent: float
    color: str

    @property
    def text(self) -> str:
        """Name and percent, on one line."""
        return unbroken(f"{self.source} {self.percent:.1f} %")


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
        self._differs = len(texts) > 1
        self._smallest = min(texts) if texts else ""
        # beside P_all
        self._has_error = self.name == "P_all" and not all(
            is_nearly_one(value, self._required) for value in probabilities
        )

    def text(self, value: float) -> str:
        """Return a probability."""
        return probability_text(value, self._required)

    @property
    def columns(self) -> list[Column]:
        """The columns."""
        names = [*([self.name] if self._differs else []), *(["P"] if self._has_error else [])]
        return [Column(name, right=True) for name in names]

    def cells(self, promise: float, probability: float) -> list[str]:
        """Return the cells of a row."""
        values = (promise, probability) if self._differs else (probability,)
        return [self.text(value) for _, value in zip(self.columns, values, strict=False)]

    def sentence(self, n: int) -> str:
        """Say what is the same for all n rows; nothing if a column shows it."""
        if self._differs or not n:
            return ""
        return f"{self.name} is {self._smallest} for {'each target' if n > 1 else 'the target'}."


def results(plan: InspectionPlan, rows: Sequence[Sequence[Row]], noun: str) -> Table | None:
    """Return a row per target: its setting with the largest promise, in the order of the request."""
    best: dict[str, Row] = {}
    settings: dict[str, list[int]] = {}
    for row in (row for setting in rows for row in setting):
        settings.setdefault(row.name, []).append(row.setting)
        if row.name not in best or row.promise > best[row.name].promise:
            best[row.name] = row
    if not best:
        return None
    best |= {row.name: row for row in split_rows(plan)}
    promised = Promised(
        plan,
        [row.promise for row in best.values()],
        [row.probability for row in best.values()],
    )
    columns = [
        Column(noun.capitalize(), kind="name"),
        Column("What"),
        Column("Nominal", right=True),
        Column("Permitted error", right=True),
        Column("U (k = 2)", right=True),
        Column("U / permitted", right=True),
        Column("Setting", kind="settings"),
        *promised.columns,
        Column("Budget of the variance", kind="budget"),
    ]
    values = [
        _result(plan, best[name], settings[name], promised)
        for name in plan.entities
        if name in best
    ]
    note = f"Values are those of the setting with the largest {promised.name}."
    notes = [f"{note} {promised.sentence(len(best))}"]
    return Table(columns, values, style="stack results", notes=notes)


def _result(
    plan: InspectionPlan, row: Row, settings: Sequence[int], promised: Promised
) -> list[Any]:
    expanded = 2 * row.standard_uncertainty
    return [
        (row.name, warned(row)),
        row.kind.replace("_", " "),
        plan.targets[row.name].nominal_text,
        permitted(row, plan.targets[row.name]),
        amount_text(digits_text(expanded, 3), row.unit),
        _percent(expanded / row.permitted_error),
        settings,
        *promised.cells(row.promise, row.probability),
        budget_shares(row),
    ]


def _percent(share: float) -> str:
    """Return a share in percent with two digits, or all that stand before the point."""
    text = f"{100 * share:.2g}" if share < 0.995 else f"{100 * share:.0f}"
    return f"{text} %"


def unbroken(text: str) -> str:
    """Return a text whose words stay on one line, such as a number and its unit.

    Parameters
    ----------
    text : str
        The text.
    """
    return text.replace(" ", "\u00a0")


def warned(row: Row) -> str:
    """Return what a row warns of, in one line."""
    return "; ".join(warning.text for warning in row.warnings)


def permitted(row: Row, target: Target) -> str:
    """Return the permitted error, its size in the image, and its share of the tolerance if there is one."""
    more = (
        [] if row.permitted_error_px is None else [f"{digits_text(row.permitted_error_px, 3)} px"]
    )
    more += [target.share_text] if target.share_text else []
    text = amount_text(f"±{digits_text(row.permitted_error, 3)}", row.unit)
    return f"{text} ({', '.join(more)})" if more else text


def source_text(source: str) -> str:
    """Return a source of variance in words."""
    return source.replace("_", " ")


def budget_shares(row: Row) -> list[Share]:
    """Return the share of each source of variance; none where there is no variance."""
    total = sum(row.budget.values())
    if not total > 0:
        return []
    return [
        Share(source_text(source), 100 * row.budget.get(source, 0.0) / total, COLOURS[source])
        for source in SOURCES
        if row.budget.get(source)
    ]


def arm(plan: InspectionPlan) -> Table | None:
    """Return how the robot stands in each setting of a plan for a cell; nothing of another plan."""
    if not plan.cell or not plan.settings:
        return None
    turns = any(setting.angle_deg is not None for setting in plan.settings)
    n_joints = max(len(setting.joints) for setting in plan.settings)
    columns = [
        Column("Setting", kind="settings"),
        Column("Part lies"),
        *([Column("Turntable", right=True, unit="°", spec="g")] if turns else []),
        *(Column(f"Joint {k}", right=True, unit="°", spec=".2f") for k in range(1, n_joints + 1)),
        Column("Clearance", right=True, unit="mm", spec=".1f"),
        Column("Between"),
        Column("To limit", right=True, unit="°", spec=".0f"),
        Column("Singular value", right=True, spec=".2f"),
    ]
    rows = [
        [
            [number],
            setting.fixturing,
            *([setting.angle_deg] if turns else []),
            *(float(angle) + 0.0 for angle in np.degrees(setting.joints)),
            setting.arm["clearance_robot_mm"],
            setting.arm.get("closest", ""),
            float(np.degrees(setting.arm["to_limit_rad"])),
            setting.arm["singular_value"],
        ]
        for number, setting in enumerate(plan.settings, start=1)
        if setting.fixturing
    ]
    return Table(columns, rows, style="stack arm")


def clearance_sentence(plan: InspectionPlan) -> str:
    """Say what clearance and limit are, and between which objects the clearance is smallest; empty without a robot.

    Parameters
    ----------
    plan : InspectionPlan
        A plan for a cell.
    """
    arms = {k: setting.arm for k, setting in enumerate(plan.settings, 1) if setting.fixturing}
    if not arms:
        return ""
    nearest = min(arms, key=lambda k: arms[k]["clearance_robot_mm"])
    between = f"between {arms[nearest]['closest']} " if arms[nearest].get("closest") else ""
    return (
        "The clearance is the distance of arm or camera from the nearest object, or of two links nearer than 5 mm. "
        f"The smallest is {arms[nearest]['clearance_robot_mm']:.1f} mm, {between}in setting {nearest}. "
        "The limit is that of the nearest joint."
    )


def poses(plan: InspectionPlan) -> Table:
    """Return the poses in the order of travel: front nodal point, quaternion, and roll, pitch, yaw."""
    columns = [
        Column("Setting", kind="settings"),
        *(Column(name, right=True, unit="mm", spec=".3f") for name in "xyz"),
        *(Column(name, right=True, spec=".6f") for name in ("qx", "qy", "qz", "qw")),
        *(Column(name, right=True, unit="°", spec=".3f") for name in ("Rx", "Ry", "Rz")),
    ]
    rows = []
    for number, setting in enumerate(plan.settings, start=1):
        turn = Rotation.from_matrix(setting.cam2world[:3, :3])
        with warnings.catch_warnings():
            # of two angles about one axis, one is 0 then
            warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
            angles = turn.as_euler("xyz", degrees=True)
        rows.append([[number], *setting.position, *turn.as_quat(canonical=True), *angles])
    return Table(columns, rows, style="stack poses")


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
    share = probability_share(min(setting.promise.values()), plan.probability)
    limits = [LimitShare("probability", float(share), _MEANS["probability"])]
    finite = {key: margin for key, margin in setting.margins.items() if np.isfinite(margin)}
    for key, share in shares(finite, room).items():
        name = key.rpartition("_")[0].replace("_", " ")
        limits.append(LimitShare(name, float(share), _MEANS[name], key))
    return sorted(limits, key=lambda limit: limit.share)


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


def setting_table(plan: InspectionPlan, measured: Sequence[Row]) -> Table:
    """Return the table of a setting: permitted error, budget, probability, simulation and warnings.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    measured : sequence of Row
        The rows of the setting.
    """
    simulated = any(row.rate is not None for row in measured)
    promised = Promised(
        plan, [row.promise for row in measured], [row.probability for row in measured]
    )
    words = words_of(plan.targets)
    columns = [
        Column(words.nouns[0].capitalize()),
        Column(words.value_head, right=True, kind="lines"),
        Column("Permitted error", right=True),
        Column("Budget", kind="budget"),
        *promised.columns,
    ]
    if simulated:
        columns.append(Column("Simulated", right=True))
        columns += [Column("Interval", kind="interval"), Column("", kind="lines")]
    rows = []
    here: Mapping[str, Target] = {}
    if measured:
        here = targets_of(plan.targets, plan.settings[measured[0].setting - 1])
    for row in measured:
        target = here[row.name]
        values = [
            row.name,
            [CellLine(words.value.format(target)), *_by(plan, row)],
            permitted(row, target),
            budget_shares(row),
            *promised.cells(row.promise, row.probability),
        ]
        rows.append(values + (_rate(row.rate, plan.probability) if simulated else []))
    below = {k: warned(row) for k, row in enumerate(measured) if row.warnings}
    windows = ", ".join(f"{row.name} ±{row.search_window_px:.3g} px" for row in measured)
    note = f"{promised.sentence(len(measured))} Search windows: {windows}."
    return Table(columns, rows, style="stack", below=below, notes=[note])


def _by(plan: InspectionPlan, row: Row) -> list[CellLine]:
    """Say by which entities a target is measured, where others could, too, or by one of two."""
    target = plan.targets[row.name]
    if row.name in plan.split:
        other = sum(plan.ends[row.name].values()) + 2 - row.setting
        return [
            CellLine(
                f"by {entity_words(row.entities[0])} alone, the rest in setting {other}", "note"
            )
        ]
    if len(target.ways) == 1:
        return []
    text = f"by {', '.join(map(entity_words, row.entities))}, one of {len(target.ways)} ways"
    return [CellLine(text, "note")]


def passed_over_sentence(setting: SensorSetting) -> str:
    """Say why targets are not measured by their other entities in a setting; empty if there are none."""
    parts = [
        f"{name} by {entities_words(entities)}: {why}"
        for name, others in setting.passed_over.items()
        for entities, why in others.items()
    ]
    return f"Other ways to measure, not used here: {'; '.join(parts)}." if parts else ""


def binding_sentence(plan: InspectionPlan, setting: SensorSetting) -> str:
    """Say which constraint fixes the pose, and what comes next."""
    first, *others = nearest_limits(plan, setting)
    text = f"Tightest constraint: {first.name}, with {_share(first)} of its margin left: {first.meaning}."
    if not others:
        return text
    return f"{text} Next: {', '.join(f'{limit.name} {_share(limit)}' for limit in others)}."


def _share(limit: LimitShare) -> str:
    """Return a share in percent; a share close to 0 without its digits."""
    return "less than 0.01 %" if 0 <= limit.share < 1e-4 else percent_text(limit.share)


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


class Interval(NamedTuple):
    """The interval of a frequency: in words, and where its bar and the prediction are, percent of the width."""

    text: str
    start: float
    width: float
    mark: float


def _rate(rate: SuccessRate | None, threshold: float) -> list[Any]:
    """Return the simulated frequency, its interval with the prediction marked, and the verdict."""
    if rate is None:
        return [None, None, None]
    low_end = min(threshold, rate.low, rate.predicted) - 0.02
    low, high, mark = (
        100 * (value - low_end) / (1.0 - low_end) for value in (rate.low, rate.high, rate.predicted)
    )
    text = interval_text(rate.low, rate.high)
    return [
        frequency_text(rate.successes, rate.n),
        Interval(text, low, max(high - low, 1.5), mark),
        [CellLine(rate.verdict, _STYLES[rate.verdict])],
    ]


# What a reader should look at first: targets that are not inspected, and warnings.


FEW = 6
"""Up to this many warnings of a kind, or targets without a setting, are listed one by one at the head of the page."""


class Notice(NamedTuple):
    """What deserves a look: what it is about, and pieces of text, each before numbers of settings."""

    head: str
    pieces: list[tuple[str, Sequence[int]]]


def attention(rows: Sequence[Sequence[Row]], unsharp: Sequence[int] = ()) -> list[Notice]:
    """Return all warnings, by kind.

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
    notices = [notice for kind, warned in kinds.items() for notice in _notices(kind, warned)]
    if unsharp:
        rule = (
            ": a point is less than three standard deviations of its depth from a limit. "
            "--focus-margin-mm sets a larger margin"
        )
        in_settings = f" in setting{'s' * (len(unsharp) > 1)} "
        notices.append(Notice("Narrow margin of focus", [(in_settings, unsharp), (rule, ())]))
    return notices


def _notices(kind: WarningKind, warned: Sequence[tuple[Row, str]]) -> list[Notice]:
    """Return a notice per warning of targets if they are few, otherwise a single one for all."""
    if len(warned) <= FEW:
        alike: dict[tuple[int, str], list[str]] = {}
        for row, text in warned:
            alike.setdefault((row.setting, text), []).append(row.name)
        return [
            Notice(", ".join(names), [(" (setting ", [setting]), (f"): {text}", ())])
            for (setting, text), names in alike.items()
        ]
    settings: dict[str, list[int]] = {}
    for row, _ in warned:
        settings.setdefault(row.name, []).append(row.setting)
    start = f" in {len(warned)} measurements: "
    pieces: list[tuple[str, Sequence[int]]] = []
    for name, numbers in settings.items():
        pieces.append((f"{start}{name} (", numbers))
        start = "), "
    return [Notice(kind.value, [*pieces, (")", ())])]


def not_planned(reasons: Mapping[str, str]) -> Table | None:
    """Return what the CAD model requires and the plan leaves out; None if there is nothing.

    Parameters
    ----------
    reasons : mapping of str to str
        By name.
    """
    if not reasons:
        return None
    rows = [
        (", ".join(map(unbroken, names)), len(names), reason)
        for reason, names in names_by_reason(reasons).items()
    ]
    return Table([Column("Requirement"), Column("Number", right=True), Column("Reason")], rows)


class NotInspected(NamedTuple):
    """Targets in no setting: the reason of each, and the names by kind of reason where they are many."""

    table: Table
    kinds: dict[str, list[str]]


def not_inspected(reasons: Mapping[str, str], noun: str) -> NotInspected | None:
    """Return what is in no setting; of many, their names by kind of reason as well.

    Parameters
    ----------
    reasons : mapping of str to str
        By name; a `Reason` has a kind.
    noun : str
        What a target is called.
    """
    if not reasons:
        return None
    kinds: dict[str, list[str]] = {}
    if len(reasons) > FEW:
        for name, reason in reasons.items():
            kinds.setdefault(kind_of(reason).words, []).append(name)
    rows = [
        (", ".join(map(unbroken, names)), reason)
        for reason, names in names_by_reason(reasons).items()
    ]
    return NotInspected(Table([Column(noun.capitalize()), Column("Reason")], rows), kinds)

"""Tables of a report as HTML: results by target, and poses for the robot's programmer."""

from __future__ import annotations

import base64
import warnings
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from errors.formatting import is_nearly_one, probability_text
from planner.rows.measured_rows import SOURCES, Row

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.wanted.planned import PlannedTarget

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


def permitted(row: Row, target: PlannedTarget) -> str:
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

"""A plan as rows: for data frames, for CSV files, and as a table that notebooks show."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from planner.argument_kinds import check_kinds, check_path
from planner.files import write_text
from planner.request.words import amount_text
from planner.text_table import Column, Table, count, data_frame, digits_text

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from aspectgraph import Solid
    from planner.request.reach import Space
    from planner.request.targets import Target
    from planner.rows import Row


_ROTATION_VECTOR = ("rotvec_x", "rotvec_y", "rotvec_z")
_DEG = math.degrees(1.0)
# what a notebook shows of a plan
_SHOWN_TARGETS = 12


_ARM_HEADINGS = (
    "part lies",
    "joints (°)",
    "clearance (mm)",
    "to limit (°)",
    "singular value",
)


def _arm_cells(setting: Any) -> tuple[str, ...]:
    """Return how the robot stands in a setting, a text for each of the headings."""
    turned = "" if setting.angle_deg is None else f", table at {setting.angle_deg:g}°"
    closest = setting.arm.get("closest", "")
    between = f" between {closest}" if closest else ""
    return (
        f"{setting.fixturing}{turned}",
        # adding 0 turns a negative zero into 0
        ", ".join(f"{round(angle * _DEG, 1) + 0.0:.1f}" for angle in setting.joints),
        f"{setting.arm['clearance_robot_mm']:.1f}{between}",
        f"{setting.arm['to_limit_rad'] * _DEG:.0f}",
        f"{setting.arm['singular_value']:.2f}",
    )


class PlanTables(ShownInNotebook):
    """What an `InspectionPlan` shows of itself; it brings the fields."""

    settings: tuple[Any, ...]
    uninspectable: Mapping[str, str]
    lower_bound: int
    unfinished: bool
    simulation: Any
    light: Any
    cell: Mapping[str, Any]

    if TYPE_CHECKING:

        @property
        def part(self) -> str:
            """Name of the part."""

        @property
        def targets(self) -> Mapping[str, Target]:
            """What is measured, by name."""

        @property
        def accuracy(self) -> float:
            """Required accuracy."""

        @property
        def probability(self) -> float:
            """Required probability."""

        @property
        def features_text(self) -> str:
            """Words on the characteristics that are left out."""

        @property
        def unlit(self) -> tuple[str, ...]:
            """Targets that no lamp shows."""

        @property
        def light_missing(self) -> bool:
            """Whether light of the request is not planned."""

    def ends_of(self, setting: Any, name: str) -> np.ndarray:
        """Return two points far apart of what a setting measures a target from.

        Parameters
        ----------
        setting : SensorSetting
            One of its settings.
        name : str
            A target that it measures.

        Returns
        -------
        array (2, 3)
            mm, in the part's frame.
        """
        from planner.request.targets import targets_of

        if name not in getattr(setting, "witness", {}):
            return self.targets[name].ends
        points = targets_of(self.targets, setting)[name].points
        apart = np.linalg.norm(points[:, None] - points, axis=-1)
        return np.asarray(points[list(np.unravel_index(np.argmax(apart), apart.shape))])

    def rows(self) -> list[dict[str, Any]]:
        """Return all measurements as rows, one per setting and entity.

        ``pandas.DataFrame(plan.rows())`` makes a table of them.

        Returns
        -------
        list of dict
            A row has ``setting`` (from 1), ``name``, ``kind``, ``entities``, ``nominal``,
            ``permitted_error`` and ``unit``. ``entities`` are the ids that the setting measures it
            from. Of a target that is not inspected they are all sets that could. ``n_features``
            counts the features of the target, of which one is measured; it is 1 unless the request
            asks for one feature per pattern.
            ``permitted_error_px`` is the error in the image (None for angles). ``p_all`` is the
            probability that the displaced camera measures the target, see `SensorSetting` (None if
            it was not counted). ``probability`` is that of the error alone. ``simulated``,
            ``simulated_low``, ``simulated_high`` and ``verdict`` come from the simulation, or are
            None. ``standard_uncertainty`` is u of the measured value. ``measured_uncertainty`` is the
            expanded uncertainty U that `measure` will state. ``unseen_uncertainty`` is U with breaks of edges
            that images may not show. Both are None of lengths of edges. ``variance_translation``,
            ``variance_rotation``, ``variance_localisation``, ``variance_localisation_floor``,
            ``variance_surfaces`` and ``variance_edge_state`` add up to u² (None for short arcs).
            ``search_window_px`` is the distance to search on either side of the prediction.
            ``warnings`` holds sentences or None. ``reason`` is None in these rows. ``x``, ``y``,
            ``z`` are the camera's position in mm. ``rotvec_x``, ``rotvec_y``,
            ``rotvec_z`` are its rotation vector, camera to part, in degrees: no angles about fixed
            axes, which the report states for robots. ``margin_`` with a constraint's name is the smallest margin
            of the setting. Rows of entities that are not inspected follow, with their reason.
            Unknown values are None. All rows have the same keys.
        """
        return self._table().records()

    def _table(self) -> Table:
        """Return all measurements, and then what is not inspected; an empty plan has two columns."""
        from planner.rows import measured_rows

        rows = [
            {**_values(row, self.targets[row.name].n_features), "reason": None, **_pose(setting)}
            for setting, rows in zip(self.settings, measured_rows(self), strict=True)
            for row in rows
        ]
        for name, reason in self.uninspectable.items():
            rows.append({"setting": None, **self._target_values(name), "reason": reason})
        keys = list(dict.fromkeys(key for row in rows for key in row)) or ["setting", "name"]
        columns = [_column(key) for key in keys]
        return Table(columns, [[row.get(key) for key in keys] for row in rows])

    def to_dataframe(self) -> Any:
        """Return `rows` as a data frame of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per setting and entity.

        Raises
        ------
        ImportError
            If pandas is not installed.

        Examples
        --------
        >>> from planner import read_plan
        >>> plan = read_plan("examples/two_pocket_block_plan.json")
        >>> try:
        ...     names = list(plan.to_dataframe()["name"])
        ... except ImportError:
        ...     names = [row["name"] for row in plan.rows()]
        >>> names
        ['e1', 'e4']
        """
        return data_frame(self.rows())

    def plot(self, solid: Solid | None = None, space: Space | None = None) -> go.Figure:
        """Draw the plan in 3-D, like `plan_figure`: part, entities, and cameras in order.

        Parameters
        ----------
        solid : Solid, optional
            The part of the plan. Without it, the figure shows only the targets and cameras.
        space : VisibilityRegions or EntityAspectGraph, optional
            Gives the viewing domains. They are hidden until you click them in the legend.

        Returns
        -------
        plotly.graph_objects.Figure
            A notebook shows it; ``write_html`` saves it.

        Examples
        --------
        >>> from aspectgraph import read_solid
        >>> from planner import read_plan
        >>> plan = read_plan("examples/two_pocket_block_plan.json")
        >>> figure = plan.plot(read_solid("examples/two_pocket_block.off"))
        >>> type(figure).__name__
        'Figure'
        """
        if solid is not None:
            check_kinds(solid=(solid, "Solid"))
        # the pictures are built upon plans, so their package is known by its name here
        figure = import_module("planner.report.figure")
        return figure.plan_figure(self, solid, space)

    def to_csv(self, path: str | os.PathLike[str] | None = None) -> str:
        """Return `rows` as CSV text with a heading (RFC 4180), and write it to a file if given.

        Parameters
        ----------
        path : str or os.PathLike, optional
            The file; an existing one is replaced.

        Returns
        -------
        str
            The text. Headings are the keys of `rows`, with the unit in brackets where the key does not
            state it. None becomes an empty cell. Floats have six digits or fewer, as many as they are
            known to; `rows` has them all. Text that a spreadsheet would run, such as the name
            ``=1+1``, begins with an apostrophe. `read_entities` removes it again.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        text = self._table().csv()
        if path is not None:
            check_path("path", path)
            write_text(path, text)
        return text

    def _notebook_view(self) -> NotebookView:
        """Return tables of the settings and of what they measure; see also `plan_figure` for the plan in 3-D."""
        from errors.checks import frequency_text, probability_text
        from planner.request.targets import words_of

        rows = []
        for number, setting in enumerate(self.settings, start=1):
            rates = self.simulation.rates[number - 1].values() if self.simulation else ()
            worst = min(rates, key=lambda rate: rate.frequency, default=None)
            smallest = min(setting.promise[name] for name in setting.entities)
            simulated = "not yet" if worst is None else frequency_text(worst.successes, worst.n)
            place = ", ".join(f"{c:.1f}" for c in setting.position)
            lamps = [self._lamps_cell(number - 1)] if self._has_places else []
            names = ", ".join(setting.entities)
            rows.append((number, place, *lamps, names, probability_text(smallest), simulated))
        items = words_of(self.targets).items[1]
        lamps = ["lamp at (mm)"] if self._has_places else []
        headings = ("", "camera at (mm)", *lamps, items, f"smallest {self._promised}", "simulated")
        return NotebookView(
            f"Plan of {self.part or 'a part'}",
            (self._verdict(), self._caption(), *self._light_lines(), *self._edges_lines()),
            NotebookTable(headings, rows, right=(0,)),
            self.uninspectable,
            [table for table in (self._measured_table(), self._arm_table()) if table is not None],
        )

    def _arm_table(self) -> NotebookTable | None:
        """Return how the robot stands in each setting of a plan for a cell; None of another plan."""
        if not self.cell:
            return None
        rows = [
            (number, *_arm_cells(setting))
            for number, setting in enumerate(self.settings, start=1)
            if setting.fixturing
        ]
        note = f"{self.cell['robot']} reaches these settings."
        return NotebookTable(("", *_ARM_HEADINGS), rows, right=(0, 4, 5), note=note)

    def _measured_table(self) -> NotebookTable:
        """Return what is measured, how wrong and how surely: the first targets, from their best settings."""
        from errors.checks import probability_text
        from planner.request.targets import words_of

        best = self._best_rows()
        counted = all(setting.p_all for setting in self.settings)
        shown = list(best)[:_SHOWN_TARGETS]
        # where breaks are not stated, `measure` states another U than the plan's own
        without = [name for name in shown if best[name].foreseen is None]
        is_planned = set(without if self._edges_lines() else ())
        rows = []
        for name in shown:
            row = best[name]
            stated = [row.promise, row.probability] if counted else [row.probability]
            texts = [probability_text(p, self.probability) for p in stated]
            nominal, expanded = _amounts(self.targets[name], row)
            rows.append((name, nominal, expanded + " *" * (name in is_planned), *texts))
        more = len(best) - len(rows)
        notes = ["* as planned, with sharp edges: 'measure' states another U."] * bool(is_planned)
        notes += [f"and {more} more: plan.rows() and plan.to_dataframe() list all."] * bool(more)
        note = " ".join(notes)
        noun = words_of(self.targets).items[0]
        headings = (noun, "nominal", "U", *["P_all"] * counted, "P")
        return NotebookTable(headings, rows, right=range(2, len(headings)), note=note)

    def _best_rows(self) -> dict[str, Row]:
        """Return the row of the largest probability of each inspected target, in the order of the targets."""
        from planner.rows import measured_rows, split_rows

        rows: dict[str, Row] = {}
        for row in (row for setting in measured_rows(self) for row in setting):
            if row.name not in rows or row.promise > rows[row.name].promise:
                rows[row.name] = row
        rows |= {row.name: row for row in split_rows(self)}
        return {name: rows[name] for name in self.targets if name in rows}

    @property
    def _has_places(self) -> bool:
        """Whether lamps are planned that have positions; a light that the camera carries has none."""
        return self.light is not None and len(self.light.lamps) > 0

    def _lamps_cell(self, k: int) -> str:
        """Return where the lamp of each image of a setting is."""
        lamps = [self.light.lamps[lamp] for image in self.light.images[k] for lamp in image.lamps]
        return "; ".join(", ".join(f"{c:.1f}" for c in lamp) for lamp in lamps) or "none"

    def _light_lines(self) -> list[str]:
        """Say which light is planned, and what it shows."""
        if self.light is not None and self.settings:
            return [import_module("planner.report.wording").light_sentence(self)]
        if self.light_missing or not self.settings:
            return []
        return ["Light is not planned, so nothing is promised of contrast."]

    @property
    def _promised(self) -> str:
        """Symbol of the probability that all settings state."""
        return "P_all" if all(setting.p_all for setting in self.settings) else "P"

    def _verdict(self) -> Toned:
        """Say how good the plan is: what is inspected, how surely, and whether it can be shorter."""
        from errors.checks import probability_text

        if not self.settings:
            return Toned("No target is inspected.", "bad")
        promises = [s.promise[name] for s in self.settings for name in s.entities]
        sure = f"smallest {self._promised} {probability_text(min(promises), self.probability)}"
        n = len(self.uninspectable) + len(self.unlit)
        if n:
            dark = f"; no lamp shows {', '.join(self.unlit)}" if self.unlit else ""
            ended = "; planning stopped early" if self.unfinished else ""
            text = f"{n} of {len(self.targets)} targets not inspected; {sure}{dark}{ended}."
            return Toned(text, "bad")
        if self.light_missing:
            text = f"Light is not planned yet; poses inspect every target; {sure}."
            return Toned(text, "bad")
        if len(self.settings) > self.lower_bound:
            bound = f"at least {self.lower_bound} of {len(self.settings)} settings are needed"
            return Toned(f"Every target is inspected; {sure}; {bound}.", "open")
        return Toned(f"Every target is inspected; {sure}; no plan has fewer settings.", "good")

    def _caption(self) -> str:
        total = len(self.targets)
        shown = total - len(self.uninspectable) - len(self.unlit)
        settings = count(len(self.settings), "setting")
        # a share of a tolerance does not depend on A
        uses_accuracy = any(getattr(item, "share", None) is None for item in self.targets.values())
        accuracy = f"A = {self.accuracy:g}, " if uses_accuracy else ""
        dark = f", with the {len(self.unlit)} that no lamp shows" if self.unlit else ""
        return (
            f"{self.part or 'part'}: {shown} of {total} inspected in {settings} (at least "
            f"{self.lower_bound} needed{dark}), {accuracy}P ≥ {self.probability:g}"
            f"{'; ' if self.features_text else ''}{self.features_text}"
        )

    def _edges_lines(self) -> list[str]:
        """Say what breaks of edges do to U, if nothing is stated of them."""
        text = import_module("planner.report.wording").assumed_edges_text(self)
        return (
            [f"Edges: {text}. State edge_break_mm, in planning and in measuring."] if text else []
        )

    def _target_values(self, name: str) -> dict[str, Any]:
        """Return what is to be measured, and how well."""
        target = self.targets[name]
        return {
            "name": name,
            "kind": target.kind,
            "entities": "; ".join(", ".join(way) for way in target.ways),
            "nominal": target.nominal,
            "permitted_error": target.permitted_error,
            "unit": target.unit,
            "n_features": target.n_features,
        }


def _amounts(target: Target, row: Row) -> tuple[str, str]:
    """Return the nominal value with its tolerance, and U; without a tolerance, with the permitted error.

    U is the one that `measure` will state, or that of the plan where none is foreseen.
    """
    nominal, error = target.requirement_texts
    if not target.words.requirement_column:
        nominal = target.value_text
    if target.tolerance is None:
        nominal = f"{nominal}, {error}"
    expanded = getattr(row.foreseen, "expanded_uncertainty", 2 * row.standard_uncertainty)
    return nominal, amount_text(digits_text(expanded, 2), row.unit)


def _column(key: str) -> Column:
    """Return a column of the table: its unit where neither the key nor `unit` states it, and the digits of floats."""
    if key in ("x", "y", "z"):
        return Column(key, unit="mm", spec=".4f")
    if key in _ROTATION_VECTOR:
        return Column(key, unit="deg", spec=".5f")
    if key == "nominal":
        return Column(key, spec=".9g")
    if key == "permitted_error":
        return Column(key, spec=".6g")
    uncertainties = ("standard_uncertainty", "measured_uncertainty", "unseen_uncertainty")
    if key in uncertainties or key.startswith("variance_"):
        return Column(key, spec=".3g")
    if key in ("p_all", "probability"):
        return Column(key, spec=".6f", ceiling=0.999999)
    return Column(key, spec=".6f" if key.startswith("simulated") else ".4g")


def _values(row: Row, n_features: int) -> dict[str, Any]:
    """Return a row without what it is made of."""
    # a plan is read without loading what computes errors
    from errors.checks import below_one
    from errors.measurands.measurand import SOURCES

    rate = row.rate
    return {
        "setting": row.setting,
        "name": row.name,
        "kind": row.kind,
        "entities": ", ".join(row.entities),
        "nominal": row.nominal,
        "permitted_error": row.permitted_error,
        "unit": row.unit,
        "n_features": n_features,
        "permitted_error_px": row.permitted_error_px,
        "p_all": None if row.p_all is None else below_one(row.p_all),
        "probability": below_one(row.probability),
        "simulated": None if rate is None else rate.frequency,
        "simulated_low": None if rate is None else rate.low,
        "simulated_high": None if rate is None else rate.high,
        "verdict": None if rate is None else rate.verdict,
        "standard_uncertainty": row.standard_uncertainty,
        "measured_uncertainty": getattr(row.foreseen, "expanded_uncertainty", None),
        "unseen_uncertainty": getattr(row.foreseen, "unseen_uncertainty", None),
        **{f"variance_{source}": row.budget.get(source) for source in SOURCES},
        "search_window_px": row.search_window_px,
        "warnings": "; ".join(warning.text for warning in row.warnings) or None,
    }


def _pose(setting: Any) -> dict[str, Any]:
    """Return place and turn of a camera, and its margins."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(setting.cam2world[:3, :3]).as_rotvec() * _DEG
    place = dict(zip(("x", "y", "z"), map(float, setting.position), strict=True))
    turns = dict(zip(_ROTATION_VECTOR, map(float, turn), strict=True))
    return {
        **place,
        **turns,
        **{f"margin_{name}": float(value) for name, value in setting.margins.items()},
    }

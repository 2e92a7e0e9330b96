"""The report: one self-contained HTML file about a plan, for the screen, the printer and the customer."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from errors.formatting import percent_text, probability_text
from ground.templates import asset, render
from planner.argument_kinds import check_kinds
from planner.exceptions import RequestError
from planner.progress import report
from planner.report.figure import color_of, figure_html, figure_views, plan_figure, scene_frame
from planner.report.graph_picture import GraphPicture, arm_section, graph_picture
from planner.report.overview import facts, overview, sigma_text, target_picker
from planner.report.setting_report import (
    SettingSection,
    dimensions_table,
    localisation_text,
    setting_sections,
    settings_table,
)
from planner.report.tables import (
    COLOURS,
    arm,
    attention,
    may_be_unsharp,
    not_inspected,
    poses,
    promise_name,
    results,
    source_text,
)
from planner.report.wording import (
    bound_sentence,
    calibration_rows,
    count,
    features_sentence,
    light_sentence,
    percent,
    promise_sentence,
    registration_text,
    requirement_rows,
    simulated_sentences,
    surfaces_sources,
    unfinished_sentence,
    window_sentence,
)
from planner.request.targets import words_of
from planner.rows import measured_rows
from planner.verify.simulate_setting import CONFIRMED, CONTRADICTED, MODEL_TOLERANCE

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.reach import Space
    from planner.robotcell import Cell


_POSE = "camera pose"


@dataclass
class Report:
    """A report of a plan: what it shows, to which the joint graph and notes may come later.

    Attributes
    ----------
    plan : InspectionPlan
        The plan.
    sections : list of SettingSection
        What it says of each setting.
    values : dict
        What else the template of the page takes.
    notes : list of str
        Further sentences for the reader.
    graph : GraphPicture or None
        The joint graph of the entities that the plan needs.
    """

    plan: InspectionPlan
    sections: list[SettingSection]
    values: dict[str, Any]
    notes: list[str] = field(default_factory=list)
    graph: GraphPicture | None = None

    def html(self) -> str:
        """Return the page; it refers to nothing outside it, and the same report gives the same page."""
        from markupsafe import Markup
        from plotly.offline import get_plotlyjs

        page = render(
            "planner",
            "report/templates/page.html",
            plan=self.plan,
            settings=self.sections,
            notes=self.notes,
            graph=self.graph,
            plotly=Markup(get_plotlyjs()),
            base_style=asset("planner.report", "templates/base.css"),
            style=asset("planner.report", "templates/page.css"),
            script=asset("planner.report", "templates/page.js"),
            **self.values,
        )
        return str(page)

    def draw_graph(
        self,
        graph: EntityAspectGraph,
        progress: Progress | None = None,
        *,
        until: float = math.inf,
    ) -> None:
        """Show the joint graph, whose domains a click shows in 3-D.

        Parameters
        ----------
        graph : EntityAspectGraph
            Joint graph of the entities that the plan needs.
        progress : callable, optional
            ``progress(done, total, label)``.
        until : float
            Time, as `time.time` gives it, after which domains are not drawn in 3-D.
        """
        colors = [color_of(k) for k in range(len(self.plan.settings))]
        box = scene_frame(self.plan, graph.solid).box
        self.graph = graph_picture(self.plan, graph, box, colors, progress, until=until)

    @property
    def left_out(self) -> list[str]:
        """A sentence on the pictures that it lacks, because there was no time; none if it has all."""
        n = sum(not section.shots for section in self.sections)
        if not n:
            return []
        return [
            f"The report lacks the pictures of {count(n, 'setting')}: the time limit ended. A longer "
            "--time-limit draws them."
        ]


def report_html(
    plan: InspectionPlan,
    space: Space,
    progress: Progress | None = None,
    notes: Sequence[str] = (),
    *,
    graph: EntityAspectGraph | None = None,
    date: str | None = None,
    until: float = math.inf,
    cell: Cell | None = None,
) -> str:
    """Return the report of a plan as an HTML page.

    Parameters
    ----------
    plan : InspectionPlan
        The plan, with or without the result of its simulation.
    space : VisibilityRegions or EntityAspectGraph
        Gives the part and the viewing domains.
    progress : callable, optional
        ``progress(done, total, label)``.
    notes : sequence of str
        Further sentences for the reader, for example on an omitted file.
    graph : EntityAspectGraph, optional
        Joint graph of the entities that the plan needs. The report draws its domains, and shows one in 3-D on a click.
    date : str, optional
        Date of the plan for the head of the page, such as ``"2026-03-01"``. Default: no date.
    until : float
        Time, as `time.time` gives it, after which the page gets no more pictures but a sentence for each.
        Default: never.
    cell : Cell, optional
        The robot cell of the plan. With it, the report shows the arm at each setting in 3-D.

    Returns
    -------
    str
        A page without references to anything outside it. The same arguments give the same page.

    Raises
    ------
    RequestError
        If plan or space is another object.

    Examples
    --------
    >>> from planner import read_plan, report_html
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> from aspectgraph import read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> from aspectgraph import compute_regions
    >>> regions = compute_regions(block, plan.entities, workspace=plan.workspace)
    >>> page = report_html(plan, regions)
    >>> "two_pocket_block" in page
    True
    """
    page = make_report(plan, space, progress, notes, date=date, until=until, cell=cell)
    if graph is not None:
        page.draw_graph(graph, progress, until=until)
    return page.html()


def make_report(
    plan: InspectionPlan,
    space: Space,
    progress: Progress | None = None,
    notes: Sequence[str] = (),
    *,
    date: str | None = None,
    until: float = math.inf,
    cell: Cell | None = None,
) -> Report:
    """Return the report of a plan, still without its joint graph; takes what `report_html` takes."""
    _check_arguments(plan, space)
    if plan.settings:
        # something shows while the figure and the tables are made
        report(progress, 0, len(plan.settings), "predicted images")
    figure = plan_figure(plan, space.solid, space, until=until)
    rows = measured_rows(plan)
    nouns = _nouns(plan)
    unsharp = [k for k, setting in enumerate(plan.settings, 1) if may_be_unsharp(plan, setting)]
    dimensions = dimensions_table(plan)
    only_dimensions = dimensions and len(plan.dimensions) == len(plan.entities)
    values = {
        "lead": _lead(plan),
        "figures": _figures(plan),
        "facts": facts(plan, date),
        "overview": overview(plan, space.solid),
        "scene": figure_html(figure, "plan3d", "100%", scrollZoom=True),
        "not_inspected": not_inspected(plan.uninspectable, nouns[0]),
        "notices": attention(rows, unsharp),
        "dimensions": dimensions,
        "results": None if only_dimensions else results(plan, rows, nouns[0]),
        "sources": {source_text(source): color for source, color in COLOURS.items()},
        "csv": base64.b64encode(plan.to_csv().encode()).decode(),
        "views": figure_views(plan, space.solid),
        "picker": target_picker(plan),
        "arm": arm(plan),
        "poses": poses(plan),
        "arm_scene": arm_section(plan, space.solid, cell),
        "promise_meaning": promise_sentence(plan),
        "window_meaning": window_sentence(),
        "nouns": nouns,
        "summary": settings_table(plan, nouns) if plan.settings else None,
        **_request(plan),
        "words_of": words_of,
        "count": count,
        "percent": percent,
        "model_tolerance": MODEL_TOLERANCE,
    }
    sections = setting_sections(plan, space.solid, rows, progress, until=until)
    return Report(plan, sections, values, list(notes))


def _check_arguments(plan: object, space: object) -> None:
    check_kinds(plan=(plan, "InspectionPlan"))
    if not hasattr(space, "solid"):
        rule = "must be VisibilityRegions or an EntityAspectGraph"
        got = f"an object of type {type(space).__name__}"
        raise RequestError.of_rule("space", rule, got, hint="compute_regions makes the former")


def _nouns(plan: InspectionPlan) -> tuple[str, str]:
    """Return what the report calls a target, and several."""
    return words_of(plan.targets).nouns


def _lead(plan: InspectionPlan) -> str:
    """Say what the plan does, what is proven, and how the simulation agrees."""
    n = len(plan.settings)
    inspected = len(plan.inspected)
    n_targets = count(len(plan.entities), *_nouns(plan))
    features = features_sentence(plan)
    if not n:
        return (
            f"{inspected} of {n_targets} inspected: the plan has no camera poses. {features}"
        ).rstrip()
    verb = "is" if inspected == 1 else "are"
    simulated = " ".join(simulated_sentences(plan)).rstrip()
    return (
        f"{inspected} of {n_targets} {verb} measured from {count(n, _POSE)} "
        f"({_numbers(n)}). {features}{' ' if features else ''}"
        f"{bound_sentence(plan, _nouns(plan), _POSE)} {simulated} {unfinished_sentence(plan)} {light_sentence(plan)}"
    ).rstrip()


def _numbers(n: int) -> str:
    """Return the numbers of n settings."""
    if n == 1:
        return "setting 1"
    return f"settings 1 {'and' if n == 2 else 'to'} {n}"


def _figures(plan: InspectionPlan) -> list[tuple[str, str]]:
    """Return the numbers at the head of the page, and what each counts."""
    n = len(plan.settings)
    cells = [(str(n), "camera pose" if n == 1 else "camera poses")]
    if n:
        cells.append((str(plan.lower_bound), _bound_label(plan)))
    cells.append((f"{len(plan.inspected)} / {len(plan.entities)}", f"{_nouns(plan)[1]} inspected"))
    if plan.n_features_not_planned:
        measured = sum(name in plan.dimensions for name in plan.inspected)
        cells.append((f"{measured} / {plan.n_features}", "characteristics inspected"))
    if n:
        worst = min(plan.inspected.values())
        cells.append(
            (
                probability_text(worst, plan.probability),
                f"smallest {promise_name(plan)} (required {plan.probability:g})",
            )
        )
    if n and plan.simulation is not None:
        kinds = plan.simulation.verdicts
        cells.append(
            (
                f"{kinds[CONFIRMED]} / {sum(kinds.values())}",
                "stated probabilities confirmed by simulation",
            )
        )
        cells.append((str(kinds[CONTRADICTED]), "contradicted by simulation"))
    return cells


def _bound_label(plan: InspectionPlan) -> str:
    """Name the lower bound; of an incomplete plan with the targets it is about."""
    label = "proven minimum" if plan.minimal else "proven lower bound"
    if plan.complete:
        return label
    return f"{label} for the inspected {_nouns(plan)[len(plan.inspected) > 1]}"


def _request(plan: InspectionPlan) -> dict[str, Any]:
    """Return what the page says of the request, where it takes more than to read the plan."""
    camera = plan.camera
    field = np.array(camera.sensor_size_mm) / camera.image_distance_mm * camera.focus_distance_mm
    if not camera.is_centred:
        x_low, y_low, x_high, y_high = camera.field().inner
        field = np.array([x_high - x_low, y_high - y_low]) * camera.focus_distance_mm
    dimensions = plan.dimensions.values()
    models = dict.fromkeys(localisation_text(dimension.localisation) for dimension in dimensions)
    rough = any(dimension.surfaces_mm for dimension in dimensions)
    words = words_of(plan.targets)
    return {
        "accuracy": words.accuracy.format(share=percent_text(1 - plan.accuracy)),
        "localisation": [*models, *words.localisation],
        "surfaces": surfaces_sources(dimensions) if rough else [],
        "calibration": calibration_rows(camera),
        "infinity": math.inf,
        "field_mm": field.tolist(),
        "sigmas": sigma_text(plan.pose_uncertainty.sigmas),
        "registration": registration_text(plan),
        "requirements": requirement_rows(plan),
    }

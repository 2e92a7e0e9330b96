"""The report: one self-contained HTML file about a plan, for the screen, the printer and the customer."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from errors.formatting import percent_text, probability_text
from planner.argument_kinds import check_kinds
from planner.exceptions import RequestError
from planner.progress import report
from planner.report.figure import color_of, figure_views, plan_figure, scene_frame, view_buttons
from planner.report.graph_picture import arm_section, graph_picture
from planner.report.overview import facts, overview, sigma_text, target_picker
from planner.report.setting_report import (
    NO_PICTURES,
    dimension_section,
    localisation_text,
    settings_section,
    settings_table,
)
from planner.report.tables import (
    attention,
    download,
    may_be_unsharp,
    not_inspected,
    promise_name,
    reasons_section,
    results,
    robot,
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
    shown_sentence,
    simulation_sentence,
    surfaces_sources,
    unfinished_sentence,
    window_sentence,
)
from planner.request.targets import words_of
from planner.rows import measured_rows
from planner.verify.simulate_setting import CONFIRMED, CONTRADICTED, MODEL_TOLERANCE

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph, Solid
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.reach import Space
    from planner.robotcell import Cell
    from planner.rows import Row
    from planner.verify.simulate_plan import SimulationResult


# what a page holds in the place of the graph and of notes until they are there
_GRAPH = "<!-- aspect graph -->"
_NOTES = "<!-- notes -->"
_DOMAINS = '<script type="application/json" id="domains">{}</script>'
_POSE = "camera pose"


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
    from plotly.offline import get_plotlyjs

    _check_arguments(plan, space)
    if plan.settings:
        # something shows while the figure and the tables are made
        report(progress, 0, len(plan.settings), "predicted images")
    figure = plan_figure(plan, space.solid, space, until=until)
    rows = measured_rows(plan)
    template = Template(
        resources.files("planner.report").joinpath("report.html").read_text(encoding="utf-8")
    )
    page = template.substitute(
        title=escape(f"Inspection plan: {plan.part}"),
        plotly=get_plotlyjs(),
        part=escape(plan.part or "part"),
        lead=escape(_lead(plan)),
        figures=_figures(plan),
        facts=facts(plan, date),
        overview=overview(plan, space.solid),
        scene=figure.to_html(
            full_html=False,
            include_plotlyjs=False,
            div_id="plan3d",
            default_height="100%",
            config={"displaylogo": False, "responsive": True, "scrollZoom": True},
        ),
        uninspectable=not_inspected(plan.uninspectable, _named(plan)[0]),
        reasons=reasons_section(plan.uninspectable, _named(plan)[0]),
        **_controls(plan, space.solid),
        graph=_GRAPH,
        attention=attention(
            rows, [k for k, one in enumerate(plan.settings, 1) if may_be_unsharp(plan, one)]
        ),
        results=_results(plan, rows, dimension_section(plan)),
        csv=download(plan.to_csv(), "measurements.csv", "measurements.csv"),
        robot=robot(plan) + arm_section(plan, space.solid, cell),
        meaning=_meaning(plan),
        singular=_named(plan)[0],
        plural=_named(plan)[1],
        summary=settings_table(plan, _named(plan)),
        settings=settings_section(plan, space.solid, rows, progress, until=until),
        request=_request(plan),
        method=_method(plan) + _NOTES,
        footer="Lengths are in millimetres, in the part's frame. Camera axes: x right, y down, z forward.",
    )
    page = add_notes(page, notes)
    return page if graph is None else add_graph(page, plan, graph, progress, until=until)


def _controls(plan: InspectionPlan, solid: Solid) -> dict[str, str]:
    """Return what the page needs to show the view of each setting, and to choose a target."""
    views = figure_views(plan, solid)
    picker = target_picker(plan)
    return {
        "views": json.dumps(views, sort_keys=True),
        "buttons": view_buttons(views),
        "picker": picker.html,
        "picks": picker.data,
    }


def add_notes(page: str, notes: Sequence[str]) -> str:
    """Return a page with further sentences for the reader.

    Parameters
    ----------
    page : str
        As of `report_html`.
    notes : sequence of str
        The sentences.
    """
    return page.replace(_NOTES, "".join(f"<p>{escape(note)}</p>" for note in notes) + _NOTES)


def left_out_of(page: str) -> list[str]:
    """Return a sentence on the pictures that a page lacks, because there was no time; none if it has all.

    Parameters
    ----------
    page : str
        As of `report_html`.
    """
    n = page.count(NO_PICTURES)
    if not n:
        return []
    return [
        f"The report lacks the pictures of {count(n, 'setting')}: the time limit ended. A longer "
        "--time-limit draws them."
    ]


def add_graph(
    page: str,
    plan: InspectionPlan,
    graph: EntityAspectGraph,
    progress: Progress | None = None,
    *,
    until: float = math.inf,
) -> str:
    """Return a page with the picture of the joint graph, whose domains a click shows in 3-D.

    Parameters
    ----------
    page : str
        As of `report_html`, without a graph.
    plan : InspectionPlan
        The plan of the page.
    graph : EntityAspectGraph
        Joint graph of the entities that the plan needs.
    progress : callable, optional
        ``progress(done, total, label)``.
    until : float
        Time, as `time.time` gives it, after which domains are not drawn in 3-D.
    """
    colors = [color_of(k) for k in range(len(plan.settings))]
    box = scene_frame(plan, graph.solid).box
    picture = graph_picture(plan, graph, box, colors, progress, until=until)
    text = '<p id="domain" class="note" aria-live="polite"></p>'
    figure = f"<figure>{picture.svg}{text}<figcaption>{picture.note}</figcaption></figure>"
    domains = _DOMAINS.format(picture.domains)
    return page.replace(_GRAPH, figure).replace(_DOMAINS.format("{}"), domains)


def _check_arguments(plan: object, space: object) -> None:
    check_kinds(plan=(plan, "InspectionPlan"))
    if not hasattr(space, "solid"):
        rule = "must be VisibilityRegions or an EntityAspectGraph"
        got = f"an object of type {type(space).__name__}"
        raise RequestError.of_rule("space", rule, got, hint="compute_regions makes the former")


def _results(plan: InspectionPlan, rows: Sequence[Sequence[Row]], dimensions: str) -> str:
    """Return the table of dimensions with U/T first, and that of all targets if some are edges."""
    if dimensions and len(plan.dimensions) == len(plan.entities):
        return dimensions
    return dimensions + results(plan, rows, _named(plan)[0])


def _named(plan: InspectionPlan) -> tuple[str, str]:
    """Return what the report calls a target, and several."""
    return words_of(plan.targets).nouns


def _meaning(plan: InspectionPlan) -> str:
    """Explain P and the search window."""
    conforms = (
        "P is not the probability that a part conforms, which also depends on how parts vary "
        "(JCGM 106)."
    )
    return f"{promise_sentence(plan)} {conforms} {window_sentence()}"


def _lead(plan: InspectionPlan) -> str:
    """Say what the plan does, what is proven, and how the simulation agrees."""
    n = len(plan.settings)
    inspected = len(plan.inspected)
    asked = len(plan.entities)
    features = features_sentence(plan)
    if not n:
        return (
            f"{inspected} of {count(asked, *_named(plan))} inspected: the plan has no camera poses. "
            f"{features}"
        ).rstrip()
    verb = "is" if inspected == 1 else "are"
    simulated = "Not simulated."
    if plan.simulation is not None:
        simulated = f"{simulation_sentence(plan.simulation)} {shown_sentence(plan.simulation.shown)}".rstrip()
    return (
        f"{inspected} of {count(asked, *_named(plan))} {verb} measured from {count(n, _POSE)} "
        f"({_numbers(n)}). {features}{' ' if features else ''}"
        f"{bound_sentence(plan, _named(plan), _POSE)} {simulated} {unfinished_sentence(plan)} {light_sentence(plan)}"
    ).rstrip()


def _numbers(n: int) -> str:
    """Return the numbers of n settings."""
    if n == 1:
        return "setting 1"
    return f"settings 1 {'and' if n == 2 else 'to'} {n}"


def _figures(plan: InspectionPlan) -> str:
    n = len(plan.settings)
    cells = [(str(n), "camera pose" if n == 1 else "camera poses")]
    if n:
        cells.append((str(plan.lower_bound), _bound_label(plan)))
    cells.append((f"{len(plan.inspected)} / {len(plan.entities)}", f"{_named(plan)[1]} inspected"))
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
    return "".join(
        f"<div><b>{escape(value)}</b><span>{escape(what)}</span></div>" for value, what in cells
    )


def _bound_label(plan: InspectionPlan) -> str:
    """Name the lower bound; of an incomplete plan with the targets it is about."""
    label = "proven minimum" if plan.minimal else "proven lower bound"
    if plan.complete:
        return label
    return f"{label} for the inspected {_named(plan)[len(plan.inspected) > 1]}"


def _request(plan: InspectionPlan) -> str:
    camera = plan.camera
    near, far = camera.depth_of_field_mm
    field = np.array(camera.sensor_size_mm) / camera.image_distance_mm * camera.focus_distance_mm
    left, top, right, bottom = camera.field().inner
    if not camera.is_centred:
        field = np.array([right - left, bottom - top]) * camera.focus_distance_mm
    share = percent_text(1 - plan.accuracy)
    rows = {
        "Required accuracy": f"{plan.accuracy:g} ({words_of(plan.targets).accuracy.format(share=share)})",
        **_localisation(plan),
        "Required probability": f"{plan.probability:g}",
        "Camera": f"{camera.name or 'camera'}: f = {camera.focal_length_mm:g} mm, f/{camera.f_number:g}",
        "Sensor": f"{camera.resolution[0]} x {camera.resolution[1]} pixels of "
        f"{1000 * camera.pixel_pitch_mm[0]:g} x {1000 * camera.pixel_pitch_mm[1]:g} um",
        **calibration_rows(camera),
        "Focus": f"{camera.focus_distance_mm:g} mm; sharp from {near:.1f} mm "
        + (f"to {far:.1f} mm" if np.isfinite(far) else "on"),
        "Field of view": f"{field[0]:.0f} x {field[1]:.0f} mm in the plane of focus",
        "Camera pose": f"{sigma_text(plan.pose_uncertainty.sigmas)} along and about x, y, z",
        **({"Registration": how} if (how := registration_text(plan)) else {}),
        "Workspace": f"({_list(plan.workspace[0], '.1f')}) to ({_list(plan.workspace[1], '.1f')}) mm",
        **requirement_rows(plan),
        "Seed": str(plan.seed),
    }
    return (
        "<dl>"
        + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows.items())
        + "</dl>"
    )


def _localisation(plan: InspectionPlan) -> dict[str, str]:
    """Return the row about the models of dimensions; none of a plan of edges."""
    models = dict.fromkeys(localisation_text(one.localisation) for one in plan.dimensions.values())
    texts = [*models, *words_of(plan.targets).localisation]
    return {"Localisation": "; ".join(texts), "Surfaces": _surfaces(plan)} if texts else {}


def _surfaces(plan: InspectionPlan) -> str:
    """Say how well the position of the part's faces is known."""
    if not any(one.surfaces_mm for one in plan.dimensions.values()):
        return "faces are where the model has them"
    sigma = " or ".join(surfaces_sources(plan.dimensions.values()))
    return f"{sigma}, one standard deviation of a face's position along its normal"


_RENDERED = (
    "Rendered images, not photographs, of three test parts were measured at displaced poses. Edges that meet all "
    "conditions on the image were accurate at least as often as stated, within three standard errors (137 "
    "measurements, A = 0.98 and 0.99). Edges with an end without a corner were accurate in a third of the images "
    "(A = 0.98). Edges that no lamp lights were accurate in none of 180 images of one part."
)
"""What edges of each class gave, as docs/showing.md has it with its source."""


def _method(plan: InspectionPlan) -> str:
    paragraphs = [
        f"The program computed exactly, from the part's geometry, where {words_of(plan.targets).seen} "
        "are visible from. A genetic algorithm searched these viewing domains for camera poses that "
        "satisfy resolution, focus, field of view, "
        "visibility, clearance and workspace. Integer programming and exchange then chose a few of these poses, which "
        f"together inspect every {_named(plan)[0]} that any of them inspects.",
        f"Lower bound. {plan.bound_proof} {_gap(plan)}",
    ]
    if plan.simulation is not None and plan.settings:
        paragraphs.append(_simulated(plan, plan.simulation))
    if plan.light is not None:
        paragraphs.append(_lit(plan.light))
    if len(plan.dimensions) < len(plan.entities):
        paragraphs.append(_RENDERED)
    paragraphs.append(
        "Method after C. C. Yang and F. W. Ciarallo, Optimized sensor placement for active visual inspection, Journal "
        "of Robotic Systems 18(1), 1-15, 2001."
    )
    return "".join(f"<p>{escape(text)}</p>" for text in paragraphs)


def _gap(plan: InspectionPlan) -> str:
    """Say what the bound leaves open."""
    n = len(plan.settings)
    bound = plan.lower_bound
    if not n:
        return "Without settings there is nothing to prove."
    if plan.minimal:
        return f"The plan has {count(n, 'setting')} and the bound is {bound}: it is minimal for its targets."
    return f"The plan has {count(n, 'setting')}. The smallest number for its targets is from {bound} to {n}."


def _simulated(plan: InspectionPlan, simulation: SimulationResult) -> str:
    words = words_of(plan.targets)
    return (
        f"Simulation. For each setting the program drew {count(simulation.n, 'displaced pose')}, "
        f"{words.simulated} All intervals hold together with {percent(simulation.confidence)} confidence. A "
        "stated probability inside its interval is confirmed. One below it is conservative: the "
        f"{words.nouns[0]} is measured better than stated. One above it by at most "
        f"{MODEL_TOLERANCE:g} is within the tolerance of the model, which is of second order. "
        "One above it by more is contradicted. Every draw shifts the pixel grid "
        "at random: a probability is the share of accurate measurements over displaced poses and over parts, whose "
        "edges may end anywhere within a pixel."
    )


def _lit(light: LightPlan) -> str:
    """Say what the choice of lamps assumes."""
    return (
        "Light. If both faces of an edge are visible, its contrast is that between their shades. The contrast of a "
        f"silhouette is that with its background; the model assumes a {light.ground} ground, a matt part of one "
        f"albedo, point lamps {_switched(light)}, and no light from face to face. Polished metal is out of scope. "
        f"{light.bound_proof}"
    )


def _switched(light: LightPlan) -> str:
    if not light.together:
        return "of which one is on at a time"
    return "of one strength that are all on together (checked at nine points of every edge)"


def _list(values: Iterable[float], spec: str = ".4g") -> str:
    return ", ".join(f"{value:{spec}}" for value in values)

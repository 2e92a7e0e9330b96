"""The report: one self-contained HTML file about a plan, for the screen, the printer and the customer."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from planner.output.dimension_report import dimension_section, localisation_text
from planner.output.figure import color_of, figure_views, plan_figure
from planner.output.outlines import drawn
from planner.output.predicted_image import PictureMaker
from planner.output.wording import (
    bound_sentence,
    calibration_rows,
    count,
    grid_sentence,
    lamp_texts,
    light_sentence,
    margin_texts,
    nouns,
    percent,
    requirement_rows,
    simulation_sentence,
    unfinished_sentence,
)
from planner.progress import report
from planner.report.setting_table import binding_sentence, setting_table
from planner.report.tables import attention, download, results, robot
from planner.report.views import view_buttons
from planner.rows.measured import Row, measured_rows
from planner.verify.simulate_setting import CONFIRMED, CONTRADICTED, MODEL_TOLERANCE

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.space import Space
    from planner.setting.sensor_setting import SensorSetting
    from planner.verify.simulate_plan import SimulationResult

# what fills more of the image is shown once
_WORTH_ENLARGING = 1.25
_EDGE, _POSE = ("edge", "edges"), "camera pose"


def report_html(plan: InspectionPlan, space: Space, progress: Progress | None = None, notes: Sequence[str] = ()) -> str:
    """Return the report about a plan.

    Parameters
    ----------
    plan : InspectionPlan
        With or without the result of its simulation.
    space : VisibilityRegions or EntityAspectGraph
        Gives the part and the viewing domains.
    progress : callable, optional
        ``progress(done, total, label)``.
    notes : sequence of str
        What else the reader should know, such as a file that was not written.

    Returns
    -------
    str
        A page without references to anything outside it. The same plan gives the same page.
    """
    from plotly.offline import get_plotlyjs

    figure = plan_figure(plan, space.solid, space)
    views, rows = figure_views(plan, space.solid), measured_rows(plan)
    template = Template(resources.files("planner.output").joinpath("report.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(f"Inspection plan: {plan.part}"),
        plotly=get_plotlyjs(),
        part=escape(plan.part or "part"),
        lead=escape(_lead(plan)),
        figures=_figures(plan),
        scene=figure.to_html(
            full_html=False,
            include_plotlyjs=False,
            div_id="scene",
            default_height="100%",
            config={"displaylogo": False, "responsive": True, "scrollZoom": True},
        ),
        uninspectable=_uninspectable(plan),
        views=json.dumps(views, sort_keys=True),
        buttons=view_buttons(views),
        attention=attention(rows),
        results=results(plan, rows, _named(plan)[0]),
        csv=download(plan.to_csv(), "measurements.csv", "measurements.csv"),
        robot=robot(plan),
        meaning=_meaning(plan),
        dimensions=dimension_section(plan),
        singular=_named(plan)[0],
        plural=_named(plan)[1],
        summary=_summary(plan),
        settings=_settings(plan, space.solid, progress, rows),
        request=_request(plan),
        method=_method(plan) + "".join(f"<p>{escape(note)}</p>" for note in notes),
        footer="Lengths in millimetres, in the part's own frame. Camera axes: x right, y down, z forward.",
    )


def _named(plan: InspectionPlan) -> tuple[str, str]:
    """Return what the report calls an item of the plan, and several."""
    return nouns(plan, _EDGE)


def _meaning(plan: InspectionPlan) -> str:
    """Say what P is."""
    edges = (
        f"P is the probability that the measured length of the edge is within {100 * (1 - plan.accuracy):.3g} % of its"
        "\ntrue image length, given the uncertainty of the camera's pose and the pixel grid."
    )
    if not plan.dimensions:
        return edges
    own = "P is the probability that a dimension is measured with an error of at most the permitted one, given the "
    own += "uncertainty of the camera's pose and of localising points in the image."
    if len(plan.dimensions) == len(plan.entities):
        return own
    return own + edges.replace("P is", " Of an edge it is")


def _lead(plan: InspectionPlan) -> str:
    """Say what the plan does, what is proven and what the simulation made of it."""
    n, inspected, asked = len(plan.settings), len(plan.inspected), len(plan.entities)
    if not n:
        return f"{inspected} of {count(asked, *_named(plan))} inspected: the plan has no camera poses."
    verb = "is" if inspected == 1 else "are"
    told = "Not simulated." if plan.simulation is None else simulation_sentence(plan.simulation)
    return (
        f"{inspected} of {count(asked, *_named(plan))} {verb} measured from {count(n, _POSE)}. "
        f"{bound_sentence(plan, _named(plan), _POSE)} {told} {unfinished_sentence(plan)} {light_sentence(plan)}"
    ).rstrip()


def _figures(plan: InspectionPlan) -> str:
    n = len(plan.settings)
    cells = [(str(n), "camera pose" if n == 1 else "camera poses")]
    if n:
        cells.append((str(plan.lower_bound), "proven minimum" if plan.minimal else "proven lower bound"))
    cells.append((f"{len(plan.inspected)} / {len(plan.entities)}", f"{_named(plan)[1]} inspected"))
    if n:
        worst = min(plan.inspected.values())
        cells.append((f"{_down(worst, 3)}", f"smallest probability (required {plan.probability:g})"))
    if n and plan.simulation is not None:
        kinds = plan.simulation.verdicts
        cells.append((f"{kinds[CONFIRMED]} / {sum(kinds.values())}", "stated probabilities confirmed by simulation"))
        cells.append((str(kinds[CONTRADICTED]), "contradicted by simulation"))
    return "".join(f"<div><b>{escape(value)}</b><span>{escape(what)}</span></div>" for value, what in cells)


def _uninspectable(plan: InspectionPlan) -> str:
    if not plan.uninspectable:
        return ""
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(why)}</td></tr>" for name, why in plan.uninspectable.items()
    )
    return (
        '<h2 class="bad">Not inspected</h2><p class="note">What is in no setting, and why.</p>'
        f'<div class="scroll"><table><tr><th>{_named(plan)[0].capitalize()}</th><th>Reason</th></tr>{rows}'
        "</table></div>"
    )


def _summary(plan: InspectionPlan) -> str:
    if not plan.settings:
        return '<p class="note">The plan has no settings.</p>'
    rows = []
    for k, setting in enumerate(plan.settings):
        probabilities = setting.probability.values()
        position = " ".join(f"{x:.1f}" for x in setting.position)
        rows.append(
            f'<tr><td><a href="#setting-{k + 1}">{_swatch(k)}{k + 1}</a></td><td class="n">{position}</td>'
            f'<td class="n">{len(setting.entities)}</td><td class="n">{min(probabilities):.4f}</td>'
            f"<td>{escape(', '.join(setting.entities))}</td></tr>"
        )
    head = (
        f'<th>Setting</th><th class="n">Position (mm)</th><th class="n">{_named(plan)[1].capitalize()}</th>'
        '<th class="n">Smallest P</th><th>Which</th>'
    )
    return f'<div class="scroll"><table><tr>{head}</tr>{"".join(rows)}</table></div>'


def _settings(plan: InspectionPlan, solid: Solid, progress: Progress | None, rows: Sequence[Sequence[Row]]) -> str:
    maker = PictureMaker(solid, plan.camera)
    sections = []
    for k, setting in enumerate(plan.settings):
        sections.append(_setting(plan, k, setting, maker, rows[k]))
        report(progress, k + 1, len(plan.settings), "predicted images")
    return "".join(sections)


def _setting(plan: InspectionPlan, k: int, setting: SensorSetting, maker: PictureMaker, rows: Sequence[Row]) -> str:
    entities = drawn(plan, setting.entities)
    near_image, near_map = _enlarged(maker, setting, entities, color_of(k))
    x, y, z, w = Rotation.from_matrix(setting.cam2world[:3, :3]).as_quat(canonical=True)
    position = ", ".join(f"{value:.3f}" for value in setting.position)
    lamps = "".join(f'<p class="note">{escape(text[0].upper() + text[1:])}</p>' for text in lamp_texts(plan, k))
    images = plan.light.images[k] if plan.light is not None else ()
    lamp = plan.light.lamps[images[0].lamp] if plan.light is not None and images else None
    shaded = "Predicted image, hidden lines removed" + (f", under lamp {images[0].lamp + 1}" if images else "")
    return (
        f'<section class="setting" id="setting-{k + 1}"><div class="head"><h3>{_swatch(k)}Setting {k + 1}</h3>'
        f'<span class="note">camera at ({position}) mm, '
        f"quaternion x y z w = ({x:.6f}, {y:.6f}, {z:.6f}, {w:.6f})</span>"
        f'<button data-view="setting-{k + 1}">Show in 3-D</button></div>'
        f'<div class="shots"><figure>{maker.image_svg(setting.cam2world, entities, color_of(k), lamp)}'
        f"<figcaption>{shaded}</figcaption></figure>"
        f"{near_image}<figure>{maker.edge_map_svg(setting.cam2world, entities)}"
        f"<figcaption>{_map_caption(plan)}</figcaption></figure>{near_map}</div>"
        f'<div class="scroll">{setting_table(plan, rows, _named(plan)[0])}</div>'
        f"<p>{escape(binding_sentence(plan, setting))}</p>"
        f'<p class="note">Margins: {escape("; ".join(margin_texts(setting.margins)))}.</p>{lamps}</section>'
    )


def _enlarged(maker: PictureMaker, setting: SensorSetting, entities: dict[str, Any], color: str) -> tuple[str, str]:
    """Return image and edge map of what is measured, enlarged; nothing where it fills the image anyway."""
    window, pose = maker.window(setting.cam2world, entities), setting.cam2world
    times = maker.camera.resolution[0] / window[2]
    if times < _WORTH_ENLARGING:
        return "", ""
    told = f"enlarged {times:.3g} times: {window[2]} x {window[3]} px"
    return (
        f"<figure>{maker.image_svg(pose, entities, color, window=window)}"
        f"<figcaption>The same, {told}</figcaption></figure>",
        f"<figure>{maker.edge_map_svg(pose, entities, window=window)}"
        f"<figcaption>Edge map, {told}</figcaption></figure>",
    )


def _map_caption(plan: InspectionPlan) -> str:
    if not plan.dimensions:
        return "Edge map: the measured edges and their ends in bold"
    edges = len(plan.dimensions) < len(plan.entities)
    told = "Edge map: the lines and circles that are measured in bold"
    return told + (", edges with their ends" if edges else "")


def _request(plan: InspectionPlan) -> str:
    camera, sigmas = plan.camera, plan.pose_uncertainty.sigmas
    near, far = camera.depth_of_field_mm
    field = np.array(camera.sensor_size_mm) / camera.image_distance_mm * camera.focus_distance_mm
    left, top, right, bottom = camera.field().inner
    if not camera.is_centred:
        field = np.array([right - left, bottom - top]) * camera.focus_distance_mm
    rows = {
        "Required accuracy": _accuracy(plan),
        **({"Localisation": _localisation(plan)} if plan.dimensions else {}),
        "Required probability": f"{plan.probability:g}",
        "Camera": f"{camera.name or 'camera'}: f = {camera.focal_length_mm:g} mm, f/{camera.f_number:g}",
        "Sensor": f"{camera.resolution[0]} x {camera.resolution[1]} pixels of "
        f"{1000 * camera.pixel_pitch_mm[0]:g} x {1000 * camera.pixel_pitch_mm[1]:g} um",
        **calibration_rows(camera),
        "Focus": f"{camera.focus_distance_mm:g} mm; sharp from {near:.1f} mm "
        + (f"to {far:.1f} mm" if np.isfinite(far) else "on"),
        "Field of view": f"{field[0]:.0f} x {field[1]:.0f} mm in the plane of focus",
        "Camera pose, std. deviations": f"{_list(sigmas[:3])} mm along x, y, z; {_list(sigmas[3:])} rad about x, y, z",
        "Workspace": f"({_list(plan.workspace[0], '.1f')}) to ({_list(plan.workspace[1], '.1f')}) mm",
        **requirement_rows(plan.requirements),
        "Seed": str(plan.seed),
    }
    return "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows.items()) + "</dl>"


def _accuracy(plan: InspectionPlan) -> str:
    """Say what the accuracy of the request holds for."""
    edges = f"error at most {100 * (1 - plan.accuracy):.3g} % of an edge's image"
    if not plan.dimensions:
        return f"{plan.accuracy:g} ({edges})"
    own = "dimensions without a requirement of their own may be off by "
    told = f"{own}{100 * (1 - plan.accuracy):.3g} % of the nominal value"
    return f"{plan.accuracy:g} ({told}{'' if len(plan.dimensions) == len(plan.entities) else '; ' + edges})"


def _localisation(plan: InspectionPlan) -> str:
    models = dict.fromkeys(localisation_text(one.localisation) for one in plan.dimensions.values())
    edges = [] if len(plan.dimensions) == len(plan.entities) else ["of edges, both ends on whole pixels"]
    return "; ".join([*models, *edges])


def _method(plan: InspectionPlan) -> str:
    paragraphs = [
        f"{_seen(plan)} can be seen from where was computed exactly from the part's geometry. Camera poses were "
        "searched "
        "by a genetic algorithm inside the viewing domains, subject to resolution, focus, field of view, visibility, "
        f"clearance and workspace; of all poses found, a few that together inspect every {_named(plan)[0]} that any of "
        "them inspects "
        "were chosen by integer programming and exchange.",
        f"Lower bound. {plan.bound_proof} {_gap(plan)}",
    ]
    if plan.on_grid:
        paragraphs.append(f"Pixel grid. {grid_sentence(plan)}")
    if plan.simulation is not None and plan.settings:
        paragraphs.append(_simulated(plan, plan.simulation))
    if plan.light is not None:
        paragraphs.append(_lit(plan.light))
    paragraphs.append(
        "Method after C. C. Yang and F. W. Ciarallo, Optimized sensor placement for active visual inspection, Journal "
        "of Robotic Systems 18(1), 1-15, 2001."
    )
    return "".join(f"<p>{escape(text)}</p>" for text in paragraphs)


def _gap(plan: InspectionPlan) -> str:
    """Say what the bound leaves open."""
    n, bound = len(plan.settings), plan.lower_bound
    if not n:
        return "So there is nothing to prove."
    if plan.minimal:
        return f"The plan has {count(n, 'setting')} and the bound is {bound}, so for what it inspects it is minimal."
    return f"The plan has {count(n, 'setting')}; for what it inspects, the least number is from {bound} to {n}."


def _seen(plan: InspectionPlan) -> str:
    return "Which edges, rims and arcs" if plan.dimensions else "Which edges"


def _drawn_and_measured(plan: InspectionPlan) -> str:
    """Say what a simulation does at each displaced pose."""
    edges = (
        "the edges projected, their ends rounded to pixels and measured. An end outside the image counts as a failure."
    )
    if not plan.dimensions:
        return edges
    own = (
        "points of the entities projected, found with an error after the localisation model, carried back to the part "
        "with the planned pose, and fitted. A point outside the image counts as a failure."
    )
    return own if len(plan.dimensions) == len(plan.entities) else f"{own} Of edges that are no dimensions: {edges}"


def _simulated(plan: InspectionPlan, simulation: SimulationResult) -> str:
    one = _named(plan)[0]
    return (
        f"Simulation. For each setting {count(simulation.n, 'displaced pose')} were drawn, {_drawn_and_measured(plan)} "
        f"All intervals hold together with {percent(simulation.confidence)} confidence. A stated probability is "
        "confirmed when it is "
        f"inside its interval, and conservative when it is below: the {one} is measured better than stated. Above the "
        f"interval by at most {MODEL_TOLERANCE:g} it is within the model's tolerance, as the model takes the phases of "
        "the pixel grid as random; above it by more, it is contradicted."
    )


def _lit(light: LightPlan) -> str:
    """Say what lamps rest on."""
    return (
        "Light. Where both faces of an edge are seen, its contrast is that between their shades; of a silhouette it is "
        f"that with what is seen beside it, and the ground is taken as {light.ground}. The part is taken as matt and "
        "of one albedo, lamps as points, one of them on at a time, and no face as lighting another; polished metal is "
        f"out of scope. {light.bound_proof}"
    )


def _down(value: float, digits: int) -> str:
    """Return a number rounded down, so that it does not seem to reach what it misses."""
    return f"{np.floor(value * 10**digits + 1e-6) / 10**digits:.{digits}f}"


def _swatch(k: int) -> str:
    return f'<span class="swatch" style="background:{color_of(k)}"></span>'


def _list(values: Iterable[float], spec: str = ".4g") -> str:
    return ", ".join(f"{value:{spec}}" for value in values)

"""The report of a plan as one HTML page, and the overview with which it begins."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from aspectgraph.plot.picker import LabelLayout, Spot, label_layout
from errors.checks import percent_text, probability_text
from ground.faces import program_name
from ground.templates import asset, render
from planner.argument_kinds import check_kinds, check_space, suggests_names
from planner.camera.camera import Camera
from planner.camera.pose import look_at, world_to_cam
from planner.measuring.foreseen import with_foreseen
from planner.progress import labelled, report
from planner.report.coverage import coverage_html
from planner.report.figure import (
    GraphPicture,
    arm_section,
    color_of,
    figure_html,
    figure_views,
    graph_picture,
    lines_of,
    packed,
    plan_figure,
    polylines,
    scene_frame,
)
from planner.report.predicted_image import SIMPLER, PictureMaker, path_data, png_data
from planner.report.setting_report import (
    SettingSection,
    budgets_table,
    dimensions_table,
    foreseen_table,
    localisation_text,
    setting_sections,
    settings_table,
)
from planner.report.tables import (
    COLOURS,
    Notice,
    arm,
    attention,
    clearance_sentence,
    may_be_unsharp,
    not_inspected,
    not_planned,
    poses,
    promise_name,
    results,
    source_text,
)
from planner.report.wording import (
    MORE_TIME,
    assumed_edges_text,
    bound_sentence,
    calibration_rows,
    dark_note,
    dark_sentence,
    edges_text,
    entities_words,
    entity_words,
    evolved_sentence,
    features_sentence,
    given_text,
    light_sentence,
    percent,
    promise_sentence,
    registration_text,
    requirement_rows,
    simulated_sentences,
    surfaces_sources,
    unfinished_sentence,
    unlit_sentence,
    unstated_edges_text,
    window_sentence,
)
from planner.request.reach import TargetSpace
from planner.request.targets import PlannedDimension, targets_of, words_of
from planner.rows import Row, measured_rows
from planner.text_table import count
from planner.verify.simulate_setting import CONFIRMED, CONTRADICTED, MODEL_TOLERANCE

if TYPE_CHECKING:
    from markupsafe import Markup

    from aspectgraph import EntityAspectGraph, Solid
    from planner.camera.camera import Camera
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.reach import Space
    from planner.robotcell import Cell
    from planner.sensor_setting import SensorSetting

# The part with all targets called out: the first picture of a report.
#
# A picture shows the part from outside, hidden lines removed. Targets that the first one hides
# are called out in a second one, from another side. Only what both hide is dashed. A thin line
# joins the two entities of a dimension, and carries its name. The names are laid out twice: for a
# desktop, and for a phone.


# Where a plan comes from: program, date, part, camera and uncertainty, for the head of a report.


# digits of a digest that tell parts apart at a glance
_DIGEST_DIGITS = 12


def facts(plan: InspectionPlan, date: str | None = None) -> dict[str, str]:
    """Return the facts at the head of a report by their names.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    date : str, optional
        When the report was written; nothing is said of it otherwise.
    """
    rows = {
        "Part": plan.part or "part",
        "Digest of the part": _digest(plan),
        "Camera": camera_text(plan.camera),
        "Camera pose": sigma_text(plan.pose_uncertainty.sigmas),
        "Edges": _edges(plan),
        "Program": program_name(),
        "Date": date or "",
        "Operator": "" if plan.made is None else plan.made.operator,
    }
    return {name: value for name, value in rows.items() if value}


def _edges(plan: InspectionPlan) -> str:
    """Return the state of edges; what breaks would do stands among the notices."""
    text = edges_text(plan)
    unstated = unstated_edges_text(plan)
    return text.replace(unstated, "planned as sharp") if unstated else text


def camera_text(camera: Camera) -> str:
    """Return a camera with its lens, for the head of a report.

    Parameters
    ----------
    camera : Camera
        The camera.
    """
    return (
        f"{camera.name or 'camera'}, f = {camera.focal_length_mm:g} mm, f/{camera.f_number:g}, "
        f"focused at {camera.focus_distance_mm:g} mm"
    )


def _digest(plan: InspectionPlan) -> str:
    """Return the first digits of the part's digest."""
    part = plan.request.part
    return "" if part is None else part.digest[:_DIGEST_DIGITS]


def sigma_text(sigmas: np.ndarray) -> str:
    """Return standard deviations (6,) of a camera pose, mm and rad, as short as they allow.

    Parameters
    ----------
    sigmas : ndarray, shape (6,)
        Along and about x, y, z.
    """
    groups = []
    for values, unit in ((sigmas[:3], "mm"), (sigmas[3:], "rad")):
        texts = [f"{value:.4g}" for value in values]
        if len(set(texts)) == 1:
            texts = texts[:1]
        groups.append(f"{', '.join(texts)} {unit}")
    return f"σ = {groups[0]} and {groups[1]}"


_Array = NDArray[np.float64]

NOT_INSPECTED = "#c0152f"
"""Colour of targets that no setting measures."""

MOST_NAMES = 120
"""Of more targets the pictures hold no names, which would be too small to read."""

_SIDES = tuple((x, y, z) for z in (0.75, -0.75) for x in (1.1, -1.1) for y in (-1.3, 1.3))
# from the part's middle to the eye, in diagonals of its box: little perspective
_DISTANCE = 4.0
_RESOLUTION = 2400
_FOCAL_MM = 10.0
# the part's diagonal takes this share of the virtual sensor
_FILLED = 0.8
_SAMPLES = 9
# a target is called out where at least this share of it is visible
_VISIBLE = 0.5
# larger side of the first picture and of the second one, pt
_SIZES_PT = (560.0, 400.0)
# on a phone, whose page is 370 px wide
_PHONE_PT = 266.0
# smaller names on a phone are left out
_LEAST_FONT_PT = 5.0


class OverviewView(NamedTuple):
    """A picture: pose of its eye (4, 4), and the targets it calls out."""

    cam2world: _Array
    names: tuple[str, ...]


@dataclass(frozen=True)
class _Target:
    """A target: its lines, mm, points along them, and the line (2, 3) that joins two entities."""

    lines: list[_Array]
    samples: _Array
    span: _Array | None = None


def overview(plan: InspectionPlan, solid: Solid) -> Markup | str:
    """Return the part with all targets called out, as HTML; nothing of a plan without targets.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    """
    if not plan.entities:
        return ""
    targets = {name: _target(polylines(plan, name)) for name in plan.entities}
    maker = PictureMaker(solid, _eye_camera(solid))
    views = choose_views(maker, {name: target.samples for name, target in targets.items()})
    colors = target_colors(plan)
    seen = {name for view in views for name in view.names}
    pictures = []
    for k, view in enumerate(views):
        hidden = [name for name in targets if name not in seen] if k == 0 else []
        drawing = _drawing(maker, view, hidden, targets, colors)
        pictures.append(_picture(maker, drawing, k, len(targets) <= MOST_NAMES))
    return render(
        "planner",
        "report/templates/overview.html",
        views=pictures,
        plan=plan,
        any_hidden=len(seen) < len(targets),
        most_names=MOST_NAMES,
    )


def target_colors(plan: InspectionPlan) -> dict[str, str]:
    """Return the colour of each target: of the setting with its largest probability.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    best: dict[str, tuple[float, int]] = {}
    for k, setting in enumerate(plan.settings):
        for name in setting.entities:
            best[name] = max(best.get(name, (-1.0, 0)), (setting.probability[name], -k))
    for name in plan.unlit:
        best.pop(name, None)
    return {
        name: color_of(-best[name][1]) if name in best else NOT_INSPECTED for name in plan.entities
    }


def choose_views(maker: PictureMaker, samples: Mapping[str, _Array]) -> list[OverviewView]:
    """Return one view, or two if the first one hides targets that another one shows.

    Parameters
    ----------
    maker : PictureMaker
        Of the part.
    samples : mapping of str to ndarray, shape (n, 3)
        Points along each target, mm.
    """
    bounds = maker.solid.bounds
    middle = bounds.mean(axis=0)
    distance = _DISTANCE * float(np.linalg.norm(bounds[1] - bounds[0]))
    names = list(samples)
    points = np.concatenate(list(samples.values()))
    owner = np.repeat(np.arange(len(names)), list(map(len, samples.values())))
    total = np.bincount(owner, minlength=len(names))
    poses = []
    shows = []
    for side in _SIDES:
        towards = np.array(side) / np.linalg.norm(side)
        pose = look_at((middle + distance * towards)[None], middle)[0]
        visible = maker.visible(pose, points)
        n_visible = np.bincount(owner, weights=visible, minlength=len(names))
        poses.append(_upright(pose))
        shows.append(n_visible >= _VISIBLE * total)
    first = int(np.argmax([visible.sum() for visible in shows]))
    views = [_view(poses[first], names, shows[first])]
    more = [visible & ~shows[first] for visible in shows]
    second = int(np.argmax([visible.sum() for visible in more]))
    if more[second].any():
        views.append(_view(poses[second], names, more[second]))
    return views


def _view(pose: _Array, names: Sequence[str], shown: NDArray[np.bool_]) -> OverviewView:
    return OverviewView(
        pose, tuple(name for name, is_shown in zip(names, shown.tolist(), strict=True) if is_shown)
    )


def _upright(pose: _Array) -> _Array:
    """Return a pose turned about its axis so that z points up in the image."""
    forward = pose[:3, 2]
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    upright = pose.copy()
    upright[:3, 0] = right
    upright[:3, 1] = np.cross(forward, right)
    return upright


def _eye_camera(solid: Solid) -> Camera:
    """Return a camera that holds the part at the distance of the eye; sharpness does not matter."""
    diagonal = float(np.linalg.norm(solid.bounds[1] - solid.bounds[0]))
    distance = _DISTANCE * diagonal
    focal = min(_FOCAL_MM, distance / 10)
    image_distance = focal * distance / (distance - focal)
    pitch = image_distance * diagonal / (distance * _FILLED * _RESOLUTION)
    return Camera(focal, (pitch, pitch), (_RESOLUTION, _RESOLUTION), 8.0, distance)


def _target(lines: list[_Array]) -> _Target:
    pieces = []
    for line in lines:
        pieces.append(_along(line) if len(line) == 2 else (line[:-1] + line[1:]) / 2)
    middles = [piece.mean(axis=0) for piece in pieces]
    span = np.array(middles) if len(middles) == 2 else None
    return _Target(lines, np.concatenate(pieces), span)


def _along(line: _Array) -> _Array:
    """Return points along a line (2, 3)."""
    share = (np.arange(_SAMPLES) + 0.5)[:, None] / _SAMPLES
    return np.asarray((1 - share) * line[0] + share * line[1])


class _Stroke(NamedTuple):
    """A line of a picture: its class, its colour, the data of its SVG path."""

    kind: str
    color: str
    path: str
    dashed: bool = False


class _Drawing(NamedTuple):
    """What a view shows: pose (4, 4), corners of the part in the image, targets and their spots."""

    pose: _Array
    low: _Array
    high: _Array
    lines: list[_Stroke]
    spots: list[Spot]


def _drawing(
    maker: PictureMaker,
    view: OverviewView,
    hidden: Sequence[str],
    targets: Mapping[str, _Target],
    colors: Mapping[str, str],
) -> _Drawing:
    """Return the targets of a view, and where their names may be."""
    pose = view.cam2world

    def seen(points: _Array) -> _Array:
        return np.asarray(maker.project(world_to_cam(points, pose)))

    corners = seen(maker.solid.vertices)
    spots = []
    lines = []
    # a feature of several targets has the colour of one that is inspected
    names = sorted([*view.names, *hidden], key=lambda name: colors[name] != NOT_INSPECTED)
    for name in names:
        target = targets[name]
        color = colors[name]
        path = path_data([seen(line) for line in target.lines], SIMPLER * _RESOLUTION)
        lines.append(_Stroke("entity", color, path, name in hidden))
        if target.span is None:
            spots.append(Spot(name, color, seen(target.samples)))
            continue
        lines.append(_Stroke("leader", color, path_data([seen(target.span)], 0.0)))
        spots.append(Spot(name, color, seen(_along(target.span))))
    return _Drawing(pose, corners.min(axis=0), corners.max(axis=0), lines, spots)


class _Label(NamedTuple):
    """A name on its target, beside it or at the frame; a leader joins it with the target's middle."""

    text: str
    color: str
    place: tuple[float, ...]
    middle: tuple[float, ...]
    leader: bool


class _Names(NamedTuple):
    """The names of a picture: left, top, width and height of it, units of it to the pt, size of the font."""

    box: tuple[int, ...]
    unit: float
    font: float
    labels: list[_Label]


def _picture(maker: PictureMaker, drawing: _Drawing, number: int, is_named: bool) -> dict[str, Any]:
    """Return a view for a desktop, and for a phone with the same drawing and names of its own."""
    extent = (drawing.high - drawing.low) / (drawing.high - drawing.low).max()
    spots = drawing.spots if is_named else []
    wide = label_layout(spots, drawing.low, drawing.high, extent * _SIZES_PT[number])
    narrow = label_layout(spots, drawing.low, drawing.high, extent * _PHONE_PT)
    if narrow.font_pt < _LEAST_FONT_PT:
        narrow = label_layout([], drawing.low, drawing.high, extent * _PHONE_PT)
    low = np.floor(np.minimum(wide.low, narrow.low)).astype(int).tolist()
    high = np.ceil(np.maximum(wide.high, narrow.high)).astype(int).tolist()
    window = (low[0], low[1], high[0] - low[0], high[1] - low[1])
    return {
        "name": f"targets-{number + 1}",
        "window": window,
        "png": png_data(maker.shaded(drawing.pose, window=window)),
        "edges": maker.edge_path(drawing.pose, _RESOLUTION),
        "lines": drawing.lines,
        "wide": _names(wide, spots, _SIZES_PT[number]),
        "narrow": _names(narrow, spots, _PHONE_PT),
    }


def _names(layout: LabelLayout, spots: Sequence[Spot], size_pt: float) -> _Names:
    unit = float((layout.high - layout.low).max() / size_pt)
    labels = []
    for n, place in layout.places.items():
        spot = spots[n]
        middle = tuple(spot.middle.tolist())
        leader = n not in layout.carried
        labels.append(_Label(spot.text, spot.colour, tuple(place.tolist()), middle, leader))
    corner = np.floor(layout.low).astype(int).tolist()
    size = np.ceil(layout.high - layout.low).astype(int).tolist()
    return _Names((*corner, *size), unit, layout.font_pt * unit, labels)


# Choosing a target in the 3-D view: what each setting measures of it, and by which witness.


# digits behind the point, mm
_DIGITS = 3


class TargetPicker(NamedTuple):
    """What a page needs to choose targets.

    Attributes
    ----------
    groups : dict
        The list to choose from: names of targets by their values, in groups with labels.
    data : dict
        What each entry shows, by its value in the list.
    """

    groups: dict[str, dict[str, str]]
    data: dict[str, dict[str, Any]]


def target_picker(plan: InspectionPlan) -> TargetPicker:
    """Return a list of the targets of each setting, and what is shown of each.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    shown: dict[str, dict[str, Any]] = {}
    groups = {}
    for k, setting in enumerate(plan.settings):
        values = {f"{k + 1}:{i}": name for i, name in enumerate(setting.entities)}
        shown |= {value: _shown(plan, k, name) for value, name in values.items()}
        groups[f"Setting {k + 1}"] = values
    if plan.uninspectable:
        missing = {f"none:{i}": name for i, name in enumerate(plan.uninspectable)}
        shown |= {value: _not_inspected(plan, name) for value, name in missing.items()}
        groups["Not inspected"] = missing
    return TargetPicker(groups, shown)


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
        used = targets_of(plan.targets, setting)[name]
        text += f" by {' and '.join(map(entity_words, used.entities))}"
        text += " alone" if name in setting.ends else ""
        if len(target.ways) > 1:
            text += f", one of {count(len(target.ways), 'way')}{_passed_over(setting, name)}"
    others = [
        str(i + 1) for i, other in enumerate(plan.settings) if i != k and name in other.entities
    ]
    too = f" Measured in setting {' and '.join(others)}, too." if others else ""
    return f"{text}.{too}"


def _passed_over(setting: SensorSetting, name: str) -> str:
    over = setting.passed_over.get(name, {})
    parts = [f"{entities_words(entities)}: {reason}" for entities, reason in over.items()]
    return f". Not used: {'; '.join(parts)}" if parts else ""


def _rounded(lines: Iterable[Sequence[Any] | NDArray[np.float64]]) -> list[list[list[float]]]:
    return [np.round(np.asarray(line, dtype=np.float64), _DIGITS).tolist() for line in lines]


# The report: one self-contained HTML file about a plan, for the screen, the printer and the
# customer.


_POSE = "camera pose"


@cache
def packed_plotly() -> str:
    """Return plotly's script, compressed with zlib, in base64: two fifths of its size."""
    from plotly.offline import get_plotlyjs

    return packed(get_plotlyjs())


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

        page = render(
            "planner",
            "report/templates/page.html",
            plan=self.plan,
            settings=self.sections,
            notes=self.notes,
            graph=self.graph,
            plotly=Markup(packed_plotly()),
            picks=Markup(packed(json.dumps(self.values["picker"].data, separators=(",", ":")))),
            base_style=asset("planner.report", "templates/base.css"),
            style=asset("planner.report", "templates/page.css"),
            drawing=asset("planner.report", "templates/figures.js"),
            script=asset("planner.report", "templates/page.js"),
            sorting=asset("planner.report", "templates/sort.js"),
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


@suggests_names
def report_html(
    plan: InspectionPlan,
    space: Space | Solid,
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
    space : Solid, VisibilityRegions or EntityAspectGraph
        The part, whose viewing domains are then computed. Or regions that hold the entities of the plan's targets,
        such as those of `plan_inspection`: they need not be computed again.
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
    >>> from aspectgraph import read_solid
    >>> from planner import read_plan, report_html
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> page = report_html(plan, read_solid("examples/two_pocket_block.off"))
    >>> "two_pocket_block" in page
    True
    """
    page = make_report(plan, space, progress, notes, date=date, until=until, cell=cell)
    if graph is not None:
        page.draw_graph(graph, progress, until=until)
    return page.html()


def make_report(
    plan: InspectionPlan,
    space: Space | Solid,
    progress: Progress | None = None,
    notes: Sequence[str] = (),
    *,
    date: str | None = None,
    until: float = math.inf,
    cell: Cell | None = None,
) -> Report:
    """Return the report of a plan, still without its joint graph; takes what `report_html` takes."""
    space = _space_of(plan, space, progress)
    if not plan.foreseen and until == math.inf:
        # a plan of an older file does not hold them
        plan = with_foreseen(plan, space.solid)
    if plan.settings:
        # something shows while the figure and the tables are made
        report(progress, 0, len(plan.settings), "predicted images")
    figure = plan_figure(plan, space.solid, space, until=until)
    size = scene_frame(plan, space.solid).size
    rows = measured_rows(plan)
    nouns = _nouns(plan)
    unsharp = [k for k, setting in enumerate(plan.settings, 1) if may_be_unsharp(plan, setting)]
    dimensions = dimensions_table(plan)
    only_dimensions = dimensions and len(plan.dimensions) == len(plan.entities)
    values = {
        "lead": _lead(plan),
        "more": _more(plan),
        "figures": _figures(plan),
        "facts": facts(plan, date),
        "overview": overview(plan, space.solid),
        "coverage": coverage_html(plan) if dimensions else "",
        "scene": figure_html(figure, "plan3d", "100%", size, scrollZoom=True),
        "not_inspected": not_inspected(plan.uninspectable, nouns[0]),
        "not_planned": not_planned(plan.not_planned),
        "notices": [*attention(rows, unsharp), *_run_notices(plan), *_edge_notices(plan)],
        "dimensions": dimensions,
        "budgets": budgets_table(plan),
        **_foreseen(plan, rows),
        "results": None if only_dimensions else results(plan, rows, nouns[0]),
        "sources": {source_text(source): color for source, color in COLOURS.items()},
        # shorter than base64
        "csv": quote(plan.to_csv(), safe=",;:()/=+"),
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
        "evolved_sentence": evolved_sentence,
        "count": count,
        "percent": percent,
        "model_tolerance": MODEL_TOLERANCE,
    }
    sections = setting_sections(plan, space.solid, rows, progress, until=until)
    return Report(plan, sections, values, list(notes))


def _foreseen(plan: InspectionPlan, rows: Sequence[Sequence[Row]]) -> dict[str, Any]:
    """Return what the page says of the U that `measure` will state, and of what nothing is foreseen."""
    return {
        "foreseen": foreseen_table(plan),
        "unforeseen": ", ".join(_unforeseen(plan, rows)),
    }


def _unforeseen(plan: InspectionPlan, rows: Sequence[Sequence[Row]]) -> list[str]:
    """Return the dimensions whose U no foreseen one replaces: lengths of edges."""
    measured = (row for of_setting in rows for row in of_setting if row.name in plan.dimensions)
    return list(dict.fromkeys(row.name for row in measured if row.foreseen is None))


def _space_of(plan: InspectionPlan, space: Space | Solid, progress: Progress | None) -> Space:
    """Return where a plan's targets are observable from; the regions of a part are computed."""
    from aspectgraph import Solid, compute_regions

    check_kinds(plan=(plan, "InspectionPlan"))
    if not isinstance(space, Solid):
        check_space(space, may_be_part=True)
        return TargetSpace.of_plan(space, plan)
    records = {
        record.name: record
        for target in plan.targets.values()
        for witness in target.witnesses
        for record in witness.records
    }
    entities = {name: record.entity_of(space) for name, record in records.items()}
    shown = labelled(progress, "visible regions")
    regions = compute_regions(space, entities, workspace=plan.workspace, progress=shown)
    return TargetSpace.of_plan(regions, plan)


def _nouns(plan: InspectionPlan) -> tuple[str, str]:
    """Return what the report calls a target, and several."""
    return words_of(plan.targets).nouns


def _lead(plan: InspectionPlan) -> str:
    """Say in at most three sentences what the plan does, and what is proven."""
    n = len(plan.settings)
    inspected = len(plan.inspected)
    n_targets = count(len(plan.entities), *_nouns(plan))
    features = features_sentence(plan)
    if not n:
        return f"{inspected} of {n_targets} inspected: the plan has no camera poses. {features}".rstrip()
    verb = "is" if inspected == 1 else "are"
    dark = f"{dark_sentence(plan)} ".lstrip()
    return (
        f"{inspected} of {n_targets} {verb} measured from {count(n, _POSE)} ({_numbers(n)}). "
        f"{dark}{bound_sentence(plan, _nouns(plan), _POSE)}"
    )


def _more(plan: InspectionPlan) -> str:
    """Say what stands behind the first sentences: characteristics that are not planned, simulation and light."""
    if not plan.settings:
        return ""
    poses = given_text(plan)
    named = f"{poses[0].upper()}{poses[1:]}." if poses else ""
    sentences = [named, features_sentence(plan), *simulated_sentences(plan), light_sentence(plan)]
    return " ".join(filter(None, sentences))


def _run_notices(plan: InspectionPlan) -> list[Notice]:
    """Return what the plan does not promise, because of how it was made."""
    early = f"{unfinished_sentence(plan)} {MORE_TIME}" if plan.unfinished else ""
    texts = {"Planning": early, "Light": unlit_sentence(plan)}
    return [Notice(head, [(f": {text}", ())]) for head, text in texts.items() if text]


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
    shown = len(plan.inspected)
    cells.append((f"{shown} / {len(plan.entities)}", f"{_nouns(plan)[1]} inspected"))
    if plan.n_features_not_planned:
        measured = sum(name in plan.dimensions for name in plan.inspected)
        cells.append((f"{measured} / {plan.n_features}", "characteristics inspected"))
    if shown:
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
    if plan.unlit:
        seen = count(len(plan.promises), *_nouns(plan))
        return f"{label} for the {seen} that poses inspect{dark_note(plan)}"
    if not plan.uninspectable:
        return label
    return f"{label} for the inspected {_nouns(plan)[len(plan.inspected) > 1]}"


def _edge_notices(plan: InspectionPlan) -> list[Notice]:
    """Return what breaks of edges would do where none is stated; nothing where it does not matter."""
    text = unstated_edges_text(plan)
    return [Notice("Edges", [(f" are {text}", ())])] if text else []


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
        "assumed": assumed_edges_text(plan),
        "response": plan.camera.response,
        "accuracy": words.accuracy.format(share=percent_text(1 - plan.accuracy)),
        "localisation": [*models, *words.localisation],
        "surfaces": surfaces_sources(dimensions) if rough else [],
        "edges": edges_text(plan),
        "calibration": calibration_rows(camera),
        "infinity": math.inf,
        "field_mm": field.tolist(),
        "sigmas": sigma_text(plan.pose_uncertainty.sigmas),
        "registration": registration_text(plan),
        "clearance": clearance_sentence(plan),
        "requirements": requirement_rows(plan),
    }

"""The section of the report about settings: a table of all, then each with its predicted images."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import compress
from typing import TYPE_CHECKING, Any, NamedTuple

from scipy.spatial.transform import Rotation

from aspectgraph.solid.solid import RayScene
from errors.checks import interval_text, probability_text
from errors.measurands import DecisionRule, Localisation, acceptance_limits, uncertainty_ratio
from errors.measurands.geometry import is_short
from errors.measurands.measurand import COVERAGE
from planner.light.light_plan import WHITE_SHARE, Exposure, exposure_of
from planner.measuring.foreseen import surest
from planner.measuring.results import decimals_of, rounded_up
from planner.progress import TimeLeft, report
from planner.report.coverage import zone_of
from planner.report.figure import color_of, drawn
from planner.report.predicted_image import PictureMaker
from planner.report.tables import (
    COLOURS,
    CellLine,
    Promised,
    Share,
    binding_sentence,
    focus_note,
    passed_over_sentence,
    promise_name,
    setting_table,
    source_text,
    stance,
    unbroken,
)
from planner.report.wording import (
    entity_words,
    features_cell,
    lamp_texts,
    lamps_named,
    margin_texts,
    surfaces_sources,
    white_text,
)
from planner.request.dimension import POSITIONS, is_one_sided
from planner.request.targets import targets_of, words_of
from planner.request.words import amount_text, deviation_text, tolerance_text
from planner.rows import Row, split_rows
from planner.text_table import Column, Table, digits_text
from planner.verify.setting_record import Measurement, measurements

if TYPE_CHECKING:
    from markupsafe import Markup

    from aspectgraph import Solid
    from planner.camera.camera import Camera
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.targets import PlannedDimension
    from planner.rows import Row
    from planner.sensor_setting import SensorSetting


# what fills more of the image is shown once
_WORTH_ENLARGING = 1.25
# from this ratio of light on, the dimmest target is named
_UNEVEN = 2.0


def settings_table(plan: InspectionPlan, nouns: tuple[str, str]) -> Table:
    """Return a row per setting.

    Parameters
    ----------
    plan : InspectionPlan
        The plan, with settings.
    nouns : tuple of str
        What a target is called, and several.
    """
    smallest = [min(setting.promise.values()) for setting in plan.settings]
    promised = Promised(plan, smallest, [])
    differs = bool(promised.columns)
    columns = [
        Column("Setting", kind="setting"),
        Column("Position", right=True, unit="mm", spec=".1f"),
        Column("Distance", right=True, unit="mm", spec=".0f"),
        Column("Tilt", right=True, unit="°", spec=".1f"),
        Column("µm/px", right=True, spec=".3g"),
        *([Column(f"Smallest {promised.name}", right=True)] if differs else []),
        Column(nouns[1].capitalize()),
    ]
    rows = []
    for k, setting in enumerate(plan.settings):
        row = [
            (k + 1, color_of(k)),
            setting.position,
            *stance(plan, setting),
            *([promised.text(smallest[k])] if differs else []),
            ", ".join(map(unbroken, setting.entities)),
        ]
        rows.append(row)
    note = (
        "Distance: from the front nodal point to the targets, along the optical axis. Tilt: angle between "
        "the optical axis and the part's z axis. µm/px: size of a pixel at that distance."
    )
    if not differs:
        note += f" The smallest {promised.name} of every setting is {promised.text(min(smallest))}."
    return Table(columns, rows, style="stack", notes=[note])


class CaptionedPicture(NamedTuple):
    """A picture of a setting with its caption."""

    picture: Markup
    caption: str


class SettingSection(NamedTuple):
    """What the report says of a setting.

    Attributes
    ----------
    number : int
        From 1.
    color : str
        Its colour.
    pose : str
        How its camera stands, and where.
    shots : list of CaptionedPicture
        Predicted images and edge maps; empty if there was no time for them.
    measured : Table
        What it measures.
    sentences : str
        On the constraint that binds, focus, and other ways to measure.
    margins : str
        Margin of each constraint.
    lamps : list of str
        What its lamps show and how to expose, a sentence each.
    """

    number: int
    color: str
    pose: str
    shots: list[CaptionedPicture]
    measured: Table
    sentences: str
    margins: str
    lamps: list[str]


def setting_sections(
    plan: InspectionPlan,
    solid: Solid,
    rows: Sequence[Sequence[Row]],
    progress: Progress | None = None,
    *,
    until: float = math.inf,
) -> list[SettingSection]:
    """Return each setting: pose, predicted images, probabilities, the binding constraint, margins and lamps.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    rows : sequence of sequence of Row
        As of `measured_rows`.
    progress : callable, optional
        ``progress(done, total, label)``.
    until : float
        Time, as `time.time` gives it, after which settings get no pictures.
    """
    maker = PictureMaker(solid, plan.camera)
    scene = RayScene(solid.vertices, solid.triangles) if plan.light is not None else None
    time_left = TimeLeft(until)
    sections = []
    for k, setting in enumerate(plan.settings):
        texts = [*lamp_texts(plan, k), *exposure_texts(plan, scene, k)]
        section = SettingSection(
            number=k + 1,
            color=color_of(k),
            pose=_pose_text(plan, setting),
            shots=_shots(plan, k, maker) if time_left.fits_another() else [],
            measured=setting_table(plan, rows[k]),
            sentences=f"{binding_sentence(plan, setting)} {focus_note(plan, setting)} "
            f"{passed_over_sentence(setting)}",
            margins="; ".join(margin_texts(setting.margins)),
            lamps=[text[0].upper() + text[1:] for text in texts],
        )
        sections.append(section)
        report(progress, k + 1, len(plan.settings), "predicted images")
    return sections


def exposure_texts(plan: InspectionPlan, scene: RayScene | None, k: int) -> list[str]:
    """Say what to expose each image of a setting for; nothing of a plan without lamps.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    scene : RayScene or None
        Of its part.
    k : int
        Number of the setting, from 0.
    """
    if plan.light is None or scene is None:
        return []
    texts = []
    for image in plan.light.images[k]:
        # plans of earlier programs do not have it
        exposure = image.expose_for or exposure_of(image, plan.light, plan, k, scene)
        if exposure is None:
            continue
        text = f"under {lamps_named(image, plan.light)}, expose so that {_exposed_text(exposure, plan.camera)}"
        if exposure.times >= _UNEVEN:
            text += f"; {exposure.dimmest} gets {exposure.times:.1f} times less light"
        texts.append(text)
    return texts


def _exposed_text(exposure: Exposure, camera: Camera) -> str:
    """Say what must be how bright."""
    if not exposure.radius_px:
        return (
            f"pixel {exposure.pixel} beside {exposure.target} has "
            f"{white_text(exposure.share, camera)}: it is the brightest place "
            "beside the targets of a matt part"
        )
    white = white_text(WHITE_SHARE, camera)
    return (
        f"the mean within {exposure.radius_px} px of pixel {exposure.pixel} has "
        f"{white_text(exposure.share, camera)}: the brightest place beside the targets of a matt part, "
        f"at {exposure.target}, then has at most {white}"
    )


def _pose_text(plan: InspectionPlan, setting: SensorSetting) -> str:
    x, y, z, w = Rotation.from_matrix(setting.cam2world[:3, :3]).as_quat(canonical=True)
    position = ", ".join(f"{value:.3f}" for value in setting.position)
    return (
        f"{stance(plan, setting).text}; camera at ({position}) mm, "
        f"quaternion x y z w = ({x:.6f}, {y:.6f}, {z:.6f}, {w:.6f})"
    )


def _shots(plan: InspectionPlan, k: int, maker: PictureMaker) -> list[CaptionedPicture]:
    """Return predicted image and edge map; next to each the targets enlarged, if they are small in the image."""
    pose = plan.settings[k].cam2world
    entities = drawn(plan, plan.settings[k].entities, plan.settings[k])
    color = color_of(k)
    images = plan.light.images[k] if plan.light is not None else ()
    lamp = None
    shaded = "Predicted image, hidden lines removed"
    if plan.light is not None and images:
        lamp = plan.light.area or plan.light.lamps[list(images[0].lamps)]
        shaded += f", under {lamps_named(images[0], plan.light)}"
    window = maker.window(pose, entities)
    times = maker.camera.resolution[0] / window[2]
    is_enlarged = times >= _WORTH_ENLARGING
    width = window[2] if is_enlarged else maker.camera.resolution[0]
    shared = maker.shared_lines(pose, entities, width, str(k + 1))
    edge_map = CaptionedPicture(maker.edge_map_svg(pose, entities, shared), _map_caption(plan))
    if not is_enlarged:
        image = maker.image_svg(pose, entities, color, lamp, shared=shared)
        return [CaptionedPicture(image, shaded), edge_map]
    enlarged = f"the frame enlarged {times:.3g} times ({window[2]} x {window[3]} px)"
    whole = maker.image_svg(pose, entities, color, lamp, outlined=window, shared=shared)
    near = maker.image_svg(pose, entities, color, lamp, window=window, shared=shared)
    near_map = maker.edge_map_svg(pose, entities, shared, window=window)
    return [
        CaptionedPicture(whole, shaded),
        CaptionedPicture(near, f"Predicted image: {enlarged}"),
        edge_map,
        CaptionedPicture(near_map, f"Edge map: {enlarged}"),
    ]


def _map_caption(plan: InspectionPlan) -> str:
    return f"Edge map: {words_of(plan.targets).bold}"


# The section of the report about dimensions: uncertainty, tolerance and acceptance limits of
# each.


# columns that say nothing where no dimension has a tolerance
_OF_TOLERANCES = ("U/T", "Accepted from, to")


def dimensions_table(plan: InspectionPlan) -> Table | None:
    """Return a row per dimension and setting; nothing for a plan without dimensions.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    rows = [
        (name, _row(plan, k, name, measurement))
        for k, setting in enumerate(plan.settings)
        for name, measurement in measurements(plan, setting).items()
    ]
    rows += [(row.name, _split_row(plan, row)) for row in split_rows(plan)]
    # no lamp shows the others, and the notices say why
    unlit = plan.unlit
    rows = [row for row in rows if row[0] not in unlit]
    if not rows:
        return None
    columns = [
        Column("Dimension", kind="lines"),
        Column("Nominal, tolerance", kind="lines"),
        Column("U (k = 2)", kind="lines"),
        Column("U/T", kind="lines"),
        Column("Permitted error", kind="lines"),
        Column("Setting", kind="settings"),
        Column(promise_name(plan), kind="lines"),
        Column("u", kind="lines"),
        Column("Budget of u²", kind="budget"),
        Column("Accepted from, to", kind="lines"),
        Column("Binding"),
    ]
    order = list(plan.entities)
    rows.sort(key=lambda row: order.index(row[0]))
    has_tolerances = any(plan.dimensions[name].tolerance is not None for name, _ in rows)
    shown = [has_tolerances or column.heading not in _OF_TOLERANCES for column in columns]
    values = [list(compress(row, shown)) for _, row in rows]
    return Table(list(compress(columns, shown)), values, "dimensions", "stack", notes=_notes(plan))


def budget_percents(budget: Mapping[str, float]) -> dict[str, float]:
    """Return the share of each source in percent with one decimal; they sum to 100 exactly.

    Parameters
    ----------
    budget : mapping of str to float
        Variances.

    Returns
    -------
    dict of str to float
        Rounded by largest remainders; all 0 if there is no variance.
    """
    total = math.fsum(budget.values())
    if not (total > 0 and math.isfinite(total)):
        return dict.fromkeys(budget, 0.0)
    exact = {name: 1000 * value / total for name, value in budget.items()}
    tenths = {name: math.floor(value) for name, value in exact.items()}
    for name in sorted(exact, key=lambda key: tenths[key] - exact[key])[
        : 1000 - sum(tenths.values())
    ]:
        tenths[name] += 1
    return {name: value / 10 for name, value in tenths.items()}


def localisation_text(localisation: Localisation) -> str:
    """Return a localisation model in words.

    Parameters
    ----------
    localisation : Localisation
        The model.

    Returns
    -------
    str
        Its name and its numbers.
    """
    if localisation.model == "rounding":
        return f"rounding (every point on a whole pixel, {localisation.points} points per line or circle)"
    if localisation.model == "gaussian":
        common = (
            f"; {localisation.floor_px:g} px common to all of them" if localisation.floor_px else ""
        )
        return (
            f"gaussian (standard deviation {localisation.sigma_px:g} px, {localisation.points} points per line or "
            f"circle{common})"
        )
    return (
        f"fit (standard deviation {localisation.sigma_px:g} px, one independent point per "
        f"{localisation.correlation_px:g} px of the image, no better than {localisation.floor_px:g} px)"
    )


def _row(plan: InspectionPlan, k: int, name: str, measurement: Measurement) -> list[Any]:
    dimension: Any = targets_of(plan.targets, plan.settings[k])[name]
    u = measurement.standard_uncertainty
    of_measure = _unstated_u(plan, k, name)
    amounts = [u] if of_measure is None else [of_measure, u]
    alone = " alone" if name in plan.settings[k].ends else ""
    return [
        [CellLine(name), CellLine(f"{_what(dimension)}{alone}", "note")],
        _nominal(dimension),
        _first_of([CellLine(_amount(2 * amount, dimension)) for amount in amounts]),
        _ratio(dimension, 2 * amounts[0]),
        _permitted(dimension, measurement),
        [k + 1],
        _probability(plan, k, name),
        _first_of([CellLine(digits_text(amount, 3)) for amount in amounts]),
        _budget(dimension, measurement),
        _first_of([line for amount in amounts for line in _accepted(dimension, amount)]),
        measurement.binding,
    ]


def _unstated_u(plan: InspectionPlan, k: int, name: str) -> float | None:
    """Return the u that `measure` will state of a dimension whose edges are not stated; None if it is not foreseen."""
    for row in plan.foreseen:
        if (row.setting, row.name) == (k, name) and row.limit_mm > 0:
            return row.expanded_uncertainty / COVERAGE
    return None


def _first_of(lines: list[CellLine]) -> list[CellLine]:
    """Return what `measure` will use, and in brackets, if it differs, what the plan counts."""
    first, *others = lines
    planned = [CellLine(f"({line.text})", "note") for line in others if line.text != first.text]
    return [first, *planned]


def _amount(amount: float, dimension: PlannedDimension) -> str:
    return unbroken(amount_text(digits_text(amount, 3), dimension.unit))


def _split_row(plan: InspectionPlan, row: Row) -> list[Any]:
    """Return the row of a dimension whose ends two settings measure: the value that both give."""
    setting = plan.settings[row.setting - 1]
    dimension: Any = targets_of(plan.targets, replace(setting, ends={}))[row.name]
    expanded = 2 * row.standard_uncertainty
    first, second = sorted(plan.ends[row.name].values())
    promise = [CellLine(probability_text(row.promise, plan.probability))]
    promise.append(
        CellLine(unbroken(f"P {probability_text(row.probability, plan.probability)}"), "note")
    )
    if row.rate is not None:
        text = f"simulated {interval_text(row.rate.low, row.rate.high)}"
        promise.append(CellLine(text, "note"))
    return [
        [CellLine(row.name), CellLine(_what(dimension), "note")],
        _nominal(dimension),
        [CellLine(_amount(expanded, dimension))],
        _ratio(dimension, expanded),
        [CellLine(unbroken(amount_text(f"±{dimension.permitted_error:.4g}", dimension.unit)))],
        [first + 1, second + 1],
        promise,
        [CellLine(digits_text(row.standard_uncertainty, 3))],
        [],
        _accepted(dimension, row.standard_uncertainty),
        "both ends together",
    ]


def _ratio(dimension: PlannedDimension, expanded: float) -> list[CellLine]:
    """Return U/T, or why there is none."""
    if dimension.tolerance is None:
        return [CellLine("none stated")]
    if is_one_sided(dimension.tolerance):
        return [CellLine("one limit")]
    return [CellLine(f"{uncertainty_ratio(expanded, dimension.tolerance):.3f}", "strong")]


def _what(dimension: PlannedDimension) -> str:
    """Return what a dimension is, and on how many of its features it is measured if not on all."""
    text = (
        f"{dimension.kind.replace('_', ' ')} of {', '.join(map(entity_words, dimension.entities))}"
    )
    features = features_cell(dimension)
    return f"{text}; {features}" if features else text


def _permitted(dimension: PlannedDimension, measurement: Measurement) -> list[CellLine]:
    """Return the permitted error, in the image too, and its share of the tolerance."""
    lines = [CellLine(unbroken(amount_text(f"±{dimension.permitted_error:.4g}", dimension.unit)))]
    if measurement.permitted_error_px is not None:
        lines.append(CellLine(unbroken(f"{digits_text(measurement.permitted_error_px, 3)} px")))
    if dimension.share_text:
        lines.append(CellLine(unbroken(dimension.share_text), "note"))
    return lines


def _nominal(dimension: PlannedDimension) -> list[CellLine]:
    text = amount_text(f"{dimension.nominal:.6g}", dimension.unit)
    if dimension.tolerance is None:
        return [CellLine(text)]
    if dimension.kind in POSITIONS:
        return [CellLine(" | ".join((zone_of(dimension), *dimension.datum_names)))]
    lower, upper = dimension.tolerance
    if is_one_sided(dimension.tolerance) or lower == -upper:
        return [CellLine(text), CellLine(tolerance_text(dimension.tolerance))]
    return [CellLine(text), CellLine(deviation_text(upper)), CellLine(deviation_text(lower))]


def _probability(plan: InspectionPlan, k: int, name: str) -> list[CellLine]:
    setting = plan.settings[k]
    lines = [CellLine(probability_text(setting.promise[name], plan.probability))]
    if setting.p_all:
        alone = probability_text(setting.probability[name], plan.probability)
        lines.append(CellLine(unbroken(f"P {alone}"), "note"))
    rates = plan.simulation.rates[k] if plan.simulation is not None else {}
    if name in rates:
        rate = rates[name]
        lines.append(CellLine(f"simulated {interval_text(rate.low, rate.high)}", "note"))
    return lines


def budgets_table(plan: InspectionPlan) -> Table | None:
    """Return the share of each source in u² per dimension and setting; nothing for a plan without dimensions.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    pairs = [
        (name, k, measurement)
        for k, setting in enumerate(plan.settings)
        for name, measurement in measurements(plan, setting).items()
        if not _is_short(plan, k, name)
    ]
    order = list(plan.entities)
    pairs.sort(key=lambda pair: order.index(pair[0]))
    sources = [
        source
        for source in COLOURS
        if any(measurement.budget.get(source) for _, _, measurement in pairs)
    ]
    if not sources:
        return None
    columns = [
        Column("Dimension"),
        Column("Setting", kind="settings"),
        *(Column(source_text(source).capitalize(), right=True, unit="%") for source in sources),
    ]
    rows = []
    for name, k, measurement in pairs:
        percents = budget_percents(measurement.budget)
        rows.append([name, [k + 1], *(_percent_text(percents.get(s, 0.0)) for s in sources)])
    notes = []
    if len(pairs) < sum(len(measurements(plan, setting)) for setting in plan.settings):
        notes.append("Short arcs have quantiles instead of a variance, and so no budget.")
    return Table(columns, rows, "budgets", "stack", notes=notes)


def foreseen_table(plan: InspectionPlan) -> Table | None:
    """Return U of each dimension as planned, and as `measure` will state it; nothing where edges are stated.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    rows: list[list[Any]] = []
    best = surest(plan.foreseen)
    promised = Promised(plan, [], [])
    for name in (name for name in plan.entities if name in best):
        row = best[name]
        if row.limit_mm <= 0:
            continue
        setting = plan.settings[row.setting]
        planned = measurements(plan, setting)[name].expanded_uncertainty
        amounts = (planned, row.expanded_uncertainty, row.unseen_uncertainty)
        open_text = "open" if row.is_open else ""
        unit = plan.dimensions[name].unit
        texts = [unbroken(amount_text(digits_text(amount, 2), unit)) for amount in amounts]
        rows.append(
            [name, [row.setting + 1], promised.text(setting.promise[name]), *texts, open_text]
        )
    if not rows:
        return None
    columns = [
        Column("Dimension"),
        Column("Setting", kind="settings"),
        Column(promised.name, right=True),
        Column("U as planned", right=True),
        Column("U of measure", right=True),
        Column("U with unseen breaks", right=True),
        Column("A nominal part"),
    ]
    return Table(columns, rows, "foreseen", "stack")


def _percent_text(percent: float) -> str:
    """Return a share; nothing of a source that does not count."""
    return f"{percent:.1f}" if percent else ""


def _is_short(plan: InspectionPlan, k: int, name: str) -> bool:
    """Whether a setting measures a dimension by a short arc, whose quantiles are no variance."""
    chosen = plan.settings[k].witness.get(name, 0)
    return any(map(is_short, plan.dimensions[name].choosing(chosen).geometry))


def _budget(dimension: PlannedDimension, measurement: Measurement) -> list[Share]:
    """Return the shares of the sources that count; none of a short arc, whose quantiles are no variance."""
    if any(map(is_short, dimension.geometry)):
        return []
    percents = budget_percents(measurement.budget)
    return [
        Share(source_text(source), percent, COLOURS[source])
        for source, percent in percents.items()
        if percent
    ]


def _accepted(dimension: PlannedDimension, u: float) -> list[CellLine]:
    if dimension.tolerance is None:
        return [CellLine("no tolerance stated")]
    if dimension.kind in POSITIONS:
        # its two components are decided together: limits of their length would refuse a perfect part
        return [CellLine("decided in a disc")]
    rule = DecisionRule.iso14253()
    limits = acceptance_limits(dimension.tolerance, u, rule)
    if limits is None:
        return [CellLine("nothing: u is too large for the tolerance", "bad")]
    # two digits of U, rounded inwards: no value is said to be accepted that is not
    decimals = decimals_of(2.0 * u)
    low, high = (dimension.nominal + limit for limit in limits)
    if math.isinf(low):
        return [CellLine(f"up to {_rounded(-rounded_up(-high, decimals), decimals, dimension)}")]
    lower = _rounded(rounded_up(low, decimals), decimals, dimension)
    if math.isinf(high):
        return [CellLine(f"from {lower}")]
    upper = _rounded(-rounded_up(-high, decimals), decimals, dimension)
    return [CellLine(f"{lower} to {upper}")]


def _rounded(value: float, decimals: int, dimension: PlannedDimension) -> str:
    return unbroken(amount_text(f"{value:.{decimals}f}", dimension.unit))


def _images_text(plan: InspectionPlan) -> list[str]:
    """Say where the errors come from that all points of an entity share, and what rendered images gave."""
    floors = {dimension.localisation.common_px for dimension in plan.dimensions.values()}
    if not any((*floors, *(dimension.surfaces_mm for dimension in plan.dimensions.values()))):
        return []
    surfaces = " or ".join(surfaces_sources(plan.dimensions.values()))
    return [
        f"All points of an edge or rim share an error of {_several(floors)} px across it, the localisation floor. In "
        "30 path-traced images of a test part it was 0.02 to 0.10 px over a whole rim and up to 0.04 px over a line. "
        f"The faces of the part lie off their position by {surfaces}. Both are standard "
        "deviations and do not average out.",
    ]


def _several(values: set[float]) -> str:
    return " or ".join(f"{value:g}" for value in sorted(values))


def _notes(plan: InspectionPlan) -> list[str]:
    models = [dimension.localisation for dimension in plan.dimensions.values()]
    texts = dict.fromkeys(map(localisation_text, models))
    text = f"Localisation of points in the image: {'; '.join(texts)}."
    if any(model.model == "rounding" for model in models):
        text += " The model assumes that points of one line or circle on whole pixels have independent errors."
    return [text, *_images_text(plan)]

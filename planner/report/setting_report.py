"""The section of the report about settings: a table of all, then each with its predicted images."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from scipy.spatial.transform import Rotation

from aspectgraph.solid.ray_scene import RayScene
from errors.formatting import interval_text, probability_text
from errors.measurands import Localisation, acceptance_limits, uncertainty_ratio
from errors.measurands.geometry import is_short
from planner.light.light_plan import WHITE_SHARE, exposure_of
from planner.progress import TimeLeft, report
from planner.report.figure import color_of, drawn
from planner.report.predicted_image import PictureMaker
from planner.report.tables import (
    COLOURS,
    Promised,
    binding_sentence,
    cells,
    focus_note,
    heads,
    passed_over_sentence,
    promise_name,
    setting_link,
    setting_table,
    source_text,
    stance,
    unbroken,
)
from planner.report.wording import (
    features_cell,
    lamp_texts,
    lamps_named,
    margin_texts,
    surfaces_sources,
)
from planner.request.dimension import is_one_sided
from planner.request.targets import words_of
from planner.request.words import deviation_text, tolerance_text
from planner.verify.setting_record import Measurement, measurements

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.request.targets import PlannedDimension
    from planner.rows import Row


NO_PICTURES = '<p class="note">The pictures are left out: the time limit ended. A longer --time-limit draws them.</p>'
"""What a setting has in the place of its pictures, if there was no time for them."""

# what fills more of the image is shown once
_WORTH_ENLARGING = 1.25
# from this ratio of light on, the dimmest target is named
_UNEVEN = 2.0


def settings_table(plan: InspectionPlan, named: tuple[str, str]) -> str:
    """Return a table with a row per setting.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    named : tuple of str
        What an item is called, and several.
    """
    if not plan.settings:
        return '<p class="note">The plan has no settings.</p>'
    rows = []
    several = named[1].capitalize()
    least = [min(setting.promise.values()) for setting in plan.settings]
    promised = Promised(plan, least, [])
    head = f"n:Smallest {promised.name}"
    columns = [head] if promised.heads else []
    same = (
        ""
        if columns
        else f"The smallest {promised.name} of every setting is {promised.text(min(least))}."
    )
    for k, setting in enumerate(plan.settings):
        stands = stance(plan, setting)
        position = " ".join(f"{x:.1f}" for x in setting.position)
        rows.append(
            cells(
                {
                    "": f'<a href="#setting-{k + 1}">{_swatch(k)}{k + 1}</a>',
                    "n:Position (mm)": position,
                    "n:Distance (mm)": f"{stands.distance_mm:.0f}",
                    "n:Tilt (°)": f"{stands.tilt_deg:.1f}",
                    "n:µm/px": f"{stands.um_per_px:.3g}",
                    **dict.fromkeys(columns, promised.text(least[k])),
                    several: ", ".join(map(unbroken, setting.entities)),
                }
            )
        )
    names = ["Setting", "n:Position (mm)", "n:Distance (mm)", "n:Tilt (°)", "n:µm/px"]
    titles = heads([*names, *columns, several])
    return (
        f'<div class="scroll"><table class="stack">{titles}<tbody>{"".join(rows)}</tbody></table></div>'
        '<p class="note">Distance: from the front nodal point to the targets, along the optical axis. Tilt: angle '
        "between the optical axis and the part's z axis. µm/px: size of a pixel at that distance. "
        f"{escape(same)}</p>"
    )


def settings_section(
    plan: InspectionPlan,
    solid: Solid,
    rows: Sequence[Sequence[Row]],
    progress: Progress | None = None,
    *,
    until: float = math.inf,
) -> str:
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
        Time, as `time.time` gives it, after which settings get a sentence instead of pictures.
    """
    maker = PictureMaker(solid, plan.camera)
    scene = RayScene(solid.vertices, solid.triangles) if plan.light is not None else None
    time_left = TimeLeft(until)
    sections = []
    for k in range(len(plan.settings)):
        shots = (
            f'<div class="shots">{_shots(plan, k, maker)}</div>'
            if time_left.fits_another()
            else NO_PICTURES
        )
        lit = [*lamp_texts(plan, k), *exposure_texts(plan, scene, k)]
        sections.append(_setting(plan, k, setting_table(plan, rows[k]), shots, lit))
        report(progress, k + 1, len(plan.settings), "predicted images")
    return "".join(sections)


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
        found = image.expose_for or exposure_of(image, plan.light, plan, k, scene)
        if found is None:
            continue
        text = (
            f"under {lamps_named(image)}, expose so that pixel {found.pixel} beside {found.target} "
            f"has {100 * WHITE_SHARE:.0f} % of white: it is the brightest place beside the targets of a "
            "matt part"
        )
        if found.times >= _UNEVEN:
            text += f"; {found.dimmest} gets {found.times:.1f} times less light"
        texts.append(text)
    return texts


def _setting(plan: InspectionPlan, k: int, table: str, shots: str, lit: Sequence[str]) -> str:
    setting = plan.settings[k]
    x, y, z, w = Rotation.from_matrix(setting.cam2world[:3, :3]).as_quat(canonical=True)
    position = ", ".join(f"{value:.3f}" for value in setting.position)
    lamps = "".join(f'<p class="note">{escape(text[0].upper() + text[1:])}</p>' for text in lit)
    return (
        f'<section class="setting" id="setting-{k + 1}"><div class="head"><h3>{_swatch(k)}Setting {k + 1}</h3>'
        f'<span class="note">{escape(stance(plan, setting).text)}; camera at ({position}) mm, '
        f"quaternion x y z w = ({x:.6f}, {y:.6f}, {z:.6f}, {w:.6f})</span>"
        f'<button data-view="setting-{k + 1}">Show in 3-D</button></div>'
        f'{shots}<div class="scroll">{table}</div>'
        f"<p>{escape(binding_sentence(plan, setting))} {escape(focus_note(plan, setting))} "
        f"{escape(passed_over_sentence(setting))}</p>"
        f'<p class="note">Margins: {escape("; ".join(margin_texts(setting.margins)))}.</p>{lamps}</section>'
    )


def _shots(plan: InspectionPlan, k: int, maker: PictureMaker) -> str:
    """Return predicted image and edge map; next to each the targets enlarged, if they are small in the image."""
    pose = plan.settings[k].cam2world
    entities = drawn(plan, plan.settings[k].entities, plan.settings[k])
    color = color_of(k)
    images = plan.light.images[k] if plan.light is not None else ()
    lamp = plan.light.lamps[list(images[0].lamps)] if plan.light is not None and images else None
    shaded = "Predicted image, hidden lines removed" + (
        f", under {lamps_named(images[0])}" if images else ""
    )
    window = maker.window(pose, entities)
    times = maker.camera.resolution[0] / window[2]
    if times < _WORTH_ENLARGING:
        image = maker.image_svg(pose, entities, color, lamp)
        return _figure(image, shaded) + _figure(
            maker.edge_map_svg(pose, entities), _map_caption(plan)
        )
    enlarged = f"the frame enlarged {times:.3g} times ({window[2]} x {window[3]} px)"
    return (
        _figure(maker.image_svg(pose, entities, color, lamp, outlined=window), shaded)
        + _figure(
            maker.image_svg(pose, entities, color, lamp, window=window),
            f"Predicted image: {enlarged}",
        )
        + _figure(maker.edge_map_svg(pose, entities), _map_caption(plan))
        + _figure(maker.edge_map_svg(pose, entities, window=window), f"Edge map: {enlarged}")
    )


def _figure(picture: str, caption: str) -> str:
    return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"


def _map_caption(plan: InspectionPlan) -> str:
    return f"Edge map: {words_of(plan.targets).bold}"


def _swatch(k: int) -> str:
    return f'<span class="swatch" style="background:{color_of(k)}"></span>'


# The section of the report about dimensions: uncertainty, tolerance and acceptance limits of
# each.


# before and after P_all, or P where that was not counted
_FIRST = ("Dimension", "Nominal, tolerance", "U (k = 2)", "U/T", "Permitted error", "Setting")
_LAST = ("u", "Budget of the variance", "Accept between", "Binding")


def dimension_section(plan: InspectionPlan) -> str:
    """Return the section about dimensions as HTML; nothing for a plan without them.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.

    Returns
    -------
    str
        A heading, a table with a row per dimension and setting, and what its columns mean.
    """
    rows = [
        _row(plan, k, name, one)
        for k, setting in enumerate(plan.settings)
        for name, one in measurements(plan, setting).items()
    ]
    if not rows:
        return ""
    names = [*_FIRST, promise_name(plan), *_LAST]
    order = list(plan.entities)
    rows.sort(key=lambda row: order.index(row[0]))
    return (
        '<h3 id="tolerances">Dimensions and their tolerances</h3>'
        f'<div class="scroll"><table id="dimensions" class="stack">{heads(names)}<tbody>'
        f"{''.join(html for _, html in rows)}</tbody></table></div>"
        + "".join(f'<p class="note">{escape(text)}</p>' for text in _notes(plan))
    )


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


def localisation_text(how: Localisation) -> str:
    """Return a localisation model in words.

    Parameters
    ----------
    how : Localisation
        The model.

    Returns
    -------
    str
        Its name and its numbers.
    """
    if how.model == "rounding":
        return f"rounding (every point on a whole pixel, {how.points} points per line or circle)"
    if how.model == "gaussian":
        common = f"; {how.floor_px:g} px common to all of them" if how.floor_px else ""
        return (
            f"gaussian (standard deviation {how.sigma_px:g} px, {how.points} points per line or "
            f"circle{common})"
        )
    return (
        f"fit (standard deviation {how.sigma_px:g} px, one independent point per {how.correlation_px:g} px of the "
        f"image, no better than {how.floor_px:g} px)"
    )


def _row(plan: InspectionPlan, k: int, name: str, one: Measurement) -> tuple[str, str]:
    chosen = plan.settings[k].witness.get(name, 0)
    dimension = plan.dimensions[name].choosing(chosen)
    unit = dimension.unit
    ratio = "none stated"
    if dimension.tolerance is not None and is_one_sided(dimension.tolerance):
        ratio = "one limit"
    elif dimension.tolerance is not None:
        ratio = f"<b>{uncertainty_ratio(one.expanded_uncertainty, dimension.tolerance):.3f}</b>"
    values = {
        "": f"{escape(name)}<br> <span class='note'>{escape(_what(dimension))}</span>",
        "Nominal, tolerance": _nominal(dimension),
        "U (k = 2)": unbroken(f"{one.expanded_uncertainty:.3g} {unit}"),
        "U/T": ratio,
        "Permitted error": _permitted(dimension, one),
        "Setting": setting_link(k + 1),
        promise_name(plan): _probability(plan, k, name),
        "u": f"{one.standard_uncertainty:.3g}",
        "Budget of the variance": _budget(dimension, one),
        "Accept between": _accepted(dimension, one),
        "Binding": escape(one.binding),
    }
    return name, cells(values)


def _what(dimension: PlannedDimension) -> str:
    """Return what a dimension is, and on how many of its features it is measured if not on all."""
    what = f"{dimension.kind.replace('_', ' ')} of {', '.join(dimension.entities)}"
    features = features_cell(dimension)
    return f"{what}; {features}" if features else what


def _permitted(dimension: PlannedDimension, one: Measurement) -> str:
    """Return the permitted error, in the image too, and its share of the tolerance."""
    lines = [unbroken(f"±{dimension.permitted_error:.4g} {dimension.unit}")]
    if one.permitted_error_px is not None:
        lines.append(unbroken(f"{one.permitted_error_px:.3g} px"))
    if dimension.share_text:
        lines.append(f"<span class='note'>{unbroken(dimension.share_text)}</span>")
    return "<br> ".join(lines)


def _nominal(dimension: PlannedDimension) -> str:
    text = f"{dimension.nominal:.6g} {dimension.unit}"
    if dimension.tolerance is None:
        return text
    if is_one_sided(dimension.tolerance):
        return f"{text}<br> {tolerance_text(dimension.tolerance)}"
    lower, upper = dimension.tolerance
    # pages too narrow for a table show no breaks
    return f"{text}<br> {deviation_text(upper)}<br> {deviation_text(lower)}"


def _probability(plan: InspectionPlan, k: int, name: str) -> str:
    setting = plan.settings[k]
    text = probability_text(setting.promise[name], plan.probability)
    if setting.p_all:
        alone = probability_text(setting.probability[name], plan.probability)
        text = f"{text}<br> <span class='note'>{unbroken(f'P {alone}')}</span>"
    rates = plan.simulation.rates[k] if plan.simulation is not None else {}
    if name not in rates:
        return text
    rate = rates[name]
    return f"{text}<br> <span class='note'>simulated {interval_text(rate.low, rate.high)}</span>"


def _budget(dimension: PlannedDimension, one: Measurement) -> str:
    if any(map(is_short, dimension.geometry)):
        return "short arc: quantiles, no variance"
    percents = budget_percents(one.budget)
    bars = "".join(
        f'<i style="display:inline-block;height:9px;width:{max(0.0, 1.2 * value):.1f}px;background:{COLOURS[source]}">'
        "</i>"
        for source, value in percents.items()
    )
    texts = "<br> ".join(
        unbroken(f"{source_text(source)} {value:.1f} %") for source, value in percents.items()
    )
    return f'<span style="white-space:nowrap">{bars}</span><br> <span class="note">{texts}</span>'


def _accepted(dimension: PlannedDimension, one: Measurement) -> str:
    if dimension.tolerance is None:
        return "no tolerance stated"
    limits = acceptance_limits(dimension.tolerance, one.expanded_uncertainty)
    if limits is None:
        return '<span class="bad">nothing: U takes the whole tolerance</span>'
    low, high = (dimension.nominal + limit for limit in limits)
    if math.isinf(low):
        return f"up to {unbroken(f'{high:.6g} {dimension.unit}')}"
    if math.isinf(high):
        return f"from {unbroken(f'{low:.6g} {dimension.unit}')}"
    return f"{low:.6g} and {unbroken(f'{high:.6g} {dimension.unit}')}"


def _images_text(plan: InspectionPlan) -> list[str]:
    """Say where the errors come from that all points of an entity share, and what rendered images gave."""
    floors = {one.localisation.common_px for one in plan.dimensions.values()}
    if not any((*floors, *(one.surfaces_mm for one in plan.dimensions.values()))):
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
    models = list(
        dict.fromkeys(localisation_text(one.localisation) for one in plan.dimensions.values())
    )
    rounded = any(one.localisation.model == "rounding" for one in plan.dimensions.values())
    return [
        f"Localisation of points in the image: {'; '.join(models)}."
        + (
            " The model assumes that points of one line or circle on whole pixels have independent errors."
            if rounded
            else ""
        ),
        *_images_text(plan),
        "u is the standard uncertainty of the measured value, and U = 2u. Of an arc of less than half a circle, u and "
        "U are half the widths of the intervals that hold 68.27 and 95.45 % of the errors. The sources of the "
        "budget sum to u². T is the whole width of the tolerance. Accept a part if its measured value lies between "
        "the limits: the tolerance less a guard band of U on either side (ISO 14253-1).",
        "The permitted error in px is the one in mm at the scale of the image, at the mean depth of the targets and "
        "square to the optical axis. Binding names what has the smallest share of its margin left: probability, focus "
        "or field of view.",
    ]

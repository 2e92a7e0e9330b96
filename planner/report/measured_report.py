"""The report of a measurement: one HTML file with values, decisions, and pictures that a person can check."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from string import Template

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Decision, DecisionRule
from planner.measuring.images import Picture
from planner.measuring.reading import SOURCES, Reading
from planner.measuring.registered import Registered
from planner.measuring.results import MeasurementResults, Result
from planner.measuring.scans import STATE_TEXTS, State
from planner.report.wording import count
from planner.request.words import tolerance_text
from planner.text_table import Column, print_table, print_text, words

# The table of measured values for the terminal.


def print_results(results: MeasurementResults) -> None:
    """Print measured values with their uncertainties and decisions, and why others have none."""
    columns = (
        Column("target"),
        Column("nominal", right=True),
        Column("value", right=True),
        Column("U (k = 2)", right=True),
        Column("found", right=True),
        Column("decision"),
    )
    print_table(columns, [_row(one) for one in results])
    names = [one.name for one in results]
    for one in results:
        if one.reason:
            print_text(words(f"not measured: {one.name}: {one.reason}", names))
        for note in one.notes:
            print_text(words(f"{one.name}: {note}", names))
    for note in image_notes(results):
        print_text(note)
    print_text(verdict(results))


def image_notes(results: MeasurementResults) -> Iterable[str]:
    """Yield what is to be known of the images."""
    for note in results.notes:
        yield f"note: {note}"
    for name, why in results.failed.items():
        yield f"{name} cannot be registered: {why}"


# of decisions whose words differ for several targets
_SEVERAL = {"conforms": "conform", "does not conform": "do not conform"}


def verdict(results: MeasurementResults) -> str:
    """Say in a sentence or two what was measured."""
    measured = sum(one.measured for one in results)
    parts = [
        f"{n} {name if n == 1 else _SEVERAL.get(name, name)}" for name, n in results.counts.items()
    ]
    return (
        f"{measured} of {count(len(results), 'target')} measured in "
        f"{count(len(results.images), 'image')}. "
        f"Decisions ({results.rule}): {', '.join(parts) or 'none'}."
    )


def number_text(value: float, uncertainty: float) -> str:
    """Return a value with as many decimals as its uncertainty has with two digits."""
    decimals = 4
    for decimals in range(7):
        if uncertainty * 10**decimals >= 9.5:
            break
    return f"{value:.{decimals}f}"


def _row(one: Result) -> tuple[str, ...]:
    tolerance = "" if one.tolerance is None else f" {tolerance_text(one.tolerance)}"
    nominal = f"{one.nominal:.6g} {one.unit}{tolerance}"
    readings = [reading for reading in one.readings if reading.measured] or list(one.readings)
    found = f"{100 * max((r.found_share for r in readings), default=0.0):.0f} %"
    if not one.measured:
        return one.name, nominal, "", "", found, one.decision.value
    u = one.expanded_uncertainty
    return (
        *(one.name, nominal, number_text(one.value, u), number_text(u, u), found),
        one.decision.value,
    )


# Pictures of what was measured, as SVG: found points on the image, residuals as whiskers, values
# in tolerances.


Array = NDArray[np.float64]

WHISKER = 50.0
"""Residuals are drawn this many times longer than they are."""

COLOURS = {
    State.FOUND: "#1fae54",
    State.WEAK: "#8a94a0",
    State.CLIPPED: "#ff8c1a",
    State.AT_END: "#b04bd8",
    State.TWO_STEPS: "#a8741a",
    State.OUTLIER: "#e5332a",
    State.OUTSIDE: "#8a94a0",
    State.HIDDEN: "#5b6b7b",
    State.NEAR_LINE: "#3f8fd6",
    State.SHADOW: "#e05fa0",
}
"""Colours of samples by state."""

PLANNED = "#ffe14d"
"""Colour of the planned outline."""
REGISTERED = "#e8f1ff"
"""Colour of the registered one."""
LONG_PX = 60.0
"""Samples of an edge that are farther apart are not joined: what is between them is hidden or near another line."""

_WIDE_PX = 900
_CROP_PX = 560
_ROOM_PX = 26
_QUALITY = 82
_PLOT = (560, 120)
_BAR = (420, 46)


def image_data(picture: Picture, window: tuple[int, int, int, int], width: int) -> str:
    """Return a part of an image as a data URI: left, top, width, height in px; shrunk to a width."""
    from PIL import Image

    left, top, wide, high = window
    part = picture.grey[top : top + high, left : left + wide]
    grey = np.clip(part * (255.0 / picture.white), 0, 255).astype(np.uint8)
    image = Image.fromarray(grey)
    if wide > width:
        image = image.resize((width, max(1, round(high * width / wide))), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=_QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def image_svg(picture: Picture, points: NDArray[np.void], title: str) -> str:
    """Return a whole image with the samples of its registration, and the planned and the registered outline."""
    height, width = picture.grey.shape
    window = (0, 0, width, height)
    lines = ""
    if "edge" in (points.dtype.names or ()):
        size = 0.0011 * width
        lines = outline_path(points, ("planned_u", "planned_v"), PLANNED, size)
        lines += outline_path(points, ("u", "v"), REGISTERED, size)
    dots = _dots(points[::2], 0.0026 * width)
    return _svg(window, image_data(picture, window, _WIDE_PX), lines + dots, title)


def outline_path(
    points: NDArray[np.void], fields: tuple[str, str], colour: str, size: float
) -> str:
    """Return lines through the samples (edge, and two fields of places) of each edge."""
    places = np.stack([points[name] for name in fields], axis=1)
    marks = []
    for k in np.unique(points["edge"]):
        own = places[points["edge"] == k]
        steps = np.linalg.norm(np.diff(own, axis=0), axis=1)
        for part in np.split(own, np.flatnonzero(~(steps <= LONG_PX)) + 1):
            if len(part) > 1 and np.isfinite(part).all():
                marks.append("M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in part.tolist()))
    return (
        f'<path class="outline" stroke="{colour}" stroke-width="{size:.2f}" d="{"".join(marks)}"/>'
    )


def entity_svg(picture: Picture, entities: Sequence[NDArray[np.void]], title: str) -> str:
    """Return the part of an image around the entities of a target, with their points and residuals as whiskers."""
    places = np.concatenate([np.c_[points["u"], points["v"]] for points in entities])
    places = places[np.isfinite(places).all(axis=1)]
    height, width = picture.grey.shape
    low = np.clip(places.min(axis=0) - _ROOM_PX, 0, [width - 2, height - 2]).astype(int)
    high = np.clip(places.max(axis=0) + _ROOM_PX, low + 2, [width, height]).astype(int)
    left, top = low.tolist()
    window = (left, top, int(high[0] - left), int(high[1] - top))
    size = max(window[2], window[3])
    drawn = "".join(_whiskers(points, size) + _dots(points, size / 150) for points in entities)
    return _svg(window, image_data(picture, window, _CROP_PX), drawn, title)


def residual_svg(points: NDArray[np.void], title: str) -> str:
    """Return the residuals of an entity along it, px; what was not found as marks at the bottom."""
    width, height = _PLOT
    kept = np.isfinite(points["residual_px"])
    found = points[kept]
    inner = found[found["state"] == State.FOUND]["residual_px"]
    reach = max(0.1, 1.2 * float(np.abs(inner).max())) if len(inner) else 0.1
    middle = height / 2
    parts = [
        f'<path class="zero" d="M0 {middle}H{width}"/>',
        f'<text x="4" y="14">+{reach:.2g} px</text><text x="4" y="{height - 14}">−{reach:.2g} px</text>',
    ]
    for state in State:
        own = found[found["state"] == state]
        if len(own):
            y = middle - np.clip(own["residual_px"] / reach, -1, 1) * (middle - 4)
            parts.append(_path(np.c_[own["share"] * width, y], COLOURS[state], 3.2))
        own = points[~kept & (points["state"] == state)]
        if len(own):
            places = np.c_[own["share"] * width, np.full(len(own), height - 3.0)]
            parts.append(_path(places, COLOURS[state], 4.0))
    return (
        f'<svg class="plot" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}">'
        f"<title>{escape(title)}</title>{''.join(parts)}</svg>"
    )


def value_svg(result: Result, rule: DecisionRule) -> str:
    """Return a value with its U in the tolerance, whose guard bands are shaded; empty without both."""
    if not result.measured or result.tolerance is None:
        return ""
    lower, upper = result.tolerance
    expanded = result.expanded_uncertainty
    limits = [limit for limit in (lower, upper) if math.isfinite(limit)]
    low = min(*limits, 0.0, result.deviation - expanded)
    high = max(*limits, 0.0, result.deviation + expanded)
    room = 0.12 * (high - low)
    width, height = _BAR

    def at(value: float) -> float:
        # what has no limit ends with the picture
        share = (value - low + room) / (high - low + 2 * room)
        return round(min(max(share, 0.0), 1.0) * width, 2)

    guard = _guard(rule, result.standard_uncertainty)
    bands = "".join(
        _rectangle("band", at(limit - guard), at(limit + guard)) for limit in limits if guard > 0
    )
    texts = "".join(
        f'<text{kind} x="{at(limit)}" y="44">{limit:+.4g}</text>'
        for kind, limit in (("", lower), (' class="end"', upper))
        if math.isfinite(limit)
    )
    words = f"{result.name}: deviation {result.deviation:+.4g} ± {expanded:.2g}"
    return (
        f'<svg class="bar" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(words)}">'
        f"<title>{escape(words)}</title>"
        f"{_rectangle('tolerance', at(lower), at(upper))}{bands}"
        f'<path class="zero" d="M{at(0.0)} 8V34"/>'
        f'<path class="value" d="M{at(result.deviation - expanded)} 21H{at(result.deviation + expanded)}"/>'
        f'<circle class="value" cx="{at(result.deviation)}" cy="21" r="4.5"/>'
        f"{texts}</svg>"
    )


def _rectangle(kind: str, left: float, right: float) -> str:
    return f'<rect class="{kind}" x="{left}" y="10" width="{right - left:.2f}" height="22"/>'


def legend(states: Iterable[int]) -> str:
    """Return the colours of some states with their words."""
    return " ".join(
        f'<span class="state"><i style="background:{COLOURS[State(k)]}"></i>'
        f"{escape(STATE_TEXTS[State(k)])}</span>"
        for k in sorted(set(states))
    )


def _guard(rule: DecisionRule, u: float) -> float:
    """Return how wide a guard band is drawn."""
    if rule.name == "simple":
        return 0.0
    if rule.name == "guard U":
        return 2 * u
    from scipy.stats import norm

    return float(norm.ppf(rule.level)) * u


def _svg(window: tuple[int, int, int, int], data: str, drawn: str, title: str) -> str:
    left, top, wide, high = window
    # pixel centres are whole numbers
    box = f"{left - 0.5} {top - 0.5} {wide} {high}"
    return (
        f'<svg class="image" viewBox="{box}" role="img" aria-label="{escape(title)}">'
        f"<title>{escape(title)}</title>"
        f'<image href="{data}" x="{left - 0.5}" y="{top - 0.5}" width="{wide}" height="{high}"/>'
        f"{drawn}</svg>"
    )


def _dots(points: NDArray[np.void], size: float) -> str:
    return "".join(
        _path(np.c_[own["u"], own["v"]], COLOURS[state], size)
        for state in State
        if len(own := points[points["state"] == state])
    )


def _path(places: Array, colour: str, size: float) -> str:
    """Return dots as one path of strokes without length."""
    finite = places[np.isfinite(places).all(axis=1)]
    marks = "".join(f"M{u:.1f} {v:.1f}h0" for u, v in finite.tolist())
    return f'<path class="dots" stroke="{colour}" stroke-width="{size:.2f}" d="{marks}"/>'


def _whiskers(points: NDArray[np.void], size: float) -> str:
    found = points[np.isfinite(points["residual_px"]) & (points["state"] == State.FOUND)]
    rows = np.c_[found["u"], found["v"], found["nu"], found["nv"], found["residual_px"]]
    marks = "".join(
        f"M{u:.1f} {v:.1f}l{nu * WHISKER * r:.1f} {nv * WHISKER * r:.1f}"
        for u, v, nu, nv, r in rows.tolist()
    )
    return f'<path class="whisker" stroke-width="{size / 500:.2f}" d="{marks}"/>'


_ORDER = (
    Decision.NOT_MEASURED,
    Decision.DOES_NOT_CONFORM,
    Decision.UNDECIDED,
    Decision.CONFORMS,
    Decision.NO_TOLERANCE,
)
_CLASSES = {
    Decision.NOT_MEASURED: "bad",
    Decision.DOES_NOT_CONFORM: "bad",
    Decision.UNDECIDED: "open",
    Decision.CONFORMS: "good",
    Decision.NO_TOLERANCE: "",
}


def measured_html(results: MeasurementResults) -> str:
    """Return the report of a measurement as an HTML page.

    Parameters
    ----------
    results : MeasurementResults
        The results, with their pictures.

    Returns
    -------
    str
        A page without references to anything outside it. The same results give the same page.

    Examples
    --------
    >>> import numpy as np
    >>> from aspectgraph import Solid
    >>> from planner import measure, measured_html, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> solid = Solid.read("examples/two_pocket_block.off")
    >>> width, height = plan.camera.resolution
    >>> dark = {k + 1: np.full((height, width), k, np.uint8) for k in range(len(plan.settings))}
    >>> "cannot be registered" in measured_html(measure(plan, solid, dark)).lower()
    True
    """
    ordered = sorted(results, key=lambda one: _ORDER.index(one.decision))
    heading = results.source.part or "part"
    if results.serial:
        heading += f", {results.serial}"
    page = resources.files("planner.report").joinpath("measured_report.html").read_text("utf-8")
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in image_notes(results))
    return Template(page).substitute(
        title=escape(f"{heading}: measurement"),
        heading=escape(heading),
        verdict=escape(verdict(results)),
        notes=notes,
        explanation=escape(_explanation(results)),
        rows="\n".join(_row_of_measured_report(one, results) for one in ordered),
        whisker=f"{WHISKER:g}",
        targets="\n".join(_target(one, results) for one in ordered),
        images="\n".join(_image(name, results) for name in results.pictures),
    )


def _explanation(results: MeasurementResults) -> str:
    return (
        f"Rule: {results.rule}. Values in mm, angles in degrees. U is the expanded uncertainty of two "
        "standard uncertainties: pose, surfaces and localisation. It does not count the calibration "
        "of the lens and the temperature of the part."
    )


def _row_of_measured_report(one: Result, results: MeasurementResults) -> str:
    u = one.expanded_uncertainty
    value = number_text(one.value, u) if one.measured else ""
    tolerance = "" if one.tolerance is None else f" {tolerance_text(one.tolerance)}"
    bar = value_svg(one, results.rule)
    reason = f'<br><span class="note">{escape(one.reason)}</span>' if one.reason else ""
    return (
        f'<tr><td><a href="#{_anchor(one.name, results)}">{escape(one.name)}</a></td>'
        f'<td class="n">{one.nominal:.6g} {one.unit}{escape(tolerance)}</td>'
        f'<td class="n">{value}</td><td class="n">{number_text(u, u) if one.measured else ""}</td>'
        f"<td>{bar}{reason}</td>"
        f'<td class="{_CLASSES[one.decision]}">{one.decision.value}</td></tr>'
    )


def _anchor(name: str, results: MeasurementResults) -> str:
    return f"target-{list(results.results).index(name) + 1}"


def _target(one: Result, results: MeasurementResults) -> str:
    readings = "".join(_reading(one, reading, results) for reading in one.readings)
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in one.notes)
    return (
        f'<section class="target" id="{_anchor(one.name, results)}">'
        f'<h3>{escape(one.name)} <span class="{_CLASSES[one.decision]}">{one.decision.value}</span></h3>'
        f"<p>{escape(_sentence(one))}</p>{notes}{readings}</section>"
    )


def _sentence(one: Result) -> str:
    if not one.measured:
        return f"Not measured: {one.reason}."
    u = one.expanded_uncertainty
    parts = [
        f"{one.kind.replace('_', ' ').capitalize()} {number_text(one.value, u)} {one.unit}, "
        f"deviation {one.deviation:+.4f}, U = {number_text(u, u)}."
    ]
    if math.isfinite(one.conformance_probability):
        parts.append(f"It is within its tolerance with P = {one.conformance_probability:.4f}.")
    return " ".join(parts)


def _reading(one: Result, reading: Reading, results: MeasurementResults) -> str:
    picture = results.pictures.get(reading.image)
    if picture is None or not any(len(points) for points in reading.points):
        return ""
    states = np.concatenate([points["state"] for points in reading.points]).tolist()
    title = f"{one.name} in {reading.image}"
    plots = "".join(
        residual_svg(points, f"residuals of entity {k + 1} of {title}")
        for k, points in enumerate(reading.points)
        if len(points)
    )
    own = [points for points in reading.points if len(points)]
    return (
        f'<p class="note">{escape(reading.image)}: {escape(_reading_words(reading, one.unit))}</p>'
        f'<div class="pair"><div>{entity_svg(picture, own, title)}</div>'
        f"<div>{plots}<p>{legend(states)}</p>{_budget(reading, one.unit)}</div></div>"
    )


def _reading_words(reading: Reading, unit: str) -> str:
    found = f"{100 * reading.found_share:.0f} % found"
    if not reading.measured:
        return f"{found}; {reading.reason}"
    u = reading.standard_uncertainty
    return (
        f"{reading.value:.4f} {unit}, u = {u:.4f}, {found}, "
        f"points {reading.rms_px:.3f} px from the fit"
    )


def _budget(reading: Reading, unit: str) -> str:
    if not reading.measured:
        return ""
    scale = 1000
    small = "µm" if unit == "mm" else "mdeg"
    cells = "".join(
        f"<tr><td>{escape(source)}</td><td class=n>"
        f"{math.copysign(math.sqrt(abs(v)), v) * scale:.1f} {small}</td></tr>"
        for source in SOURCES
        if (v := reading.budget[source])
    )
    return f"<table><tr><th>part of u</th><th class=n>size</th></tr>{cells}</table>"


def _image(name: str, results: MeasurementResults) -> str:
    picture = results.pictures[name]
    if name in results.failed:
        words = f"Cannot be registered: {results.failed[name]}."
    else:
        words = _image_words(results.images[name], picture.clipped_share)
    samples = _samples(name, results)
    key = legend(samples["state"].tolist()) if len(samples) else ""
    return (
        f'<section class="picture" id="{escape(name)}"><h3>{escape(name)}</h3>'
        f"<p>{escape(words)}</p>{image_svg(picture, samples, name)}<p>{key}</p></section>"
    )


def _samples(name: str, results: MeasurementResults) -> np.ndarray:
    """Return the samples of an image's registration, or of its entities where nothing was registered."""
    kind = np.dtype([("u", float), ("v", float), ("state", np.int64)])
    if name in results.images and len(results.images[name].samples):
        return results.images[name].samples
    own: Sequence[np.ndarray] = [
        points
        for one in results
        for reading in one.readings
        if reading.image == name
        for points in reading.points
    ]
    joined = np.zeros(sum(map(len, own)), dtype=kind)
    for field in ("u", "v", "state"):
        joined[field] = np.concatenate([points[field] for points in own]) if own else []
    return joined


def _image_words(one: Registered, clipped: float) -> str:
    bright = f" {100 * clipped:.1f} % of the image is overexposed." if clipped >= 0.001 else ""
    if one.method != "own edges":
        return f"The pose is {one.method}.{bright}"
    notes = "".join(f" {note[0].upper()}{note[1:]}." for note in one.notes)
    return (
        f"Registered to own edges: the image was {one.shift_px:.1f} px off its prediction, "
        f"{one.misfit_px:.3f} px after it; {one.used} of {one.offered} samples agree.{bright}{notes}"
    )

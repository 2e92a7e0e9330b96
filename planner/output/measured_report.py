"""The report of a measurement: one HTML file with values, decisions, and pictures that a person can check."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from importlib import resources
from string import Template

import numpy as np

from errors.measurands import Decision
from planner.measuring.merge import Result
from planner.measuring.poses.registered import Registered
from planner.measuring.reading import SOURCES, Reading
from planner.measuring.results import MeasurementResults
from planner.output.measured_table import image_notes, number_text, verdict
from planner.output.overlay import (
    WHISKER,
    entity_svg,
    image_svg,
    legend,
    residual_svg,
    value_svg,
)
from planner.wanted.words.tolerance_texts import tolerance_text

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
    heading = str(results.source.get("part") or "part")
    if results.serial:
        heading += f", {results.serial}"
    page = resources.files("planner.output").joinpath("measured_report.html").read_text("utf-8")
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in image_notes(results))
    return Template(page).substitute(
        title=escape(f"{heading}: measurement"),
        heading=escape(heading),
        verdict=escape(verdict(results)),
        notes=notes,
        explanation=escape(_explanation(results)),
        rows="\n".join(_row(one, results) for one in ordered),
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


def _row(one: Result, results: MeasurementResults) -> str:
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

"""The report of a measurement: one HTML file with values, decisions, and pictures that a person can check."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import probability_text
from errors.measurands import Decision, DecisionRule, guard_band
from ground.templates import asset, render, render_macro
from planner.argument_kinds import check_kinds
from planner.camera.camera import Camera
from planner.measuring.advice import as_sentence
from planner.measuring.images import Picture
from planner.measuring.reading import SOURCES, Reading
from planner.measuring.registered import Registered
from planner.measuring.results import (
    MeasurementResults,
    Result,
    UnseenBreaks,
    decimals_of,
    nominal_text,
    number_text,
    rounded_up,
    value_texts,
    verdict,
)
from planner.measuring.samples import STATE_TEXTS, State
from planner.measuring.seen_breaks import U_HOLDS
from planner.report.tables import CellLine
from planner.request.dimension import POSITIONS
from planner.request.words import amount_text
from planner.text_table import (
    Column,
    Table,
    digits_text,
    enumerated,
    print_table,
    print_text,
    words,
)

# The table of measured values for the terminal.


def print_results(results: MeasurementResults) -> None:
    """Print measured values with their uncertainties and decisions, and why others have none."""
    has_u = all(result.interval is None for result in results)
    columns = (
        Column("target"),
        Column("nominal", right=True),
        Column("value", right=True),
        Column("U (k = 2)" if has_u else "U (k = 2) or 95 %", right=True),
        Column("found", right=True),
        Column("decision"),
    )
    # a column that says "no tolerance" of every value says nothing
    is_decided = any(result.decision is not Decision.NO_TOLERANCE for result in results)
    n_columns = len(columns) if is_decided else len(columns) - 1
    print_table(columns[:n_columns], [_row(result)[:n_columns] for result in results])
    names = [result.name for result in results]
    for reason, targets in _reasons(results).items():
        print_text(words(f"not measured: {enumerated(targets)}: {reason}", names))
    for result in results:
        for note in result.notes:
            print_text(words(f"{result.name}: {note}", names))
    for note in image_notes(results, is_brief=True):
        print_text(note)
    print_text(verdict(results))


def image_notes(results: MeasurementResults, *, is_brief: bool = False) -> Iterable[str]:
    """Yield what is to be known of the edges, in full or in one sentence, and of the images."""
    if results.edges:
        yield f"edges: {_brief_edges(results) if is_brief else results.edges}"
    alike: dict[str, list[str]] = {}
    for note in results.notes:
        image, _, text = note.partition(": ")
        # a note need not be about an image
        if image not in results.pictures:
            alike.setdefault(note, [])
        elif text.rpartition(": ")[2] not in results.failed.get(image, ""):
            alike.setdefault(text, []).append(image)
    for text, images in alike.items():
        yield f"note: {enumerated(images)}: {text}" if images else f"note: {text}"
    for why, images in _by_text(results.failed).items():
        yield f"{enumerated(images)} cannot be registered: {why}"


def _brief_edges(results: MeasurementResults) -> str:
    """Say by how much edges are taken to be broken, and that more is possible; the report says what that would do."""
    text, more, _ = results.edges.partition(f"; {U_HOLDS}")
    if not more or results.unseen is None:
        return results.edges
    limit = f"{results.unseen.limit_mm:.2g} mm"
    open_ones = len(results.unseen.open_decisions)
    decided = f", and {open_ones} decision{'s' * (open_ones > 1)} open" if open_ones else ""
    with_them = f"unseen breaks of up to {limit} would make U larger{decided}"
    return f"{text}; {with_them}. State --edges; see the report"


def _reasons(results: MeasurementResults) -> dict[str, list[str]]:
    """Return why targets are not measured, with what to change; those of a reason together.

    What is wrong with images that cannot be registered is said once, of the images.
    """
    texts = {}
    for result in results:
        text = _short_reason(result, results)
        if text == result.reason and result.advice not in text:
            text += f"; {result.advice}"
        if text:
            texts[result.name] = text
    return _by_text(texts)


def _short_reason(result: Result, results: MeasurementResults) -> str:
    """Return why a target is not measured, without what is said of its images; empty if it is measured."""
    images = sorted({reading.image for reading in result.readings})
    if not result.reason or not images or not set(images) <= set(results.failed):
        return result.reason
    return f"{enumerated(images)} {'is' if len(images) == 1 else 'are'} not registered"


def _by_text(texts: Mapping[str, str]) -> dict[str, list[str]]:
    """Return names by what is said of them."""
    groups: dict[str, list[str]] = {}
    for name, text in texts.items():
        groups.setdefault(text, []).append(name)
    return groups


def _row(result: Result) -> tuple[str, ...]:
    readings = [reading for reading in result.readings if reading.measured] or result.readings
    share = max((reading.found_share for reading in readings), default=0.0)
    return (
        result.name,
        nominal_text(result),
        *value_texts(result),
        # of an image that was not registered nothing was looked for
        f"{100 * share:.0f} %" if share or result.measured else "",
        result.decision.value,
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
    State.OUTSIDE: "#8822ff",
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
_BAR = (420, 54)


def image_data(picture: Picture, window: tuple[int, int, int, int], width: int) -> str:
    """Return a part of an image as a data URI: left, top, width, height in px; shrunk to a width."""
    from PIL import Image

    column, row, wide, high = window
    part = picture.grey[row : row + high, column : column + wide]
    grey = np.clip(part * (255.0 / picture.white), 0, 255).astype(np.uint8)
    image = Image.fromarray(grey)
    if wide > width:
        image = image.resize((width, max(1, round(high * width / wide))), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=_QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


class Stroke(NamedTuple):
    """A path of a picture: its data, the width of its stroke, and its colour."""

    d: str
    size: float
    color: str = ""


class DrawnImage(NamedTuple):
    """A part of an image (left, top, width, height, px) with what is drawn on it."""

    title: str
    window: tuple[int, int, int, int]
    jpeg: str
    dots: list[Stroke]
    outlines: Sequence[Stroke] = ()
    whiskers: Sequence[Stroke] = ()


class Residuals(NamedTuple):
    """Residuals of an entity along it; what was not found as marks at the bottom. `reach` is half the height, px."""

    title: str
    reach: float
    dots: list[Stroke]
    size: tuple[int, int] = _PLOT


class ValueBar(NamedTuple):
    """A value with its U in the tolerance, whose guard bands are shaded; places in px of the picture."""

    title: str
    bands: list[tuple[str, float, float]]
    zero: float
    low: float
    middle: float
    high: float
    limits: list[tuple[str, float, float]]
    size: tuple[int, int] = _BAR


def whole_image(picture: Picture, points: NDArray[np.void], title: str) -> DrawnImage:
    """Return a whole image with the samples of its registration, and the planned and the registered outline."""
    height, width = picture.grey.shape
    window = (0, 0, width, height)
    outlines = []
    if "edge" in (points.dtype.names or ()):
        size = 0.0011 * width
        outlines = [
            Stroke(_outline(points, ("planned_u", "planned_v")), size, PLANNED),
            Stroke(_outline(points, ("u", "v")), size, REGISTERED),
        ]
    jpeg = image_data(picture, window, _WIDE_PX)
    return DrawnImage(title, window, jpeg, _dots(points[::2], 0.0026 * width), outlines)


def _outline(points: NDArray[np.void], fields: tuple[str, str]) -> str:
    """Return lines through the samples (edge, and two fields of places) of each edge."""
    places = np.stack([points[name] for name in fields], axis=1)
    marks = []
    for k in np.unique(points["edge"]):
        samples = places[points["edge"] == k]
        steps = np.linalg.norm(np.diff(samples, axis=0), axis=1)
        for part in np.split(samples, np.flatnonzero(~(steps <= LONG_PX)) + 1):
            if len(part) > 1 and np.isfinite(part).all():
                marks.append("M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in part.tolist()))
    return "".join(marks)


def entity_image(picture: Picture, entities: Sequence[NDArray[np.void]], title: str) -> DrawnImage:
    """Return the part of an image around the entities of a target, with their points and residuals as whiskers."""
    places = np.concatenate([np.c_[points["u"], points["v"]] for points in entities])
    places = places[np.isfinite(places).all(axis=1)]
    height, width = picture.grey.shape
    low = np.clip(places.min(axis=0) - _ROOM_PX, 0, [width - 2, height - 2]).astype(int)
    high = np.clip(places.max(axis=0) + _ROOM_PX, low + 2, [width, height]).astype(int)
    column, row = low.tolist()
    window = (column, row, int(high[0] - column), int(high[1] - row))
    size = max(window[2], window[3])
    dots = [path for points in entities for path in _dots(points, size / 150)]
    whiskers = [Stroke(_whiskers(points), size / 500) for points in entities]
    return DrawnImage(title, window, image_data(picture, window, _CROP_PX), dots, whiskers=whiskers)


def residual_plot(points: NDArray[np.void], title: str) -> Residuals:
    """Return the residuals of an entity along it, px."""
    width, height = _PLOT
    is_found = np.isfinite(points["residual_px"])
    inner = points[is_found & (points["state"] == State.FOUND)]["residual_px"]
    reach = max(0.1, 1.2 * float(np.abs(inner).max())) if len(inner) else 0.1
    middle = height / 2
    dots = []
    for state in State:
        samples = points[is_found & (points["state"] == state)]
        if len(samples):
            y = middle - np.clip(samples["residual_px"] / reach, -1, 1) * (middle - 4)
            dots.append(_dot_path(np.c_[samples["share"] * width, y], COLOURS[state], 3.2))
        samples = points[~is_found & (points["state"] == state)]
        if len(samples):
            places = np.c_[samples["share"] * width, np.full(len(samples), height - 3.0)]
            dots.append(_dot_path(places, COLOURS[state], 4.0))
    return Residuals(title, reach, dots)


def value_bar(result: Result, rule: DecisionRule) -> ValueBar | None:
    """Return a value with its U in the tolerance; None without both, or of a position, which is decided in a disc."""
    if not result.measured or result.tolerance is None or result.kind in POSITIONS:
        return None
    lower, upper = result.tolerance
    expanded = result.expanded_uncertainty
    limits = [limit for limit in (lower, upper) if math.isfinite(limit)]
    low = min(*limits, 0.0, result.deviation - expanded)
    high = max(*limits, 0.0, result.deviation + expanded)
    room = 0.12 * (high - low)

    def at(value: float) -> float:
        # what has no limit ends with the picture
        share = (value - low + room) / (high - low + 2 * room)
        return round(min(max(share, 0.0), 1.0) * _BAR[0], 2)

    bands = [("tolerance", at(lower), at(upper))]
    outside = guard_band(result.standard_uncertainty, rule)
    if outside > 0:
        # between the values that conform and those that do not, nothing is decided
        accepted = result.accepted or (upper, upper)
        undecided = [(lower - outside, accepted[0]), (accepted[1], upper + outside)]
        bands += [
            ("band", at(low), at(high))
            for (low, high), limit in zip(undecided, (lower, upper), strict=True)
            if math.isfinite(limit)
        ]
    return ValueBar(
        f"{result.name}: deviation {_minus(f'{result.deviation:+.4g}')} ± {digits_text(expanded, 2)}",
        bands,
        at(0.0),
        at(result.deviation - expanded),
        at(result.deviation),
        at(result.deviation + expanded),
        [
            (kind, at(limit), limit)
            for kind, limit in (("", lower), ("end", upper))
            if math.isfinite(limit)
        ],
    )


def _legend(states: Iterable[int]) -> list[tuple[str, str]]:
    """Return the colours of states with their words."""
    return [(COLOURS[State(k)], STATE_TEXTS[State(k)]) for k in sorted(set(states))]


def _dots(points: NDArray[np.void], size: float) -> list[Stroke]:
    return [
        _dot_path(np.c_[samples["u"], samples["v"]], COLOURS[state], size)
        for state in State
        if len(samples := points[points["state"] == state])
    ]


def _dot_path(places: Array, color: str, size: float) -> Stroke:
    """Return dots as one path of strokes without length."""
    finite = places[np.isfinite(places).all(axis=1)]
    return Stroke("".join(f"M{u:.1f} {v:.1f}h0" for u, v in finite.tolist()), size, color)


def _whiskers(points: NDArray[np.void]) -> str:
    """Return the residuals of found points as lines across their entity."""
    fit = points[np.isfinite(points["residual_px"]) & (points["state"] == State.FOUND)]
    rows = np.c_[fit["u"], fit["v"], fit["nu"], fit["nv"], fit["residual_px"]]
    return "".join(
        f"M{u:.1f} {v:.1f}l{nu * WHISKER * r:.1f} {nv * WHISKER * r:.1f}"
        for u, v, nu, nv, r in rows.tolist()
    )


_PICTURES = "report/templates/measured_pictures.svg"
# digits of a digest that tell files apart at a glance
_DIGEST_DIGITS = 12
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

    Raises
    ------
    RequestError
        If the results are none.

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
    check_kinds(results=(results, "MeasurementResults"))
    # what no image was read for is said last, and once for each reason
    ordered = sorted(results, key=lambda result: (_unread(result), _ORDER.index(result.decision)))
    heading = results.source.part or "part"
    if results.serial:
        heading += f", {results.serial}"
    page = render(
        "planner",
        "report/templates/measured.html",
        base_style=asset("planner.report", "templates/base.css"),
        style=asset("planner.report", "templates/measured.css"),
        heading=heading,
        verdict=verdict(results),
        facts=_facts(results),
        sorting=asset("planner.report", "templates/sort.js"),
        notes=list(image_notes(results)),
        explanation=_explanation(results),
        whisker=f"{WHISKER:g}",
        values=_values(ordered, results),
        targets=_targets(ordered, results),
        budgets=_budgets(ordered),
        images=[_image(name, results) for name in results.pictures],
    )
    return str(page)


def _facts(results: MeasurementResults) -> dict[str, str]:
    """Return what an auditor asks first, by names: what was measured, when, by whom, with what, how decided."""
    source = results.source
    rows = {
        "Part": source.part or "part",
        "Serial": results.serial or "not stated",
        "Measured": source.date,
        "Operator": source.operator or "not stated",
        "Decision rule": str(results.rule),
        "Poses of images": _poses_text(results),
        "Grey values": _response_text(results),
        "Program": source.program,
        "Digest of the part": source.part_digest[:_DIGEST_DIGITS],
        "Digest of the part's file": source.part_file_sha256[:_DIGEST_DIGITS],
        "Digest of the plan": source.plan_digest[:_DIGEST_DIGITS],
        **(_camera_facts(source.camera) if source.camera is not None else {}),
    }
    return {name: value for name, value in rows.items() if value}


# how the poses of images are known, by the method of their registration
_POSES = {
    "planned": "as planned, not registered",
    "given": "as given",
    "own edges": "registered to the part's edges",
    "fiducials": "registered to fiducials",
    "fiducials and own edges": "registered to fiducials and the part's edges",
}


def _poses_text(results: MeasurementResults) -> str:
    """Return how the poses of images are known; nothing if none is."""
    methods = dict.fromkeys(image.method for image in results.images.values())
    return "; ".join(_POSES[method] for method in methods)


# what says which response an image has
_SAID_BY = {
    "camera": "stated",
    "file": "stated by the image files",
    "edges": "found on the edges of the images",
    "assumed": "assumed",
}


def _response_text(results: MeasurementResults) -> str:
    """Return how much light grey values stand for, and what says so."""
    texts = {
        f"{results.pictures[name].response.words}, {_SAID_BY[record.origin]}"
        for name, record in results.responses.items()
    }
    return "; ".join(sorted(texts))


def _camera_facts(camera: Camera) -> dict[str, str]:
    """Return the camera and its calibration in words."""
    width, height = camera.resolution
    pitch = " × ".join(f"{1000 * length:.4g}" for length in dict.fromkeys(camera.pixel_pitch_mm))
    centre = camera.principal_point_px
    place = "in the middle" if centre is None else f"at {centre[0]:.2f}, {centre[1]:.2f} px"
    lens = "no distortion" if camera.distortion is None else "distortion calibrated"
    return {
        "Camera": f"{camera.name or 'camera'}, {width} × {height} px of {pitch} µm",
        "Calibration": f"image distance {camera.image_distance_mm:.6g} mm, principal point {place}, {lens}",
    }


def _explanation(results: MeasurementResults) -> str:
    return (
        f"Rule: {results.rule}. Values in mm, angles in degrees. U is the expanded uncertainty, twice the standard "
        "uncertainty u. It counts the camera's pose, the part's surfaces, the points in the image, the response of "
        "the camera and broken edges. It does not count the calibration of the lens and the temperature of the part."
        f"{_foreseen_explanation(results)}{_interval_explanation(results)}{_break_explanation(results)}"
    )


def _foreseen_explanation(results: MeasurementResults) -> str:
    is_foreseen = [math.isfinite(result.foreseen_uncertainty) for result in results]
    if not any(is_foreseen):
        return ""
    text = (
        " U measured is that of these images, and decides. U foreseen is what the plan expected of the planned pose "
        "and lamps."
    )
    if all(is_foreseen):
        return text
    return (
        f"{text} A plan foresees no U of the length of an edge, of an arc of less than half a circle, of a value from "
        "two images, and of what it does not inspect."
    )


def _interval_explanation(results: MeasurementResults) -> str:
    if all(result.interval is None for result in results):
        return ""
    return (
        " A position is twice a distance, and never below 0. So its interval of 95 % counts errors in all directions, "
        "may be wider on one side, and is not the value ± U."
    )


def _break_explanation(results: MeasurementResults) -> str:
    if results.unseen is None:
        return ""
    return " U with breaks is red where the decision would be open with breaks that images may not show."


def _values(ordered: Sequence[Result], results: MeasurementResults) -> Table:
    """Return the values, each with a picture of its tolerance. Below a row stands the reason why it has no value."""
    unseen = results.unseen
    has_u = all(result.interval is None for result in ordered)
    has_tolerances = any(result.tolerance is not None for result in ordered)
    u_head = "U measured (k = 2)" if has_u else "U measured (k = 2), or 95 % of a position"
    columns: list[tuple[Column, Callable[[Result], Any]]] = [
        (Column("Target", kind="link"), lambda result: (_anchor(result, results), result.name)),
        (Column("Nominal, tolerance" if has_tolerances else "Nominal", right=True), nominal_text),
        (Column("Value", right=True), lambda result: value_texts(result)[0]),
        (Column("Deviation", right=True), _deviation_text),
        (Column(u_head, right=True), lambda result: value_texts(result)[1]),
    ]
    if any(math.isfinite(result.foreseen_uncertainty) for result in ordered):
        columns.append((Column("U foreseen by the plan", right=True), _foreseen_text))
    if has_tolerances:
        columns.append((Column("Accepted deviation", right=True), _accepted_text))
    if unseen:
        head = f"U with breaks to {unseen.limit_mm:.2g} mm"
        column = Column(head, right=True, kind="lines")
        columns.append((column, lambda result: _wider_line(result, unseen)))
    if has_tolerances:
        column = Column("Tolerance, guard bands, value ± U", kind="lines")
        columns.append((column, lambda result: _bar_line(result, results)))
    columns.append((Column("Decision", kind="lines"), _decision_line))
    rows = [tuple(cell(result) for _, cell in columns) for result in ordered]
    below = {
        k: f"Reason: {reason}"
        for k, result in enumerate(ordered)
        if (reason := _reason_of_row(result, results))
    }
    return Table(tuple(column for column, _ in columns), rows, style="stack", below=below)


def _bar_line(result: Result, results: MeasurementResults) -> list[CellLine]:
    bar = value_bar(result, results.rule)
    return [] if bar is None else [CellLine(render_macro("planner", _PICTURES, "value", bar))]


def _decision_line(result: Result) -> list[CellLine]:
    return [CellLine(result.decision.value, _CLASSES[result.decision])]


def _reason_of_row(result: Result, results: MeasurementResults) -> str:
    """Return why a result has no value; of several with one reason, the others refer to the first."""
    if not result.reason:
        return ""
    first = _first_alike(result, results)
    return _short_reason(result, results) if first is result else f"as {first.name}"


def _foreseen_text(result: Result) -> str:
    """Return U as the plan foresaw it; nothing of what was not measured."""
    if not result.measured:
        return ""
    amount = result.foreseen_uncertainty
    return number_text(amount, amount) if math.isfinite(amount) else "not foreseen"


def _wider_line(result: Result, unseen: UnseenBreaks) -> list[CellLine]:
    """Return U of a value if its edges are broken as images do not show; marked where the decision is then open."""
    wider = unseen.uncertainties.get(result.name)
    if wider is None:
        return []
    return [CellLine(number_text(wider, wider), "bad" * (result.name in unseen.open_decisions))]


def _deviation_text(result: Result) -> str:
    """Return how far a value is off, with the digits of its U; nothing of what was not measured."""
    if not result.measured:
        return ""
    text = number_text(result.deviation, result.expanded_uncertainty)
    return _minus(text) if text.startswith("-") else f"+{text}"


def _accepted_text(result: Result) -> str:
    """Return the deviations that the rule accepts with this uncertainty; nothing without a tolerance."""
    if not result.measured or result.tolerance is None:
        return ""
    if result.kind in POSITIONS:
        return "decided in a disc"
    if result.accepted is None:
        return "none: u is too large"
    decimals = decimals_of(result.expanded_uncertainty)
    lower, upper = result.accepted
    texts = []
    # inwards, so that no value is said to be accepted that is not
    if math.isfinite(lower):
        texts.append(f"{rounded_up(lower, decimals):+.{decimals}f}")
    if math.isfinite(upper):
        texts.append(f"{-rounded_up(-upper, decimals):+.{decimals}f}")
    texts = [_minus(text) for text in texts]
    if len(texts) == 2:
        return " .. ".join(texts)
    return f"{'up to' if math.isinf(lower) else 'from'} {texts[0]}"


def _minus(number: str) -> str:
    """Return a number with the sign that pages set for minus."""
    return number.replace("-", "−")


def _anchor(result: Result, results: MeasurementResults) -> str:
    first = _first_alike(result, results)
    return f"target-{list(results.results).index(first.name) + 1}"


def _unread(result: Result) -> bool:
    """Tell whether a target has no value because no image was read for it, as of one that is not planned."""
    return not result.measured and not result.readings


def _first_alike(result: Result, results: MeasurementResults) -> Result:
    """Return the first target that no image was read for, for the same reason; the target itself if it was read."""
    if not _unread(result):
        return result
    return next(
        other for other in results if _unread(other) and _sentence(other) == _sentence(result)
    )


def _targets(ordered: Sequence[Result], results: MeasurementResults) -> list[dict[str, Any]]:
    """Return what the page says of targets: of those that no image was read for, once for each reason."""
    texts = {result.name: _sentence(result) for result in ordered if _unread(result)}
    groups = {names[0]: ", ".join(names) for names in _by_text(texts).values()}
    firsts = {_first_alike(result, results).name for result in ordered}
    return [
        {**_target(result, results), "name": groups.get(result.name, result.name)}
        for result in ordered
        if result.name in firsts
    ]


def _target(result: Result, results: MeasurementResults) -> dict[str, Any]:
    """Return what the page says of a target."""
    readings = [_reading(result, reading, results) for reading in result.readings]
    return {
        "anchor": _anchor(result, results),
        "name": result.name,
        "decision": result.decision.value,
        "style": _CLASSES[result.decision],
        "sentence": _sentence(result),
        "notes": result.notes,
        "readings": [reading for reading in readings if reading is not None],
    }


def _sentence(result: Result) -> str:
    if not result.measured:
        reason = result.reason.removesuffix(".")
        return f"Not measured: {reason}. {as_sentence(result.advice)}".rstrip()
    value, uncertainty = value_texts(result)
    decimals = decimals_of(result.expanded_uncertainty)
    text = (
        f"{result.kind.replace('_', ' ').capitalize()} {amount_text(value, result.unit)}, "
        f"deviation {_minus(f'{result.deviation:+z.{decimals}f}')}, U = {uncertainty}."
    )
    if result.interval is not None:
        zone = nominal_text(result)
        text = f"{result.kind.capitalize()} {value} {result.unit} in {zone}, with 95 % in {uncertainty} {result.unit}."
    if math.isfinite(result.conformance_probability):
        probability = probability_text(result.conformance_probability)
        if not float(probability.removeprefix("> ")):
            probability = "< 0.0001"
        sign = "" if probability[0] in "<>" else "= "
        text += f" It is within its tolerance with P {sign}{probability}."
    return text


def _reading(
    result: Result, reading: Reading, results: MeasurementResults
) -> dict[str, Any] | None:
    """Return what the page says of a target in an image; None without a picture or points."""
    picture = results.pictures.get(reading.image)
    entities = {k: points for k, points in enumerate(reading.points, 1) if len(points)}
    if picture is None or not entities:
        return None
    title = f"{result.name} in {reading.image}"
    place = reading.image
    if reading.entity:
        place += f", {reading.entity} alone"
    return {
        "sentence": f"{place}: {_reading_words(reading, result.unit)}",
        "picture": entity_image(picture, list(entities.values()), title),
        "plots": [
            residual_plot(points, f"residuals of entity {k} of {title}")
            for k, points in entities.items()
        ],
        "states": _legend(state for points in entities.values() for state in points["state"]),
    }


def _reading_words(reading: Reading, unit: str) -> str:
    share = f"{100 * reading.found_share:.0f} % found"
    if not reading.measured:
        return f"{share}; {reading.reason}"
    u = reading.standard_uncertainty
    return (
        f"{amount_text(f'{reading.value:.4f}', unit)}, u = {u:.4f}, {share}, "
        f"points {reading.rms_px:.3f} px from the fit"
    )


def _budgets(ordered: Sequence[Result]) -> Table | None:
    """Return the parts of u of each reading, in thousandths of its unit; None without readings."""
    readings = [
        (result, reading) for result in ordered for reading in result.readings if reading.measured
    ]
    sources = [
        source for source in SOURCES if any(reading.budget[source] for _, reading in readings)
    ]
    if not readings:
        return None
    columns = (
        Column("Target"),
        Column("Image"),
        *(Column(source.capitalize(), right=True, kind="lines") for source in sources),
        Column("u", right=True),
    )
    rows = []
    for result, reading in readings:
        largest = max(sources, key=lambda source: reading.budget[source])
        parts = [
            [CellLine(_thousandths(reading.budget[source]), "strong" if source == largest else "")]
            for source in sources
        ]
        small = "µm" if result.unit == "mm" else "mdeg"
        total = f"{1000 * reading.standard_uncertainty:.1f} {small}"
        rows.append((result.name, reading.image, *parts, total))
    return Table(columns, rows, style="stack")


def _thousandths(variance: float) -> str:
    """Return a part of u in thousandths of its unit; nothing of one that has none."""
    return f"{1000 * math.sqrt(variance):.1f}" if variance else ""


def _image(name: str, results: MeasurementResults) -> dict[str, Any]:
    """Return what the page says of an image."""
    picture = results.pictures[name]
    if name in results.failed:
        sentence = f"Cannot be registered: {results.failed[name]}."
    else:
        sentence = _image_words(results.images[name], picture.clipped_share)
    samples = _samples(name, results)
    return {
        "name": name,
        "sentence": sentence,
        "picture": whole_image(picture, samples, name),
        "states": _legend(samples["state"].tolist()),
    }


def _samples(name: str, results: MeasurementResults) -> np.ndarray:
    """Return the samples of an image's registration, or of its entities where nothing was registered."""
    kind = np.dtype([("u", float), ("v", float), ("state", np.int64)])
    if name in results.images and len(results.images[name].samples):
        return results.images[name].samples
    readings = [reading for result in results for reading in result.readings]
    entities = [
        points for reading in readings if reading.image == name for points in reading.points
    ]
    joined = np.zeros(sum(map(len, entities)), dtype=kind)
    for field in ("u", "v", "state"):
        parts = (points[field] for points in entities)
        joined[field] = np.concatenate([joined[field][:0], *parts])
    return joined


def _image_words(registered: Registered, clipped: float) -> str:
    bright = f" {100 * clipped:.1f} % of the image is overexposed." if clipped >= 0.001 else ""
    if registered.method != "own edges":
        return f"The pose is {registered.method}.{bright}"
    notes = "".join(f" {note[0].upper()}{note[1:]}." for note in registered.notes)
    return (
        f"Registered to own edges: the image was {registered.shift_px:.1f} px off its prediction, "
        f"{registered.misfit_px:.3f} px after it; {registered.used} of {registered.offered} "
        f"samples agree.{bright}{notes}"
    )

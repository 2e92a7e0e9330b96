"""Pictures of what was measured, as SVG: found points on the image, residuals as whiskers, values in tolerances."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from errors.measurands import DecisionRule
from planner.measuring.image.picture import Picture
from planner.measuring.image.scans import STATE_TEXTS, State
from planner.measuring.merge import Result

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
    low = min(lower, result.deviation - expanded)
    high = max(upper, result.deviation + expanded)
    room = 0.12 * (high - low)
    width, height = _BAR

    def at(value: float) -> float:
        return round((value - low + room) / (high - low + 2 * room) * width, 2)

    guard = _guard(rule, result.standard_uncertainty)
    bands = "".join(
        _rectangle("band", at(limit - guard), at(limit + guard))
        for limit in (lower, upper)
        if math.isfinite(limit) and guard > 0
    )
    words = f"{result.name}: deviation {result.deviation:+.4g} ± {expanded:.2g}"
    return (
        f'<svg class="bar" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(words)}">'
        f"<title>{escape(words)}</title>"
        f"{_rectangle('tolerance', at(lower), at(upper))}{bands}"
        f'<path class="zero" d="M{at(0.0)} 8V34"/>'
        f'<path class="value" d="M{at(result.deviation - expanded)} 21H{at(result.deviation + expanded)}"/>'
        f'<circle class="value" cx="{at(result.deviation)}" cy="21" r="4.5"/>'
        f'<text x="{at(lower)}" y="44">{lower:+.4g}</text>'
        f'<text class="end" x="{at(upper)}" y="44">{upper:+.4g}</text></svg>'
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

"""Draw which parts of an edge and of the lines at its ends a line fit can use: writes ``corners.svg``."""

from __future__ import annotations

from math import cos, radians, sin, tan
from pathlib import Path

# edge from A to B, in pixels of the picture; y points down
A = (120.0, 190.0)
LENGTH = 460.0
ALPHA_DEG = 38.0
BETA_DEG = 55.0
ARM = 175.0
SEPARATION = 46.0
EDGE = "#0072b2"
MIXED = "#d55e00"
INK = "#2b3138"


def line(start: tuple[float, float], end: tuple[float, float], style: str) -> str:
    """Return a line."""
    (x0, y0), (x1, y1) = start, end
    return f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" {style}/>'


def text(x: float, y: float, words: str, colour: str = INK, anchor: str = "middle") -> str:
    """Return a label."""
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


def span(x0: float, x1: float, y: float, words: str, colour: str) -> list[str]:
    """Return a length with its label below."""
    style = f'stroke="{colour}" stroke-width="1.2"'
    ticks = [line((x, y - 6), (x, y + 6), style) for x in (x0, x1)]
    return [line((x0, y), (x1, y), style), *ticks, text((x0 + x1) / 2, y + 20, words, colour)]


def arm(corner: tuple[float, float], towards: float, angle_deg: float) -> list[str]:
    """Return a line that leaves a corner, its first part mixed with the edge."""
    direction = (towards * cos(radians(angle_deg)), -sin(radians(angle_deg)))
    mixed = SEPARATION / sin(radians(angle_deg))
    points = [
        (corner[0] + length * direction[0], corner[1] + length * direction[1])
        for length in (0.0, mixed, ARM)
    ]
    return [
        line(points[0], points[1], f'stroke="{MIXED}" stroke-width="3"'),
        line(points[1], points[2], f'stroke="{INK}" stroke-width="3"'),
    ]


def draw() -> str:
    """Return the picture."""
    left, y = A
    right = left + LENGTH
    first = SEPARATION / tan(radians(ALPHA_DEG))
    last = SEPARATION / tan(radians(BETA_DEG))
    strip = f'<rect x="{left}" y="{y - SEPARATION}" width="{LENGTH}" height="{2 * SEPARATION}"'
    parts = [
        f'{strip} fill="{EDGE}" opacity="0.09"/>',
        *arm((left, y), 1.0, ALPHA_DEG),
        *arm((right, y), -1.0, BETA_DEG),
        line((left, y), (left + first, y), f'stroke="{MIXED}" stroke-width="5"'),
        line((left + first, y), (right - last, y), f'stroke="{EDGE}" stroke-width="5"'),
        line((right - last, y), (right, y), f'stroke="{MIXED}" stroke-width="5"'),
        text(left + 42, y - 9, "α"),
        text(right - 34, y - 11, "β"),
        *span(left, left + first, y + 72, "s′ / tan α", MIXED),
        *span(left + first, right - last, y + 72, "the edge alone: at least 2 s", EDGE),
        *span(right - last, right, y + 72, "s′ / tan β", MIXED),
        line((left - 22, y), (left - 22, y - SEPARATION), f'stroke="{INK}"'),
        text(left - 30, y - SEPARATION / 2 + 5, "s′", anchor="end"),
        text(left + 120, y - 112, "line at one end", anchor="end"),
        text(right - 80, y - 142, "line at the other end", anchor="start"),
        text((left + right) / 2, y + 24, "edge", EDGE),
    ]
    head = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 700 310" width="700" height="310" '
        'font-family="sans-serif" font-size="15">'
    )
    return "\n".join([head, '<rect width="700" height="310" fill="white"/>', *parts, "</svg>\n"])


if __name__ == "__main__":
    Path(__file__).with_suffix(".svg").write_text(draw(), encoding="utf-8")

"""Draw the rooms of the packages: floors from the import contracts, arrows from the imports.

Run from anywhere; writes ``rooms.svg`` beside this file, the same bytes for the same code. A new room needs a place in
`PLACES`; the tests say so, and that the picture is no longer that of the code.
"""

from __future__ import annotations

import ast
import tomllib
from html import escape
from pathlib import Path

import networkx as nx

ROOT = Path(__file__).parents[2]

COLUMN = 162
FLOOR = 62
BOX = (148, 38)
MARGIN = 24
HEAD = 34
COLOURS = {
    "planner": "#dcebf7",
    "aspectgraph": "#e2f0dc",
    "errors": "#fbead2",
    "ga": "#eee6f4",
    "ground": "#ececec",
}

# of each room: its place from left to right, in columns, and what it does
PLACES = {
    "planner": {
        "app": (2.5, "options, commands, batch"),
        "inspection": (1.5, "the whole plan"),
        "report": (4.1, "page, pictures, words"),
        "optics": (0.6, "poses and lenses, judged"),
        "robotprogram": (2.1, "moves and programs"),
        "measuring": (3.1, "images to values"),
        "search": (1.5, "poses, columns, stages"),
        "resolve_request": (2.6, "from words to the request"),
        "resume": (4.1, "continue where it stopped"),
        "identity": (3.2, "the request as one value"),
        "options": (3.5, "keywords and defaults"),
        "plan": (4, "the plan and its file"),
        "travel": (2.4, "order of the poses"),
        "plan_tables": (4.4, "tables of a plan"),
        "rows": (4.4, "measurements as rows"),
        "bound": (0.5, "no plan has fewer settings"),
        "light": (2.6, "lamps for a plan"),
        "cover": (0.2, "few columns for all targets"),
        "sensor_setting": (4.9, "one pose, what it measures"),
        "verify": (3.6, "probabilities, simulated"),
        "effort": (0.9, "how to search, in numbers"),
        "request": (2.7, "targets and constraints"),
        "detectability": (3.2, "what an image needs"),
        "robotcell": (1.9, "what an arm reaches"),
        "camera": (3.25, "camera, pose, uncertainty"),
        "callbacks": (4.4, "calls on the way, the end"),
        "plan_file": (2.6, "strict files"),
        "text_table": (4.2, "tables for a terminal"),
        "argument_kinds": (2, "arguments of wrong types"),
        "executors": (0, "work in processes"),
        "progress": (4, "how far it is"),
        "files": (5, "files written whole"),
        "compiling": (1, "says what is compiled"),
        "exceptions": (3, "for every room"),
    },
    "aspectgraph": {
        "plot": (2.6, "pictures"),
        "light": (1.4, "where lamps show edges"),
        "graph": (2, "the aspect graph, its files"),
        "domains": (1.5, "cells merged to domains"),
        "visibility": (1.5, "from where edges are seen"),
        "cells": (1, "convex cells, cut exactly"),
        "dimensions": (2, "dimensions of the model"),
        "exact": (1, "grid and exact signs"),
        "entities": (2, "what can be measured"),
        "read": (0, "part files"),
        "solid": (1, "a surface that is checked"),
        "files": (2.92, "files written whole"),
        "exceptions": (1.94, "for every room"),
        "phases": (0.97, "what takes time"),
    },
}
LEAVES = {"errors": "error of a measured length", "ga": "a genetic algorithm"}
BELOW = {"ground": "lazy faces, and compiled loops on disk"}


def floors(package: str) -> list[list[str]]:
    """Return the rooms of a package from the top floor to the ground, as its import contract states them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(one["layers"] for one in contracts if one.get("containers") == [package])
    return [[room.strip() for room in layer.split("|")] for layer in layers]


def arrows(package: str) -> list[tuple[str, str]]:
    """Return which rooms import which, without those that follow from others and those to the exceptions."""
    graph = nx.DiGraph()
    for path in sorted((ROOT / package).rglob("*.py")):
        room = path.relative_to(ROOT / package).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = (node.module or "").split(".") if isinstance(node, ast.ImportFrom) else []
            if len(names) > 1 and names[0] == package and room not in ("__init__", names[1]):
                graph.add_edge(room, names[1])
    return sorted(edge for edge in nx.transitive_reduction(graph).edges if edge[1] != "exceptions")


def box(
    x: float, y: float, name: str, what: str, colour: str, folder: bool, width: float = BOX[0]
) -> str:
    """Return a room: a box with a name and what it does; a single file has a dashed border."""
    dash = "" if folder else ' stroke-dasharray="4 3"'
    return (
        f'<rect x="{x - width / 2:g}" y="{y - BOX[1] / 2:g}" width="{width:g}" height="{BOX[1]}" rx="4" '
        f'fill="{colour}" stroke="#444"{dash}/>\n'
        f'<text x="{x:g}" y="{y - 3:g}" class="name">{escape(name)}</text>\n'
        f'<text x="{x:g}" y="{y + 12:g}" class="what">{escape(what)}</text>'
    )


def arrow(start: tuple[float, float], end: tuple[float, float]) -> str:
    """Return an arrow from the lower side of one box to the upper side of another."""
    (x0, y0) = start
    (x1, y1) = end
    half = BOX[1] / 2
    return (
        f'<line x1="{x0:g}" y1="{y0 + half:g}" x2="{x1:g}" y2="{y1 - half - 2:g}" class="arrow"/>'
    )


def house(package: str, left: float, top: float, columns: float) -> tuple[list[str], float]:
    """Return the parts of the picture of one package, and where it ends below."""
    levels = floors(package)
    where = {
        room: (left + (PLACES[package][room][0] + 0.5) * COLUMN, top + HEAD + (k + 0.5) * FLOOR)
        for k, level in enumerate(levels)
        for room in level
    }
    width = columns * COLUMN
    height = HEAD + len(levels) * FLOOR
    parts = [frame(package, left, top, width, height)]
    parts += [arrow(where[upper], where[lower]) for upper, lower in arrows(package)]
    for room, (x, y) in where.items():
        folder = (ROOT / package / room).is_dir()
        parts.append(box(x, y, room, PLACES[package][room][1], COLOURS[package], folder))
    return parts, top + height


def frame(package: str, left: float, top: float, width: float, height: float) -> str:
    """Return the outline of a package with its name."""
    return (
        f'<rect x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}" rx="6" fill="#fcfcfc" stroke="#999"/>\n'
        f'<text x="{left + 12:g}" y="{top + 22:g}" class="package">{package}</text>'
    )


def strong_arrow(x: float, start: float, end: float) -> str:
    """Return an arrow straight down from one package to another."""
    return f'<line x1="{x:g}" y1="{start:g}" x2="{x:g}" y2="{end - 4:g}" class="arrow strong"/>'


def draw() -> str:
    """Return the picture as SVG."""
    upper, end = house("planner", MARGIN, MARGIN, 6)
    top = end + FLOOR
    lower, bottom = house("aspectgraph", MARGIN, top, 3.9)
    parts = [*upper, *lower]
    middles = [MARGIN + 1.95 * COLUMN]
    for k, (name, what) in enumerate(LEAVES.items()):
        left = MARGIN + (4.02 + 1.02 * k) * COLUMN
        wide = 0.96 * COLUMN
        middles.append(left + wide / 2)
        parts.append(frame(name, left, top, wide, HEAD + FLOOR))
        parts.append(
            box(
                middles[-1],
                top + HEAD + FLOOR / 2,
                "one room",
                what,
                COLOURS[name],
                True,
                wide - 16,
            )
        )
    parts += [strong_arrow(x, end, top) for x in middles]
    left = MARGIN + 4.02 * COLUMN
    low = top + HEAD + 2 * FLOOR
    wide = 1.98 * COLUMN
    for name, what in BELOW.items():
        parts.append(frame(name, left, low, wide, HEAD + FLOOR))
        middle = (left + wide / 2, low + HEAD + FLOOR / 2)
        parts.append(box(*middle, "one room", what, COLOURS[name], True, wide - 16))
        parts.append(strong_arrow(middles[1], top + HEAD + FLOOR, low))
    width = 6 * COLUMN + 2 * MARGIN
    height = bottom + MARGIN
    return "\n".join([HEADER.format(width=f"{width:g}", height=f"{height:g}"), *parts, "</svg>\n"])


HEADER = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">
<style>
text {{ font-family: "Helvetica Neue", Arial, "Liberation Sans", sans-serif; fill: #222; text-anchor: middle; }}
.package {{ font-size: 16px; font-weight: bold; text-anchor: start; }}
.name {{ font-size: 13px; font-weight: bold; }}
.what {{ font-size: 10px; }}
.arrow {{ stroke: #555; stroke-width: 1.1; marker-end: url(#tip); }}
.strong {{ stroke-width: 2.2; }}
</style>
<marker id="tip" markerUnits="userSpaceOnUse" markerWidth="9" markerHeight="8" refX="8" refY="4" orient="auto">
<path d="M0 0 L9 4 L0 8 z" fill="#555"/></marker>
<rect width="{width}" height="{height}" fill="white"/>"""


if __name__ == "__main__":
    Path(__file__).with_suffix(".svg").write_text(draw(), "utf-8", newline="\n")

"""Draw the wings of the packages: floors from the import contracts, arrows from the imports.

Run from anywhere; writes ``rooms.svg`` beside this file, the same bytes for the same code. A new wing needs a place in
`PLACES`, a new module beside the wings its words in `BESIDE`; the tests say so, and that the picture is no longer that
of the code.
"""

from __future__ import annotations

import ast
import tomllib
from collections import defaultdict
from html import escape
from pathlib import Path

import networkx as nx

ROOT = Path(__file__).parents[2]

COLUMN = 162
FLOOR = 68
LINE = 17
BOX = (148, 38)
MARGIN = 24
HEAD = 34
# where the modules beside the wings are listed, in columns
LIST = {"planner": 4.35, "aspectgraph": 2.5}
COLOURS = {
    "planner": "#dcebf7",
    "aspectgraph": "#e2f0dc",
    "errors": "#fbead2",
    "ga": "#eee6f4",
    "ground": "#ececec",
}

# of each wing: its place from left to right, in columns, and what it does
PLACES = {
    "planner": {
        "app": (2.4, "options, commands, batch"),
        "inspection": (1.9, "the whole plan"),
        "report": (0.55, "page, pictures, words"),
        "robotprogram": (3.1, "moves and programs"),
        "measuring": (0.2, "images to values"),
        "search": (1.75, "poses, columns, stages"),
        "plan": (0.45, "the plan and its file"),
        "bound": (1.43, "no plan has fewer settings"),
        "light": (0.45, "lamps for a plan"),
        "verify": (0.45, "probabilities, simulated"),
        "request": (0.95, "targets and constraints"),
        "detectability": (0.95, "what an image needs"),
        "robotcell": (3.1, "what an arm reaches"),
        "camera": (0.95, "camera, pose, uncertainty"),
    },
    "aspectgraph": {
        "plot": (1.1, "pictures"),
        "light": (0.1, "where lamps show edges"),
        "graph": (0.6, "the aspect graph, its files"),
        "domains": (0.6, "cells merged to domains"),
        "visibility": (0.6, "from where edges are seen"),
        "cells": (0.1, "convex cells, cut exactly"),
        "dimensions": (1.7, "dimensions of the model"),
        "exact": (0, "grid and exact signs"),
        "entities": (0.95, "what can be measured"),
        "read": (1.9, "part files"),
        "solid": (0.95, "a surface that is checked"),
    },
}
# modules that stand beside the wings of their floor
BESIDE = {
    "planner": {
        "optics": "cameras and lenses, ranked",
        "lights": "lights for a plan",
        "pose_files": "poses that exist",
        "resolve_request": "from arguments to the request",
        "resume": "continue an interrupted plan",
        "options": "keywords and defaults",
        "travel": "order of the poses",
        "identity": "the request as one value",
        "plan_record": "what plan.json holds",
        "plan_tables": "what a plan shows of itself",
        "rows": "rows of measurements",
        "cover": "few columns for all targets",
        "sensor_setting": "one pose, its targets",
        "effort": "how long to search",
        "callbacks": "calls on the way, the end",
        "light_catalogue": "catalogue of lights",
        "plan_file": "rules of plan files",
        "text_table": "the table model",
        "argument_kinds": "arguments of wrong types",
        "executors": "work in processes",
        "files": "files written whole",
        "progress": "how far it is",
        "compiling": "what is compiled",
        "exceptions": "for every wing",
    },
    "aspectgraph": {
        "files": "files written whole",
        "exceptions": "for every wing",
        "phases": "what takes time",
    },
}
LEAVES = {"errors": "error of a measured length", "ga": "a genetic algorithm"}
BELOW = {"ground": "converter, templates, lazy faces, compiled loops on disk"}


def floors(package: str) -> list[list[str]]:
    """Return the wings and modules of a package, from the top floor down, as its import contract states them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(one["layers"] for one in contracts if one.get("containers") == [package])
    return [[room.strip() for room in layer.split("|")] for layer in layers]


def arrows(package: str) -> list[tuple[str, str]]:
    """Return which wings use which, also by modules beside them, without those that follow from others."""
    graph = nx.DiGraph()
    for path in sorted((ROOT / package).rglob("*.py")):
        room = path.relative_to(ROOT / package).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = (node.module or "").split(".") if isinstance(node, ast.ImportFrom) else []
            if len(names) > 1 and names[0] == package and room not in ("__init__", names[1]):
                graph.add_edge(room, names[1])
    wings = nx.transitive_closure_dag(graph).subgraph(PLACES[package])
    return sorted(nx.transitive_reduction(nx.DiGraph(wings.edges)).edges)


def box(
    x: float, y: float, name: str, what: str, colour: str, folder: bool, width: float = BOX[0]
) -> str:
    """Return a wing: a box with a name and what it does; a single file has a dashed border."""
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


Point = tuple[float, float]


def ends(
    pairs: list[tuple[str, str]], middles: dict[str, Point]
) -> dict[tuple[str, str], list[Point]]:
    """Return where each arrow starts and ends: several at one side of a box are apart, in the order of their boxes."""
    points: dict[tuple[str, str], list[Point]] = {pair: [(0.0, 0.0)] * 2 for pair in pairs}
    for side in (0, 1):
        at_box = defaultdict(list)
        for pair in pairs:
            at_box[pair[side]].append(pair)
        for room, group in at_box.items():
            x, y = middles[room]
            group.sort(key=lambda pair: middles[pair[1 - side]][0])
            for k, pair in enumerate(group):
                points[pair][side] = (x + 36 * (k - (len(group) - 1) / 2), y)
    return points


def listed(package: str, level: list[str], left: float, middle: float) -> list[str]:
    """Return the modules beside the wings of a floor, one a line."""
    modules = [room for room in level if room in BESIDE[package]]
    top = middle - LINE * (len(modules) - 1) / 2 + 4
    return [
        f'<text x="{left:g}" y="{top + k * LINE:g}" class="beside"><tspan class="module">{room}</tspan>'
        f"  {escape(BESIDE[package][room])}</text>"
        for k, room in enumerate(modules)
    ]


def house(package: str, left: float, top: float, columns: float) -> tuple[list[str], float]:
    """Return the parts of the picture of one package, and where it ends below."""
    width = columns * COLUMN
    list_left = left + LIST[package] * COLUMN
    y = top + HEAD
    middles = {}
    lines = []
    for level in floors(package):
        wings = [room for room in level if room in PLACES[package]]
        height = max(FLOOR * bool(wings), LINE * (len(level) - len(wings)) + 10)
        for room in wings:
            middles[room] = (left + (PLACES[package][room][0] + 0.5) * COLUMN, y + height / 2)
        lines += listed(package, level, list_left, y + height / 2)
        y += height
        lines.append(
            f'<line x1="{left:g}" y1="{y:g}" x2="{left + width:g}" y2="{y:g}" class="floor"/>'
        )
    # the last floor ends with the frame
    lines.pop()
    parts = [frame(package, left, top, width, y - top), *lines]
    pairs = arrows(package)
    parts += [arrow(*points) for points in ends(pairs, middles).values()]
    for room, middle in middles.items():
        folder = (ROOT / package / room).is_dir()
        parts.append(box(*middle, room, PLACES[package][room][1], COLOURS[package], folder))
    return parts, y


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
                "one wing",
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
        parts.append(box(*middle, "one wing", what, COLOURS[name], True, wide - 16))
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
.floor {{ stroke: #ddd; stroke-width: 1; }}
.beside {{ font-size: 11px; text-anchor: start; white-space: pre; }}
.module {{ font-weight: bold; }}
</style>
<marker id="tip" markerUnits="userSpaceOnUse" markerWidth="9" markerHeight="8" refX="8" refY="4" orient="auto">
<path d="M0 0 L9 4 L0 8 z" fill="#555"/></marker>
<rect width="{width}" height="{height}" fill="white"/>"""


if __name__ == "__main__":
    Path(__file__).with_suffix(".svg").write_text(draw(), "utf-8", newline="\n")

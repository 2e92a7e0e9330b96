"""Parts to plan by the thousand: blocks with holes, pockets and steps, like those of MFCAD, all different.

``python benchmarks/running/made_parts.py FOLDER --parts 1000 --broken 10``

Part k follows from k alone. Every block has two to four features, one in a quarter of it: a hole through it, a pocket,
or a step at its corner. Broken files are cut in the middle, lack a face, or are empty; their names say so.
"""

from __future__ import annotations

import argparse
import random
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

_HOLE, _POCKET, _STEP = range(3)
DIGITS = 4


class Feature(NamedTuple):
    """A box that is taken away: x, y and z from and to, mm."""

    x: tuple[int, int]
    y: tuple[int, int]
    z: int


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--parts", type=int, default=1000, metavar="N")
    parser.add_argument("--broken", type=int, default=0, metavar="N")
    options = parser.parse_args()
    write_parts(options.folder, options.parts, options.broken)


def write_parts(folder: Path, n: int, n_broken: int = 0) -> None:
    """Write so many good and broken files."""
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(n):
        (folder / f"block-{k:0{DIGITS}d}.off").write_text(block(k), encoding="ascii")
    for k in range(n_broken):
        (folder / f"broken-{k:0{DIGITS}d}.off").write_text(broken(k), encoding="ascii")


def broken(k: int) -> str:
    """Return file k of those that are damaged."""
    text = block(k)
    if k % 3 == 0:
        return text[: len(text) // 2]
    if k % 3 == 1:
        lines = text.splitlines()
        n_vertices, n_faces, _ = map(int, lines[1].split())
        return "\n".join([lines[0], f"{n_vertices} {n_faces - 1} 0", *lines[2:-1]]) + "\n"
    return ""


def block(k: int) -> str:
    """Return the OFF file of part k."""
    chance = random.Random(k)
    size = chance.randint(56, 88), chance.randint(48, 72), chance.randint(14, 24)
    quarters = chance.sample([(i, j) for i in (0, 1) for j in (0, 1)], chance.randint(2, 4))
    return _off(size, [_feature(chance, size, *quarter) for quarter in quarters])


def _feature(chance: random.Random, size: tuple[int, int, int], i: int, j: int) -> Feature:
    """Return a feature in a quarter of the block, away from the others."""
    kind = chance.choice((_HOLE, _POCKET, _POCKET, _STEP))
    low_high = []
    for side, which in ((size[0], i), (size[1], j)):
        half = side // 2
        length = chance.randint(10, half - 8)
        first = 0 if which == 0 else side - length
        if kind != _STEP:
            first = (
                chance.randint(4, half - 3 - length) + which * half
                if half - 3 - length > 4
                else 4 + which * half
            )
        low_high.append((first, first + length))
    depth = size[2] if kind == _HOLE else chance.randint(4, size[2] - 5)
    return Feature(low_high[0], low_high[1], size[2] - depth)


def _off(size: tuple[int, int, int], features: list[Feature]) -> str:
    """Return a block less its features: columns of different heights, side by side."""
    xs = sorted({0, size[0], *(x for one in features for x in one.x)})
    ys = sorted({0, size[1], *(y for one in features for y in one.y)})
    levels = sorted({0, size[2], *(one.z for one in features)})
    n_i = len(xs) - 1
    n_j = len(ys) - 1

    def height(i: int, j: int) -> int:
        if not (0 <= i < n_i and 0 <= j < n_j):
            return 0
        inside = [
            one.z
            for one in features
            if one.x[0] <= xs[i] < one.x[1] and one.y[0] <= ys[j] < one.y[1]
        ]
        return min(inside, default=size[2])

    number: dict[tuple[int, int, int], int] = {}

    def point(i: int, j: int, z: int) -> int:
        return number.setdefault((xs[i], ys[j], z), len(number))

    faces = []
    for i in range(n_i):
        for j in range(n_j):
            top = height(i, j)
            ring = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            if not top:
                continue
            faces.append([point(*p, top) for p in ring])
            faces.append([point(*p, 0) for p in reversed(ring)])
            beside = [(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)]
            for (a, b), neighbour in zip(
                zip(ring, [*ring[1:], ring[0]], strict=True), beside, strict=True
            ):
                # cut at all heights there are, so that walls side by side have the same corners
                bare = [z for z in levels if height(*neighbour) <= z <= top]
                for low, high in pairwise(bare):
                    faces.append([point(*a, low), point(*b, low), point(*b, high), point(*a, high)])
    lines = [f"{x} {y} {z}" for x, y, z in number] + [
        " ".join(map(str, [4, *face])) for face in faces
    ]
    return "\n".join(["OFF", f"{len(number)} {len(faces)} 0", *lines]) + "\n"


if __name__ == "__main__":
    main()

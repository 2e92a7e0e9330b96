"""How the time of `aspectgraph info` grows: plates with more holes, meshes with more triangles.

``python benchmarks/running/reading_growth.py``               up to 400 holes and 100,000 triangles
``... --holes 25 100 --triangles 20000 1000000 --keep FOLDER``  these, and the part files stay

Two meshes of each size are made. Nearly every facet of the torus is a face of its own. Most
facets of the bored block lie in six planes. Every file is read in a process of its own; the time is
processor time of it and of the kernel's process, so other work on the machine matters little.
Plates need the extra ``step``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_PITCH_MM = 20.0
_COMMAND = "import sys; from planner.app.main import main; sys.exit(main())"


class Cost(NamedTuple):
    """What a process took: processor seconds, megabytes."""

    seconds: float
    megabytes: float


def main() -> None:
    """Make the parts, read them, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--holes", type=int, nargs="*", default=[25, 100, 400], metavar="N")
    parser.add_argument("--triangles", type=int, nargs="*", default=[20_000, 100_000], metavar="N")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the parts there")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        print("part                        CPU s      MB", flush=True)
        for n in options.holes:
            _report(write_plate(folder / f"plate_{n}.step", n))
        for n in options.triangles:
            _report(write_torus(folder / f"torus_{n}.stl", n))
            _report(write_bored_block(folder / f"bored_block_{n}.stl", n))


def _report(part: Path) -> None:
    cost = measure_info(part)
    print(f"{part.name:24} {cost.seconds:8.1f} {cost.megabytes:7.0f}", flush=True)


def measure_info(part: Path) -> Cost:
    """Return what `aspectgraph info` of a part takes."""
    process = subprocess.Popen(
        [sys.executable, "-c", _COMMAND, "info", str(part)], stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{part.name}: info ended with status {status}")
    return Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0)


def write_plate(path: Path, n_holes: int) -> Path:
    """Write a plate with a square number of holes through it, at most `n_holes`."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.OCP.collections import List_TopoDS_Shape
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    side = int(n_holes**0.5)
    blank = List_TopoDS_Shape()
    blank.Append(BRepPrimAPI_MakeBox(_PITCH_MM * side, _PITCH_MM * side, 10.0).Shape())
    drills = List_TopoDS_Shape()
    for i in range(side):
        for j in range(side):
            foot = gp_Pnt(_PITCH_MM * (i + 0.5), _PITCH_MM * (j + 0.5), -1.0)
            drill = BRepPrimAPI_MakeCylinder(gp_Ax2(foot, gp_Dir(0, 0, 1)), 5.0, 12.0)
            drills.Append(drill.Shape())
    cut = BRepAlgoAPI_Cut()
    cut.SetArguments(blank)
    cut.SetTools(drills)
    cut.Build()
    writer = STEPControl_Writer()
    writer.Transfer(cut.Shape(), STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
    return path


def write_torus(path: Path, n_triangles: int) -> Path:
    """Write a torus with bumps, all of it curved."""
    n_u = int(n_triangles**0.5)
    n_v = n_triangles // 2 // n_u
    u = np.linspace(0.0, 2.0 * np.pi, n_u, endpoint=False)[:, None]
    v = np.linspace(0.0, 2.0 * np.pi, n_v, endpoint=False)[None, :]
    radius = 20.0 + 2.0 * np.sin(5.0 * u) * np.cos(3.0 * v)
    away = 60.0 + radius * np.cos(v)
    grid = np.stack([away * np.cos(u), away * np.sin(u), radius * np.sin(v)], axis=-1)
    return _write_grid(path, grid)


def write_bored_block(path: Path, n_triangles: int) -> Path:
    """Write a square block with a round bore: flat faces cut into many facets, and a curved one."""
    n_around = max(64, int((n_triangles / 2) ** 0.5) // 8 * 8)
    n_side = max(8, n_triangles // 2 // n_around) // 4
    step = np.arange(n_side) / n_side
    # along outer wall, top, bore and bottom: 1 on the square, 0 on the circle
    share = np.concatenate([np.ones(n_side), 1.0 - step, np.zeros(n_side), step])
    height = 30.0 * np.concatenate([step, np.ones(n_side), 1.0 - step, np.zeros(n_side)])
    angle = np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    square = circle / np.abs(circle).max(axis=1, keepdims=True)
    across = (
        share[:, None] * 50.0 * square[:, None] + (1.0 - share[:, None]) * 25.0 * circle[:, None]
    )
    upwards = np.broadcast_to(height[None, :, None], (n_around, len(height), 1))
    return _write_grid(path, np.concatenate([across, upwards], axis=-1))


def _write_grid(path: Path, grid: np.ndarray) -> Path:
    """Write a surface that is closed both ways as binary STL; vertices (u, v, 3)."""
    n_u, n_v = grid.shape[:2]
    number = np.arange(n_u * n_v).reshape(n_u, n_v)
    ahead = np.roll(number, -1, axis=0)
    corners = [number, ahead, np.roll(ahead, -1, axis=1), np.roll(number, -1, axis=1)]
    a, b, c, d = (corner.ravel() for corner in corners)
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    facets = np.zeros(len(triangles), dtype=_FACET)
    facets["corners"] = grid.reshape(-1, 3)[triangles]
    path.write_bytes(bytes(80) + np.uint32(len(facets)).tobytes() + facets.tobytes())
    return path


if __name__ == "__main__":
    main()

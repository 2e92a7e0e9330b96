"""Throughput of `aspectgraph batch`: parts per hour and memory per worker, with one worker and with two.

``python benchmarks/running/batch_speed.py --parts 16``

The parts are plates with one to three square holes, different in size; all edges longer than 12 mm of each are planned.
Each number of workers begins with an empty folder; the plans must be the same. Linux only; run it on a machine that
does nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_COMMAND = "import sys; from planner.app import start; sys.exit(start())"
_REQUEST = ["--camera", "basler-acA2440-20gm-8mm", "--select", "length > 12", "--accuracy", "0.95"]
_REQUEST += [
    "--sigma-mm",
    "0.05",
    "--sigma-rad",
    "0.001",
    "--simulate",
    "1000",
    "--effort",
    "quick",
]


def main() -> None:
    """Plan and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", type=int, default=16, metavar="N")
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2], metavar="N")
    options = parser.parse_args()
    # the one value of a plan that is not from its request
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "parts"
        folder.mkdir()
        for k in range(options.parts):
            (folder / f"plate-{k:03d}.off").write_text(plate(k), encoding="utf-8")
        print("workers  parts  planned      s  parts/h  s/part of worker  MiB/worker", flush=True)
        plans = [
            _measured(folder, Path(scratch) / f"out-{jobs}", jobs, options.parts)
            for jobs in options.jobs
        ]
    if any(one != plans[0] for one in plans):
        sys.exit("the plans depend on the number of workers.")


def plate(k: int) -> str:
    """Return an OFF file of plate k: its size and its one to three square holes follow from k."""
    x = 60 + 4 * (k % 7)
    y = 40 + 3 * (k % 5)
    z = 10 + k % 4
    holes = 1 + k % 3
    squares = [(8 + 18 * i, 10 + k % 6, 12 + k % 3) for i in range(holes)]
    # a plate with holes as a ring of cells: its columns and rows are cut at the sides of the holes
    columns = sorted({0, x, *(a for left, _, size in squares for a in (left, left + size))})
    rows = sorted({0, y, *(b for _, low, size in squares for b in (low, low + size))})
    hollow = {(left, low) for left, low, _ in squares}
    n_i = len(columns) - 1
    n_j = len(rows) - 1
    full = {(i, j) for i in range(n_i) for j in range(n_j) if (columns[i], rows[j]) not in hollow}
    number: dict[tuple[int, int, int], int] = {}

    def point(i: int, j: int, top: int) -> int:
        return number.setdefault((i, j, top), len(number))

    faces = []
    for i, j in sorted(full):
        ring = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        faces.append([point(*p, 1) for p in ring])
        faces.append([point(*p, 0) for p in reversed(ring)])
        beside = [(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)]
        for side, (a, b) in enumerate(zip(ring, [*ring[1:], ring[0]], strict=True)):
            if beside[side] not in full:
                faces.append([point(*a, 0), point(*b, 0), point(*b, 1), point(*a, 1)])
    lines = [f"{columns[i]} {rows[j]} {z * top}" for i, j, top in number]
    lines += [" ".join(map(str, [4, *face])) for face in faces]
    return "\n".join(["OFF", f"{len(number)} {len(faces)} 0", *lines]) + "\n"


def _measured(folder: Path, out: Path, jobs: int, n_parts: int) -> dict[str, str]:
    """Plan with some workers, print a row and return the digests of the plans."""
    command = [
        "batch",
        str(folder),
        *_REQUEST,
        "--out",
        str(out),
        "--jobs",
        str(jobs),
        "--json",
        "--quiet",
    ]
    begun = time.perf_counter()
    most = 0.0
    process = subprocess.Popen(
        [sys.executable, "-c", _COMMAND, *command], stdout=subprocess.DEVNULL
    )
    while process.poll() is None:
        most = max([most, *map(_resident, _children(process.pid))])
        time.sleep(0.1)
    seconds = time.perf_counter() - begun
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    planned = sum(one["status"] == "planned" for one in results)
    each = sum(one["seconds"] for one in results) / n_parts
    counts = f"{jobs:>7}{n_parts:>7}{planned:>9}{seconds:>7.0f}"
    print(f"{counts}{3600 * n_parts / seconds:>9.0f}{each:>18.1f}{most / 2**20:>12.0f}", flush=True)
    return {one["part"]: one["plan_sha256"] for one in results}


def _children(pid: int) -> list[int]:
    try:
        return [
            int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        ]
    except OSError:
        return []


def _resident(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


if __name__ == "__main__":
    main()

"""How long `aspectgraph plan --time-limit` really takes, how long it is silent, and how large its report is.

    python benchmarks/running/time_limits.py --parts FOLDER            all cases at 5, 20 and 60 s
    python benchmarks/running/time_limits.py plate-400 --limits 5      one of them

Every case is planned by the command line in a process of its own, with two processes and `--verbose`. Wall time is
measured from outside, from before Python starts. A silence is the time between two lines of the program, and before
the first one. The size of a report per target leaves out plotly's script, which every report has once. Where there is
no plan at the end, the row states the exit code. FOLDER holds the NIST parts. The plates
of through holes are made here, and the diameters of their rims are planned as dimensions. Run it on two free cores.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "aspectgraph" / "helpers"))

from rimmed_solids import PITCH, PlateBuilder  # noqa: E402

from aspectgraph import Solid, read_solid  # noqa: E402
from planner import read_plan  # noqa: E402
from planner.report.page import packed_plotly  # noqa: E402

CAMERA = ["--camera", "flir-BFS-U3-200S6M-25mm"]
CASES = {
    "d2mi": ("nist_d2mi_827-9999-904.stp.gz", ["--all", *CAMERA]),
    "ctc-02": ("nist_ctc_02_ap242.stp", ["--all", *CAMERA]),
    "ctc-04": ("nist_ctc_04_ap242.stp", ["--dimensions", "all", *CAMERA]),
    "plate-100": (10, ["--units", "mm", *CAMERA]),
    "plate-400": (20, ["--units", "mm", *CAMERA]),
}
"""A part, or the number of holes in a row of a plate, and the options."""

_COMMAND = "import sys; from planner.app import start; sys.exit(start())"
_HEADER = (
    f"{'case':12}{'limit s':>8}{'wall s':>8}{'over s':>8}{'CPU s':>8}{'silence s':>10}"
    f"{'targets':>12}{'settings':>9}{'report kB':>10}{'kB/target':>10}  longest silence was before"
)


def write_plate(n: int, folder: Path) -> tuple[Path, Path]:
    """Write a plate of n x n through holes and the diameters of its 2 n x n rims; return both files."""
    builder = PlateBuilder(n, n, 6)
    for i in range(n):
        for j in range(n):
            builder.add((PITCH * i + PITCH // 2, PITCH * j + PITCH // 2), 25, 0)
    made = builder.part(f"plate of {n * n} holes")
    triangles = Solid(made.vertices, made.faces).triangles
    lines = ["OFF", f"{len(made.vertices)} {len(triangles)} 0"]
    lines += [" ".join(map(str, vertex)) for vertex in made.vertices]
    lines += [" ".join(map(str, [3, *triangle])) for triangle in triangles]
    part = folder / f"plate-{n * n}.off"
    part.write_text("\n".join(lines) + "\n", encoding="ascii")
    rims = read_solid(part, units="mm").rims()
    stated = [f'bore_{r.id} = {{ diameter = "{r.id}", tolerance = [-1.2, 1.2] }}' for r in rims]
    dimensions = folder / f"plate-{n * n}.toml"
    dimensions.write_text("\n".join(stated) + "\n", encoding="ascii")
    return part, dimensions


def measured(case: str, limit: float, folder: Path, scratch: Path) -> str:
    """Plan a case under a limit, and return a row of the table."""
    file, options = CASES[case]
    if isinstance(file, int):
        part, dimensions = write_plate(file, scratch)
        options = ["--dimensions", str(dimensions), *options]
    else:
        part = folder / file
    out = scratch / f"{case}-{limit:g}"
    arguments = ["plan", str(part), *options, "--time-limit", f"{limit:g}", "--out", str(out)]
    command = [sys.executable, "-c", _COMMAND, *arguments, "--verbose"]
    before = os.times()
    begun = time.monotonic()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    last = begun
    silence = 0.0
    after = ""
    assert process.stderr is not None
    for line in process.stderr:
        now = time.monotonic()
        if now - last > silence:
            silence = now - last
            after = line.strip()
        last = now
    code = process.wait()
    wall = time.monotonic() - begun
    if time.monotonic() - last > silence:
        silence = time.monotonic() - last
        after = "(the end)"
    times = os.times()
    cpu = times.children_user + times.children_system
    cpu -= before.children_user + before.children_system
    row = f"{case:12}{limit:>8g}{wall:>8.1f}{wall - limit:>8.1f}{cpu:>8.1f}{silence:>10.1f}"
    if not (out / "plan.json").exists():
        return f"{row}   exit code {code}, no plan  {after}"
    plan = read_plan(out / "plan.json")
    size = (out / "report.html").stat().st_size / 1000.0
    n = len(plan.targets)
    growing = size - len(packed_plotly()) / 1000.0
    counts = f"{len(plan.inspected):>5} of {n:<4}{len(plan.settings):>9}{size:>10.0f}{growing / n:>10.1f}"
    return f"{row}{counts}  {after}"


def main() -> None:
    """Print a row for each case and limit."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}")
    parser.add_argument("--parts", type=Path, default=Path(), metavar="FOLDER")
    parser.add_argument("--limits", type=float, nargs="+", default=[5.0, 20.0, 60.0], metavar="S")
    parser.add_argument("--out", type=Path, help="keep the plans in folders of this one")
    options = parser.parse_args()
    print(_HEADER, flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        place = options.out or Path(scratch)
        place.mkdir(parents=True, exist_ok=True)
        for case in options.cases or CASES:
            for limit in options.limits:
                print(measured(case, limit, options.parts, place), flush=True)


if __name__ == "__main__":
    main()

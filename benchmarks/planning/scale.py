"""Plans for all straight edges of four real parts: time, memory, settings, and what is proven.

``python benchmarks/planning/scale.py --parts FOLDER``            all four, one after the other
``python benchmarks/planning/scale.py --parts FOLDER mtc d2mi``   some of them
``... --paper``                                          under the paper's constraints, without any other

Every plan is made by the command line, ``aspectgraph plan PART --all``, as a user would: reading, regions, plan, bound,
simulation, report. FOLDER holds the files of CASES (NIST and MFCAD parts; nist_ctc_01_ap242.stp is also in examples).
Time is that of the whole process tree; memory is the most that all its processes held at once, pages that several of
them share counted once. Run it on a machine that does nothing else. The cameras are bodies and lenses of the catalogue,
set so that nearly every edge can be sharp and long enough.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from planner import Camera, InspectionPlan, read_plan

# file, catalogue camera, its settings, required accuracy
CASES = {
    "ctc": ("nist_ctc_01_ap242.stp", "basler-acA2440-20gm-8mm", {}, 0.98),
    "d2mi": (
        "nist_d2mi_827-9999-904.stp.gz",
        "flir-BFS-U3-200S6M-25mm",
        {"f_number": 11.0, "focus_distance_mm": 250.0, "largest_blur_mm": 0.0048},
        0.95,
    ),
    "mtc": (
        "nist_mtc_plate.step",
        "flir-BFS-U3-200S6M-25mm",
        {"f_number": 11.0, "focus_distance_mm": 250.0, "largest_blur_mm": 0.0048},
        0.95,
    ),
    "mfcad": (
        "mfcad_2-3-3-3-3-23.step",
        "basler-acA2440-20gm-25mm",
        {"f_number": 11.0, "focus_distance_mm": 150.0, "largest_blur_mm": 0.0069},
        0.95,
    ),
}
_PAPER = [
    "--separation-px",
    "0",
    "--surround-px",
    "0",
    "--min-corner-deg",
    "0",
    "--focus-margin-mm",
    "0",
]
_HEADER = "part     edges  settings  bound  left out  confirmed      s   CPU s   GiB"


def main() -> None:
    """Plan the parts asked for and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}")
    parser.add_argument("--parts", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--out", type=Path, help="keep the plans in folders of this one")
    parser.add_argument("--paper", action="store_true", help="the paper's constraints only")
    options = parser.parse_args()
    print(_HEADER, flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        for case in options.cases or CASES:
            file, name, settings, accuracy = CASES[case]
            folder = (options.out or Path(scratch)) / case
            folder.mkdir(parents=True, exist_ok=True)
            camera = folder / "camera.toml"
            camera.write_text(_toml(Camera.named(name, **settings)), encoding="utf-8")
            arguments = [
                "--all",
                "--camera",
                str(camera),
                "--accuracy",
                str(accuracy),
                "--out",
                str(folder),
            ]
            arguments += _PAPER if options.paper else []
            wall, cpu, peak = _run(["plan", str(options.parts / file), *arguments])
            print(_row(case, read_plan(folder / "plan.json"), wall, cpu, peak), flush=True)


def _toml(camera: Camera) -> str:
    return "".join(f"{name} = {json.dumps(value)}\n" for name, value in camera.to_dict().items())


def _run(arguments: list[str]) -> tuple[float, float, float]:
    """Run the command line; return wall time and processor time, s, and peak memory, GiB."""
    begun = time.perf_counter()
    before = os.times()
    command = [
        sys.executable,
        "-c",
        "import sys; from planner.app import start; sys.exit(start())",
        *arguments,
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    peak = [0.0]
    watch = threading.Thread(target=_watch, args=(process, peak), daemon=True)
    watch.start()
    code = process.wait()
    watch.join()
    after = os.times()
    if code not in (0, 1):
        sys.exit(f"aspectgraph {' '.join(arguments)} ended with exit code {code}.")
    cpu = (
        after.children_user + after.children_system - before.children_user - before.children_system
    )
    return time.perf_counter() - begun, cpu, peak[0]


def _watch(process: subprocess.Popen, peak: list[float]) -> None:
    while process.poll() is None:
        peak[0] = max(peak[0], _held_gib(process.pid))
        time.sleep(0.2)


def _held_gib(session: int) -> float:
    """Memory that the processes of a session hold, GiB (Linux): each one's share of the pages it has with others."""
    kib = 0
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                # after the name in brackets: state, parent, group, session
                if int((folder / "stat").read_text().rpartition(")")[2].split()[3]) == session:
                    held = (folder / "smaps_rollup").read_text()
                    kib += int(held.partition("\nPss:")[2].split()[0])
            except (OSError, IndexError):
                # it has just ended
                continue
    return kib / 2**20


def _row(case: str, plan: InspectionPlan, wall: float, cpu: float, peak: float) -> str:
    counts = f"{len(plan.entities):>6}{len(plan.settings):>10}{plan.lower_bound:>7}{len(plan.uninspectable):>10}"
    return f"{case:<8}{counts}{plan.simulation.confirmed!s:>11}{wall:>7.0f}{cpu:>8.0f}{peak:>6.2f}"


if __name__ == "__main__":
    main()

"""Plan every part of folders with all that can be asked of it, each in a process of its own, and fail on any crash.

Of every part all sharp straight edges are planned, and of STEP files all stated dimensions, too. The limits are the
defaults of the command line. A plan may be incomplete, and a part may be refused in one line; a traceback, a signal or
any other exit code is a crash. Regions are computed before the time limit of the search begins, so each process also
has a limit on the wall clock: beyond it the outcome is "not within N s", which is no crash.

Usage: python benchmarks/running/every_part.py [FOLDER ...] [--time-limit 30] [--wall 300] [--only TEXT]
       Without a folder, the environment variable ASPECTGRAPH_PARTS names them, separated as in PATH.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from aspectgraph.read.part_file import MESH_SUFFIXES
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE

STEP_SUFFIXES = (".step", ".stp")
FOLDERS = "ASPECTGRAPH_PARTS"
REQUESTS = {"edges": ["--all"], "dimensions": ["--dimensions", "all"]}
CAMERA = """\
name = "basler-acA2440-20gm-25mm-at-250mm"
focal_length_mm = 25.0
pixel_pitch_mm = [0.00345, 0.00345]
resolution = [2448, 2048]
f_number = 8.0
focus_distance_mm = 250.0
"""
PROGRAM = "import sys; from planner.app.main import main; sys.exit(main())"
ROW = "{:<38} {:<11} {:>9} {:>9} {:>5} {:>8}  {}"


@dataclass(frozen=True)
class Outcome:
    """What became of one request.

    Attributes
    ----------
    code : int or None
        Exit code; None of a process that was ended by the limit on the wall clock.
    seconds : float
        Wall clock.
    entities, inspected : int or None
        Counts of the plan; None without a plan.
    text : str
        "planned", "incomplete", "refused: …", "not within N s" or "CRASH: …".
    """

    code: int | None
    seconds: float
    entities: int | None
    inspected: int | None
    text: str

    @property
    def is_crash(self) -> bool:
        """Whether the program failed."""
        return self.text.startswith("CRASH")


def parts_in(folder: Path) -> list[Path]:
    """Return the part files of a folder, in order of their names."""
    suffixes = (*STEP_SUFFIXES, *MESH_SUFFIXES)
    return sorted(path for path in folder.iterdir() if suffix_of(path) in suffixes)


def suffix_of(path: Path) -> str:
    """Return the suffix that names the format: that before ``.gz``."""
    name = path.name.lower().removesuffix(".gz")
    return Path(name).suffix


def plan(part: Path, request: str, camera: Path, out: Path, options: argparse.Namespace) -> Outcome:
    """Plan one request in a process of its own."""
    command = [sys.executable, "-c", PROGRAM, "plan", str(part), *REQUESTS[request]]
    command += ["--camera", str(camera), "--out", str(out), "--jobs", "1", "--quiet"]
    command += ["--effort", "quick", "--time-limit", str(options.time_limit)]
    command += ["--simulate", str(options.simulate)]
    begun = time.monotonic()
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        _, errors = process.communicate(timeout=options.wall)
    except subprocess.TimeoutExpired:
        seconds = time.monotonic() - begun
        return Outcome(None, seconds, None, None, f"not within {options.wall:g} s")
    finally:
        if process.poll() is None:
            # the STEP kernel may have a process of its own
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    seconds = time.monotonic() - begun
    entities, inspected = counts_of(out / "plan.json")
    text = judged(process.returncode, errors, entities)
    return Outcome(process.returncode, seconds, entities, inspected, text)


def counts_of(path: Path) -> tuple[int | None, int | None]:
    """Return how many entities a plan is asked for, and how many it inspects."""
    if not path.exists():
        return None, None
    data = json.loads(path.read_text(encoding="utf-8"))
    n_entities = len(data["entities"])
    return n_entities, n_entities - len(data["uninspectable"])


def judged(code: int, errors: str, entities: int | None) -> str:
    """Return the outcome of a process that ended by itself."""
    lines = errors.strip().splitlines()
    last = lines[-1] if lines else ""
    if code < 0:
        return f"CRASH: {signal.Signals(-code).name}"
    if "Traceback" in errors or code not in (DONE, INCOMPLETE, BAD_INPUT):
        return f"CRASH: {last}"
    if code == BAD_INPUT or entities is None:
        return f"refused: {last}" if len(lines) == 1 else f"CRASH: {len(lines)} lines, {last}"
    return "planned" if code == DONE else "incomplete"


def main() -> int:
    """Plan all parts; return 1 if a request crashed, 2 without parts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    named = os.environ.get(FOLDERS, "")
    known = [Path(text) for text in named.split(os.pathsep) if text]
    parser.add_argument("folders", nargs="*", type=Path, default=known, metavar="FOLDER")
    parser.add_argument("--camera", type=Path, help="TOML file (default: 25 mm, f/8, at 250 mm)")
    parser.add_argument("--time-limit", type=float, default=30.0, help="of the search, s")
    parser.add_argument("--wall", type=float, default=300.0, help="of the whole process, s")
    parser.add_argument("--simulate", type=int, default=200, help="displaced poses per setting")
    parser.add_argument("--only", default="", help="parts whose name holds this text")
    parser.add_argument("--requests", nargs="+", choices=REQUESTS, default=list(REQUESTS))
    options = parser.parse_args()
    parts = [part for folder in options.folders for part in parts_in(folder)]
    parts = [part for part in parts if options.only in part.name]
    if not parts:
        print(f"there must be parts: name a folder, or set {FOLDERS}.", file=sys.stderr)
        return 2
    print(ROW.format("part", "request", "entities", "inspected", "exit", "seconds", "outcome"))
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        camera = options.camera or Path(folder) / "camera.toml"
        if options.camera is None:
            camera.write_text(CAMERA, encoding="utf-8")
        for part in parts:
            for request in options.requests:
                if request == "dimensions" and suffix_of(part) not in STEP_SUFFIXES:
                    continue
                out = Path(folder) / f"plan-{len(outcomes)}"
                outcome = plan(part, request, camera, out, options)
                outcomes.append(outcome)
                counts = (outcome.entities, outcome.inspected, outcome.code)
                cells = ["-" if count is None else str(count) for count in counts]
                seconds = f"{outcome.seconds:.1f}"
                row = ROW.format(part.name, request, *cells, seconds, outcome.text[:300])
                print(row, flush=True)
    n_crashes = sum(outcome.is_crash for outcome in outcomes)
    n_late = sum(outcome.code is None for outcome in outcomes)
    print(f"{len(outcomes)} requests, {n_crashes} crashed, {n_late} not within {options.wall:g} s")
    return 1 if n_crashes else 0


if __name__ == "__main__":
    sys.exit(main())

"""Digests of what the program decides, for changes that must not change it: run as ``make golden``.

Twelve requests are planned in one process with fixed seeds. Of each, the plan without its request, the
aspect graph, the rows of the report, the texts of robot programs and the measured values are
digested, and compared with ``golden.json``. ``make golden RECORD=1`` writes that file anew: do this
only for a change that is meant to change results, and say so in the commit.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STORED = Path(__file__).with_suffix(".json")
CTC_01 = "examples/nist_ctc_01_ap242.stp"
POCKETS = "examples/two_pocket_block.off"
FILE_CAMERA = ["--camera", "examples/camera.toml"]
NAMED_CAMERA = ["--camera", "basler-acA2440-20gm-8mm"]
PROMISE = ["--accuracy", "0.99", "--probability", "0.9"]
DRAWING = ["--share", "0.3", "--accuracy", "0.999", "--probability", "0.9"]
DRAWING += ["--sigma-mm", "0.05", "--sigma-rad", "0.001"]
POCKET_DIMENSIONS = ["--dimensions", "examples/two_pocket_block_dimensions.toml"]
LAMPS = ["--light", "box:-300,-300,200,300,300,600"]
CELL = "examples/cell.toml"
HELD_CELL = """
clearance_mm = 10.0
home_deg = [0.0, -91.67, 80.21, -80.21, -89.95, 0.0]
cam2base = { xyz = [700.0, 0.0, 800.0], rpy_deg = [180.0, 0.0, 0.0] }

[robot]
urdf = "made_parallel.urdf"
tip = "tool0"
accelerations = 1.4

[robot.packages]
made_robots = "."

[[camera_body]]
low = [-30.0, -30.0, -90.0]
high = [30.0, 30.0, 0.0]

[fixturings.grip]
part2flange = { xyz = [-100.0, -60.0, 40.0] }

[fixturings.grip.gripper.jaws]
low = [-30.0, -30.0, 0.0]
high = [30.0, 30.0, 30.0]
"""
# name: part and options of ``aspectgraph plan``; what stands twice there replaces the first
PLANS = {
    "demo_dimensions": [CTC_01, "--dimensions", "all", "--no-positions", *FILE_CAMERA, *DRAWING],
    "demo_edges": [
        CTC_01,
        "--entities",
        "examples/nist_ctc_01_corners.toml",
        *FILE_CAMERA,
        *PROMISE,
    ],
    "pocket_edge": [POCKETS, "--entities", "17", *NAMED_CAMERA, *PROMISE],
    "pocket_dimensions": [POCKETS, *POCKET_DIMENSIONS, *NAMED_CAMERA, *PROMISE],
    "pocket_registered": [
        POCKETS,
        *POCKET_DIMENSIONS,
        "--register",
        "edges",
        *NAMED_CAMERA,
        *PROMISE,
    ],
    "ctc_01_entities": [
        CTC_01,
        "--entities",
        "examples/nist_ctc_01_entities.toml",
        *FILE_CAMERA,
        *PROMISE,
    ],
    "mfcad_11": ["examples/mfcad_6-11-11-19.step", "--all", *FILE_CAMERA, *PROMISE],
    "mfcad_23": ["examples/mfcad_4-5-5-6-9-23.step", "--all", *FILE_CAMERA, *PROMISE],
    "slotted_lamps": [
        "examples/slotted_block.off",
        "--entities",
        "examples/slotted_block_entities.toml",
        *NAMED_CAMERA,
        *LAMPS,
    ],
    "pocket_cell": [POCKETS, "--entities", "9,10", *NAMED_CAMERA, "--cell", CELL],
    "pocket_held": [POCKETS, "--entities", "9,10", *NAMED_CAMERA, "--cell", "HELD_CELL"],
}
PROGRAMS = ("urscript", "rapid", "krl", "ros", "csv", "json")
# an account of how, when and by which program a file was made, and digests of files that hold one
ACCOUNT = ("request", "program", "version", "source", "made", "plan")
# what a plan says of its request in fields of its own: their layout may change, what follows from them may not
ASKED = ("part", "accuracy", "probability", "seed", "workspace", "requirements", "camera")
ASKED += ("pose_uncertainty", "entities", "dimensions", "features", "units", "minimal", "targets")
_ACCOUNT_IN_TEXT = re.compile(r"\b(?:[0-9a-f]{64}|\d{4}-\d\d-\d\d)\b")


def main() -> int:
    """Plan, measure, digest and compare; the exit code is 1 if anything differs."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    with tempfile.TemporaryDirectory() as folder:
        digests = dict(_digests(Path(folder)))
    if "--record" in sys.argv:
        STORED.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")
        print(f"{len(digests)} digests written to {STORED.name}")
        return 0
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    names = sorted({*stored, *digests})
    different = [name for name in names if stored.get(name) != digests.get(name)]
    for name in different:
        print(f"different: {name}")
    print(f"{len(names) - len(different)} of {len(names)} digests are the same")
    return int(bool(different))


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    held = ROOT / "examples" / "robots" / "golden_held_cell.toml"
    try:
        held.write_text(HELD_CELL, encoding="utf-8")
        for name, options in PLANS.items():
            out = folder / name
            arguments = [str(held) if text == "HELD_CELL" else text for text in options]
            _run("plan", *arguments, "--effort", "quick", "--jobs", "1", "--out", str(out))
            yield from _of_plan(name, out)
            if name.endswith(("_cell", "_held")):
                yield from _of_programs(name, out, arguments)
    finally:
        held.unlink(missing_ok=True)
    out = folder / "measured"
    example = "examples/measured"
    _run(
        "measure", f"{example}/plan.json", f"{example}/images", "--part", CTC_01, "--out", str(out)
    )
    yield "measured/results.json", _of_json((out / "results.json").read_text(encoding="utf-8"))
    yield "measured/results.csv", _digest(_without_account(out / "results.csv").encode())


def _of_plan(name: str, out: Path) -> Iterator[tuple[str, str]]:
    yield f"{name}/plan.json", _of_json((out / "plan.json").read_text(encoding="utf-8"), ASKED)
    yield f"{name}/measurements.csv", _digest(_all_digits(out / "plan.json").encode())
    for file in ("graph.graphml", "transforms.json"):
        path = out / file
        if path.exists():
            yield f"{name}/{file}", _digest(path.read_bytes())


def _without_account(path: Path) -> str:
    """Return a table of measured values without the columns that say of which part, when and by whom."""
    with open(path, encoding="utf-8", newline="") as table:
        heading, *rows = csv.reader(table)
    apart = ("serial", "date", "operator")
    columns = [k for k, name in enumerate(heading) if name not in apart]
    text = io.StringIO()
    csv.writer(text).writerows([row[k] for k in columns] for row in (heading, *rows))
    return text.getvalue()


def _all_digits(path: Path) -> str:
    """Return the rows of a plan with all their digits, which its CSV file does not have."""
    from aspectgraph.entities.entity_rules import csv_text
    from planner import read_plan

    rows = read_plan(path).rows()
    return csv_text(list(rows[0]), rows)


def _of_programs(name: str, out: Path, options: list[str]) -> Iterator[tuple[str, str]]:
    cell = options[options.index("--cell") + 1]
    for language in PROGRAMS:
        path = out / f"program.{language}"
        _run(
            "program",
            str(out / "plan.json"),
            options[0],
            "--cell",
            cell,
            "--format",
            language,
            "--out",
            str(path),
        )
        text = _ACCOUNT_IN_TEXT.sub("", path.read_text(encoding="utf-8"))
        yield f"{name}/program.{language}", _digest(text.encode())


def _run(command: str, *arguments: str) -> None:
    from planner.app.main import main as run

    with redirect_stdout(io.StringIO()):
        code = run([command, *arguments, "--quiet"])
    # 1 and 3: something is left out or does not conform, which is a result, too
    if code not in (0, 1, 3):
        raise SystemExit(f"aspectgraph {command} {' '.join(arguments)}: exit code {code}")


def _of_json(text: str, asked: tuple[str, ...] = ()) -> str:
    """Digest JSON without what is no decision: the request, the program, times and places."""
    apart = (*ACCOUNT, *asked)
    content = {key: value for key, value in json.loads(text).items() if key not in apart}
    return _digest(json.dumps(content, sort_keys=True).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


if __name__ == "__main__":
    sys.exit(main())

"""Settings against time: incumbents of plan_inspection beside what a user would write instead.

``python benchmarks/planning/anytime.py [--parts ctc01 ...] [--limit 300] [--csv FILE]``

The notebook comparisons shows such a file. The constraints are those that plan_inspection has by default (parts whose
name ends with "-default"), or these without separation, corners and surroundings, as in the paper.
The rivals are those of `planners`; all are given the visible regions, whose seconds are printed apart, and all run in
one process, so every clock starts when the regions are there. A rival has one point, at its end.

No rival counts what it promises, as plan_inspection does before it tells of a plan. So of its entities those are
counted, too, that have the required probability in one of its settings at least, over displaced poses of which
everything is asked: ``supported``. The share of these poses decides, without a margin for chance.

A rival is *ahead* at a time if so many of its entities are supported as of the incumbent then, or more, and it needs
fewer settings by more than one, or if there is no incumbent. Printed is for how long, and after what share of the time
of the greedy cover a plan has as many supported, has them in no more settings, and has them in as many of its settings.
Seconds are processor time, threads added up, so that other work on the machine does not count; the limit is of wall
time, of which counting takes nothing. Products of matrices get one thread, as on the command line. Memory is the
largest resident size of the process up to the end of plan_inspection; every part has a process of its own.

Rivals do not depend on plan_inspection: ``--rivals FILE`` takes their points from such a file.

Parts that are not in the examples are looked for in the folder of ``--folder`` and below it, compressed ones (gzip),
too; those not found are left out.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import os
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from cases import EXAMPLES
from planners import PLANNERS

from aspectgraph import Solid, compute_regions, read_entities, read_solid
from planner import Camera, InspectionPlan, PoseUncertainty
from planner.detectability.conditions import NOT_ASKED
from planner.inspection import plan_inspection
from planner.options import InspectionOptions
from planner.request.camera_limits import default_workspace
from planner.request.problem import Problem
from planner.search.columns import Judge
from planner.search.realise_column import joint_counts

PROBABILITY = 0.9
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.2, rotation_rad=0.002)
# for so long a rival may be ahead, s
TOLERATED_S = 2.0
# displaced poses per setting
COUNTED = 2_000
# of these poses, unlike those of plans
SEED = 20261126


@dataclass(frozen=True)
class Case:
    """A part, its entities, and the camera."""

    part: str
    camera: Callable[[], Camera]
    accuracy: float = 0.99
    entities: str = ""
    by_default: bool = False

    def options(self, **changes: Any) -> InspectionOptions:
        """Return the options of plan_inspection for it."""
        if not self.by_default:
            changes = {"showing": NOT_ASKED, **changes}
        return InspectionOptions(**changes)


def wide() -> Camera:
    """The camera of the examples."""
    return Camera.from_toml(EXAMPLES / "camera.toml")


def narrow(focus_mm: float) -> Callable[[], Camera]:
    """25 mm at f/8: little depth of field at a short distance."""
    return lambda: Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, focus_mm)


CASES = {
    "demo": Case("nist_ctc_01_ap242.stp", wide, entities="nist_ctc_01_entities.toml"),
    "ctc01": Case("nist_ctc_01_ap242.stp", wide, 0.98),
    "mfcad": Case("mfcad_2-3-3-3-3-23.step", wide, 0.98),
    "d2mi": Case("nist_d2mi_827-9999-904.stp", wide, 0.98),
    "mtc": Case("nist_mtc_plate.step", wide, 0.98),
    "mfcad-narrow": Case("mfcad_2-3-3-3-3-23.step", narrow(120.0), 0.98),
    "mtc-narrow": Case("nist_mtc_plate.step", narrow(250.0), 0.98),
    "mfcad-default": Case("mfcad_2-3-3-3-3-23.step", narrow(120.0), 0.98, by_default=True),
    "d2mi-default": Case("nist_d2mi_827-9999-904.stp", wide, 0.98, by_default=True),
}


@dataclass(frozen=True)
class Point:
    """What a planner has at a time: settings, entities inspected, those supported, proven bound (0: none).

    And what each setting inspects, where that is known.
    """

    seconds: float
    settings: int
    inspected: int
    supported: int
    bound: int = 0
    sets: tuple[tuple[str, ...], ...] = ()

    def most(self, n_settings: int) -> int:
        """Return how many entities some settings of the plan inspect, no more than so many, the most worthy first."""
        chosen: set[str] = set()
        for _ in range(min(n_settings, len(self.sets))):
            chosen |= max((set(names) - chosen for names in self.sets), key=len)
        return len(chosen)


def files_of(part: str, folder: Path) -> list[Path]:
    """Return where the file of a part is: in the examples, or in a folder or below it, perhaps compressed."""
    return [
        path
        for place in (EXAMPLES, folder)
        for name in (part, f"{part}.gz")
        for path in sorted(place.rglob(name))
    ]


def solid_of(part: str, folder: Path) -> Solid:
    """Return the solid of a part's file."""
    path = files_of(part, folder)[0]
    if path.suffix != ".gz":
        return read_solid(path)
    with tempfile.TemporaryDirectory() as place:
        plain = Path(place) / part
        plain.write_bytes(gzip.decompress(path.read_bytes()))
        return read_solid(plain)


def judge_of(case: Case, folder: Path) -> tuple[Judge, float]:
    """Return the judge of a case, and the seconds its regions took."""
    solid = solid_of(case.part, folder)
    camera = case.camera()
    if case.entities:
        wanted = read_entities(EXAMPLES / case.entities, solid)
    else:
        wanted = {f"e{edge.id}": edge.id for edge in solid.straight_edges()}
    start = time.process_time()
    space = compute_regions(solid, wanted, workspace=default_workspace(solid, camera))
    seconds = time.process_time() - start
    need = case.options().requirements(camera, UNCERTAINTY)
    return Judge(
        Problem(space, space.entity_names, camera, UNCERTAINTY, case.accuracy, PROBABILITY, need)
    ), seconds


def curve(case: Case, judge: Judge, limit_s: float | None) -> list[Point]:
    """Return the incumbents of plan_inspection."""
    space = judge.space
    incumbents: list[tuple[float, InspectionPlan]] = []
    start = time.process_time()
    plan_inspection(
        space.solid,
        {name: space.entities[name] for name in space.entity_names},
        judge.camera,
        UNCERTAINTY,
        case.options(
            space=space,
            time_limit_s=limit_s,
            on_incumbent=lambda plan: incumbents.append((time.process_time() - start, plan)),
        ),
        accuracy=judge.accuracy,
        probability=PROBABILITY,
    )
    # counted afterwards, which takes none of the limit; most settings are in many incumbents
    shown = Shown(judge)
    points = []
    for seconds, plan in incumbents:
        seen = [(setting.cam2world, setting.entities) for setting in plan.settings]
        counts = len(plan.settings), len(plan.inspected), supported(shown, seen)
        points.append(Point(seconds, *counts, plan.lower_bound, tuple(names for _, names in seen)))
    return points


def rival(judge: Judge, name: str) -> Point:
    """Return the one point of a rival."""
    start = time.process_time()
    poses, _ = PLANNERS[name](judge, 0)
    seconds = time.process_time() - start
    if not len(poses):
        return Point(seconds, 0, 0, 0)
    inspects = judge(poses).inspects
    seen = [
        (pose, names)
        for pose, own in zip(poses, inspects, strict=True)
        if (names := tuple(np.array(judge.names)[own].tolist()))
    ]
    return Point(
        seconds, len(poses), int(inspects.any(axis=0).sum()), supported(Shown(judge), seen)
    )


class Shown:
    """What poses show, counted over displaced poses, each once."""

    def __init__(self, judge: Judge) -> None:
        self.judge = judge
        self._counted: dict[tuple[bytes, tuple[str, ...]], set[str]] = {}

    def of(self, pose: np.ndarray, names: tuple[str, ...]) -> set[str]:
        """Return which of these entities a pose inspects with the required probability."""
        key = pose.tobytes(), names
        if key not in self._counted:
            counts = joint_counts(self.judge, pose, names, SEED, COUNTED)
            shares = zip(counts.names, counts.successes, strict=True)
            self._counted[key] = {name for name, n in shares if n >= PROBABILITY * counts.n}
        return self._counted[key]


def supported(shown: Shown, seen: list[tuple[np.ndarray, tuple[str, ...]]]) -> int:
    """Return how many entities have the required probability, counted from a pose that is said to inspect them."""
    return len(set().union(*(shown.of(pose, names) for pose, names in seen)))


def ahead_s(other: Point, ours: list[Point]) -> float:
    """Return for how many seconds a rival is ahead, from its end to that of ours."""
    moments = sorted({other.seconds, *(p.seconds for p in ours if p.seconds > other.seconds)})
    total = 0.0
    for begin, end in zip(moments, [*moments[1:], moments[-1]], strict=True):
        now = [p for p in ours if p.seconds <= begin]
        behind = not now or (
            other.supported >= now[-1].supported and now[-1].settings - other.settings > 1
        )
        total += (end - begin) * behind
    return total


def stored(path: Path, part: str) -> dict[str, Point]:
    """Return the rivals' points of a case from a file of an earlier run."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if row["part"] == part and row["planner"] in PLANNERS
        ]
    return {
        row["planner"]: Point(
            float(row["seconds"]), *(int(row[n]) for n in ("settings", "inspected", "supported"))
        )
        for row in rows
    }


def measure(
    name: str, folder: Path, limit_s: float | None, rivals: Path | None, without: Sequence[str]
) -> list[tuple[str, Point]]:
    """Print the table of a case; return planners and points."""
    known = stored(rivals, name) if rivals else {}
    judge, seconds = judge_of(CASES[name], folder)
    print(
        f"\n{name}: {CASES[name].part}, {len(judge.names)} entities, regions {seconds:.1f} s",
        flush=True,
    )
    print(
        f"  {'':<36}{'seconds':>9}{'settings':>10}{'inspected':>11}{'supported':>11}{'at least':>10}{'ahead':>9}"
    )
    ours = curve(CASES[name], judge, limit_s)
    rows = [("plan_inspection", point) for point in ours]
    for point in ours:
        print(_row("plan_inspection", point), flush=True)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  memory {used:.0f} MB", flush=True)
    for other in (one for one in PLANNERS if one not in without):
        point = known[other] if other in known else rival(judge, other)
        late = ahead_s(point, ours)
        print(
            _row(other, point) + f"{late:7.1f} s" + (" !" if late > TOLERATED_S else ""), flush=True
        )
        if other.startswith("greedy"):
            n = point.supported
            print(f"  as many as it is supported in, {n}: {_reached(ours, n, point)}")
        rows.append((other, point))
    return rows


def _reached(ours: list[Point], n: int, other: Point) -> str:
    """Say when so many entities of our plans are supported, and when in no more settings than another's."""
    told = []
    most = other.settings
    for what, reached in (
        ("first", lambda p: True),
        (f"in {most} settings at most", lambda p: p.settings <= most),
        (f"in some {most} settings of a plan", lambda p: p.most(most) >= n),
    ):
        point = next((p for p in ours if p.supported >= n and reached(p)), None)
        if point is None:
            told.append(f"{what} never")
        else:
            share = point.seconds / other.seconds
            told.append(
                f"{what} after {share:.2f} of its time, {point.settings} for {point.supported}"
            )
    return "; ".join(told)


def _row(name: str, point: Point) -> str:
    bound = f"{point.bound}" if point.bound else "-"
    return f"  {name:<36}{point.seconds:9.2f}{point.settings:10d}{point.inspected:11d}{point.supported:11d}{bound:>10}"


def main() -> None:
    """Print a table per part; write all points to a file if one is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument(
        "--folder", type=Path, default=Path(), help="of parts that are not examples, at any depth"
    )
    parser.add_argument("--limit", type=float, help="seconds for plan_inspection, wall time")
    parser.add_argument(
        "--rivals", type=Path, help="take the rivals from this file, of an earlier run"
    )
    parser.add_argument("--without", nargs="+", choices=list(PLANNERS), default=())
    parser.add_argument("--csv", default=os.devnull, help="write every point to this file")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with open(given.csv, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["part", "planner", "seconds", "settings", "inspected", "supported", "bound"]
        )
        for name in given.parts:
            if not files_of(CASES[name].part, given.folder):
                print(f"\n{name}: {CASES[name].part} is not there")
                continue
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as alone:
                options = given.limit, given.rivals, given.without
                rows = alone.submit(measure, name, given.folder, *options).result()
            for planner, point in rows:
                writer.writerow(
                    [name, planner, f"{point.seconds:.3f}", *astuple(point)[1:4], point.bound or ""]
                )
            file.flush()


if __name__ == "__main__":
    main()

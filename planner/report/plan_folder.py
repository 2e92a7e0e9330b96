"""What is written about a plan: all files of one plan in one folder."""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from aspectgraph import MemoryLimitError, graph_of, write_graphml
from aspectgraph import OutputError as GraphOutputError
from planner.callbacks import PICTURES_SHARE, Deadline
from planner.exceptions import OutputError
from planner.files import absolute, name_text, staged_folder
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError, report
from planner.report.overview import report_date
from planner.report.page import make_report
from planner.report.pose_files import POSE_FILES, write_poses
from planner.report.wording import graph_sentence, regions_sentence
from planner.request.reach import Seen, TargetSpace
from planner.resume import holds_plan

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph, VisibilityRegions
    from planner.progress import Progress
    from planner.request.reach import Space
    from planner.robotcell import Cell


# How the file of a part was read, as a plan keeps it: so the plan can be made again.


def with_source(
    plan: InspectionPlan, folder: Path, part: str | Path, reading: Mapping[str, Any]
) -> InspectionPlan:
    """Return a plan that says which file its part is, and how it was read.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    folder : Path
        Where it is written: the file is named relative to it, so that both can be moved.
    part : path
        The part's file.
    reading : mapping
        Options of `aspectgraph.read_solid`; those that are None are left out.
    """
    path = absolute(part)
    try:
        name = Path(os.path.relpath(path, absolute(folder))).as_posix()
    except (OSError, ValueError):
        # on another drive
        name = str(path)
    options = {key: value for key, value in reading.items() if value is not None}
    # names of files need not be Unicode
    return replace(plan, source={"file": name_text(name), **options})


# the plan first: see `staged_folder`
PLAN_FILES = ("plan.json", "report.html", "measurements.csv", "graph.graphml", *POSE_FILES)
# with more entities their joint graph is built where it can be afforded: no clock decides, so that machines agree
FEW_GRAPH_ENTITIES = 24
AFFORDABLE_BYTES = 64 * 2**20
# what `graph_of` calls its first part
JOINING = "joint graph"
_AFTER_JOINING = 3.0
# places drawn to tell how much is observable from where
_PLACES = 10_000


class Written(NamedTuple):
    """What was written about a plan.

    Attributes
    ----------
    files : list of pathlib.Path
        The most useful first.
    notes : list of str
        What was left out, and why.
    """

    files: list[Path]
    notes: list[str]


def write_outputs(
    plan: InspectionPlan,
    regions: VisibilityRegions,
    folder: Path,
    progress: Progress | None = None,
    *,
    graph_limit: int | None = None,
    deadline: Deadline | None = None,
    notes: Sequence[str] = (),
    cell: Cell | None = None,
) -> Written:
    """Write plan, report and poses, which appear in the folder together or not at all; then the joint graph.

    Files of an earlier plan do not stay. A link in the place of a file is replaced, not the file it leads to. The joint
    graph comes last because it takes the longest: with it the report is replaced by one that shows it. Beyond
    ``graph_limit`` entities it is left out; if that is None, beyond 24 if it takes much memory, and so time. What
    is not complete at the ``deadline`` is left out, pictures and the graph. ``notes`` say what else is missing.
    The report shows the arm at each setting of a plan for a ``cell``.

    Returns
    -------
    Written
        The files, and what was left out.

    Raises
    ------
    OutputError
        If they cannot be written. The folder is then as it was, or holds the whole plan without its graph.
    """
    deadline = deadline or Deadline()
    with staged_folder(folder, PLAN_FILES, "--out") as staging:
        plan.write(staging / "plan.json")
        page = make_report(
            plan,
            _space(plan, regions),
            progress,
            notes,
            date=report_date(),
            until=deadline.time_left(PICTURES_SHARE).until,
            cell=cell,
        )
        (staging / "report.html").write_text(page.html(), encoding="utf-8")
        # lines end as the format says, on every system
        (staging / "measurements.csv").write_bytes(plan.to_csv().encode())
        written = ["plan.json", "report.html", "measurements.csv"]
        poses = [str(path.relative_to(staging)) for path in write_poses(plan, staging)]
    graph, without = _joint_graph(regions, graph_limit, _ended_at(deadline.at(), progress))
    page.notes += without
    with staged_folder(folder, ("report.html", "graph.graphml"), "--out") as staging:
        if graph is not None:
            page.draw_graph(graph, progress, until=deadline.at())
            write_graphml(graph, staging / "graph.graphml")
            written.append("graph.graphml")
        (staging / "report.html").write_text(page.html(), encoding="utf-8")
    left_out = [*notes, *page.left_out, *without]
    return Written([folder / name for name in (*written, *poses)], left_out)


def _joint_graph(
    regions: VisibilityRegions, graph_limit: int | None, progress: Progress | None = None
) -> tuple[EntityAspectGraph | None, list[str]]:
    """Return the joint graph; or none, why it is left out, and what the regions say instead."""
    n = len(regions.entity_names)
    if graph_limit is not None and n > graph_limit:
        return None, _instead(regions, graph_limit)
    limit = AFFORDABLE_BYTES if graph_limit is None and n > FEW_GRAPH_ENTITIES else None
    try:
        report(progress, 0, n, JOINING)
        return graph_of(regions, memory_limit_bytes=limit, progress=progress), []
    except TimeIsUpError:
        return None, ["graph.graphml was not written: the time limit ended before it was complete."]
    except MemoryLimitError as error:
        # the plan does without it
        return None, [f"graph.graphml was not written: {error}"] if limit is None else _instead(
            regions, None
        )


def _ended_at(deadline: float, progress: Progress | None) -> Progress | None:
    """Return a progress that ends the work at a deadline."""
    if deadline == math.inf:
        return progress

    begun = time.time()

    def ended(done: int, total: int, label: str) -> None:
        report(progress, done, total, label)
        now = time.time()
        # what follows the joining cannot be ended, and takes some times as long
        joined = label == JOINING and done == total
        if now + (_AFTER_JOINING * (now - begun) if joined else 0.0) > deadline:
            raise TimeIsUpError

    return ended


def _instead(regions: VisibilityRegions, graph_limit: int | None) -> list[str]:
    """Say that the joint graph is left out, and what the regions say of it."""
    return [
        graph_sentence(len(regions.entity_names), graph_limit),
        regions_sentence(*_observable_shares(regions)),
    ]


def _observable_shares(regions: VisibilityRegions) -> tuple[dict[str, float], int]:
    """Return from which share of the workspace each entity is observable, and how many at most from one place."""
    low, high = regions.workspace
    seen = regions.observable(np.random.default_rng(0).uniform(low, high, (_PLACES, 3)))
    return dict(zip(regions.entity_names, seen.mean(axis=0).tolist(), strict=True)), int(
        seen.sum(axis=1).max()
    )


def _space(plan: InspectionPlan, regions: Space) -> Space:
    """Return where the targets of a plan are observable from, without those whose regions were late."""
    names = set(regions.entity_names)
    return TargetSpace(
        regions,
        {
            name: Seen(target.ways, plan.entities[name])
            for name, target in plan.targets.items()
            if all(names.issuperset(way) for way in target.ways)
        },
    )


def rescue(plan: InspectionPlan, state: Path) -> str:
    """See that a plan that cannot be written is not lost; return where it is, in one sentence."""
    if holds_plan(state):
        return f"The plan is saved in {state}. The same command with --resume writes it without planning again."
    return _saved_elsewhere("plan", plan.write, "plan.json")


def write_graph(graph: EntityAspectGraph, path: str, parameter: str) -> None:
    """Write a joint graph; it may have taken long, so that one that cannot be written is kept elsewhere.

    Raises
    ------
    OutputError
        If it cannot be written where it should be; says where it is instead.
    """
    try:
        write_graphml(graph, path)
    except GraphOutputError as error:
        rescue = _saved_elsewhere(
            "graph", lambda place: write_graphml(graph, place), "graph.graphml"
        )
        raise OutputError(f"{parameter} {error.rule}. Got {error.got}. {rescue}") from None


def _saved_elsewhere(noun: str, write: Callable[[Path], object], name: str) -> str:
    """Write to the system's, the current or the user's folder, whichever takes it; return a sentence with the place."""
    reason = ""
    # each is tried on its own: the current folder may be deleted, and a user may have no home
    for parent in (lambda: None, Path.cwd, Path.home):
        try:
            folder = Path(tempfile.mkdtemp(prefix="aspectgraph-", dir=parent()))
        except (OSError, RuntimeError) as error:
            reason = reason or f"Got: {error}."
            continue
        try:
            write(folder / name)
        except OSError as error:
            # one of ours is a sentence that names the file
            ours = isinstance(error, OutputError | GraphOutputError)
            reason = reason or (str(error) if ours else f"Got: {error}.")
            with suppress(OSError):
                folder.rmdir()
        else:
            return f"The {noun} is in {folder / name} instead."
    return f"The {noun} cannot be saved elsewhere either: {reason}"

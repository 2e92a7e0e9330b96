"""What is written about a plan: all files of one plan in one folder."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from aspectgraph import MemoryLimitError, graph_of, write_graphml
from planner.exceptions import OutputError
from planner.files import staged_folder
from planner.output.pose_files import POSE_FILES, write_poses
from planner.output.report import report_html
from planner.output.wording import graph_sentence
from planner.plan import InspectionPlan
from planner.request.target_space import TargetSpace
from planner.resume import holds_plan

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph, VisibilityRegions
    from planner.progress import Progress
    from planner.request.space import Space

# the plan first: see `staged_folder`
PLAN_FILES = ("plan.json", "report.html", "measurements.csv", "graph.graphml", *POSE_FILES)
# beyond this the joint graph of all entities is neither worth drawing nor worth waiting for
MOST_GRAPH_ENTITIES = 24


def write_outputs(
    found: InspectionPlan,
    regions: VisibilityRegions,
    folder: Path,
    progress: Progress | None = None,
    *,
    graph_limit: int = MOST_GRAPH_ENTITIES,
) -> list[Path]:
    """Write plan, graph, report and poses; they appear in the folder together, or not at all.

    Of an earlier plan's files none stays. Beyond ``graph_limit`` entities their joint graph is left out.

    Returns
    -------
    list of pathlib.Path
        The files, the most useful first.

    Raises
    ------
    OutputError
        If they cannot be written; the folder is as it was then.
    """
    with staged_folder(folder, PLAN_FILES, "--out") as staging:
        found.write(staging / "plan.json")
        graph, notes = _joint_graph(regions, graph_limit)
        report = report_html(found, _space(found, regions), progress=progress, notes=notes, graph=graph)
        (staging / "report.html").write_text(report, encoding="utf-8")
        # lines end as the format says, on every system
        (staging / "measurements.csv").write_bytes(found.to_csv().encode())
        written = ["plan.json", "report.html", "measurements.csv"]
        if graph is not None:
            write_graphml(graph, staging / "graph.graphml")
            written.append("graph.graphml")
        written += [str(path.relative_to(staging)) for path in write_poses(found, staging)]
    return [folder / name for name in written]


def _joint_graph(regions: VisibilityRegions, graph_limit: int) -> tuple[EntityAspectGraph | None, list[str]]:
    """Return the joint graph, or none and why it is left out."""
    notes = left_out(len(regions.entity_names), graph_limit)
    try:
        return (None, notes) if notes else (graph_of(regions), [])
    except MemoryLimitError as error:
        # a plan that is done must not be lost for its picture
        return None, [f"graph.graphml is left out: {error}"]


def _space(found: InspectionPlan, regions: Space) -> Space:
    """Return where what is planned is observable from: of a dimension, where all of its entities are."""
    if not found.dimensions:
        return regions
    dimensions = found.dimensions
    needs = {name: dimensions[name].entities if name in dimensions else (name,) for name in found.entities}
    return TargetSpace(regions, needs, found.entities)


def left_out(n: int, graph_limit: int = MOST_GRAPH_ENTITIES) -> list[str]:
    """Say what is left out of what a plan of n entities usually leaves."""
    return [graph_sentence(n, graph_limit)] if n > graph_limit else []


def rescue(found: InspectionPlan, state: Path) -> str:
    """See that a plan that cannot be written is not lost; return where it is, in one sentence."""
    if holds_plan(state):
        return f"The plan is kept in {state}: the same command with --resume writes it without planning again."
    try:
        place = Path(tempfile.mkdtemp(prefix="aspectgraph-")) / "plan.json"
        found.write(place)
    except OSError as error:
        # one of ours is a sentence that names the file
        reason = str(error) if isinstance(error, OutputError) else f"Got: {error}."
        return f"The plan cannot be kept anywhere else: {reason}"
    return f"The plan is in {place} instead."

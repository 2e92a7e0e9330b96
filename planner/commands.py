"""What the four commands do. Each takes the parsed options and returns the exit code."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from aspectgraph import (
    AspectGraphError,
    compute_regions,
    graph_of,
    read_entities,
    read_solid,
    write_edge_picture,
    write_graphml,
)
from planner import tables
from planner.camera import Camera
from planner.defaults import check_fraction, default_workspace
from planner.exceptions import OutputError, RequestError
from planner.exitcodes import DONE, INCOMPLETE
from planner.export import write_poses
from planner.files import check_folder, staged_folder
from planner.inspection import plan_inspection
from planner.plan import InspectionPlan, read_plan
from planner.pose import PoseUncertainty
from planner.progress import labelled, terminal_progress
from planner.report import report_html
from planner.verification import simulate_plan

STATE_FILE = "planning-state.json"
# beyond this the joint graph of all entities is neither worth drawing nor worth waiting for
_MOST_GRAPH_ENTITIES = 24


def info(options) -> int:
    """Show what a part consists of and which edges can be entities."""
    solid = _read_part(options)
    edges = solid.straight_edges(min_length_mm=options.min_length)
    if options.picture:
        write_edge_picture(solid, options.picture, [edge.id for edge in edges])
    tables.print_part(solid, edges)
    if options.picture:
        print(options.picture)
    return DONE


def graph(options) -> int:
    """Build the entity-based aspect graph and write it."""
    _check_file_place(options.graphml)
    solid = _read_part(options)
    entities = read_entities(options.entities, solid)
    with terminal_progress() as progress:
        regions = compute_regions(
            solid, entities, workspace=_workspace(options), progress=labelled(progress, "visible regions")
        )
        result = graph_of(regions)
    write_graphml(result, options.graphml)
    tables.print_graph(result)
    print(options.graphml)
    return DONE


def plan(options) -> int:
    """Plan an inspection and write everything about it."""
    folder = check_folder(options.out)
    check_fraction("accuracy", options.accuracy)
    check_fraction("probability", options.probability)
    for name, least in (("seed", 0), ("simulate", 1), ("jobs", 1)):
        if getattr(options, name) < least:
            raise RequestError(f"--{name} must be at least {least}. Got {getattr(options, name)}.")
    camera = read_camera(options.camera)
    uncertainty = PoseUncertainty.isotropic(translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad)
    solid = _read_part(options)
    entities = read_entities(options.entities, solid)
    state = folder / STATE_FILE
    if not options.resume:
        state.unlink(missing_ok=True)
    box = _workspace(options)
    with terminal_progress() as progress, _executor(options.jobs) as executor:
        regions = compute_regions(
            solid,
            entities,
            workspace=default_workspace(solid, camera) if box is None else box,
            executor=executor,
            progress=labelled(progress, "visible regions"),
        )
        found = plan_inspection(
            solid,
            entities,
            camera,
            uncertainty,
            accuracy=options.accuracy,
            probability=options.probability,
            rng=options.seed,
            stand_off_mm=options.stand_off,
            space=regions,
            state=state,
            executor=executor,
            progress=progress,
        )
        found = found.simulated(options.simulate, rng=options.seed, progress=progress)
        written = write_outputs(found, regions, folder, progress)
    state.unlink(missing_ok=True)
    tables.print_plan(found)
    for path in written:
        print(os.path.relpath(path) if path.is_relative_to(Path.cwd()) else path)
    return DONE if found.complete and found.simulation.confirmed else INCOMPLETE


def simulate(options) -> int:
    """Check a plan by simulation."""
    if options.poses < 1 or options.seed < 0:
        raise RequestError(f"--poses must be at least 1 and --seed at least 0. Got {options.poses} and {options.seed}.")
    found = read_plan(options.plan)
    with terminal_progress() as progress:
        result = simulate_plan(found, options.poses, rng=options.seed, progress=progress)
    tables.print_simulation(found, result)
    return DONE if found.complete and result.confirmed else INCOMPLETE


def read_camera(text: str) -> Camera:
    """Return the camera of a TOML file, or the one with that name in the catalogue."""
    path = Path(text)
    return Camera.from_toml(path) if path.suffix.lower() == ".toml" or path.is_file() else Camera.named(text)


def write_outputs(found: InspectionPlan, regions, folder: Path, progress=None) -> list[Path]:
    """Write plan, graph, report and poses; they appear in the folder together, or not at all.

    Returns
    -------
    list of pathlib.Path
        The files, the most useful first.
    """
    with staged_folder(folder) as staging:
        found.write(staging / "plan.json")
        (staging / "report.html").write_text(report_html(found, regions, progress=progress), encoding="utf-8")
        written = ["plan.json", "report.html"]
        if len(regions.entity_names) <= _MOST_GRAPH_ENTITIES:
            write_graphml(graph_of(regions), staging / "graph.graphml")
            written.append("graph.graphml")
        written += [str(path.relative_to(staging)) for path in write_poses(found, staging)]
    return [folder / name for name in written]


def _read_part(options):
    """Read the part; an error names the file."""
    try:
        return read_solid(options.part, units=options.units, solids=options.solids, gap_mm=options.gap_mm)
    except AspectGraphError as error:
        if str(options.part) in str(error):
            raise
        raise type(error)(f"{options.part}: {error}") from None


def _workspace(options) -> np.ndarray | None:
    return None if options.workspace is None else np.reshape(options.workspace, (2, 3))


@contextmanager
def _executor(jobs: int):
    """Provide a process pool, or none for one process."""
    with ProcessPoolExecutor(jobs) if jobs > 1 else nullcontext() as executor:
        yield executor


def _check_file_place(path) -> None:
    """Refuse a file that could not be written, before the work and not after it."""
    parent = Path(path).absolute().parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise OutputError(f"{path} must be in a folder that exists and can be written. Got {parent}.")

"""What the commands do. Each takes the parsed options and returns the exit code."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph import (
    AspectGraphError,
    JointForecast,
    ReadError,
    compute_light,
    compute_regions,
    estimate_graph,
    graph_of,
    light_graph_of,
    read_dimensions,
    select_entities,
    write_edge_picture,
)
from aspectgraph.read.part_file import MESH_SUFFIXES
from planner.batch.folder_of_parts import plan_folder
from planner.batch.part_request import PartRequest, limits_of
from planner.batch.part_result import PLANNED, TABLES, is_table
from planner.batch.scheduler import dask_executor
from planner.callbacks import LEAST_SIMULATION_S, SEARCH_SHARE, SIMULATION_SHARE, Deadline
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.best_so_far import BestSoFar
from planner.cli.folder_owner import STATE_FILE, Leftovers, check_owner
from planner.cli.job import (
    Job,
    check_nothing_read,
    check_same_part,
    inspection_options,
    read_job,
    read_part,
    workspace_of,
)
from planner.cli.light import with_light
from planner.cli.optics_ranking import rank_optics
from planner.cli.parsing.camera_option import read_camera
from planner.cli.process.exit_codes import DONE, INCOMPLETE
from planner.cli.robot.arm_table import print_arm
from planner.cli.wanted import Wanted, chosen_entities, localisation_text, read_limits, read_request
from planner.effort.effort import Effort
from planner.exceptions import OutputError
from planner.executors import leave_signals_to_the_parent, usable_cores
from planner.files import absolute, check_set_place, output_folder, path_text
from planner.inspection import space_of, visible_regions
from planner.output import terminal_tables
from planner.output.folder_lock import folder_lock
from planner.output.json_records import graph_record, part_record, plan_record
from planner.output.part_source import with_source
from planner.output.plan_folder import PLAN_FILES, Written, rescue, write_graph, write_outputs
from planner.plan import InspectionPlan, read_plan
from planner.progress import Progress, labelled, note, reading_shown, terminal_progress
from planner.progress.terminal_text import visible
from planner.progress.text_table import print_text, words
from planner.records.json_file import print_json
from planner.report.wording import cost_sentence
from planner.request.defaults import default_workspace
from planner.verify.in_time import simulate_in_time
from planner.verify.simulate_plan import simulate_plan

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph, Solid, VisibilityRegions


def info(options: argparse.Namespace) -> int:
    """Show what a part consists of and which edges, rims and arcs can be entities."""
    solid = read_part(options)
    with reading_shown(quiet=options.quiet, lines=options.verbose):
        edges = solid.straight_edges(min_length_mm=options.min_length)
        curves = (*solid.rims(), *solid.arcs())
    if options.select is not None:
        chosen = set(select_entities(solid, options.select))
        edges = tuple(edge for edge in edges if edge.id in chosen)
        curves = tuple(curve for curve in curves if curve.id in chosen)
    if options.picture:
        _write_picture(
            solid, options.picture, [edge.id for edge in edges], [curve.id for curve in curves]
        )
    if options.json:
        print_json(
            part_record(
                solid, edges, curves, filter(None, [_unit_note(options.part, options.units)])
            )
        )
        return DONE
    terminal_tables.print_part(solid, edges, curves)
    _print_unit(options.part, options.units)
    if options.picture:
        print(visible(str(options.picture)))
    return DONE


def _write_picture(solid: Solid, path: str, edge_ids: list[int], curve_ids: list[str]) -> None:
    """Write the picture of `info`; an error names the option."""
    try:
        write_edge_picture(solid, path, edge_ids, curve_ids)
    except AspectGraphError as error:
        if error.parameter != "path":
            raise
        raise type(error).of_rule("picture", error.rule, error.got) from None


def graph(options: argparse.Namespace) -> int:
    """Build the entity-based aspect graph and write it."""
    solid = read_part(options)
    entities = chosen_entities(options, solid)
    box = workspace_of(options)
    if box is None and options.camera is not None:
        box = default_workspace(solid, read_camera(options.camera))
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        result = _graph(options, solid, entities, box, progress)
    write_graph(result, options.graphml, "--graphml")
    if options.json:
        print_json(graph_record(result, options.graphml))
        return DONE
    terminal_tables.print_graph(result)
    _print_unit(options.part, options.units)
    print(visible(str(options.graphml)))
    return DONE


def _graph(
    options: argparse.Namespace, solid: Solid, entities: Any, box: Any, progress: Any
) -> EntityAspectGraph:
    """Return the graph of viewpoints, or of lamp positions."""
    shown = labelled(progress, "visible regions")
    limit = options.memory_limit
    if options.lamps:
        lit = compute_light(solid, entities, options.contrast, box, progress=shown)
        note(progress, cost_sentence(estimate_graph(lit), len(entities)))
        return light_graph_of(lit, memory_limit_bytes=limit, progress=progress)
    regions = compute_regions(
        solid, entities, workspace=box, progress=shown, kept=JointForecast(limit)
    )
    note(progress, cost_sentence(estimate_graph(regions), len(entities)))
    return graph_of(regions, memory_limit_bytes=limit, progress=progress)


def dimensions(options: argparse.Namespace) -> int:
    """Show the dimensions an AP242 file states, and the entities that measure them."""
    solid = read_part(options)
    with reading_shown(quiet=options.quiet, lines=options.verbose):
        stated = read_dimensions(options.part, solid, limits=read_limits(options))
    if not stated:
        raise ReadError(
            f"the part must be a STEP file with semantic dimensions (AP242). Got {options.part}, which states none."
        )
    if options.json:
        print_json([one.to_dict() for one in stated])
    else:
        terminal_tables.print_dimensions(stated)
    return DONE


def plan(options: argparse.Namespace) -> int:
    """Plan an inspection and write everything about it."""
    names = (*PLAN_FILES, STATE_FILE)
    with (
        output_folder(options.out, names, "--out") as folder,
        folder_lock(folder, "--out"),
        (leftovers := Leftovers(folder)).told(),
    ):
        job = read_job(options)
        lighting = job.request.lighting
        if lighting is not None:
            lighting.check_part(job.solid)
        is_default = "--out" not in options.typed
        check_owner(folder, job.request, force=options.force, is_default=is_default)
        leftovers.prepare(
            job.request, resume=options.resume, force=options.force, quiet=options.quiet
        )
        with leftovers.forgotten_if_refused():
            result, written, interrupted = _planned(options, job, leftovers)
        _print_planned(options, result, job, written, leftovers)
        if interrupted:
            raise KeyboardInterrupt
    lit = result.light is None or result.light.complete
    confirmed = result.simulation is not None and result.simulation.confirmed
    return DONE if result.complete and confirmed and lit else INCOMPLETE


def _print_planned(
    options: argparse.Namespace,
    result: InspectionPlan,
    job: Job,
    written: Written,
    leftovers: Leftovers,
) -> None:
    """Print a plan, and the files it is in."""
    files = [path_text(path) for path in written.files]
    if options.json:
        print_json(plan_record(result, files, job.wanted.left_out))
        return
    terminal_tables.print_plan(result)
    if result.cell:
        print_arm(result)
    _print_unit(job.part, job.reading.get("units"))
    _print_left_out(job.wanted)
    if text := localisation_text(options, job.wanted.items):
        print_text(text)
    if result.unfinished and leftovers:
        print("The same command with --resume continues from here.")
    for text in written.notes:
        print_text(text)
    report = next(path for path in files if path.endswith("report.html"))
    terminal_tables.print_written(files, path_text(leftovers.folder), report)


def _print_left_out(wanted: Wanted) -> None:
    """Print what the model states and nothing can measure, with the reasons."""
    for name, reason in wanted.left_out.items():
        print_text(words(f"{name} is not planned: {reason}", [name]))


def _planned(
    options: argparse.Namespace, job: Job, leftovers: Leftovers
) -> tuple[InspectionPlan, Written, bool]:
    """Plan and write; return plan, files, and whether it was interrupted. The state is deleted only after the end."""
    solid = job.solid
    with (
        terminal_progress(quiet=options.quiet, lines=options.verbose) as progress,
        _executor(options.jobs) as executor,
    ):
        best = BestSoFar(progress)
        deadline = Deadline(options.time_limit, begun=options.begun)
        with deadline.stated_whole():
            result, regions = _searched(job, leftovers, best, deadline, executor, progress)
        simulation, notes = simulate_in_time(
            result,
            options.simulate,
            job.request.seed,
            progress,
            solid,
            deadline.time_left(SIMULATION_SHARE, LEAST_SIMULATION_S),
        )
        result = replace(result, simulation=simulation)
        result = with_light(result, solid, job.request.lighting, progress)
        result = with_source(result, leftovers.folder, job.part, job.reading)
        try:
            folder = Path(path_text(leftovers.folder))
            written = write_outputs(
                result,
                regions,
                folder,
                progress,
                graph_limit=options.graph_limit,
                deadline=deadline,
                notes=notes,
                cell=job.cell,
            )
        except OutputError as error:
            raise OutputError(f"{error} {rescue(result, leftovers.state)}") from None
    if not result.unfinished:
        leftovers.remove()
    return result, written, best.interrupted


def _searched(
    job: Job,
    leftovers: Leftovers,
    best: BestSoFar,
    deadline: Deadline,
    executor: Executor | None,
    progress: Progress | None,
) -> tuple[InspectionPlan, VisibilityRegions]:
    """Return the plan, or the best so far if the search is interrupted, and the regions it rests on."""
    request = job.request
    regions = visible_regions(
        job.solid,
        job.wanted.entities,
        request,
        executor=executor,
        progress=progress,
        kept=leftovers.regions,
        deadline=deadline.of_regions(),
    )
    try:
        found = job.plan(
            time_limit_s=deadline.seconds_left(SEARCH_SHARE),
            on_incumbent=best,
            space=space_of(request, regions),
            state=leftovers.state,
            executor=executor,
            progress=progress,
        )
    except KeyboardInterrupt:
        found = best.instead()
    return found, regions


def batch(options: argparse.Namespace) -> int:
    """Plan every part of a folder."""
    uncertainty = PoseUncertainty.isotropic(
        translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad
    )
    effort = Effort.named(options.effort or "standard")
    request = PartRequest(
        read_camera(options.camera),
        uncertainty,
        accuracy=options.accuracy,
        probability=options.probability,
        seed=options.seed,
        select=options.select,
        units=options.units,
        simulate=options.simulate,
        graph_limit=options.graph_limit,
        effort=effort if options.give_up is None else effort.giving_up(options.give_up),
        limits=limits_of(inspection_options(options, time_limit_s=options.time_limit)),
    )
    if not options.force:
        check_set_place(Path(options.out), TABLES, is_table)
    out = absolute(options.out)
    workers = nullcontext() if options.scheduler is None else dask_executor(options.scheduler)
    try:
        with (
            workers as executor,
            terminal_progress(quiet=options.quiet, lines=options.verbose) as progress,
        ):
            jobs = min(options.jobs, usable_cores())
            results = plan_folder(
                options.folder,
                options.out,
                request,
                jobs=jobs,
                executor=executor,
                progress=progress,
                replace=options.force,
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command continues with the remaining parts") from None
    if options.json:
        print_json([asdict(part_result) for part_result in results])
    else:
        terminal_tables.print_batch(results)
        files = [path_text(out / name) for name in TABLES]
        terminal_tables.print_written(files, path_text(out), files[-1])
    return DONE if all(part_result.status == PLANNED for part_result in results) else INCOMPLETE


def simulate(options: argparse.Namespace) -> int:
    """Check a plan by simulation."""
    if options.part is None:
        check_nothing_read(options)
    loaded = read_plan(options.plan)
    solid = None if options.part is None else read_part(options)
    if solid is not None:
        check_same_part(solid, loaded, options.part)
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        result = simulate_plan(
            loaded, options.poses, rng=options.seed, progress=progress, solid=solid
        )
    if options.json:
        print_json(result.to_dict())
    else:
        terminal_tables.print_simulation(loaded, result)
    return DONE if loaded.complete and result.confirmed else INCOMPLETE


def optics(options: argparse.Namespace) -> int:
    """Rank bodies and lenses of the catalogue by how well they measure what is wanted."""
    solid = read_part(options)
    wanted = read_request(options, solid)
    given = inspection_options(
        options, workspace=workspace_of(options), localisation=wanted.localisation
    )
    code = rank_optics(options, solid, wanted.items, given)
    if not options.json:
        _print_unit(options.part, options.units)
        _print_left_out(wanted)
        if text := localisation_text(options, wanted.items):
            print_text(text)
    return code


def _print_unit(part: str, units: str | None) -> None:
    if told := _unit_note(part, units):
        print_text(f"note: {told}")


def _unit_note(part: str, units: str | None) -> str:
    """Say which unit was assumed for a file that has none; nothing of others."""
    mesh = [suffix for suffix in Path(part).suffixes if suffix.lower() in MESH_SUFFIXES]
    if units is None and mesh and mesh[-1].lower() != ".glb":
        return f"{mesh[-1][1:].upper()} files state no unit, so the program assumes mm. Use --units for another unit"
    return ""


@contextmanager
def _executor(jobs: int) -> Iterator[Executor | None]:
    """Provide a process pool, or none for one process; work not begun is dropped at the end."""
    # more processes than cores cost memory and gain nothing, and no result depends on their number
    jobs = min(jobs, usable_cores())
    if jobs == 1:
        yield None
        return
    executor = ProcessPoolExecutor(
        jobs, initializer=leave_signals_to_the_parent, initargs=(os.getpid(),)
    )
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)

"""What the commands do. Each takes the parsed options and returns the exit code."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph import (
    AspectGraphError,
    JointForecast,
    LightRegions,
    ReadError,
    SolidChoice,
    compute_light,
    compute_regions,
    estimate_graph,
    graph_of,
    light_graph_of,
    read_dimensions,
    read_solid,
    select_entities,
    write_edge_picture,
)
from aspectgraph.read.part_file import MESH_SUFFIXES
from planner.batch.part_request import PartRequest
from planner.batch.part_result import PLANNED, TABLES
from planner.batch.plan_folder import plan_folder
from planner.batch.scheduler import dask_executor
from planner.camera.camera import Camera
from planner.camera.catalogue import camera_names
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.best_so_far import BestSoFar
from planner.cli.catalogue import cameras as cameras
from planner.cli.catalogue import rank_optics
from planner.cli.completion import completion_script
from planner.cli.folder_owner import asked_request, check_owner
from planner.cli.leftovers import STATE_FILE, Leftovers
from planner.cli.light import read_lighting, with_light
from planner.cli.process.exit_codes import DONE, INCOMPLETE
from planner.cli.wanted import chosen_entities, read_request
from planner.exceptions import OutputError
from planner.executors import leave_signals_to_the_parent, usable_cores
from planner.files import check_file_place, output_folder
from planner.inspection import plan_inspection
from planner.inspection_options import InspectionOptions
from planner.light.lamps import RING
from planner.light.ring_space import RingSpace
from planner.output import terminal_tables
from planner.output.json_records import graph_record, part_record, plan_record, print_json
from planner.output.plan_folder import PLAN_FILES, Written, rescue, write_graph, write_outputs
from planner.output.wording import cost_sentence
from planner.plan import InspectionPlan, read_plan
from planner.progress import labelled, note, terminal_progress
from planner.request.defaults import check_fraction, default_workspace
from planner.request.effort import Effort
from planner.showing.showing import Showing
from planner.verify.simulate_plan import simulate_plan

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph, Solid, VisibilityRegions


def info(options: argparse.Namespace) -> int:
    """Show what a part consists of and which edges, rims and arcs can be entities."""
    if options.picture:
        check_file_place(options.picture, "--picture")
    solid = _read_part(options)
    edges = solid.straight_edges(min_length_mm=options.min_length)
    curves = (*solid.rims(), *solid.arcs())
    if options.select is not None:
        chosen = set(select_entities(solid, options.select))
        edges = tuple(edge for edge in edges if edge.id in chosen)
        curves = tuple(curve for curve in curves if curve.id in chosen)
    if options.picture:
        write_edge_picture(
            solid, options.picture, [edge.id for edge in edges], [curve.id for curve in curves]
        )
    if options.json:
        print_json(part_record(solid, edges, curves, filter(None, [_unit_note(options)])))
        return DONE
    terminal_tables.print_part(solid, edges, curves)
    _print_unit(options)
    if options.picture:
        print(options.picture)
    return DONE


def graph(options: argparse.Namespace) -> int:
    """Build the entity-based aspect graph and write it."""
    check_file_place(options.graphml, "--graphml")
    solid = _read_part(options)
    entities, box = chosen_entities(options, solid), _workspace(options)
    if box is None and options.camera is not None:
        box = default_workspace(solid, read_camera(options.camera))
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        result = _graph(options, solid, entities, box, progress)
    write_graph(result, options.graphml, "--graphml")
    if options.json:
        print_json(graph_record(result, options.graphml))
        return DONE
    terminal_tables.print_graph(result)
    _print_unit(options)
    print(options.graphml)
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
    found = read_dimensions(options.part, _read_part(options))
    if not found:
        raise ReadError(
            f"the part must be a STEP file with semantic dimensions (AP242). Got {options.part}, which states none."
        )
    if options.json:
        print_json([one.to_dict() for one in found])
    else:
        terminal_tables.print_dimensions(found)
    return DONE


def plan(options: argparse.Namespace) -> int:
    """Plan an inspection and write everything about it."""
    check_fraction("accuracy", options.accuracy)
    check_fraction("probability", options.probability)
    names = (*PLAN_FILES, STATE_FILE)
    with (
        output_folder(options.out, names, "--out") as folder,
        (leftovers := Leftovers(folder)).told(),
    ):
        camera = read_camera(options.camera)
        uncertainty = PoseUncertainty.isotropic(
            translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad
        )
        solid = _read_part(options)
        wanted, lighting = read_request(options, solid), read_lighting(options)
        if lighting is not None:
            lighting.check_part(solid)
        how = _limits(options, solid, camera)
        asked = asked_request(options, solid.name, wanted.items, camera, uncertainty, how)
        check_owner(folder, asked, force=options.force)
        found, written, interrupted = _planned(
            options, solid, wanted, camera, uncertainty, leftovers
        )
        _print_planned(options, found, wanted, written, leftovers.state)
        if interrupted:
            raise KeyboardInterrupt
    lit = found.light is None or found.light.complete
    return DONE if found.complete and found.simulation.confirmed and lit else INCOMPLETE


def _print_planned(
    options: argparse.Namespace, found: InspectionPlan, wanted: Any, written: Written, state: Path
) -> None:
    """Print a plan, and the files it is in."""
    files = [
        os.path.relpath(path) if path.is_relative_to(Path.cwd()) else str(path)
        for path in written.files
    ]
    if options.json:
        print_json(plan_record(found, files, wanted.left_out))
        return
    terminal_tables.print_plan(found)
    _print_unit(options)
    for name, reason in wanted.left_out.items():
        print(f"{name} is not planned: {reason}")
    if found.unfinished and state.exists():
        print("The same command with --resume goes on from here.")
    print("\n".join([*written.notes, *files]))


def _planned(
    options: argparse.Namespace,
    solid: Solid,
    wanted: Any,
    camera: Camera,
    uncertainty: PoseUncertainty,
    leftovers: Leftovers,
) -> tuple[Any, ...]:
    """Plan and write; return plan, files, and whether it was interrupted. The state is deleted only after the end."""
    state, how, lighting = leftovers.state, _limits(options, solid, camera), read_lighting(options)
    leftovers.prepare(resume=options.resume, quiet=options.quiet)
    with (
        terminal_progress(quiet=options.quiet, lines=options.verbose) as progress,
        _executor(options.jobs) as executor,
    ):
        best = BestSoFar(progress)
        regions = _regions(
            options, solid, wanted.entities, how.workspace, (executor, progress, leftovers)
        )
        try:
            found = plan_inspection(
                solid,
                wanted.items,
                camera,
                uncertainty,
                accuracy=options.accuracy,
                probability=options.probability,
                rng=options.seed,
                **_limit_keywords(options),
                **_ends(options, best),
                lamps=lighting,
                space=RingSpace(regions, camera, options.grey_step)
                if isinstance(regions, LightRegions)
                else regions,
                localisation=wanted.localisation,
                state=state,
                executor=executor,
                progress=progress,
            )
        except KeyboardInterrupt:
            found = best.instead()
        found = found.simulated(options.simulate, rng=options.seed, progress=progress, solid=solid)
        found = with_light(found, solid, lighting, progress)
        try:
            written = write_outputs(
                found, regions, Path(options.out), progress, graph_limit=options.graph_limit
            )
        except OutputError as error:
            raise OutputError(f"{error} {rescue(found, state)}") from None
    if not found.unfinished:
        leftovers.remove()
    return found, written, best.interrupted


def _regions(
    options: argparse.Namespace,
    solid: Solid,
    entities: Any,
    box: Any,
    how: tuple[Any, Any, Leftovers],
) -> VisibilityRegions:
    """Return from where a camera observes entities; with a ring light on it, from where they show besides."""
    executor, progress, leftovers = how
    shown = labelled(progress, "visible regions")
    if options.light == RING:
        return compute_light(solid, entities, options.contrast, box, executor, shown)
    return compute_regions(
        solid, entities, workspace=box, executor=executor, progress=shown, kept=leftovers.regions
    )


def _ends(options: argparse.Namespace, best: BestSoFar) -> dict[str, Any]:
    """Return what may end a planning, as `plan_inspection` takes it."""
    limit = options.time_limit
    return {
        # the first plan is waited for, however little is left
        "time_limit_s": None if limit is None else max(limit - best.seconds, 1e-3),
        "gap": options.gap,
        **({} if options.effort is None else {"effort": Effort.named(options.effort)}),
        "on_incumbent": best,
    }


def _limit_keywords(options: argparse.Namespace) -> dict[str, Any]:
    """Return the limits as `plan_inspection` takes them."""
    return {
        "stand_off_mm": options.stand_off,
        "min_length_px": options.min_length_px,
        "field_margin_px": options.field_margin_px,
        "focus_margin_mm": options.focus_margin_mm,
        "visibility_radius_mm": options.visibility_radius_mm,
        "showing": Showing(options.separation_px, options.surround_px, options.min_corner_deg),
    }


def _limits(options: argparse.Namespace, solid: Solid, camera: Camera) -> InspectionOptions:
    """Return workspace and limits of a request."""
    box = _workspace(options)
    return InspectionOptions(
        workspace=default_workspace(solid, camera) if box is None else box,
        **_limit_keywords(options),
    )


def batch(options: argparse.Namespace) -> int:
    """Plan every part of a folder."""
    uncertainty = PoseUncertainty.isotropic(
        translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad
    )
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
        effort=Effort.named(options.effort or "standard"),
        limits={**_limit_keywords(options), "time_limit_s": options.time_limit, "gap": options.gap},
    )
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
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            "the same command goes on with the parts that are not done"
        ) from None
    if options.json:
        print_json([asdict(one) for one in results])
    else:
        terminal_tables.print_batch(results)
        print("\n".join(os.path.relpath(Path(options.out) / name) for name in TABLES))
    return DONE if all(one.status == PLANNED for one in results) else INCOMPLETE


def simulate(options: argparse.Namespace) -> int:
    """Check a plan by simulation."""
    found = read_plan(options.plan)
    solid = None if options.part is None else _read_part(options)
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        result = simulate_plan(
            found, options.poses, rng=options.seed, progress=progress, solid=solid
        )
    if options.json:
        print_json(result.to_dict())
    else:
        terminal_tables.print_simulation(found, result)
    return DONE if found.complete and result.confirmed else INCOMPLETE


def optics(options: argparse.Namespace) -> int:
    """Rank bodies and lenses of the catalogue by how well they measure what is wanted."""
    solid = _read_part(options)
    wanted = read_request(options, solid)
    given = {
        "workspace": _workspace(options),
        "localisation": wanted.localisation,
        **_limit_keywords(options),
    }
    code = rank_optics(options, solid, wanted.items, InspectionOptions(**given))
    if not options.json:
        _print_unit(options)
    return code


def completion(options: argparse.Namespace) -> int:
    """Print the script for a shell."""
    print(completion_script(options.parser, camera_names(), options.shell), end="")
    return DONE


def read_camera(text: str) -> Camera:
    """Return the camera of a TOML file, or the one with that name in the catalogue."""
    path = Path(text)
    return (
        Camera.from_toml(path)
        if path.suffix.lower() == ".toml" or path.is_file()
        else Camera.named(text)
    )


def _read_part(options: argparse.Namespace) -> Solid:
    """Read the part; an error names the file."""
    try:
        solids = (
            SolidChoice(options.solids, options.occluders) if options.occluders else options.solids
        )
        return read_solid(options.part, units=options.units, solids=solids, gap_mm=options.gap_mm)
    except AspectGraphError as error:
        if str(options.part) in str(error):
            raise
        raise type(error)(f"{options.part}: {error}") from None


def _print_unit(options: argparse.Namespace) -> None:
    if told := _unit_note(options):
        print(f"note: {told}")


def _unit_note(options: argparse.Namespace) -> str:
    """Say which unit was assumed for a file that has none; nothing of others."""
    mesh = [suffix for suffix in Path(options.part).suffixes if suffix.lower() in MESH_SUFFIXES]
    if options.units is None and mesh and mesh[-1].lower() != ".glb":
        return f"{mesh[-1][1:].upper()} files state no unit: mm is assumed; --units says otherwise"
    return ""


def _workspace(options: argparse.Namespace) -> np.ndarray | None:
    return None if options.workspace is None else np.reshape(options.workspace, (2, 3))


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

"""What the commands do. Each takes the parsed options and returns the exit code."""

from __future__ import annotations

import math
import os
import sys
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph import (
    EntityError,
    JointForecast,
    ReadError,
    compute_light,
    compute_regions,
    estimate_graph,
    graph_of,
    light_graph_of,
    read_requirements,
)
from aspectgraph.read.step.text import UNIT_NOTE
from aspectgraph.visibility.visibility_regions import KeptRegions
from planner.app.batch import (
    PLAN_FILE,
    PLANNED,
    REGIONS_FOLDER,
    STATE_FILE,
    TABLES,
    FolderWork,
    PartRequest,
    dask_executor,
    limits_of,
    no_table,
    plan_folder,
    worker_processes,
)
from planner.app.checks import option, read_camera
from planner.app.job import (
    Job,
    JobTargets,
    all_of_model,
    check_of_model,
    check_same_part,
    choice_of,
    chosen_entities,
    inspection_options,
    localisation_text,
    read_cell,
    read_given,
    read_job,
    read_localisation,
    read_request,
    wanted_light,
    workspace_of,
)
from planner.app.model_dimensions import DimensionFolder, ModelDimensions
from planner.app.options import Batch, Dimensions, Graph, Optics, Plan, Predict, Simulate
from planner.app.part import (
    check_nothing_read,
    print_reading,
    read_limits,
    read_part,
    shown_reading,
)
from planner.app.process import DONE, INCOMPLETE
from planner.callbacks import Deadline
from planner.camera.pose import PoseUncertainty
from planner.effort import Effort
from planner.exceptions import InfeasibleError, OutputError, PlanFileError, RequestError
from planner.executors import usable_cores
from planner.files import (
    absolute,
    check_set_place,
    name_text,
    output_folder,
    path_text,
    print_json,
)
from planner.identity import Request, first_difference
from planner.optics import (
    DISTANCES_MM,
    OPTICS_COLUMNS,
    OpticsProposal,
    optics_rows,
    predict_poses,
    propose_optics,
)
from planner.options import InspectionOptions
from planner.plan import InspectionPlan, read_plan
from planner.progress import (
    WATCHED_S,
    Progress,
    labelled,
    note,
    report,
    terminal_progress,
    visible,
)
from planner.report import terminal_tables
from planner.report.plan_folder import (
    PLAN_FILES,
    Written,
    folder_lock,
    rescue,
    write_graph,
)
from planner.report.tables import clearance_sentence
from planner.report.terminal_tables import (
    graph_record,
    plan_record,
)
from planner.report.wording import cost_sentence, incumbent_line, names_by_reason
from planner.request.camera_limits import default_workspace
from planner.request.dimension import Dimension
from planner.request.words import features_text, n_not_planned
from planner.resume import read_state, state_difference
from planner.robotcell.arm import unchecked_text
from planner.robotcell.camera_body import unchecked_of
from planner.robotcell.hand import has_camera_body
from planner.text_table import Column, enumerated, print_table, print_text, words
from planner.verify.simulate_plan import simulate_plan

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from aspectgraph import EntityAspectGraph, Solid


# The best plan so far: a line in the log for each, and something to write when the work is
# interrupted.


class BestSoFar:
    """Takes in the incumbents of a planning.

    Parameters
    ----------
    progress : callable or None
        Shows a line for each.

    Attributes
    ----------
    plan : InspectionPlan or None
        The latest.
    interrupted : bool
        Whether the planning was.
    """

    def __init__(self, progress: Progress | None):
        self.plan: InspectionPlan | None = None
        self.interrupted = False
        self._progress = progress
        self._start = time.monotonic()

    def __call__(self, plan: InspectionPlan) -> None:
        """Take in one that is better."""
        previous = self.plan
        self.plan = plan
        # the last one may be the same with surer poses
        if previous is None or _line(previous) != _line(plan):
            note(self._progress, incumbent_line(plan, self.seconds))

    @property
    def seconds(self) -> float:
        """Since this began."""
        return time.monotonic() - self._start

    def instead(self) -> InspectionPlan:
        """Return the plan to write when the planning is interrupted.

        Raises
        ------
        KeyboardInterrupt
            If there is none yet.
        """
        if self.plan is None:
            raise KeyboardInterrupt
        self.interrupted = True
        note(self._progress, "interrupted: the best plan so far is written")
        return self.plan


def _line(plan: InspectionPlan) -> str:
    return incumbent_line(plan, 0.0)


# An output folder belongs to one request: its plan, and what an interrupted planning of it left,
# stay with it.
#
# Nothing is deleted in silence: a plan or unfinished work of another request is replaced with
# ``--force`` only, and unfinished work of the same request is continued with ``--resume``, or
# discarded with ``--force``.


# numbers computed on another machine may differ in their last digits
_SAME = 1e-9
_RULE = "--out must be a folder without another plan; --force replaces it."
_DEFAULT_RULE = "--out must be given where ./{name} holds other files."
_UNFINISHED = "--out must be a folder without an unfinished plan."


def check_owner(folder: Path, request: Request, *, force: bool, is_default: bool = False) -> None:
    """Refuse a folder that holds the plan of another request, or files that a plan would replace.

    Parameters
    ----------
    folder : pathlib.Path
        The output folder.
    request : Request
        What is asked now.
    force : bool
        Replace whatever is there.
    is_default : bool
        Nobody named the folder. Then it must not hold anything but a plan.

    Raises
    ------
    OutputError
        If there is a plan, and it is of another request or cannot be read; names the first difference.
        Or if there is no plan, but a file with the name of one of its files.
    """
    path = folder / PLAN_FILE
    if force:
        return
    if not path.exists():
        _check_files(folder, is_default=is_default)
        return
    try:
        stored = read_plan(path).request
    except PlanFileError as error:
        raise OutputError(f"{_RULE} Got {error}") from None
    change = request.difference(stored, option, _SAME)
    if change is not None:
        raise OutputError(f"{_RULE} Got {path} of another request: {change}.")


def _check_files(folder: Path, *, is_default: bool) -> None:
    """Refuse a folder without a plan that holds files of somebody else."""
    for name in PLAN_FILES:
        if (folder / name).exists():
            raise OutputError(f"{_RULE} Got {folder / name} without its plan.json.")
    if not is_default or not folder.is_dir():
        return
    state_names = (STATE_FILE, REGIONS_FOLDER)
    others = sorted(
        path.name
        for path in folder.iterdir()
        if path.name not in state_names and not path.name.startswith(".")
    )
    if others:
        rule = _DEFAULT_RULE.format(name=folder.name)
        raise OutputError(f"{rule} Got {folder / others[0]} in it; write --out {folder.name}.")


class Leftovers:
    """State and visible regions of an interrupted planning.

    Parameters
    ----------
    folder : pathlib.Path
        The output folder.

    Attributes
    ----------
    state : pathlib.Path
        File of the state.
    regions : KeptRegions
        Visible regions; they are computed before there is a state.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.state = folder / STATE_FILE
        self.regions = KeptRegions(folder / REGIONS_FOLDER)

    def __bool__(self) -> bool:
        """Whether there is anything to go on from."""
        return self.state.exists() or bool(self.regions)

    def prepare(self, request: Request, *, resume: bool, force: bool, quiet: bool) -> None:
        """Refuse what is not to be resumed, or cannot be, before any work; discard it if that is asked for.

        Raises
        ------
        PlanFileError
            If the state is to be resumed and is damaged, or of another request.
        OutputError
            If there is unfinished work that is neither to be resumed nor to be discarded, or it cannot be deleted.
        """
        identity = request.identity()
        if self.regions.folder.is_symlink():
            raise OutputError(
                f"--out must be a folder in which {REGIONS_FOLDER} is no link. "
                f"Got {self.regions.folder}, a link to {os.readlink(self.regions.folder)}."
            )
        if not self:
            if resume and not quiet:
                print(
                    f"nothing to resume in {self.folder}: planning starts from the beginning",
                    file=sys.stderr,
                )
        elif resume:
            change = self._change(identity)
            if change is not None:
                raise PlanFileError(
                    f"--resume must be of the same request. Got {self._place} of another one: {change}; "
                    "--force without --resume discards it."
                )
        elif force:
            self._discard()
        else:
            raise OutputError(f"{_UNFINISHED} Got {self._unfinished(identity)}.")
        self.regions = KeptRegions(self.regions.folder, identity)

    @property
    def _place(self) -> Path:
        return self.state if self.state.exists() else self.regions.folder

    def _unfinished(self, identity: dict[str, Any]) -> str:
        """Say what is there, and what can be done about it."""
        try:
            change = self._change(identity)
        except PlanFileError as error:
            return f"{str(error).rstrip('.')}; --force discards it"
        if change is not None:
            return (
                f"{self._place} of another request: {change}; that request with --resume continues it, "
                "--force discards it"
            )
        return f"{self._place} of this request: --resume continues it, --force starts again"

    def _change(self, identity: dict[str, Any]) -> str | None:
        """Return in what the request of what is there differs; None if it does not, or nothing says so."""
        if self.state.exists():
            return state_difference(read_state(self.state), identity, option)
        owner = self.regions.owner()
        if owner is None:
            return None
        return first_difference(identity, owner, option)

    def _discard(self) -> None:
        self.regions.remove()
        try:
            self.state.unlink(missing_ok=True)
        except OSError as error:
            reason = f"{self.state} cannot be deleted: {error.strerror}"
            raise OutputError(
                f"--out must be a folder that can be written. Got {reason}."
            ) from None

    @contextmanager
    def with_advice(self) -> Iterator[None]:
        """Tell how to go on when the work is interrupted, if there is something to go on from then."""
        try:
            with warnings.catch_warnings():
                # if it matters in the end, that is told then
                warnings.filterwarnings("ignore", "state is no longer saved", RuntimeWarning)
                yield
        except KeyboardInterrupt:
            if self:
                raise KeyboardInterrupt("'plan' with --resume continues from here") from None
            raise

    @contextmanager
    def forgotten_if_refused(self) -> Iterator[None]:
        """Delete regions if the request turns out to be one that cannot be planned: nobody can go on from them."""
        try:
            yield
        except (EntityError, InfeasibleError, RequestError) as error:
            # with more time the request can be planned
            if error.parameter != "time_limit_s" and not self.state.exists():
                self.regions.remove()
            raise


# Ranking the parts of the catalogue: which bodies and lenses suit a request.


def rank_optics(
    options: Optics, solid: Solid, items: Mapping[str, Any], limits: InspectionOptions
) -> int:
    """Print bodies and lenses, ranked by how well they measure what is wanted; return the exit code."""
    proposals = propose_optics(
        solid,
        items,
        PoseUncertainty.isotropic(translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad),
        bodies=options.body,
        accuracy=options.accuracy,
        probability=options.probability,
        distances_mm=options.distances or DISTANCES_MM,
        options=limits,
    )
    counts = [item.n_features for item in items.values() if isinstance(item, Dimension)]
    features = {"n": sum(counts), "not_planned": n_not_planned(counts)}
    if options.json:
        records = [proposal.to_dict() for proposal in proposals[: options.rows]]
        print_json([{**record, "features": features} if counts else record for record in records])
    else:
        print_table(OPTICS_COLUMNS, optics_rows(proposals, options.rows))
        if features_text(counts):
            text = f"{features_text(counts)}; optics are ranked by one feature of each dimension"
            print_text(text)
    if options.write is not None:
        _write_best(proposals, options.write, quiet=options.json)
    return DONE if proposals and len(proposals[0].able) == len(items) else INCOMPLETE


def _write_best(proposals: Sequence[OpticsProposal], path: str, *, quiet: bool) -> None:
    """Write the camera of the first row, unless it measures nothing."""
    if not proposals or not proposals[0].able:
        text = (
            f"{path} was not written: no camera measures any target with the required probability"
        )
    else:
        proposals[0].camera.write(path)
        text = f"wrote {proposals[0].camera.name} to {path}; give it to plan as --camera {path}"
    if not quiet:
        print_text(words(text, [path]))


# Where the robot stands in each setting, as a table for the terminal.


def print_arm(plan: InspectionPlan) -> None:
    """Print the fixturing and the joints of each setting of a plan for a robot cell."""
    columns = (
        Column("setting", right=True),
        Column("part lies"),
        Column("joints (degrees)"),
        Column("clearance (mm)", right=True),
        Column("to limit", right=True),
    )
    rows = [
        (
            str(number),
            setting.fixturing,
            _turned(setting.angle_deg)
            + " ".join(f"{angle + 0.0:.1f}" for angle in np.round(np.degrees(setting.joints), 1)),
            f"{setting.arm['clearance_robot_mm']:.1f}",
            f"{np.degrees(setting.arm['to_limit_rad']):.0f}°",
        )
        for number, setting in enumerate(plan.settings, start=1)
        if setting.fixturing
    ]
    if not rows:
        return
    print()
    print_table(columns, rows)
    names = list(dict.fromkeys(setting.fixturing for setting in plan.settings if setting.fixturing))
    print_text(f"{plan.cell['robot']} reaches all settings, with the part lying {listed(names)}.")
    print_text(clearance_sentence(plan))
    links = unchecked_text(plan.cell.get("bodiless_links", ()))
    has_body = has_camera_body(plan.cell.get("parts", {}))
    for text in unchecked_of(links, has_camera_body=has_body):
        print_text(f"warning: {text}")


def _turned(angle_deg: float | None) -> str:
    return "" if angle_deg is None else f"table {angle_deg:g}°: "


def listed(names: list[str]) -> str:
    """Return names in quotes, the last behind an and."""
    return enumerated([repr(name) for name in names])


def graph(options: Graph) -> int:
    """Build the entity-based aspect graph and write it."""
    solid = read_part(options.part, options)
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
    print_reading(options.part, options.units, solid)
    print(visible(str(options.graphml)))
    return DONE


def _graph(
    options: Graph, solid: Solid, entities: Any, box: Any, progress: Any
) -> EntityAspectGraph:
    """Return the graph of viewpoints, or of lamp positions."""
    labels = labelled(progress, "visible regions")
    limit = options.memory_limit
    if options.lamps:
        lit = compute_light(solid, entities, options.contrast, box, progress=labels)
        note(progress, cost_sentence(estimate_graph(lit), len(entities)))
        return light_graph_of(lit, memory_limit_bytes=limit, progress=progress)
    regions = compute_regions(
        solid, entities, workspace=box, progress=labels, kept=JointForecast(limit)
    )
    note(progress, cost_sentence(estimate_graph(regions), len(entities)))
    return graph_of(regions, memory_limit_bytes=limit, progress=progress)


def dimensions(options: Dimensions) -> int:
    """Show the dimensions and tolerances an AP242 file states, and the entities that measure them."""
    solid = read_part(options.part, options)
    with shown_reading(options):
        stated = read_requirements(options.part, solid, limits=read_limits(options))
    if not stated:
        raise ReadError(
            f"the part must be a STEP file with semantic dimensions (AP242). Got {options.part}, which states none. "
            "Pick them in a page and save the file for plan: 'aspectgraph info PART --picture edges.html'."
        )
    if options.json:
        print_json([requirement.to_dict() for requirement in stated])
    else:
        for text in solid.notes:
            if text.startswith(UNIT_NOTE):
                print_text(f"note: {text}")
        terminal_tables.print_requirements(stated)
    return DONE


def plan(options: Plan) -> int:
    """Plan an inspection and write everything about it."""
    names = (*PLAN_FILES, STATE_FILE)
    with (
        output_folder(options.out, names, "--out") as folder,
        folder_lock(folder, "--out"),
        (leftovers := Leftovers(folder)).with_advice(),
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
        by_limit = options.time_limit is not None and not interrupted
        _print_planned(options, result, job, written, leftovers, ended_by_limit=by_limit)
        if interrupted:
            raise KeyboardInterrupt
    if result.simulation is None:
        confirmed = options.simulate == 0
    else:
        confirmed = result.simulation.confirmed
    return DONE if result.complete and confirmed else INCOMPLETE


def _print_planned(
    options: Plan,
    result: InspectionPlan,
    job: Job,
    written: Written,
    leftovers: Leftovers,
    *,
    ended_by_limit: bool,
) -> None:
    """Print a plan, and the files it is in."""
    files = [path_text(path) for path in written.files]
    if options.json:
        print_json(plan_record(result, files, job.targets.left_out))
        return
    terminal_tables.print_plan(result)
    if result.cell:
        print_arm(result)
    print_reading(job.part, job.reading.get("units"), job.solid)
    _print_left_out(job.targets)
    if options.explain:
        terminal_tables.print_details(result)
        terminal_tables.print_explanation(result)
        if text := localisation_text(options, job.targets.items):
            print_text(text)
    elif result.settings:
        print("--explain prints the proof, what P and P_all mean, and what is assumed.")
    if result.unfinished and ended_by_limit:
        print_text(
            f"The time limit of {options.time_limit:g} s ended the planning; a larger --time-limit may give more."
        )
    if result.unfinished and leftovers:
        print("The same command with --resume continues from here.")
    for text in written.notes:
        print_text(text)
    report = next(path for path in files if path.endswith("report.html"))
    terminal_tables.print_written(files, path_text(leftovers.folder), report)


def _print_left_out(targets: JobTargets) -> None:
    """Print what the model states and nothing can measure, with the reasons."""
    for reason, names in names_by_reason(targets.left_out).items():
        verb = "is" if len(names) == 1 else "are"
        print_text(words(f"{', '.join(names)} {verb} not planned: {reason}", names))


class _CommandWork(FolderWork):
    def search(self, options: InspectionOptions) -> InspectionPlan:
        """Return the plan, or the best so far if the search is interrupted."""
        try:
            return super().search(options)
        except KeyboardInterrupt:
            if not isinstance(options.on_incumbent, BestSoFar):
                raise
            return options.on_incumbent.instead()

    def unwritten(self, plan: InspectionPlan, error: OutputError) -> OutputError:
        """Return an error that says where the plan is instead."""
        return OutputError(f"{error} {rescue(plan, self.state)}")


def _earlier_plan(folder: Path) -> InspectionPlan | None:
    """Return the plan in a folder; None if there is none that can be read."""
    try:
        return read_plan(folder)
    except PlanFileError:
        return None


def _planned(options: Plan, job: Job, leftovers: Leftovers) -> tuple[InspectionPlan, Written, bool]:
    """Plan and write; return plan, files, and whether it was interrupted."""
    limited = options.time_limit is not None
    until = math.inf if options.time_limit is None else options.begun + options.time_limit
    with (
        terminal_progress(
            quiet=options.quiet,
            lines=options.verbose,
            waiting=limited,
            most_silent_s=WATCHED_S if limited else None,
            until=until,
        ) as progress,
        _executor(options.jobs) as executor,
    ):
        report(progress, 0, len(job.resolved.entities), "visible regions")
        best = BestSoFar(progress)
        run = replace(job.options, on_incumbent=best, executor=executor, progress=progress)
        work = _CommandWork(
            job.solid,
            job.resolved,
            run,
            Deadline(options.time_limit, begun=options.begun),
            Path(path_text(leftovers.folder)),
            leftovers.state,
            leftovers.regions,
            job.part,
            job.reading,
            options.simulate,
            options.graph_limit,
            job.cell,
            name_text(options.operator or ""),
            job.targets.left_out,
            _earlier_plan(leftovers.folder) if options.resume else None,
        )
        return *work.done(), best.interrupted


def _request_of_parts(options: Batch) -> PartRequest:
    """Return what is asked for every part of a folder."""
    uncertainty = PoseUncertainty.isotropic(
        translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad
    )
    check_of_model(options)
    choice: ModelDimensions | DimensionFolder | None = None
    effort = Effort.named(options.effort or "standard")
    localisation = None
    if options.localisation is not None:
        localisation = read_localisation(options.localisation)
    if options.dimensions is not None:
        choice = _choice_of_parts(options, options.dimensions)
        localisation = localisation or read_localisation("gaussian")
        if options.effort is None:
            effort = Effort.for_dimensions()
    elif "--surfaces-mm" in options.typed:
        raise RequestError("--surfaces-mm must be given with --dimensions. Got none.")
    limits = inspection_options(
        options,
        time_limit_s=options.time_limit,
        localisation=localisation,
        lamps=wanted_light(options),
    )
    return PartRequest(
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
        limits=limits_of(limits),
        dimensions=choice,
        solids=options.solids,
    )


def _choice_of_parts(options: Batch, dimensions: str) -> ModelDimensions | DimensionFolder:
    """Return the dimensions of all parts: those of the models, or of a folder of files."""
    if all_of_model(options):
        return choice_of(options)
    if not Path(dimensions).is_dir():
        rule = "must be all or a folder with a file of dimensions for each part"
        raise RequestError.of_rule("dimensions", rule, repr(dimensions))
    return DimensionFolder(str(absolute(dimensions)), options.share)


def batch(options: Batch) -> int:
    """Plan every part of a folder."""
    request = _request_of_parts(options)
    if not options.force:
        check_set_place(Path(options.out), TABLES, no_table)
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


def simulate(options: Simulate) -> int:
    """Check a plan by simulation."""
    if options.part is None:
        check_nothing_read(options)
    loaded = read_plan(options.plan)
    solid = None if options.part is None else read_part(options.part, options)
    if solid is not None:
        check_same_part(solid, loaded, str(options.part))
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        result = simulate_plan(
            loaded, options.poses, rng=options.seed, progress=progress, solid=solid
        )
    if options.json:
        print_json(result.to_dict())
    else:
        terminal_tables.print_simulation(loaded, result, explain=options.explain)
    return DONE if loaded.complete and result.confirmed else INCOMPLETE


def optics(options: Optics) -> int:
    """Rank bodies and lenses of the catalogue by how well they measure what is wanted."""
    solid = read_part(options.part, options)
    targets = read_request(options, solid)
    plan_options = inspection_options(
        options, workspace=workspace_of(options), localisation=targets.localisation
    )
    code = rank_optics(options, solid, targets.items, plan_options)
    if not options.json:
        print_reading(options.part, options.units, solid)
        _print_left_out(targets)
        if text := localisation_text(options, targets.items):
            print_text(text)
    return code


def predict(options: Predict) -> int:
    """Print what each of some poses measures, and what none of them does."""
    camera = read_camera(options.camera)
    pose_file = read_given(options, read_cell(options.cell))
    assert pose_file is not None
    solid = read_part(options.part, options)
    targets = read_request(options, solid)
    box = workspace_of(options)
    predict_options = inspection_options(
        options,
        localisation=targets.localisation,
        workspace=default_workspace(solid, camera) if box is None else box,
        cell=None,
        poses=None,
    )
    uncertainty = PoseUncertainty.isotropic(
        translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad
    )
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        predicted = predict_poses(
            solid,
            targets.items,
            pose_file.poses,
            camera,
            uncertainty,
            accuracy=options.accuracy,
            options=replace(predict_options, progress=progress),
        )
    if options.json:
        print_json(
            terminal_tables.prediction_record(
                predicted, pose_file.source, pose_file.frame, targets.left_out
            )
        )
    else:
        terminal_tables.print_prediction(predicted, pose_file.source, pose_file.frame)
        if pose_file.light:
            print_text(
                f"note: the light of that plan ({pose_file.light}) is not considered: targets that it does not "
                "show count as inspected here. plan --poses with --light considers it"
            )
        print_reading(options.part, options.units, solid)
        _print_left_out(targets)
        if text := localisation_text(options, targets.items):
            print_text(text)
    return INCOMPLETE if predicted.missed else DONE


def _executor(jobs: int) -> AbstractContextManager[Executor | None]:
    """Return a process pool, or none for one process."""
    # more processes than cores cost memory and gain nothing, and no result depends on their number
    jobs = min(jobs, usable_cores())
    return nullcontext() if jobs == 1 else worker_processes(jobs)

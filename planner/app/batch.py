"""Every part of a folder planned; what was done before is found again."""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from aspectgraph import (
    AspectGraphError,
    read_entities,
    read_solid,
    resolve_entities,
    select_entities,
)
from aspectgraph.entities.entity_rules import check_selection, csv_text
from aspectgraph.exceptions import MissingExtraError, ReadError, how_to_install
from aspectgraph.files import listed_solids
from aspectgraph.read.mesh import check_units
from aspectgraph.read.part_file import MESH_SUFFIXES, STEP_SUFFIXES
from aspectgraph.visibility.visibility_regions import KeptRegions
from errors.exceptions import MeasurementModelError
from ga.exceptions import GAError
from ground.convert import STATED, Meta, from_plain, to_plain
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from ground.short_repr import count, short_repr
from planner.app.model_dimensions import DimensionFolder, ModelDimensions, stated_dimensions
from planner.argument_kinds import (
    MAPPING,
    NOT_NEGATIVE,
    check_accuracy,
    check_count,
    check_fraction,
    check_kinds,
    check_number,
    check_path,
    suggests_names,
)
from planner.callbacks import (
    FORESEEN_SHARE,
    LAMPS_SHARE,
    LEAST_SIMULATION_S,
    LIT_SEARCH_SHARE,
    PAGE_S,
    SEARCH_SHARE,
    SIMULATION_SHARE,
    Deadline,
)
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.effort import Effort
from planner.exceptions import OutputError, PlanFileError, PlannerError, RequestError
from planner.executors import leave_signals_to_the_parent
from planner.files import (
    absolute,
    check_set_place,
    file_digest,
    name_text,
    output_folder,
    read_json,
    write_text,
)
from planner.identity import Made, Request, digest_of
from planner.inspection import plan_request, space_of, visible_regions, with_light
from planner.measuring.foreseen import foreseen_in_time
from planner.options import InspectionOptions
from planner.plan import InspectionPlan
from planner.plan_file import Amount, Count
from planner.progress import Progress, report
from planner.report.plan_folder import PLAN_FILES, Written, folder_lock, with_source, write_outputs
from planner.report.wording import stopped_note
from planner.request.camera_limits import MOST_SEED
from planner.request.constraints import limit_names
from planner.resolve_request import ResolvedRequest, request_of_any_part, resolve_request
from planner.sensor_setting import ReasonKind, kind_of
from planner.verify.simulate_plan import simulate_in_time

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid
    from planner.robotcell import Cell

# What is asked for every part of a folder.


_LENGTHS = tuple(field.name for field in fields(InspectionOptions) if field.name in limit_names())
_LIMITS = (
    *_LENGTHS,
    *("showing", "time_limit_s", "gap", "localisation", "surfaces_mm", "edge_break_mm"),
    *("registration", "split", "lamps"),
)
# least and most of what is counted
_COUNTS = {"seed": (0, MOST_SEED), "simulate": (0, 10**9), "graph_limit": (0, 10**9)}


@dataclass(frozen=True)
class PartRequest:
    """The options for planning every part of a folder.

    `plan_inspection` describes most of them in full.

    Parameters
    ----------
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of its real pose about the planned one.
    accuracy, probability : float
        Required accuracy, and required probability of reaching it, in (0, 1).
    seed : int
        The same seed gives the same plans.
    select : str, optional
        Rule for the entities, as `aspectgraph.select_entities` takes it. Default: all sharp
        straight edges. The plans measure the diameter of rims and the radius of arcs.
    units : str, optional
        Unit of the coordinates of mesh files.
    simulate : int
        Number of displaced poses per setting that check each plan. 0: no simulation.
    graph_limit : int
        Write the joint graph for at most this many entities.
    effort : Effort
        How long to search.
    limits : mapping
        ``stand_off_mm``, ``min_length_px``, ``field_margin_px``, ``visibility_radius_mm``,
        ``focus_margin_mm``, ``showing``, ``localisation``, ``surfaces_mm``, ``edge_break_mm``, ``registration``,
        ``split``, ``lamps``, ``time_limit_s`` and ``gap`` as `plan_inspection` takes them. The time limit applies to
        each part.
    dimensions : ModelDimensions or DimensionFolder, optional
        Plan the dimensions that each part (AP242) states, or those of a file for each part,
        instead of its edges. Take ``Effort.for_dimensions()`` with it. A part that states none is
        refused.
    solids : int, str or sequence of these, optional
        Solids of STEP files to measure, by number or name, as `aspectgraph.read_solid` takes them. Default:
        all. A part without them is refused.

    Raises
    ------
    RequestError
        If an option breaks its rule.
    EntityError, ReadError
        If the rule for the entities is not valid, or the unit is not known.

    Examples
    --------
    >>> from planner import Camera, PartRequest, PoseUncertainty
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> request = PartRequest(camera, uncertainty, select="length > 20", limits={"stand_off_mm": 80.0})
    >>> request.options.stand_off_mm
    80.0
    """

    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float = 0.98
    probability: float = 0.9
    seed: int = 0
    select: str | None = None
    units: str | None = None
    simulate: int = 10_000
    graph_limit: int = 0
    effort: Effort = field(default_factory=Effort)
    limits: Mapping[str, Any] = field(default_factory=dict)
    dimensions: ModelDimensions | DimensionFolder | None = None
    solids: Any = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        check_kinds(
            camera=(self.camera, "Camera"),
            pose_uncertainty=(self.pose_uncertainty, "PoseUncertainty"),
            effort=(self.effort, "Effort"),
            limits=(self.limits, MAPPING),
        )
        check_accuracy(self.accuracy)
        check_fraction("probability", self.probability)
        for name, (low, high) in _COUNTS.items():
            check_count(name, getattr(self, name), low, high)
        if self.select is not None:
            check_kinds(select=(self.select, "str"))
            check_selection(self.select)
        if self.dimensions is not None:
            if not isinstance(self.dimensions, DimensionFolder):
                check_kinds(dimensions=(self.dimensions, "ModelDimensions"))
            if self.select is not None:
                rule = "must not be given with dimensions"
                raise RequestError.of_rule("select", rule, repr(self.select))
        if self.units is not None:
            check_kinds(units=(self.units, "str"))
            check_units(self.units)
        if self.solids is not None:
            object.__setattr__(self, "solids", _checked_solids(self.solids))
        for name, value in self.limits.items():
            if name not in _LIMITS:
                hint = ""
                if near := get_close_matches(str(name), _LIMITS, n=1):
                    hint = f"the nearest is {near[0]}"
                rule = f"must be of {', '.join(_LIMITS)}"
                raise RequestError.of_rule("limits", rule, repr(name), hint=hint)
            if name in _LENGTHS and value is not None:
                check_number(name, value, NOT_NEGATIVE)
        # what would be refused with every part is refused before the first one
        Deadline(self.options.time_limit_s, self.options.gap)
        request_of_any_part(self.camera, self.pose_uncertainty, self.options)

    @property
    def options(self) -> InspectionOptions:
        """The limits and the effort, as `plan_inspection` takes them."""
        limits = {name: value for name, value in self.limits.items() if value is not None}
        return InspectionOptions(
            **limits,
            effort=self.effort,
            accuracy=self.accuracy,
            probability=self.probability,
            rng=self.seed,
        )

    @cached_property
    def request(self) -> Request:
        """The request that applies to every part, without part, targets and workspace."""
        return request_of_any_part(self.camera, self.pose_uncertainty, self.options)

    def fingerprint_of(self, part: str) -> str:
        """Return the digest of the request for one part: with that of its file of dimensions, if it has one.

        Parameters
        ----------
        part : str
            The part's file, relative to the folder of parts.

        Returns
        -------
        str
            Equal to `fingerprint` without a folder of such files.
        """
        if not isinstance(self.dimensions, DimensionFolder):
            return self.fingerprint
        path = self.dimensions.file_of(part)
        return digest_of(self.fingerprint, "" if path is None else file_digest(path))

    @property
    def fingerprint(self) -> str:
        """Digest of the request and the program. Equal digests mean equal plans of a file.

        All fields count, also those that an `Request` lacks.
        """
        names = {field.name for field in fields(Request)}
        own = [field.name for field in fields(self) if field.name not in names]
        settings = {name: getattr(self, name) for name in own}
        if self.solids is None:
            # digests of results from before there was a choice
            del settings["solids"]
        # in the request as they are resolved: a default that is given is a default
        settings["limits"] = {"time_limit_s": self.options.time_limit_s}
        if self.dimensions is not None:
            settings["dimensions"] = asdict(self.dimensions)
            # what its files hold counts, not where they are
            settings["dimensions"].pop("folder", None)
        return digest_of(self.request.fingerprint(), settings)


def _checked_solids(solids: Any) -> list[int | str]:
    """Return numbers or names of solids as a list, or raise `RequestError`."""
    try:
        chosen = listed_solids("solids", solids)
    except ReadError as error:
        raise RequestError.of_rule("solids", error.rule, error.got) from error
    if not chosen:
        raise RequestError.of_rule("solids", "must hold at least one item", "none")
    return list(chosen)


def limits_of(options: InspectionOptions) -> dict[str, Any]:
    """Return the options that `PartRequest` takes as limits."""
    return {name: getattr(options, name) for name in _LIMITS}


# What came of a part: a record beside its plan, and the table of all parts.


RECORD = "result.json"
PLAN_FILE = "plan.json"
TABLES = ("results.json", "results.csv")
PLANNED = "planned"
INCOMPLETE = "incomplete"
REFUSED = "refused"
FAILED = "failed"


@dataclass(frozen=True)
class PartResult:
    """The result of planning one part of a folder.

    Attributes
    ----------
    part : str
        Its file, relative to the folder of parts.
    status : {"planned", "incomplete", "refused", "failed"}
        "incomplete": some entity cannot be inspected, no lamp shows it, or the simulation contradicts the plan.
        "refused": the part or the request breaks a rule, and would break it again. "failed":
        another error occurred, and the next call tries again.
    reason : str
        Why there is no plan, what it lacks, or that it was stopped early. Otherwise empty.
    entities, settings, lower_bound : int
        Numbers of the plan, 0 without one.
    seconds : float
        Time of the planning, in seconds.
    file_sha256, request, plan_sha256 : str
        Digests of the part file, the request and ``plan.json``. They decide whether the result is
        still valid.
    left_out : int
        Number of requirements that the part states and the plan leaves out, such as geometric tolerances.
    left_out_reasons : str
        Their names, each with its reason. Otherwise empty.
    inspected, targets : int
        How many targets the plan inspects, and of how many.
    """

    part: str
    status: Annotated[
        str,
        Meta(
            pattern="^(planned|incomplete|refused|failed)$",
            title="must be planned, incomplete, refused or failed",
        ),
    ]
    reason: Annotated[str, STATED] = ""
    entities: Annotated[Count, STATED] = 0
    settings: Annotated[Count, STATED] = 0
    lower_bound: Annotated[Count, STATED] = 0
    seconds: Annotated[Amount, STATED] = 0.0
    file_sha256: Annotated[str, STATED] = ""
    request: Annotated[str, STATED] = ""
    plan_sha256: Annotated[str, STATED] = ""
    left_out: Annotated[Count, STATED] = 0
    left_out_reasons: Annotated[str, STATED] = ""
    inspected: Annotated[Count, STATED] = 0
    targets: Annotated[Count, STATED] = 0

    __repr__ = short_repr

    def write(self, folder: Path) -> None:
        """Write the record next to the plan.

        Parameters
        ----------
        folder : Path
            Folder of the part's plan.
        """
        write_text(folder / RECORD, json.dumps(to_plain(self), indent=1) + "\n")


# what a notebook shows of the results of a folder
_SHOWN_PARTS = 12
_TONES = {"planned": "good", "incomplete": "bad", "refused": "bad", "failed": "bad"}


class PartResults(list[PartResult], ShownInNotebook):
    """The results of a folder of parts: a list that notebooks show as a table.

    Parameters
    ----------
    iterable : iterable of PartResult, optional
        The results. Default: none.

    Examples
    --------
    >>> from planner import PartResult, PartResults
    >>> PartResults([PartResult("a.off", "planned"), PartResult("b.off", "failed", "no light")])
    <PartResults of 2 parts: 1 planned, 1 failed>
    """

    @property
    def counts(self) -> dict[str, int]:
        """Number of parts by status."""
        statuses = [result.status for result in self]
        return {status: statuses.count(status) for status in _TONES if status in statuses}

    def __repr__(self) -> str:
        """Return a one-line summary."""
        counts = ", ".join(f"{n} {status}" for status, n in self.counts.items())
        texts = [counts or "nothing", self._inspected_text()]
        return f"<PartResults of {count(len(self), 'part')}: {'; '.join(filter(None, texts))}>"

    def _inspected_text(self) -> str:
        """Say how many targets all plans inspect; empty if no plan is known to have any."""
        total = sum(result.targets for result in self)
        inspected = sum(result.inspected for result in self)
        if not total:
            return ""
        return f"{inspected} of {count(total, 'target')} inspected"

    def _notebook_view(self) -> NotebookView:
        """Return a table of the parts, those without a whole plan first, and their reasons below it."""
        ordered = sorted(self, key=lambda result: result.status == "planned")
        rows = [
            (
                result.part,
                Toned(result.status, _TONES[result.status]),
                f"{result.inspected} of {result.targets}" if result.targets else "",
                f"{result.settings} (at least {result.lower_bound})" if result.settings else "",
            )
            for result in ordered[:_SHOWN_PARTS]
        ]
        counts = ", ".join(f"{n} {status}" for status, n in self.counts.items())
        tone = "good" if set(self.counts) == {"planned"} else "bad"
        lines: list[str | Toned] = [Toned(f"{counts}.", tone)] if counts else []
        if n_left_out := sum(result.left_out for result in self):
            lines.append(Toned(f"{count(n_left_out, 'requirement')} left out.", "open"))
        more = len(self) - len(rows)
        note = f"and {more} more; results.csv in the folder lists all." if more else ""
        if text := self._inspected_text():
            lines.append(f"{text}.")
        table = NotebookTable(("part", "status", "inspected", "settings"), rows, note=note)
        # sentences, for which a narrow page has no column
        reasons = {result.part: result.reason for result in ordered[:_SHOWN_PARTS] if result.reason}
        return NotebookView(count(len(self), "part"), lines, table, reasons)


class _Table(NamedTuple):
    """The table of all parts."""

    rows: tuple[PartResult, ...]


def found_again(part: str, folder: Path, file_sha256: str, request: str) -> PartResult | None:
    """Return the result of an earlier call, if it holds for this file and this request; else None.

    A failure is no result. A plan that is gone, or is not the one that was written, is made again.
    """
    result = read_record(folder / RECORD)
    if result is None:
        return None
    identity = (part, file_sha256, request)
    if (result.part, result.file_sha256, result.request) != identity or result.status == FAILED:
        return None
    return (
        result
        if result.status == REFUSED or file_digest(folder / PLAN_FILE) == result.plan_sha256
        else None
    )


def read_record(path: Path) -> PartResult | None:
    """Return a record that `PartResult.write` wrote; None of what is no such record, or is not there."""
    try:
        return from_plain(PartResult, read_json(path, "result"), PlanFileError)
    except PlanFileError:
        return None


# of a file that would be lost
_NOT_OURS = "which no batch wrote"


def no_table(path: Path) -> str:
    """Say that a file is no ``results.json`` of `write_tables`; nothing of one that is."""
    return _NOT_OURS if parts_in(path) is None else ""


def parts_in(path: Path) -> set[str] | None:
    """Return the parts in ``results.json`` of `write_tables`; None of what is no such table, or is not there."""
    try:
        rows = read_json(path, "results")
        return {result.part for result in from_plain(_Table, {"rows": rows}, PlanFileError).rows}
    except PlanFileError:
        return None


def write_tables(results: Iterable[PartResult], out: Path) -> None:
    """Write ``results.json`` and ``results.csv``, a row per part, in the order of their names."""
    rows: list[dict[str, Any]] = [
        to_plain(result) for result in sorted(results, key=lambda result: result.part)
    ]
    write_text(out / TABLES[0], json.dumps(rows, indent=1) + "\n")
    write_text(out / TABLES[1], csv_text([field.name for field in fields(PartResult)], rows))


# One part of a folder, from its file to its plan: what a worker does.


STATE_FILE = "planning-state.json"
REGIONS_FOLDER = "planning-regions"
_OWN = (AspectGraphError, MeasurementModelError, GAError, PlannerError)
# of ours, too, but not the fault of part or request: a disk that is full, a package that is not there
_OUTER = (OSError, MemoryError, ImportError)


def plan_part(request: PartRequest, part: str, path: Path, folder: Path) -> PartResult:
    """Plan one part and write everything about it; whatever goes wrong is the result's reason.

    Parameters
    ----------
    request : PartRequest
        What is asked.
    part : str
        What the result calls the part.
    path, folder : pathlib.Path
        Its file, and where to write. A state that is there is resumed.

    Returns
    -------
    PartResult
        It is written, too, if that is possible.
    """
    file_sha256 = file_digest(path)
    fingerprint = request.fingerprint_of(part)
    begun = time.monotonic()
    earlier_result = found_again(part, folder, file_sha256, fingerprint)
    if earlier_result is not None:
        return earlier_result
    blank = PartResult(part, FAILED, file_sha256=file_sha256, request=fingerprint)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with folder_lock(folder):
            # whose folder it is must be known if the process is killed
            replace(blank, reason="it was not planned to the end").write(folder)
            plan, left_out = _planned(request, part, path, folder)
            result = _described(blank, plan, left_out, folder)
    except Exception as error:
        # one part, whatever is wrong with it, must not end the batch
        refused = isinstance(error, _OWN) and not isinstance(error, _OUTER)
        result = replace(blank, status=REFUSED if refused else FAILED, reason=reason_of(error))
    result = replace(result, seconds=round(time.monotonic() - begun, 3))
    try:
        result.write(folder)
    except OSError as error:
        return replace(blank, reason=reason_of(error))
    return result


def check_part_place(folder: Path) -> None:
    """Refuse a folder with a plan, or other files, that no earlier batch wrote.

    Raises
    ------
    OutputError
        Names the file that would be lost.
    """
    names = (RECORD, *PLAN_FILES, STATE_FILE, REGIONS_FOLDER)
    check_set_place(folder, names, lambda path: "" if read_record(path) else _NOT_OURS, "out")


def reason_of(error: BaseException) -> str:
    """Return an error in one line; of errors that are not ours with the kind."""
    text = " ".join(str(error).split()).encode("utf-8", "backslashreplace").decode("utf-8")
    return (
        text if isinstance(error, _OWN) and text else f"{type(error).__name__}: {text}".rstrip(": ")
    )


NOT_LIT = "The time limit ended before lamps were found. A longer one goes on from here."
"""What a plan says whose lamps there was no time for."""


def _is_worse(plan: InspectionPlan, earlier: InspectionPlan) -> bool:
    """Return whether a plan that the time ended inspects less than an earlier one of the same request and program."""
    if not plan.unfinished or plan.made is None or earlier.made is None:
        return False
    of_both = [replace(made, date="", operator="") for made in (plan.made, earlier.made)]
    return of_both[0] == of_both[1] and len(plan.inspected) < len(earlier.inspected)


@dataclass(frozen=True)
class FolderWork:
    """What is planned, simulated and written into a folder, and what is kept there on the way.

    Attributes
    ----------
    solid : Solid
        The part.
    resolved : ResolvedRequest
        The request on it.
    options : InspectionOptions
        Of the search, with executor and progress, but without space, state and time limit.
    deadline : Deadline
        When all of it ends.
    folder, state : pathlib.Path
        Where files are written, and the state of the search.
    regions : KeptRegions
        Visible regions; they are computed before there is a state.
    part, reading
        The part's file, and how it is read, as `with_source` takes them.
    simulate : int
        Number of displaced poses per setting.
    graph_limit : int or None
        As `write_outputs` takes it.
    cell : Cell, optional
        That the plan is for.
    operator : str
        Who plans.
    not_planned : mapping of str to str
        What the CAD model requires besides, and why it is not planned.
    earlier : InspectionPlan, optional
        A plan in the folder. It stays if the time ends one that inspects less.
    """

    solid: Solid
    resolved: ResolvedRequest
    options: InspectionOptions
    deadline: Deadline
    folder: Path
    state: Path
    regions: KeptRegions
    part: str | Path
    reading: Mapping[str, Any]
    simulate: int
    graph_limit: int | None
    cell: Cell | None = None
    operator: str = ""
    not_planned: Mapping[str, str] = field(default_factory=dict)
    earlier: InspectionPlan | None = None

    @property
    def page_s(self) -> float:
        """Seconds that the page takes."""
        return PAGE_S * len(self.resolved.request.targets)

    def search(self, options: InspectionOptions) -> InspectionPlan:
        """Return the plan of the search."""
        request = self.resolved.request
        share = SEARCH_SHARE if request.lighting is None else LIT_SEARCH_SHARE
        deadline = self.deadline.of_search(request.gap, share, later_s=self.page_s)
        return plan_request(
            self.solid,
            self.resolved,
            options,
            deadline,
            lamps_until=self.deadline.at(LAMPS_SHARE),
        )

    def unwritten(self, plan: InspectionPlan, error: OutputError) -> OutputError:
        """Return what to raise when a plan cannot be written."""
        return error

    def done(self) -> tuple[InspectionPlan, Written]:
        """Plan, simulate and write. State and regions are deleted only after the end."""
        request = self.resolved.request
        progress = self.options.progress
        with self.deadline.stated_whole():
            regions = visible_regions(
                self.solid,
                self.resolved.entities,
                request,
                executor=self.options.executor,
                progress=progress,
                kept=self.regions,
                deadline=self.deadline.of_regions(),
            )
            plan = self.search(
                replace(
                    self.options,
                    space=space_of(request, regions),
                    state=self.state,
                    time_limit_s=self.deadline.seconds_left(SEARCH_SHARE),
                )
            )
        plan, notes = self.checked(plan)
        if self.earlier is not None and _is_worse(plan, self.earlier):
            plan = self.earlier
            notes.append(
                f"the earlier plan in {self.folder} inspects more than this run in its time, and stays"
            )
        try:
            written = write_outputs(
                plan,
                regions,
                self.folder,
                progress,
                graph_limit=self.graph_limit,
                deadline=self.deadline,
                notes=notes,
                cell=self.cell,
            )
        except OutputError as error:
            raise self.unwritten(plan, error) from None
        if not plan.unfinished:
            # a longer limit goes on from there; what stays does no harm, it gives the same plan again
            self.regions.remove()
            with suppress(OSError):
                self.state.unlink(missing_ok=True)
        return plan, written

    def checked(self, plan: InspectionPlan) -> tuple[InspectionPlan, list[str]]:
        """Return a plan with its lamps, simulation and foreseen uncertainties, and sentences on what is missing."""
        request = self.resolved.request
        progress = self.options.progress
        lit = with_light(
            plan,
            self.solid,
            request.lighting,
            progress,
            self.options.executor,
            self.deadline.at(LAMPS_SHARE),
        )
        until = self.deadline.time_left(SIMULATION_SHARE, LEAST_SIMULATION_S, later_s=self.page_s)
        simulation, notes = simulate_in_time(
            lit, self.simulate, request.seed, progress, self.solid, until
        )
        if lit.light_missing:
            notes.append(NOT_LIT)
        plan = replace(lit, simulation=simulation)
        plan = with_source(plan, self.folder, self.part, self.reading)
        # what can be read only once has no digest
        digest = file_digest(Path(self.part)) if Path(self.part).is_file() else ""
        made = Made.now(request, digest, self.operator)
        until = self.deadline.time_left(FORESEEN_SHARE, later_s=self.page_s)
        plan, late = foreseen_in_time(plan, self.solid, until)
        return replace(plan, made=made, not_planned=self.not_planned), [*notes, *late]


class _PartWork(FolderWork):
    def search(self, options: InspectionOptions) -> InspectionPlan:
        try:
            return super().search(options)
        except PlanFileError:
            # the state is of another request, or damaged
            self.state.unlink(missing_ok=True)
            return super().search(options)


def _planned(
    request: PartRequest, part: str, path: Path, folder: Path
) -> tuple[InspectionPlan, dict[str, str]]:
    """Read a part, and plan it; return the plan, and the dimensions left out with the reasons."""
    solid = read_solid(path, units=request.units, solids=request.solids)
    entities: Mapping[str, Any]
    left_out: dict[str, str] = {}
    if isinstance(request.dimensions, DimensionFolder):
        entities = request.dimensions.chosen(part, solid)
    elif request.dimensions is not None:
        stated = stated_dimensions(path, solid)
        entities, left_out = request.dimensions.chosen(stated, path.name)
    else:
        entities = _selected(solid, request.select)
    options = request.options
    deadline = Deadline(options.time_limit_s, options.gap)
    # what cannot be measured is refused before the work
    resolved = resolve_request(solid, entities, request.camera, request.pose_uncertainty, options)
    work = _PartWork(
        solid,
        resolved,
        options,
        deadline,
        folder,
        folder / STATE_FILE,
        KeptRegions(folder / REGIONS_FOLDER, resolved.request.identity()),
        path,
        {"units": request.units, "solids": request.solids},
        request.simulate,
        request.graph_limit,
        not_planned=left_out,
    )
    return work.done()[0], left_out


def _selected(solid: Solid, select: str | None) -> dict[str, Entity]:
    """Return the entities for which a rule holds; all sharp straight edges without one."""
    if select is not None:
        return resolve_entities(solid, select_entities(solid, select))
    if not solid.straight_edges():
        rule = "must be given for a part without a sharp straight edge, such as 'kind = rim'"
        raise RequestError.of_rule("select", rule, "none")
    return read_entities("all", solid)


def _described(
    blank: PartResult, plan: InspectionPlan, left_out: Mapping[str, str], folder: Path
) -> PartResult:
    """Return the result of a plan that is written."""
    reasons = _short_reasons(plan.uninspectable)
    simulation = plan.simulation
    if simulation is not None and not simulation.confirmed:
        reasons.append("the simulation contradicts the plan")
    if plan.unlit:
        reasons.append(f"no lamp shows {', '.join(plan.unlit)}")
    if plan.light_missing:
        reasons.append("light is not planned yet")
    return replace(
        blank,
        status=INCOMPLETE if reasons else PLANNED,
        reason="; ".join(filter(None, [*reasons, stopped_note(plan)])),
        entities=len(plan.entities),
        settings=len(plan.settings),
        lower_bound=int(plan.lower_bound),
        left_out=len(left_out),
        left_out_reasons="; ".join(f"{name}: {reason}" for name, reason in left_out.items()),
        inspected=len(plan.targets) - len(plan.uninspectable) - len(plan.unlit),
        targets=len(plan.targets),
        plan_sha256=file_digest(folder / PLAN_FILE),
    )


def _short_reasons(reasons: Mapping[str, str]) -> list[str]:
    """Return why targets are not inspected: of several by one kind of reason, only the kind; plan.json has all."""
    names: dict[ReasonKind, list[str]] = {}
    for name, reason in reasons.items():
        names.setdefault(kind_of(reason), []).append(name)
    texts = []
    for kind, of_kind in names.items():
        if len(of_kind) == 1 or kind is ReasonKind.NOT_STATED:
            texts += [f"{name}: {reasons[name].rstrip('.')}" for name in of_kind]
        else:
            texts.append(f"{kind.words}: {', '.join(of_kind)}")
    return texts


# Workers of a Dask cluster as an executor.


_ANSWERS_S = 15


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler; its executor gives every part its own task.

    Parameters
    ----------
    address : str
        Such as ``tcp://host:8786``.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    RequestError
        If no scheduler answers there.
    """
    try:
        # its functions have no types
        connect: Any = import_module("distributed").Client
    except ImportError:
        raise MissingExtraError(
            f"a scheduler needs Dask's distributed, which is not installed; {how_to_install('dask')}."
        ) from None
    try:
        client = connect(address, timeout=_ANSWERS_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RequestError.of_rule(
            "scheduler",
            "must be the address of a Dask scheduler that answers, like tcp://host:8786",
            f"{address!r}: {reason}",
        ) from None
    try:
        # results are small, and a part planned again costs more than a look at its folder
        yield client.get_executor(pure=False)
    finally:
        client.close()


# Parts on worker processes: one that dies costs at most the part that killed it.


# parts that an executor of the caller has at a time; enough for hundreds of workers
_AT_A_TIME = 1000


class PartTask(NamedTuple):
    """What `plan_part` takes."""

    request: PartRequest
    part: str
    path: Path
    folder: Path

    def failed(self, reason: str, status: str = FAILED) -> PartResult:
        """Return the result where there is none of the worker."""
        fingerprint = self.request.fingerprint_of(self.part)
        return PartResult(self.part, status, reason, request=fingerprint)


def on_executor(tasks: Sequence[PartTask], executor: Executor) -> Iterator[PartResult]:
    """Yield results as they come from an executor, which replaces its own workers."""
    waiting: deque[PartTask] = deque(tasks)
    running: dict[Future[PartResult], PartTask] = {}
    try:
        while waiting or running:
            while waiting and len(running) < _AT_A_TIME:
                task = waiting.popleft()
                running[executor.submit(plan_part, *task)] = task
            for future in _first(running):
                task = running.pop(future)
                yield _result(task, future)
    finally:
        for future in running:
            future.cancel()


def on_own_processes(tasks: Sequence[PartTask], jobs: int) -> Iterator[PartResult]:
    """Yield results as they come from processes of this machine.

    When one dies, all parts that were being planned are suspects. Each is planned alone then: so it is known on which
    part a process dies.
    """
    waiting: deque[PartTask] = deque(tasks)
    suspects: deque[PartTask] = deque()
    while waiting or suspects:
        if suspects:
            task = suspects.popleft()
            with worker_processes(1) as pool:
                yield _result(task, pool.submit(plan_part, *task))
        else:
            with worker_processes(jobs) as pool:
                suspects.extend((yield from _while_whole(pool, waiting, jobs)))


def _while_whole(
    pool: Executor, waiting: deque[PartTask], jobs: int
) -> Generator[PartResult, None, list[PartTask]]:
    """Yield results until all are there or a process dies; return the parts without a result."""
    running: dict[Future[PartResult], PartTask] = {}
    lost: list[PartTask] = []
    while (waiting and not lost) or running:
        while waiting and not lost and len(running) < jobs:
            task = waiting.popleft()
            try:
                running[pool.submit(plan_part, *task)] = task
            except BrokenProcessPool:
                lost.append(task)
        for future in _first(running):
            task = running.pop(future)
            if isinstance(future.exception(), BrokenProcessPool):
                lost.append(task)
            else:
                yield _result(task, future)
    return lost


def _first(running: dict[Future[PartResult], PartTask]) -> list[Future[PartResult]]:
    """Wait; return what is done, in the order in which it was begun."""
    done, _ = wait(running, return_when=FIRST_COMPLETED)
    return [future for future in running if future in done]


def _result(task: PartTask, future: Future[PartResult]) -> PartResult:
    try:
        return future.result()
    except BrokenProcessPool:
        return task.failed(
            "the process that planned it died: it crashed, or was ended for its memory"
        )
    except Exception as error:
        # one part, or a result that cannot be unpickled, must not end the batch
        return task.failed(reason_of(error))


@contextmanager
def worker_processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Provide processes; where the work is interrupted they are ended at once, for what they know is on the disk."""
    pool = ProcessPoolExecutor(
        jobs, initializer=leave_signals_to_the_parent, initargs=(os.getpid(),)
    )
    try:
        yield pool
    except BaseException:
        # after an interruption, too, no process may stay. Python before 3.14 has no public way
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


# between two writings of the table while parts are planned
_TABLE_S = 10.0


@suggests_names
def plan_folder(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str],
    request: PartRequest,
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
    replace: bool = False,
) -> PartResults:
    """Plan every part of a folder, and write each plan to a folder of its own.

    **Guarantee.** Every part has a result: a plan, or one reason. Finished results remain after an
    interruption. The same call reuses them while file, request and program are the same. The plans
    do not depend on the executor.

    Parameters
    ----------
    folder : path
        Folder of the part files. Subfolders are included.
    out : path
        Folder for ``results.json``, ``results.csv`` and a folder for every part, named after its
        file.
    request : PartRequest
        The options for every part.
    jobs : int
        Number of processes on this machine. A process that dies is replaced. A part that alone
        kills its process fails.
    executor : concurrent.futures.Executor, optional
        Plans the parts instead of local processes, such as
        ``dask.distributed.Client(...).get_executor()``. Its workers must reach both folders under
        the same names.
    progress : callable, optional
        The program calls ``progress(done, total, "parts")``. An exception it raises ends the work.
    replace : bool
        Replace plans and other files in ``out`` that no earlier call wrote. By default, such files
        stay: a table refuses the call, and the files of a part make this part fail.

    Returns
    -------
    PartResults
        A list of `PartResult`, in the order of the names of the parts.

    Raises
    ------
    RequestError
        If an argument has the wrong type, the folder does not exist or holds no part file, or a number breaks its
        rule.
    OutputError
        If nothing can be written, another process writes there, or a table is there that no
        earlier call wrote.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from planner import Camera, Effort, PartRequest, PoseUncertainty, plan_folder
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> effort = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)
    >>> rule = "near 60,30,10 < 1"
    >>> request = PartRequest(camera, uncertainty, 0.95, select=rule, simulate=100, effort=effort)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     part = Path(folder) / "parts" / "block.off"
    ...     part.parent.mkdir()
    ...     _ = part.write_bytes(Path("examples/two_pocket_block.off").read_bytes())
    ...     (result,) = plan_folder(part.parent, Path(folder) / "plans", request)
    >>> result.part, result.status
    ('block.off', 'planned')
    """
    check_kinds(request=(request, "PartRequest"))
    check_count("jobs", jobs, 1)
    for name, path in (("folder", folder), ("out", out)):
        check_path(name, path)
    source = absolute(folder)
    if not source.is_dir():
        got = name_text(Path(folder)) + (", a file" if source.exists() else "")
        raise RequestError.of_rule("folder", "must be an existing folder", got)
    if source.resolve() == absolute(out).resolve():
        rule = "must be another folder than that of the parts"
        raise RequestError.of_rule("out", rule, name_text(Path(out)))
    if not replace:
        check_set_place(Path(out), TABLES, no_table, "out")
    with output_folder(out, TABLES, "out") as target, folder_lock(target):
        results: dict[str, PartResult] = {}
        waiting: list[PartTask] = []
        ours = parts_in(target / TABLES[0]) or set()
        paths = part_files(source, target)
        if isinstance(request.dimensions, DimensionFolder):
            request.dimensions.check_parts([name_text(path.relative_to(source)) for path in paths])
        for path in paths:
            name = name_text(path.relative_to(source))
            task = PartTask(request, name, path, target / path.relative_to(source))
            earlier_result = _earlier_result(task, replace or name in ours)
            if earlier_result is None:
                waiting.append(task)
            else:
                results[name] = earlier_result
        total = len(results) + len(waiting)
        reported = time.monotonic()
        report(progress, len(results), total, "parts")
        try:
            for result in _planned_of_folder_of_parts(waiting, jobs, executor):
                results[result.part] = result
                report(progress, len(results), total, "parts")
                if time.monotonic() - reported > _TABLE_S:
                    write_tables(results.values(), target)
                    reported = time.monotonic()
        finally:
            write_tables(results.values(), target)
    return PartResults(sorted(results.values(), key=lambda part_result: part_result.part))


def _earlier_result(task: PartTask, may_replace: bool) -> PartResult | None:
    """Return the result of a part without planning it; None if it is to be planned."""
    if not task.path.is_file():
        kind = "a link that leads nowhere" if task.path.is_symlink() else "a pipe or a device"
        return task.failed(f"the part must be an existing file. Got {kind}.", REFUSED)
    earlier_result = found_again(
        task.part, task.folder, file_digest(task.path), task.request.fingerprint_of(task.part)
    )
    if earlier_result is None and not may_replace:
        try:
            check_part_place(task.folder)
        except (OutputError, OSError) as error:
            return task.failed(reason_of(error), FAILED)
    return earlier_result


def part_files(folder: Path, out: Path) -> list[Path]:
    """Return the part files in a folder and those in it, but for those of the output, in order.

    Links that lead nowhere, pipes and devices with the name of a part file are among them.

    Raises
    ------
    RequestError
        If there are none.
    """
    paths = [
        path
        for path in sorted(folder.rglob("*"))
        if _is_part(path) and not path.is_dir() and out not in path.parents
    ]
    if not paths:
        raise RequestError(
            f"the folder of parts must hold part files ({_kinds()}). Got {name_text(folder)}."
        )
    return paths


def _is_part(path: Path) -> bool:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    packed = suffixes[-1:] == [".gz"]
    return bool(suffixes) and suffixes[-1 - packed :][:1][0] in (*STEP_SUFFIXES, *MESH_SUFFIXES)


def _kinds() -> str:
    return " ".join((*STEP_SUFFIXES, *MESH_SUFFIXES))


def _planned_of_folder_of_parts(
    waiting: list[PartTask], jobs: int, executor: Executor | None
) -> Iterator[PartResult]:
    if executor is not None:
        yield from on_executor(waiting, executor)
    else:
        yield from on_own_processes(waiting, jobs)

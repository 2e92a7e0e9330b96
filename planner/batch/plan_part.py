"""One part of a folder, from its file to its plan: what a worker does."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from aspectgraph import (
    AspectGraphError,
    read_entities,
    read_solid,
    resolve_entities,
    select_entities,
)
from aspectgraph.visibility.kept_regions import KeptRegions
from errors.exceptions import MeasurementModelError
from ga.exceptions import GAError
from planner.batch.part_request import PartRequest
from planner.batch.part_result import (
    FAILED,
    INCOMPLETE,
    PLAN,
    PLANNED,
    RECORD,
    REFUSED,
    PartResult,
    digest_of,
    found_again,
    read_record,
)
from planner.callbacks import LEAST_SIMULATION_S, SEARCH_SHARE, SIMULATION_SHARE, Deadline
from planner.exceptions import PlanFileError, PlannerError
from planner.files import check_set_place
from planner.identity.resolve_request import Promise, resolve_request
from planner.inspection import plan_by_options, visible_regions
from planner.output.folder_lock import folder_lock
from planner.output.part_source import with_source
from planner.output.plan_folder import PLAN_FILES, write_outputs
from planner.plan import InspectionPlan
from planner.verify.in_time import simulate_in_time

STATE = "planning-state.json"
REGIONS = "planning-regions"
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
    file_sha256 = digest_of(path)
    fingerprint = request.fingerprint
    begun = time.monotonic()
    known = found_again(part, folder, file_sha256, fingerprint)
    if known is not None:
        return known
    blank = PartResult(part, FAILED, file_sha256=file_sha256, request=fingerprint)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with folder_lock(folder):
            # whose folder it is must be known if the process is killed
            replace(blank, reason="it was not planned to the end").write(folder)
            result = _described(blank, _planned(request, path, folder), folder)
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
    names = (RECORD, *PLAN_FILES, STATE, REGIONS)
    check_set_place(folder, names, lambda path: read_record(path) is not None, "out")


def reason_of(error: BaseException) -> str:
    """Return an error in one line; of errors that are not ours with the kind."""
    text = " ".join(str(error).split()).encode("utf-8", "backslashreplace").decode("utf-8")
    return (
        text if isinstance(error, _OWN) and text else f"{type(error).__name__}: {text}".rstrip(": ")
    )


def _planned(request: PartRequest, path: Path, folder: Path) -> InspectionPlan:
    """Read, plan, simulate and write."""
    solid = read_solid(path, units=request.units)
    if request.select is None:
        entities = read_entities("all", solid)
    else:
        entities = resolve_entities(solid, select_entities(solid, request.select))
    options = request.options
    promise = Promise(request.accuracy, request.probability, request.seed)
    asked = (request.camera, request.pose_uncertainty, promise)
    deadline = Deadline(options.time_limit_s, options.gap)
    # what cannot be measured is refused before the work
    resolved = resolve_request(solid, entities, *asked, options)
    state = folder / STATE
    kept = KeptRegions(folder / REGIONS, resolved.request.identity())
    regions = visible_regions(
        solid, resolved.entities, resolved.request, kept=kept, deadline=deadline.of_regions()
    )
    options = replace(
        options, space=regions, state=state, time_limit_s=deadline.seconds_left(SEARCH_SHARE)
    )
    plan = partial(plan_by_options, solid, entities, *asked, options)
    with deadline.stated_whole():
        try:
            found = plan()
        except PlanFileError:
            # of another request, or damaged
            state.unlink(missing_ok=True)
            found = plan()
    simulation, notes = simulate_in_time(
        found,
        request.simulate,
        request.seed,
        None,
        solid,
        deadline.time_left(SIMULATION_SHARE, LEAST_SIMULATION_S),
    )
    found = replace(found, simulation=simulation)
    found = with_source(found, folder, path, {"units": request.units})
    limit = request.graph_limit
    write_outputs(found, regions, folder, graph_limit=limit, deadline=deadline, notes=notes)
    if not found.unfinished:
        # a longer limit goes on from there
        state.unlink(missing_ok=True)
        kept.remove()
    return found


def _described(blank: PartResult, plan: InspectionPlan, folder: Path) -> PartResult:
    """Return the result of a plan that is written."""
    reasons = [f"{name}: {reason}" for name, reason in plan.uninspectable.items()]
    simulation = plan.simulation
    if simulation is not None and not simulation.confirmed:
        reasons.append("the simulation contradicts the plan")
    return replace(
        blank,
        status=INCOMPLETE if reasons else PLANNED,
        reason="; ".join(reasons),
        entities=len(plan.entities),
        settings=len(plan.settings),
        lower_bound=int(plan.lower_bound),
        plan_sha256=digest_of(folder / PLAN),
    )

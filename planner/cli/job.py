"""What `plan` is to do: the request, built once from the options or from the file of a plan."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph import AspectGraphError, PartFileNotFoundError, SolidChoice, read_solid
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.light import read_lighting
from planner.cli.naming import in_words_of_shell, named_by
from planner.cli.parsing.camera_option import read_camera
from planner.cli.parsing.cell_option import cell_again, read_cell, without_cell
from planner.cli.wanted import Wanted, read_limits, read_request
from planner.detectability.conditions import Detectability
from planner.effort.effort import Effort
from planner.exceptions import PlanFileError, RequestError
from planner.files import plan_file
from planner.identity.inspection_request import SOURCE, InspectionRequest
from planner.identity.planned_part import other_part
from planner.identity.resolve_request import Promise, resolve_request
from planner.identity.restore import restored_options, restored_request
from planner.inspection import plan_by_options
from planner.inspection_options import InspectionOptions
from planner.plan import InspectionPlan, read_plan
from planner.progress import reading_shown
from planner.request.defaults import default_workspace

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.light.lighting import Lighting
    from planner.robot import Cell

# with --again, what else may be given
_BESIDE_AGAIN = {
    *("--again", "--out", "--jobs", "--resume", "--force", "--graph-limit", "--simulate"),
    *("--time-limit", "--read-time-limit", "--json", "--quiet", "--verbose", "--cell"),
}


@dataclass(frozen=True)
class Job:
    """A request, and what a call of `plan_inspection` needs to answer it.

    Attributes
    ----------
    request : InspectionRequest
        What is asked.
    solid : Solid
        The part.
    wanted : Wanted
        What is to be inspected, and what of it cannot be.
    options : InspectionOptions
        Options of `plan_inspection`.
    part : str
        The part's file.
    reading : dict of str to value
        How it is read, as `aspectgraph.read_solid` takes it.
    """

    request: InspectionRequest
    solid: Solid
    wanted: Wanted
    options: InspectionOptions
    part: str
    reading: dict[str, Any]

    @property
    def cell(self) -> Cell | None:
        """The robot cell that the plan is for; its options know any region of poses."""
        if self.options.cell is None:
            return None
        from planner.robot import Cell

        return self.options.cell if isinstance(self.options.cell, Cell) else None

    def plan(self, **more: Any) -> InspectionPlan:
        """Plan it; ``more`` replaces some of the options."""
        request = self.request
        return plan_by_options(
            self.solid,
            self.wanted.items,
            request.camera,
            request.pose_uncertainty,
            Promise(request.accuracy, request.probability, request.seed),
            replace(self.options, **more),
        )


def read_job(options: argparse.Namespace) -> Job:
    """Return what the options of `plan` ask for.

    Raises
    ------
    RequestError, ReadError, EntityError, PlanFileError
        If they ask for what is not there, or break a rule.
    """
    if options.again is not None:
        return _job_again(options)
    camera = read_camera(options.camera)
    uncertainty = PoseUncertainty.isotropic(
        translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad
    )
    solid = read_part(options)
    wanted = read_request(options, solid)
    box = workspace_of(options)
    given = inspection_options(
        options,
        lamps=_lighting(options),
        localisation=wanted.localisation,
        workspace=default_workspace(solid, camera) if box is None else box,
        cell=read_cell(options.cell),
    )
    promise = Promise(options.accuracy, options.probability, options.seed)
    resolved = resolve_request(solid, wanted.items, camera, uncertainty, promise, given)
    if options.give_up is not None:
        # the usual effort depends on what is measured
        given = replace(given, effort=resolved.request.effort.giving_up(options.give_up))
        resolved = resolve_request(solid, wanted.items, camera, uncertainty, promise, given)
    wanted = replace(wanted, entities=resolved.entities)
    return Job(resolved.request, solid, wanted, given, options.part, reading_of(options))


def _lighting(options: argparse.Namespace) -> Lighting | None:
    """Return what is asked of lamps; an error names the option."""
    with named_by("light", vars(options)):
        return read_lighting(options)


def inspection_options(options: argparse.Namespace, **more: Any) -> InspectionOptions:
    """Return the options of `plan_inspection` that the command line gives.

    An option that has the same name there is taken over as it is; ``more`` holds what is not.
    """
    names = {field.name for field in fields(InspectionOptions)}
    same = {name: value for name, value in vars(options).items() if name in names}
    effort = getattr(options, "effort", None)
    given = {
        "stand_off_mm": options.stand_off,
        "showing": Detectability(
            options.separation_px, options.surround_px, options.min_corner_deg
        ),
        "effort": None if effort is None else Effort.named(effort),
        "workspace": None,
        "localisation": None,
    }
    return InspectionOptions(**{**same, **given, **more})


def _job_again(options: argparse.Namespace) -> Job:
    """Return the job whose plan a file holds."""
    for name in options.typed:
        if name not in _BESIDE_AGAIN and name not in _READING:
            raise RequestError(
                f"{name} must not be given with --again, which takes the request from the plan. "
                f"Got {name}."
            )
    path = plan_file(options.again)
    with named_by("again", vars(options)):
        plan = read_plan(path)
    if not plan.request:
        raise PlanFileError(
            f"{path}: plan file must hold its request. Got one of an earlier version. Plan the part again."
        )
    cell = cell_again(plan, options.cell, path)
    try:
        request = restored_request(without_cell(plan.request))
        part, reading = _part_again(options, path, plan.request)
    except PlanFileError as error:
        raise PlanFileError(f"{path}: {error}") from None
    if options.part is None and not Path(part).exists():
        hint = "give PART, too, if it was moved"
        raise RequestError.of_rule("part", "must be an existing file", repr(part), hint=hint)
    solid = _read(part, reading, options)
    check_same_part(solid, plan, part, hint="plan it from its options")
    items = {record.name: record.item_of(solid) for record in request.targets or ()}
    given = replace(restored_options(request), cell=cell)
    promise = Promise(request.accuracy, request.probability, request.seed)
    resolved = resolve_request(
        solid, items, request.camera, request.pose_uncertainty, promise, given
    )
    wanted = Wanted(items, resolved.entities, request.localisation)
    return Job(resolved.request, solid, wanted, given, part, reading)


def check_same_part(solid: Solid, plan: InspectionPlan, path: str, *, hint: str = "") -> None:
    """Refuse a part that is not the one of a plan.

    Parameters
    ----------
    solid : Solid
        The part.
    plan : InspectionPlan
        The plan.
    path : str
        The part's file, for the error.
    hint : str
        What to do about it.

    Raises
    ------
    RequestError
        If the part has another shape, or the plan holds nothing of its part to compare.
    """
    why = other_part(plan, solid)
    if why:
        got = f"{path!r}, {why}"
        raise RequestError.of_rule("part", "must be the one that was planned", got, hint=hint)


# how a part's file is read
_READING = ("--units", "--solids", "--occluders", "--gap-mm")


def _part_again(
    options: argparse.Namespace, path: Path, stored: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return the part's file and how it is read: as given, or as the plan stores it."""
    source = stored.get(SOURCE)
    if options.part is not None:
        kept = {} if source is None else {k: v for k, v in source.items() if k != "file"}
        typed = {name: value for name, value in reading_of(options).items() if value is not None}
        return options.part, {**kept, **typed}
    if any(name in options.typed for name in _READING):
        raise RequestError("the part must be given with options that say how to read it. Got none.")
    if not isinstance(source, dict) or not isinstance(source.get("file"), str):
        raise PlanFileError("request.source must name the part's file. Got none; give PART, too.")
    return str(path.parent / source["file"]), {k: v for k, v in source.items() if k != "file"}


def reading_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return how the part is to be read, as `aspectgraph.read_solid` takes it, with ``occluders`` apart."""
    return {
        "units": options.units,
        "solids": options.solids,
        "occluders": options.occluders,
        "gap_mm": options.gap_mm,
    }


def check_nothing_read(options: argparse.Namespace) -> None:
    """Refuse options that say how a part is read where there is none.

    Raises
    ------
    RequestError
        Names the option.
    """
    for name, value in reading_of(options).items():
        if value is not None:
            raise RequestError.of_rule(name, "must be given with a part", "none")


def read_part(options: argparse.Namespace) -> Solid:
    """Read the part; an error names the file."""
    with reading_shown(quiet=options.quiet, lines=options.verbose):
        return _read(options.part, reading_of(options), options)


def _read(part: str, reading: dict[str, Any], options: argparse.Namespace) -> Solid:
    given = dict(reading)
    occluders = given.pop("occluders", None)
    if occluders:
        given["solids"] = SolidChoice(given.get("solids"), occluders)
    try:
        return read_solid(part, limits=read_limits(options), **given)
    except AspectGraphError as error:
        if error.parameter == "path":
            missing = isinstance(error, PartFileNotFoundError)
            rule = "must be an existing file" if missing else error.rule
            raise type(error).of_rule("part", rule, error.got) from None
        words = in_words_of_shell(error, vars(options))
        raise type(error)(f"{part}: {words}") from None


def workspace_of(options: argparse.Namespace) -> np.ndarray | None:
    """Return the box the camera may be in, (2, 3), mm, if one is given."""
    return None if options.workspace is None else np.reshape(options.workspace, (2, 3))

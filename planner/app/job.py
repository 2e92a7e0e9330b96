"""What `plan` is to do: the request, built once from the options or from the file of a plan."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph import (
    read_entities,
    resolve_entities,
    select_entities,
)
from aspectgraph.entities.entity_rules import check_selection, parse_names
from aspectgraph.light import check_contrast
from aspectgraph.phases import phase
from errors.exceptions import InvalidParameterError
from errors.measurands import Localisation
from errors.measurands.geometry import DETECTOR_FLOOR_PX, FLOOR_PX
from errors.measurands.measurand import kinds
from planner.app.checks import OF_LIGHT, named_by, option, read_camera
from planner.app.model_dimensions import ModelDimensions, stated_dimensions
from planner.app.options import (
    Batch,
    ChosenEntities,
    DimensionTargets,
    GivenPoses,
    Light,
    Optics,
    Plan,
    Predict,
    Workspace,
)
from planner.app.part import (
    read_as,
    read_in_time,
    read_limits,
    read_part,
    reading_of,
    shown_reading,
)
from planner.app.quantities import localisation_words
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import Detectability
from planner.effort import Effort
from planner.exceptions import PlanFileError, PoseFileError, RequestError
from planner.files import plan_file
from planner.identity import Request
from planner.light.area_lights import BACKLIGHT, is_area_word, light_of_cell
from planner.light.backlight import Backlight
from planner.light.lighting import (
    RING,
    LampBox,
    LampDome,
    Lighting,
    check_lamps_given,
    check_step,
)
from planner.light.mounted_light import MOUNTED
from planner.light_catalogue import light_facts
from planner.options import InspectionOptions
from planner.plan import InspectionPlan, read_plan
from planner.request.camera_limits import default_workspace
from planner.request.dimension_files import SURFACES_MM, read_wanted
from planner.request.resolve import resolve_wanted, with_places
from planner.resolve_request import ResolvedRequest, resolve_request

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid
    from planner.pose_files import PoseFile
    from planner.robotcell import Cell


_RESOLVE = "resolve the targets"


# The cell of a plan, from its file.


def read_cell(path: str | None) -> Cell | None:
    """Return the cell of a file, or None without one."""
    if path is None:
        return None
    from planner.robotcell import Cell

    return Cell.from_toml(path)


def cell_again(plan: InspectionPlan, path: str | None, plan_path: Path) -> Cell | None:
    """Return the cell for which a plan is made again.

    Parameters
    ----------
    plan : InspectionPlan
        It holds a digest of its cell only.
    path : str or None
        The cell's file.
    plan_path : Path
        The plan's file, for the error.

    Raises
    ------
    RequestError
        If there is no file although the plan is for a cell, or it describes another one.
    """
    region = plan.request.requirements.cell
    cell = read_cell(path)
    if region is None and cell is None:
        return None
    if region is None:
        rule = "must not be given with --again, which takes the request from the plan"
        raise RequestError.of_rule("cell", rule, f"{path!r}, and {plan_path} is for no cell")
    if cell is None:
        rule = "must be given for a plan of a robot cell, of which plan.json holds a digest only"
        raise RequestError.of_rule("cell", rule, "none")
    if region.state_name != cell.state_name:
        raise RequestError.of_rule("cell", "must be the cell of the plan", f"{path!r}, another one")
    return cell


# Camera poses that exist.


def read_given(options: GivenPoses, cell: Cell | None) -> PoseFile | None:
    """Return the poses of the file that is given; None if there is none.

    Raises
    ------
    RequestError, PoseFileError, PlanFileError
        As `planner.read_poses`; errors name the option.
    """
    if options.poses is None:
        if options.pose_units is not None:
            raise RequestError.of_rule("pose_units", "must be given with --poses", "none")
        return None
    from planner.pose_files import read_poses

    try:
        return read_poses(options.poses, units=options.pose_units, cell=cell)
    except PoseFileError as error:
        if error.parameter == "units":
            raise PoseFileError.of_rule("pose_units", error.rule, error.got) from None
        if error.hint:
            error.hint = "state it with --pose-units, such as --pose-units mm"
        raise


# The lamps that the command line asks for: ``--light``, ``--contrast``, ``--grey-step`` and
# ``--ground``.


_RULE = (
    "--light must be backlight, diffuse-dome, coaxial or ring-light, each alone or with :NAME of the catalogue, "
    "backlight:X,Y,Z,WIDTH,HEIGHT, ring, box:X0,Y0,Z0,X1,Y1,Z1, dome:X,Y,Z,RADIUS[,LOWEST], at:X,Y,Z[;X,Y,Z...] in "
    "mm, or a TOML file with lamps = [[X, Y, Z], ...]."
)
_FORMS = {
    "at": "at:X,Y,Z[;X,Y,Z...]: three numbers for each lamp",
    "box": "box:X0,Y0,Z0,X1,Y1,Z1: six numbers",
    "dome": "dome:X,Y,Z,RADIUS[,LOWEST]: four or five numbers",
}


def read_lighting(options: Light, of_cell: Any = None) -> Lighting | None:
    """Return what is asked of lamps, or else of the light of a cell; None if there is none.

    Raises
    ------
    RequestError, LightError
        If the words have no meaning, or a number breaks its rule.
    """
    check_contrast(options.contrast)
    check_step(options.grey_step)
    is_one = options.light in (None, RING) or is_area_word(options.light)
    if options.together and is_one:
        option_text = "no --light" if options.light is None else f"--light {options.light}"
        raise RequestError(f"--together needs lamps by --light at, box or dome. Got {option_text}.")
    lamps = _lamps(options.light)
    if lamps is None:
        lamps = of_cell
    if lamps is None:
        return None
    return Lighting(
        lamps,
        options.contrast,
        options.grey_step,
        options.ground,
        together=options.together,
        material=options.material,
    )


def _lamps(text: str | None) -> Any:
    if text is None or text == RING:
        return text
    name, _, numbers = text.partition(":")
    is_rectangle = name == BACKLIGHT and "," in numbers
    if is_area_word(text) and not is_rectangle and not text.endswith(":"):
        if numbers:
            light_facts(name, numbers)
        return text
    if name == "at":
        places = [_numbers(place, text) for place in numbers.split(";")]
        if all(len(place) == 3 for place in places):
            return check_lamps_given(places)
    if name == "box":
        values = _numbers(numbers, text)
        if len(values) == 6:
            return LampBox((values[0], values[1], values[2]), (values[3], values[4], values[5]))
    elif name == BACKLIGHT:
        values = _numbers(numbers, text)
        if len(values) == 5:
            return Backlight.horizontal(values[:3], values[3], values[4])
    elif name == "dome":
        values = _numbers(numbers, text)
        if len(values) in (4, 5):
            return LampDome((values[0], values[1], values[2]), *values[3:])
    elif Path(text).suffix.lower() == ".toml":
        return check_lamps_given(_from_file(Path(text)))
    raise _light_error(text)


def _light_error(text: str) -> RequestError:
    """Return what is wrong with words for a light: the form of their kind, or all kinds and the one that is meant."""
    kind = text.partition(":")[0]
    if kind in _FORMS:
        return RequestError(f"--light must be {_FORMS[kind]}, in mm. Got {text!r}.")
    kinds = (BACKLIGHT, *MOUNTED, RING, *_FORMS)
    near = difflib.get_close_matches(kind.lower(), kinds, n=1, cutoff=0.7)
    meant = f"; {near[0]!r} may be meant" if near else ""
    return RequestError(f"{_RULE} Got {text!r}{meant}.")


def _numbers(text: str, whole: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise _light_error(whole) from None


def _from_file(path: Path) -> Any:
    try:
        return parse_names(path)["lamps"]
    except KeyError:
        raise RequestError(
            f"{path}: a file of lamps must hold lamps = [[X, Y, Z], ...]. Got no lamps."
        ) from None
    except ValueError as error:
        if isinstance(error.__cause__, OSError):
            raise RequestError(
                f"{path}: file of lamps must be readable. Got: {error.__cause__.strerror}."
            ) from error
        raise RequestError(f"{path}: file of lamps must be TOML. Got: {error}.") from error


# What the command line asks to be inspected: edges, or dimensions of a file or of the model
# itself.


_OF_MODEL = ("one_per_pattern", "reference_dimensions", "no_basic_dimensions", "no_positions")
"""Options that choose among the dimensions of the model."""


@dataclass(frozen=True)
class JobTargets:
    """What is to be inspected.

    Attributes
    ----------
    items : mapping
        As `plan_inspection` takes them.
    entities : mapping of str to Entity
        What must be seen for them.
    localisation : Localisation or None
        How well points are found in the image.
    left_out : dict of str to str
        Characteristics of the model that cannot be planned, and why.
    """

    items: Mapping[str, Any]
    entities: Mapping[str, Entity]
    localisation: Localisation | None = None
    left_out: dict[str, str] = field(default_factory=dict)


def read_request(options: Plan | Optics | Predict, solid: Solid) -> JobTargets:
    """Return what the options of `plan` ask for.

    Raises
    ------
    RequestError, ReadError, EntityError
        If they ask for what is not there, or break a rule.
    """
    check_of_model(options)
    if options.dimensions is None:
        usual = "rounding" if getattr(options, "edges", None) is None else _gaussian_text(options)
        localisation = read_localisation(options.localisation or usual)
        entities = chosen_entities(options, solid)
        # what cannot be measured is refused before the work
        with named_by("entities" if options.select is None else "select", vars(options)):
            resolve_wanted(solid, entities, options.accuracy)
        return JobTargets(entities, entities, localisation)
    localisation = read_localisation(options.localisation or _gaussian_text(options))
    with named_by("dimensions", vars(options)):
        return _wanted_dimensions(options, solid, localisation)


def check_of_model(options: DimensionTargets) -> None:
    """Refuse options that choose among dimensions where none are asked for.

    Raises
    ------
    RequestError
        Names the option.
    """
    for name in _OF_MODEL:
        if getattr(options, name) and not all_of_model(options):
            got = "none" if options.dimensions is None else repr(options.dimensions)
            raise RequestError(f"{option(name)} must be given with --dimensions all. Got {got}.")
    if options.dimensions is None and "--share" in options.typed:
        raise RequestError("--share must be given with --dimensions. Got none.")


def all_of_model(options: DimensionTargets) -> bool:
    """Tell whether the dimensions of the model are asked for."""
    return options.dimensions is not None and options.dimensions.strip().lower() == "all"


def choice_of(options: DimensionTargets) -> ModelDimensions:
    """Return which dimensions of the model the options choose."""
    return ModelDimensions(
        options.share,
        options.one_per_pattern,
        options.reference_dimensions,
        not options.no_basic_dimensions,
        not options.no_positions,
    )


def _wanted_dimensions(
    options: Plan | Optics | Predict, solid: Solid, localisation: Localisation
) -> JobTargets:
    """Return the dimensions of the model, or those of a file."""
    left_out: dict[str, str] = {}
    items: Mapping[str, Any]
    if all_of_model(options):
        with shown_reading(options), read_in_time(options):
            stated = stated_dimensions(options.part, solid, read_limits(options))
        items, left_out = choice_of(options).chosen(stated, options.part)
    else:
        items = with_places(
            solid, read_wanted(Path(str(options.dimensions)), kinds(), options.share)
        )
    rounded = localisation.model == "rounding"
    with shown_reading(options), phase(_RESOLVE):
        entities, _ = resolve_wanted(solid, items, options.accuracy, as_lengths=not rounded)
    return JobTargets(items, entities, localisation, left_out)


def chosen_entities(options: ChosenEntities, solid: Solid) -> dict[str, Entity]:
    """Return the entities that ``--entities`` or ``--select`` stand for.

    Raises
    ------
    EntityError
        If there are none, or the text breaks a rule.
    """
    with named_by("entities" if options.select is None else "select", vars(options)):
        if options.select is None:
            return read_entities(str(options.entities), solid)
        return resolve_entities(solid, select_entities(solid, options.select))


def localisation_text(options: Plan | Optics | Predict, items: Mapping[str, Any]) -> str:
    """Say which error of points in the image was assumed, if it was not chosen.

    Edges of ``--entities`` are measured as in the paper unless their breaks are stated, and dimensions with the error
    that edge detectors have. So the same feature has another probability by the other option.

    Parameters
    ----------
    options : Plan or Optics
        What was typed.
    items : mapping
        What is to be inspected.

    Returns
    -------
    str
        One sentence; empty if ``--localisation`` was given, or a stored request is planned again.
    """
    if options.localisation is not None or getattr(options, "again", None) is not None:
        return ""
    if options.dimensions is None and getattr(options, "edges", None) is not None:
        return (
            f"note: with --edges, lengths are measured by edge detectors (--localisation {_gaussian_text(options)}); "
            "without it, points are rounded to whole pixels, a model that counts no breaks"
        )
    if options.dimensions is None:
        return (
            "note: points in the image are rounded to whole pixels, the default without --dimensions. "
            "With --dimensions, the default is --localisation gaussian:0.1:0.05"
        )
    faces = ""
    if getattr(options, "surfaces_mm", None) is None:
        faces = (
            f"The position of the part's faces has an error of {SURFACES_MM:g} mm (--surfaces-mm). "
        )
        n_stated = sum(bool(getattr(item, "surfaces_from", "")) for item in items.values())
        if n_stated:
            faces += (
                f"For {n_stated} of {len(items)} dimensions, the error follows from flatness and profile tolerances of "
                "the model. "
            )
    default = _gaussian_text(options)
    floor = default.rpartition(":")[2]
    return (
        f"note: points in the image have errors of 0.1 px, and of {floor} px that all points of an edge or rim share "
        f"(--localisation {default}), the default with --dimensions. {faces}Without --dimensions, points are "
        "rounded to whole pixels"
    )


def _gaussian_text(options: Plan | Optics | Predict) -> str:
    """Return the default of ``--localisation`` for dimensions: stated breaks are no part of its floor."""
    floor_px = FLOOR_PX if getattr(options, "edges", None) is None else DETECTOR_FLOOR_PX
    return f"gaussian:0.1:{floor_px:g}"


def _gaussian(sigma_px: float = 0.1, floor_px: float = FLOOR_PX) -> Localisation:
    return Localisation.gaussian(sigma_px, floor_px=floor_px)


def read_localisation(text: str) -> Localisation:
    """Return the model that words such as ``gaussian:0.05`` stand for.

    Raises
    ------
    RequestError
        If the model is unknown, or a number breaks its rule.
    """
    name, numbers = localisation_words(text)
    makers: dict[str, Any] = {
        "rounding": Localisation.rounding,
        "gaussian": _gaussian,
        "fit": Localisation.fit,
    }
    try:
        model: Localisation = makers[name](*numbers)
    except InvalidParameterError as error:
        raise RequestError(f"--localisation: {error}") from error
    return model


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
    request : Request
        What is asked.
    solid : Solid
        The part.
    targets : JobTargets
        What is to be inspected, and what of it cannot be.
    options : InspectionOptions
        Options of `plan_inspection`.
    part : str
        The part's file.
    reading : dict of str to value
        How it is read, as `aspectgraph.read_solid` takes it.
    """

    request: Request
    solid: Solid
    targets: JobTargets
    options: InspectionOptions
    part: str
    reading: dict[str, Any]

    @property
    def cell(self) -> Cell | None:
        """The robot cell that the plan is for; its options know any region of poses."""
        if self.options.cell is None:
            return None
        from planner.robotcell import Cell

        return self.options.cell if isinstance(self.options.cell, Cell) else None

    @property
    def resolved(self) -> ResolvedRequest:
        """The request with what of the part it stands for."""
        return ResolvedRequest(self.request, self.targets.entities)


def read_job(options: Plan) -> Job:
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
    # a slip in a word is found before a large part is read
    cell = read_cell(options.cell)
    lighting = wanted_light(options, cell)
    if options.select is not None:
        with named_by("select", vars(options)):
            check_selection(options.select)
    solid = read_part(options.part, options)
    targets = read_request(options, solid)
    box = workspace_of(options)
    pose_file = read_given(options, cell)
    plan_options = inspection_options(
        options,
        lamps=lighting,
        localisation=targets.localisation,
        workspace=default_workspace(solid, camera) if box is None else box,
        cell=cell,
        poses=None if pose_file is None else pose_file.poses,
    )
    with shown_reading(options), phase(_RESOLVE):
        request, entities = resolve_request(solid, targets.items, camera, uncertainty, plan_options)
    if options.give_up is not None:
        # the usual effort depends on what is measured
        request = replace(request, effort=request.effort.giving_up(options.give_up))
    targets = replace(targets, entities=entities)
    return Job(request, solid, targets, plan_options, options.part, reading_of(options))


def wanted_light(options: Plan | Batch, cell: Cell | None = None) -> Lighting | None:
    """Return what is asked of lamps, or of the light of a cell; None if there is none.

    Raises
    ------
    RequestError
        Names the option that is wrong, or that needs --light.
    """
    with named_by("light", vars(options)):
        lighting = read_lighting(options, light_of_cell(cell))
    for name in OF_LIGHT:
        if lighting is None and f"--{name}" in options.typed:
            rule = "must be given with --light, or a cell that has a light"
            raise RequestError.of_rule(name, rule, "none")
    return lighting


def inspection_options(options: Plan | Optics | Predict | Batch, **more: Any) -> InspectionOptions:
    """Return the options of `plan_inspection` that the command line gives.

    An option that has the same name there is taken over as it is; ``more`` holds what is not.
    """
    names = {field.name for field in fields(InspectionOptions)}
    same = {name: value for name, value in vars(options).items() if name in names}
    effort = getattr(options, "effort", None)
    values = {
        "stand_off_mm": options.stand_off,
        "showing": Detectability(
            options.separation_px, options.surround_px, options.min_corner_deg
        ),
        "effort": None if effort is None else Effort.named(effort),
        "workspace": None,
        "localisation": None,
        "rng": getattr(options, "seed", 0),
        "edge_break_mm": getattr(options, "edges", None),
    }
    return InspectionOptions(**{**same, **values, **more})


def _job_again(options: Plan) -> Job:
    """Return the job whose plan a file holds."""
    for name in options.typed:
        if name not in _BESIDE_AGAIN and name not in _READING:
            raise RequestError(
                f"{name} must not be given with --again, which takes the request from the plan. "
                f"Got {name}."
            )
    path = plan_file(str(options.again))
    with named_by("again", vars(options)):
        plan = read_plan(path)
    cell = cell_again(plan, options.cell, path)
    request = plan.request
    try:
        plan_options = replace(InspectionOptions.of_request(request), cell=cell)
        part, reading = _part_again(options, path, plan.source)
    except PlanFileError as error:
        raise PlanFileError(f"{path}: {error}") from None
    if options.part is None and not Path(part).exists():
        hint = "give PART, too, if it was moved"
        raise RequestError.of_rule("part", "must be an existing file", repr(part), hint=hint)
    solid = read_as(part, reading, options)
    check_same_part(solid, plan, part, hint="plan it from its options")
    items = {target.name: target.item_of(solid) for target in request.targets}
    request, entities = resolve_request(
        solid, items, request.camera, request.pose_uncertainty, plan_options
    )
    targets = JobTargets(items, entities, request.localisation)
    return Job(request, solid, targets, plan_options, part, reading)


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
    why = plan.request.other_part(solid)
    if why:
        got = f"{path!r}, {why}"
        raise RequestError.of_rule("part", "must be the one that was planned", got, hint=hint)


# how a part's file is read
_READING = ("--units", "--solids", "--occluders", "--gap-mm")
# which file the part was read from
_OF_FILE = ("file", "relative_to")


def _part_again(options: Plan, path: Path, source: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the part's file and how it is read: as given, or as the plan stores it."""
    if options.part is not None:
        stored_reading = {name: value for name, value in source.items() if name not in _OF_FILE}
        typed = {name: value for name, value in reading_of(options).items() if value is not None}
        return options.part, {**stored_reading, **typed}
    if any(name in options.typed for name in _READING):
        raise RequestError("the part must be given with options that say how to read it. Got none.")
    if not source:
        raise PlanFileError("source must name the part's file. Got none; give PART, too.")
    reading = {name: value for name, value in source.items() if name not in _OF_FILE}
    return str(path.parent / source["file"]), reading


def workspace_of(options: Workspace) -> np.ndarray | None:
    """Return the box the camera may be in, (2, 3), mm, if one is given."""
    return None if options.workspace is None else np.reshape(options.workspace, (2, 3))

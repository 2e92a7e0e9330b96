"""Rules of the command line that are checked before anything is loaded that takes long.

An error names the option as it was typed.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.app.options import Command, rules_of
from planner.app.process import write_error
from planner.app.quantities import Count, localisation_words
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    BETWEEN_0_AND_1,
    FROM_0_BELOW_1,
    NumberRule,
    check_accuracy,
)
from planner.exceptions import CameraError, OutputError, RequestError
from planner.files import GRAPHML, PICKER, PICTURE, Kind, check_file_place

if TYPE_CHECKING:
    from planner.camera.camera import Camera

# The camera that ``--camera`` names; it loads numpy, and nothing that takes longer.


_OF_CAMERA = "must be a TOML file, or a name that 'aspectgraph cameras' lists"


def read_camera(text: str) -> Camera:
    """Return the camera of a TOML file, or the one with that name in the catalogue."""
    from planner.camera.camera import Camera

    path = Path(text)
    if path.suffix.lower() == ".toml" or path.is_file():
        try:
            return Camera.from_toml(path)
        except CameraError as error:
            kind = _kind_of_content(path)
            if kind in ("dimensions", "cell"):
                got = f"{text!r}, {_WORDS[kind]}"
                hint = f"give it to --{kind}"
                raise CameraError.of_rule("camera", _OF_CAMERA, got, hint=hint) from None
            # begins with the file, and the line that breaks a rule
            raise CameraError(f"--camera {error}") from None
    try:
        return Camera.named(text)
    except CameraError as error:
        if error.parameter != "camera":
            raise
        raise CameraError.of_rule("camera", _OF_CAMERA, error.got, hint=error.hint) from None


# What somebody at a shell knows the parameters of a call as, and errors in these words.


# options that are not named like the parameters they give
_OPTIONS = {
    "part": "the part",
    "plan": "the plan",
    "images": "the images",
    "folder": "the folder of parts",
    "covariance": "--sigma-mm or --sigma-rad",
    "pose_uncertainty": "--sigma-mm or --sigma-rad",
    "translation_mm": "--sigma-mm",
    "rotation_rad": "--sigma-rad",
    "stand_off_mm": "--stand-off",
    "lighting": "--light",
    "lamps": "--light",
    "ring": "--light",
    "step": "--grey-step",
    "registration": "--register",
    "focus_reserve": "--focus-margin-mm",
    "rng": "--seed",
    "edge_break_mm": "--edges",
    "time_limit_s": "--time-limit",
    "memory_limit_bytes": "--memory-limit",
    "bodies": "--body",
    "distances_mm": "--distances",
    "joints_rad": "--sigma-joints",
    "settle_s": "--settle",
    "post_heights_mm": "--post-heights",
    "cell.home": "home_deg of the cell file",
    "solid": "the part",
}

# digits of a number that is printed as it was typed
_LONGEST_NUMBER = 20

# fields that some commands have an option of another name for
_FIELDS = {"time_s": "read_time_limit"}
_LIMIT = re.compile(r"limits=ReadLimits\((\w+)=\.\.\.\)")

# what helps at a shell, where that is not what helps in a call, of the error with this name
_HINTS = {"MemoryLimitError": "Choose fewer entities: a plan needs no joint graph"}


def option(name: str) -> str:
    """Return the option that a user of the command line knows a parameter, or a field of a request, as.

    Parameters
    ----------
    name : str
        The parameter's name.
    """
    return _OPTIONS.get(name, f"--{name.replace('_', '-')}")


def as_typed(name: str, options: Mapping[str, Any]) -> str:
    """Return what the user of a command knows a parameter as.

    Parameters
    ----------
    name : str
        The parameter's name.
    options : mapping of str to value
        The command's options; ``typed`` holds those that were typed. Other parameters keep their
        names.
    """
    if name in ("part2base", "part2flange") and options.get("cell"):
        return f"{options['cell']}: {name}"
    if _FIELDS.get(name) in options:
        return option(_FIELDS[name])
    same = f"--{name.replace('_', '-')}"
    if same in options.get("typed", ()):
        return same
    return option(name) if name in _OPTIONS or name in options else name


def in_words_of_shell(error: Exception, options: Mapping[str, Any]) -> str:
    """Return the text of an error of ours with its parameters named as options.

    Parameters
    ----------
    error : Exception
        Holds as data what it names.
    options : mapping of str to value
        The command's options, see `as_typed`.
    """
    # the exceptions of the packages have no base in common
    data: Any = error
    mentions = getattr(data, "mentions", ())
    if data.rule:
        parameter = data.parameter and as_typed(data.parameter, options)
        rule = _worded(data.rule, mentions, options)
        worded = type(data).of_rule(parameter, rule, data.got)
    else:
        worded = type(data)(*data.args)
    if hint := getattr(data, "hint", ""):
        hint = _worded(_HINTS.get(type(data).__name__, hint), mentions, options)
        # an argument that no option gives helps nobody at a shell
        worded.hint = "" if any(mention in hint for mention in mentions) else hint
    return str(worded)


@contextmanager
def named_by(name: str, options: Mapping[str, Any]) -> Iterator[None]:
    """Let an error in the block begin with the option whose value it is about, unless it does.

    Parameters
    ----------
    name : str
        The option's name in `options`. A value that is a file is named, too.
    options : mapping of str to value
        The command's options, see `as_typed`.
    """
    from aspectgraph.exceptions import AspectGraphError
    from planner.exceptions import PlannerError

    try:
        yield
    except (AspectGraphError, PlannerError) as error:
        text = in_words_of_shell(error, options)
        if text.startswith(("--", "the part")):
            raise
        typed = as_typed(name, options)
        value = str(options[name])
        named = f"{typed} {value}" if os.path.isfile(value) else typed
        # of a file with the place of the error in it
        if text.startswith(value):
            raise type(error)(f"{typed} {text}") from error
        raise type(error)(f"{named}: {text}") from error


def _worded(text: str, mentions: Sequence[str], options: Mapping[str, Any]) -> str:
    """Return a text with the arguments that it mentions as options, where the command has them."""
    for mention in mentions:
        limit = _LIMIT.fullmatch(mention)
        name, _, value = (f"{limit[1]}=..." if limit else mention).partition("=")
        option = as_typed(name, options)
        if option != name:
            # an option that is a switch has no value
            value = "" if value in ("...", "True") else value.strip("[]").replace(", ", ",")
            text = text.replace(mention, f"{option} {value}".rstrip())
    return text


# Numbers, files and names, before any work.


# a share close to 1 needs all its digits
_IN_FULL = ("accuracy", "probability", "contrast", "share")
_OF_SHARES = (BETWEEN_0_AND_1.holds, FROM_0_BELOW_1.holds, ABOVE_0_TO_1.holds)
OF_LIGHT = ("contrast", "grey-step", "ground", "material")
"""Options that say nothing without a light."""


def check_numbers(options: Command) -> None:
    """Refuse numbers that break the rule of their option, before any work.

    Parameters
    ----------
    options : Command
        Those of one command.

    Raises
    ------
    RequestError
        If a number breaks its rule; names the option.
    """
    for name, rule in rules_of(type(options)).items():
        value = getattr(options, name)
        if value is None:
            continue
        if isinstance(rule, Count):
            _check_count(name, value, rule)
        elif not rule.accepts(value):
            got = repr(value) if name in _IN_FULL else f"{value:g}"
            hint = _percent_hint(name, value, rule)
            raise RequestError.of_rule(name, rule.text, got, hint=hint)
        elif name == "accuracy":
            check_accuracy(value)


def _percent_hint(name: str, value: float, rule: NumberRule) -> str:
    """Return how to write a share that was typed in percent without its sign; empty of other numbers."""
    if rule.holds not in _OF_SHARES or value < 2 or not rule.accepts(value / 100):
        return ""
    if name == "accuracy" and value < 50:
        return f"write {100 - value:g}% for an error of {value:g}%"
    return f"write {value:g}%"


def _check_count(name: str, value: int, rule: Count) -> None:
    if value < rule.minimum:
        raise RequestError.of_rule(name, f"must be at least {rule.minimum}", str(value))
    if value > rule.maximum:
        text = str(value)
        got = text if len(text) <= _LONGEST_NUMBER else f"a number of {len(text)} digits"
        raise RequestError.of_rule(name, f"must be at most {rule.maximum:g}", got)


def check_inputs(options: Command) -> None:
    """Refuse empty texts, files and names that are not there, and values that break a rule, before the part is read.

    Parameters
    ----------
    options : Command
        Those of one command.

    Raises
    ------
    CameraError, OutputError, RequestError
        Names the option.
    """
    values = vars(options)
    for name, value in values.items():
        if isinstance(value, str) and not value.strip():
            raise RequestError.of_rule(name, "must not be empty", repr(value))
    _check_files(values)
    if values.get("write") is not None:
        _check_new_camera(values["write"])
    if values.get("localisation") is not None:
        localisation_words(values["localisation"])
    _check_box("workspace", values.get("workspace"))
    _check_box("within", values.get("within"), flat=True)
    _check_optics(values)
    _check_image(values)
    for name, other in (("contrast", "lamps"), *((option, "light") for option in OF_LIGHT)):
        # a cell may have a light; `read_job` knows
        has_cell = other == "light" and values.get("cell")
        if f"--{name}" in values["typed"] and other in values and not (values[other] or has_cell):
            raise RequestError.of_rule(name, f"must be given with --{other}", "none")
    camera = values.get("camera")
    if camera is not None:
        _check_no_part(camera, values.get("part"))
        _tell_exchanged(read_camera(camera), camera)
    # last, because a file that can be written takes a second to check
    for name in ("picture", "graphml", "write"):
        if values.get(name):
            check_file_place(values[name], f"--{name}", _kind(name, values[name]))


def _check_no_part(camera: str, part: str | None) -> None:
    """Refuse a part in the place of the camera; say so if the part is where the camera belongs."""
    if not Path(camera).is_file() or not _is_part(camera):
        return
    rule = "must be a TOML file, or a name that 'aspectgraph cameras' lists"
    hint = ""
    if part is not None and Path(part).suffix.lower() == ".toml":
        hint = f"the camera seems to be {part!r}, so exchange the two"
    raise CameraError.of_rule("camera", rule, f"{camera!r}, a part", hint=hint)


def _is_part(path: str) -> bool:
    """Return whether the name of a file is that of a part."""
    if Path(path).suffix.lower() in ("", ".toml"):
        return False
    # loads what takes long, and a camera rarely has another ending
    from aspectgraph.read.part_file import MESH_SUFFIXES, STEP_SUFFIXES

    name = Path(path).name.lower().removesuffix(".gz")
    return name.endswith((*STEP_SUFFIXES, *MESH_SUFFIXES))


def _tell_exchanged(camera: Camera, text: str) -> None:
    """Print a note on a calibration that fits an image of exchanged width and height."""
    if not camera.seems_turned or camera.principal_point_px is None:
        return
    (across, down) = camera.principal_point_px
    (width, height) = camera.resolution
    write_error(
        f"note: --camera {text}: the principal point ({across:.6g}, {down:.6g}) is far from the middle of the "
        f"image of {width} x {height} px, and fits {height} x {width}: are width and height exchanged?"
    )


def _kind(name: str, path: str) -> Kind | None:
    """Return what kind of file an option writes; None of a camera, which replaces nothing."""
    if name == "picture":
        return PICKER if Path(path).suffix.lower() == ".html" else PICTURE
    return GRAPHML if name == "graphml" else None


# what must be there, of which kind; a part may be a pipe, too
_PLACES: dict[str, tuple[str, Callable[[Path], bool]]] = {
    "poses": ("file of poses", Path.exists),
    "part": ("file", lambda path: path.exists() and not path.is_dir()),
    "cell": ("file", Path.is_file),
    "images": ("folder", Path.is_dir),
    "folder": ("folder", Path.is_dir),
}


def _check_files(values: Mapping[str, Any]) -> None:
    """Refuse a part, a plan, a folder, and a file of what is measured, that is not there."""
    _check_not_exchanged(values.get("plan"), values.get("part"))
    for name, (kind, holds) in _PLACES.items():
        place = values.get(name)
        # --poses is a number where poses are drawn
        if isinstance(place, str) and not holds(Path(place)):
            raise RequestError.of_rule(name, f"must be an existing {kind}", _place(place))
    for name in ("plan", "again"):
        if values.get(name) is not None:
            _check_plan(name, values[name])
    register = values.get("register") or "none"
    is_word = register in ("none", "edges")
    if not is_word and not Path(register.removeprefix("edges+")).is_file():
        rule = "must be edges, none or name an existing file"
        raise RequestError.of_rule("register", rule, repr(register))
    entities = (values.get("entities") or "").strip()
    is_file = Path(entities).suffix.lower() in (".toml", ".json", ".csv")
    if is_file and not Path(entities).exists():
        raise RequestError.of_rule("entities", "must name an existing file", repr(entities))
    if is_file:
        _check_content("entities", entities, values)
    dimensions = values.get("dimensions") or "all"
    if dimensions.strip().lower() != "all" and not Path(dimensions).exists():
        rule = "must be 'all' or name an existing file"
        raise RequestError.of_rule("dimensions", rule, repr(dimensions))
    if Path(dimensions).is_file():
        _check_content("dimensions", dimensions, values)
    cell = values.get("cell")
    if isinstance(cell, str) and Path(cell).is_file():
        _check_content("cell", cell, values)


_CONTENTS = {
    "entities": "must name edges, rims or arcs, or a file of them",
    "dimensions": "must be 'all' or a file of dimensions",
    "cell": "must be a cell file, which names a robot",
}
_WORDS = {"dimensions": "a file of dimensions", "camera": "a camera file", "cell": "a cell file"}
# what any camera file has, of which a file of dimensions may use one as a name
_OF_CAMERAS = ("pixel_pitch_mm", "f_number", "focus_distance_mm")


def _check_content(name: str, path: str, values: Mapping[str, Any]) -> None:
    """Refuse a file of another kind than is asked for, such as a camera for a cell."""
    kind = _kind_of_content(Path(path))
    if kind not in ("", name):
        hint = f"give it to --{kind}" * (kind in values)
        raise RequestError.of_rule(name, _CONTENTS[name], f"{path!r}, {_WORDS[kind]}", hint=hint)


def _kind_of_content(path: Path) -> str:
    """Return the option that a TOML or JSON file seems to be meant for; empty of entities, and if it is not clear."""
    if path.suffix.lower() not in (".toml", ".json"):
        return ""
    # here, because they load what takes long
    from aspectgraph.entities.entity_rules import parse_names
    from errors.measurands.measurand import kinds

    try:
        content = parse_names(path)
    except ValueError:
        # where the file is read, the error says why
        return ""
    if not isinstance(content, dict):
        return ""
    if sum(key in content for key in _OF_CAMERAS) > 1:
        return "camera"
    robot = content.get("robot")
    if isinstance(robot, dict) and "urdf" in robot:
        return "cell"
    dimensions = content.get("dimensions", content)
    words = (*kinds(), "edge")
    if isinstance(dimensions, dict):
        for item in dimensions.values():
            if isinstance(item, dict) and any(map(item.get, words)):
                return "dimensions"
    return ""


def _check_not_exchanged(plan: Any, part: Any) -> None:
    """Refuse a part in the place of the plan, if the plan is where the part belongs."""
    if not (isinstance(plan, str) and isinstance(part, str)) or not Path(plan).is_file():
        return
    place = Path(part)
    seems_plan = place.suffix.lower() == ".json" or (place / "plan.json").exists()
    if seems_plan and _is_part(plan):
        rule = "must be an existing plan file, or its folder"
        hint = f"the plan seems to be {part!r}, so exchange the two"
        raise RequestError.of_rule("plan", rule, f"{plan!r}, a part", hint=hint)


def _check_plan(name: str, path: str) -> None:
    """Refuse a plan that is not there."""
    place = Path(path)
    if place.is_dir() and not (place / "plan.json").exists():
        rule = "must be a plan file, or the folder it is in"
        raise RequestError.of_rule(name, rule, f"{path!r}, a folder without plan.json")
    if not place.exists():
        rule = "must be an existing plan file, or its folder"
        raise RequestError.of_rule(name, rule, repr(path))


def _place(path: str) -> str:
    """Return a path, and say if it is a file or a folder."""
    if Path(path).is_dir():
        return f"{path!r}, a folder"
    return f"{path!r}, a file" if Path(path).is_file() else repr(path)


def _check_new_camera(path: str) -> None:
    """Refuse the place of a camera's file; a file that is there is kept."""
    if Path(path).suffix.lower() != ".toml":
        raise RequestError.of_rule("write", "must end in .toml", repr(path))
    if Path(path).exists():
        raise OutputError(f"--write must be a new file. Got {path!r}, which exists.")


def _check_box(name: str, numbers: Sequence[float] | None, *, flat: bool = False) -> None:
    """Refuse what is no box, which may be flat or not; whether it is around the part is known later."""
    if numbers is None:
        return
    corners = [list(numbers[:3]), list(numbers[3:])]
    ordered = all(low < high or (flat and low == high) for low, high in zip(*corners, strict=True))
    if not (ordered and all(map(math.isfinite, numbers))):
        rule = "must be finite, lower corner first"
        raise RequestError.of_rule(name, rule, str(corners))


def _check_optics(values: Mapping[str, Any]) -> None:
    """Refuse bodies and working distances that `optics` cannot try."""
    distances = values.get("distances")
    if distances is not None and not all(0 < distance < math.inf for distance in distances):
        rule = "must be finite and positive, at least one"
        raise RequestError.of_rule("distances", rule, repr(distances))
    if values.get("body"):
        # here, because it loads the catalogue
        from planner.camera.camera import check_bodies

        check_bodies(values["body"])


def _check_image(values: Mapping[str, Any]) -> None:
    """Refuse an angle that no corner has."""
    corner = values.get("min_corner_deg")
    if corner is not None and corner >= 90:
        raise RequestError.of_rule("min_corner_deg", "must be below 90", repr(corner))

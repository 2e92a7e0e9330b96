"""Rules of the command line that are checked before anything is loaded that takes long.

An error names the option as it was typed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from planner.argument_kinds import (
    ABOVE_0_TO_1,
    BETWEEN_0_AND_1,
    FROM_0_BELOW_1,
    NOT_NEGATIVE,
    POSITIVE_SECONDS,
    NumberRule,
)
from planner.cli.parsing.quantities import localisation_words
from planner.exceptions import OutputError, RequestError
from planner.files import GRAPHML, PICKER, PICTURE, Kind, check_file_place

_COUNTS = {"seed": 0, "simulate": 1, "jobs": 1, "poses": 1, "draws": 1, "graph_limit": 0, "rows": 1}
# of what is counted
_MOST = 10**9
# as `planner.request.defaults.MOST_SEED`, which takes a second to load
_MOST_SEED = 10**300
_PROMISES = ("accuracy", "probability")
# a share close to 1 needs all its digits
_IN_FULL = (*_PROMISES, "contrast", "share")
_RULES = {
    **dict.fromkeys(
        (
            "sigma_mm",
            "sigma_rad",
            "stand_off",
            "min_length",
            "min_length_px",
            "field_margin_px",
            "focus_margin_mm",
            "visibility_radius_mm",
            "separation_px",
            "surround_px",
            "min_corner_deg",
            "surfaces_mm",
        ),
        NOT_NEGATIVE,
    ),
    **dict.fromkeys(_PROMISES, BETWEEN_0_AND_1),
    "contrast": NumberRule("must lie strictly between 0 and 1", BETWEEN_0_AND_1.holds),
    "share": ABOVE_0_TO_1,
    "speed": ABOVE_0_TO_1,
    "settle": NOT_NEGATIVE,
    "sigma_joints": NOT_NEGATIVE,
    "coverage": ABOVE_0_TO_1,
    "time_limit": POSITIVE_SECONDS,
    "read_time_limit": POSITIVE_SECONDS,
    "gap": FROM_0_BELOW_1,
    "give_up": FROM_0_BELOW_1,
}
# options that say nothing without --light
_OF_LIGHT = ("contrast", "grey-step", "ground")


def check_numbers(options: Any) -> None:
    """Refuse numbers that break the rule of their option, before any work.

    Parameters
    ----------
    options : argparse.Namespace
        Those of one command; options it does not have are passed over.

    Raises
    ------
    RequestError
        If a number breaks its rule; names the option.
    """
    given = vars(options)
    for name, least in _COUNTS.items():
        value = given.get(name)
        if value is None:
            continue
        if value < least:
            raise RequestError.of_rule(name, f"must be at least {least}", str(value))
        most = _MOST_SEED if name == "seed" else _MOST
        if value > most:
            got = f"a number of {len(str(value))} digits"
            raise RequestError.of_rule(name, f"must be at most {most:g}", got)
    for name, rule in _RULES.items():
        value = given.get(name)
        if value is None or rule.accepts(value):
            continue
        hint = f"write {value:g}%" if name in _PROMISES and 2 <= value < 100 else ""
        got = repr(value) if name in _IN_FULL else f"{value:g}"
        raise RequestError.of_rule(name, rule.text, got, hint=hint)


def check_inputs(options: Any) -> None:
    """Refuse empty texts, files and names that are not there, and values that break a rule, before the part is read.

    Parameters
    ----------
    options : argparse.Namespace
        Those of one command; options it does not have are passed over.

    Raises
    ------
    CameraError, OutputError, RequestError
        Names the option.
    """
    given = vars(options)
    for name, value in given.items():
        if isinstance(value, str) and not value.strip():
            raise RequestError.of_rule(name, "must not be empty", repr(value))
    _check_files(given)
    if given.get("write") is not None:
        _check_new_camera(given["write"])
    if given.get("localisation") is not None:
        localisation_words(given["localisation"])
    _check_box("workspace", given.get("workspace"))
    _check_box("within", given.get("within"), flat=True)
    _check_optics(given)
    _check_image(given)
    for name, other in (("contrast", "lamps"), *((one, "light") for one in _OF_LIGHT)):
        if f"--{name}" in given["typed"] and other in given and not given[other]:
            raise RequestError.of_rule(name, f"must be given with --{other}", "none")
    camera = given.get("camera")
    if camera is not None:
        # here, because it loads numpy
        from planner.cli.parsing.camera_option import read_camera

        read_camera(camera)
    # last, because a file that can be written takes a second to check
    for name in ("picture", "graphml", "write"):
        if given.get(name):
            check_file_place(given[name], f"--{name}", _kind(name, given[name]))


def _kind(name: str, path: str) -> Kind | None:
    """Return what kind of file an option writes; None of a camera, which replaces nothing."""
    if name == "picture":
        return PICKER if Path(path).suffix.lower() == ".html" else PICTURE
    return GRAPHML if name == "graphml" else None


def _check_files(given: Mapping[str, Any]) -> None:
    """Refuse a part, a plan, a folder, and a file of what is measured, that is not there."""
    part = given.get("part")
    if part is not None and (Path(part).is_dir() or not Path(part).exists()):
        rule = "must be an existing file"
        raise RequestError.of_rule("part", rule, _place(part))
    for name in ("plan", "again"):
        if given.get(name) is not None:
            _check_plan(name, given[name])
    cell = given.get("cell")
    if cell is not None and not Path(cell).is_file():
        raise RequestError.of_rule("cell", "must be an existing file", _place(cell))
    images = given.get("images")
    if images is not None and not Path(images).is_dir():
        raise RequestError.of_rule("images", "must be an existing folder", _place(images))
    register = given.get("register")
    if (
        register not in (None, "none", "edges")
        and not Path(register.removeprefix("edges+")).is_file()
    ):
        rule = "must be edges, none or name an existing file"
        raise RequestError.of_rule("register", rule, repr(register))
    folder = given.get("folder")
    if folder is not None and not Path(folder).is_dir():
        raise RequestError.of_rule("folder", "must be an existing folder", _place(folder))
    entities = (given.get("entities") or "").strip()
    is_file = Path(entities).suffix.lower() in (".toml", ".json", ".csv")
    if is_file and not Path(entities).exists():
        raise RequestError.of_rule("entities", "must name an existing file", repr(entities))
    dimensions = given.get("dimensions") or "all"
    if dimensions.strip().lower() != "all" and not Path(dimensions).exists():
        rule = "must be 'all' or name an existing file"
        raise RequestError.of_rule("dimensions", rule, repr(dimensions))


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


def _check_optics(given: Mapping[str, Any]) -> None:
    """Refuse bodies and working distances that `optics` cannot try."""
    distances = given.get("distances")
    if distances is not None and not all(0 < one < math.inf for one in distances):
        rule = "must be finite and positive, at least one"
        raise RequestError.of_rule("distances", rule, repr(distances))
    if given.get("body"):
        # here, because it loads the catalogue
        from planner.camera.catalogue import check_bodies

        check_bodies(given["body"])


def _check_image(given: Mapping[str, Any]) -> None:
    """Refuse an angle that no corner has."""
    corner = given.get("min_corner_deg")
    if corner is not None and corner >= 90:
        raise RequestError.of_rule("min_corner_deg", "must be below 90", repr(corner))

"""The lamps that the command line asks for: ``--light``, ``--contrast``, ``--grey-step`` and ``--ground``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph.entities.entity_files import parse_names
from aspectgraph.light.contrast import check_contrast
from planner.exceptions import RequestError
from planner.light.lamps import RING, LampBox, LampDome, check_lamps_given
from planner.light.lighting import Lighting, check_step
from planner.light.plan_light import chosen_lamps

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.progress import Progress

_RULE = (
    "--light must be ring, box:X0,Y0,Z0,X1,Y1,Z1, dome:X,Y,Z,RADIUS[,LOWEST], at:X,Y,Z[;X,Y,Z...] in mm, or a TOML "
    "file with lamps = [[X, Y, Z], ...]."
)


def read_lighting(options: Any) -> Lighting | None:
    """Return what is asked of lamps; None if nothing is.

    Raises
    ------
    RequestError, LightError
        If the words have no meaning, or a number breaks its rule.
    """
    check_contrast(options.contrast)
    check_step(options.grey_step)
    if options.together and options.light in (None, RING):
        given = "no --light" if options.light is None else f"--light {options.light}"
        raise RequestError(f"--together needs lamps by --light at, box or dome. Got {given}.")
    lamps = _lamps(options.light)
    if lamps is None:
        return None
    return Lighting(
        lamps, options.contrast, options.grey_step, options.ground, together=options.together
    )


def _lamps(text: str | None) -> Any:
    if text is None or text == RING:
        return text
    name, _, numbers = text.partition(":")
    if name == "at":
        return check_lamps_given([_numbers(place, text) for place in numbers.split(";")])
    if name == "box":
        values = _numbers(numbers, text)
        if len(values) == 6:
            return LampBox((values[0], values[1], values[2]), (values[3], values[4], values[5]))
    elif name == "dome":
        values = _numbers(numbers, text)
        if len(values) in (4, 5):
            return LampDome((values[0], values[1], values[2]), *values[3:])
    elif Path(text).suffix.lower() == ".toml":
        return check_lamps_given(_from_file(Path(text)))
    raise RequestError(f"{_RULE} Got {text!r}.")


def with_light(
    found: InspectionPlan, solid: Solid, lighting: Lighting | None, progress: Progress | None
) -> InspectionPlan:
    """Return a plan with the lamps asked for, if it has none yet: the best one before an interruption has not."""
    if lighting is None or found.light is not None:
        return found
    return replace(found, light=chosen_lamps(lighting, found, solid, progress))


def _numbers(text: str, whole: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise RequestError(f"{_RULE} Got {whole!r}.") from None


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

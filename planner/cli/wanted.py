"""What the command line asks to be inspected: edges, or dimensions of a file or of the model itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph import (
    ReadError,
    ReadLimits,
    read_dimensions,
    read_entities,
    resolve_entities,
    select_entities,
)
from errors.exceptions import InvalidParameterError
from errors.measurands import Localisation, kinds
from errors.measurands.localisation import FLOOR_PX
from planner.cli.naming import named_by, option
from planner.cli.parsing.quantities import localisation_words
from planner.exceptions import RequestError
from planner.progress import reading_shown
from planner.report.wording import count
from planner.wanted.assumed import SURFACES_MM
from planner.wanted.dimension_files import read_wanted
from planner.wanted.model_dimensions import dimensions_to_plan
from planner.wanted.places import with_places
from planner.wanted.resolve import resolve_wanted

if TYPE_CHECKING:
    from aspectgraph import Entity, ModelDimension, Solid

_OF_MODEL = ("one_per_pattern", "reference_dimensions", "no_basic_dimensions")
"""Options that choose among the dimensions of the model."""

_LEFT_OUT = {
    "reference": "see --reference-dimensions",
    "basic": "plan without --no-basic-dimensions",
}
"""What to do about dimensions that their role leaves out."""


@dataclass(frozen=True)
class Wanted:
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


def read_request(options: Any, solid: Solid) -> Wanted:
    """Return what the options of `plan` ask for.

    Raises
    ------
    RequestError, ReadError, EntityError
        If they ask for what is not there, or break a rule.
    """
    for name in _OF_MODEL:
        if getattr(options, name) and not _all_of_model(options):
            got = "none" if options.dimensions is None else repr(options.dimensions)
            raise RequestError(f"{option(name)} must be given with --dimensions all. Got {got}.")
    if options.dimensions is None:
        localisation = read_localisation(options.localisation or "rounding")
        if "--share" in options.typed:
            raise RequestError("--share must be given with --dimensions. Got none.")
        entities = chosen_entities(options, solid)
        # what cannot be measured is refused before the work
        with named_by("entities" if options.select is None else "select", vars(options)):
            resolve_wanted(solid, entities, options.accuracy)
        return Wanted(entities, entities, localisation)
    localisation = read_localisation(options.localisation or "gaussian")
    with named_by("dimensions", vars(options)):
        return _wanted_dimensions(options, solid, localisation)


def _all_of_model(options: Any) -> bool:
    return options.dimensions is not None and options.dimensions.strip().lower() == "all"


def _wanted_dimensions(options: Any, solid: Solid, localisation: Localisation) -> Wanted:
    """Return the dimensions of the model, or those of a file."""
    left_out: dict[str, str] = {}
    items: Mapping[str, Any]
    if _all_of_model(options):
        stated = _stated(options, solid)
        items, left_out = dimensions_to_plan(
            stated,
            share=options.share,
            one_per_pattern=options.one_per_pattern,
            reference=options.reference_dimensions,
            basic=not options.no_basic_dimensions,
        )
        if not items:
            raise _nothing_to_plan(stated, options.part)
    else:
        items = with_places(solid, read_wanted(Path(options.dimensions), kinds(), options.share))
    rounded = localisation.model == "rounding"
    entities, _ = resolve_wanted(solid, items, options.accuracy, as_lengths=not rounded)
    return Wanted(items, entities, localisation, left_out)


def _nothing_to_plan(stated: Iterable[ModelDimension], part: str) -> RequestError:
    """Return the error of a model without a dimension to plan; it counts those left out by their role."""
    roles = Counter(one.role for one in stated if one.entities is not None)
    texts = [
        f"{count(roles[role], f'{role} dimension')} {'is' if roles[role] == 1 else 'are'} left out: {advice}"
        for role, advice in _LEFT_OUT.items()
        if roles[role]
    ]
    error = RequestError(
        f"--dimensions all needs a dimension that can be measured. Got none in {part}."
    )
    error.hint = ". ".join(texts)
    return error


def chosen_entities(options: Any, solid: Solid) -> dict[str, Entity]:
    """Return the entities that ``--entities`` or ``--select`` stand for.

    Raises
    ------
    EntityError
        If there are none, or the text breaks a rule.
    """
    with named_by("entities" if options.select is None else "select", vars(options)):
        if options.select is None:
            return read_entities(options.entities, solid)
        return resolve_entities(solid, select_entities(solid, options.select))


def read_limits(options: Any) -> ReadLimits:
    """Return what reading the part may take."""
    seconds = options.read_time_limit
    return ReadLimits() if seconds is None else ReadLimits(time_s=seconds)


def _stated(options: Any, solid: Solid) -> tuple[ModelDimension, ...]:
    part = options.part
    with reading_shown(quiet=options.quiet, lines=options.verbose):
        stated = read_dimensions(part, solid, limits=read_limits(options))
    if not stated:
        raise ReadError(
            f"the part must be a STEP file with semantic dimensions (AP242). Got {part}, which states none; a file of "
            "dimensions can be given instead."
        )
    return stated


def localisation_text(options: Any, items: Mapping[str, Any]) -> str:
    """Say which error of points in the image was assumed, if it was not chosen.

    Edges of ``--entities`` are measured as in the paper, and dimensions with the error that edge
    detectors have. So the same feature has another probability by the other option.

    Parameters
    ----------
    options : argparse.Namespace
        Those of `plan` or `optics`.
    items : mapping
        What is to be inspected.

    Returns
    -------
    str
        One sentence; empty if ``--localisation`` was given, or a stored request is planned again.
    """
    if options.localisation is not None or getattr(options, "again", None) is not None:
        return ""
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
        own = sum(bool(getattr(item, "surfaces_from", "")) for item in items.values())
        if own:
            faces += (
                f"For {own} of {len(items)} dimensions, the error follows from flatness and profile tolerances of the "
                "model. "
            )
    return (
        "note: points in the image have errors of 0.1 px, and of 0.05 px that all points of an edge or rim share "
        f"(--localisation gaussian:0.1:0.05), the default with --dimensions. {faces}Without --dimensions, points are "
        "rounded to whole pixels"
    )


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
        found: Localisation = makers[name](*numbers)
    except InvalidParameterError as error:
        raise RequestError(f"--localisation: {error}") from error
    return found

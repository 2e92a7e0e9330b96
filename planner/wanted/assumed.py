"""What is assumed of points in the image and of the part's faces where a request does not say it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from errors.checks import check_not_negative
from errors.exceptions import InvalidParameterError
from errors.measurands.localisation import Localisation
from planner.exceptions import RequestError
from planner.wanted.dimension import Dimension

if TYPE_CHECKING:
    from aspectgraph.dimensions import SurfaceZone

SURFACES_MM = 0.02
"""Standard deviation of a face's position along its normal, mm, where it is not given.

A place within a zone of 0.07 mm has it, if all of the zone is equally likely: 0.07 / sqrt(12). That is between the
tolerance grades IT8 (0.054 mm) and IT9 (0.087 mm) of sizes of 80 to 120 mm (ISO 286-1), which milling holds.
"""


def surfaces_of_zone(zone: SurfaceZone | None) -> tuple[float | None, str]:
    """Return how far a face is off its place by a tolerance of the model, and that tolerance in words.

    Every place in a zone of width t is taken as equally likely: t / sqrt(12), the standard deviation where only limits
    are known (JCGM 100:2008, 4.3.7). A zone that does not say where the face is makes nothing better than the default.

    Parameters
    ----------
    zone : SurfaceZone or None
        The zone; None if the model states none.

    Returns
    -------
    (float or None, str)
        One standard deviation, mm, and such as "profile 0.1 mm". None and an empty text without a zone.
    """
    if zone is None:
        return None, ""
    sigma = zone.width_mm / math.sqrt(12.0)
    return (
        sigma if zone.places else max(sigma, SURFACES_MM),
        f"{zone.tolerance} {zone.width_mm:.4g} mm",
    )


def with_surfaces_of_call(
    items: Mapping[str, Any], surfaces_mm: float | None, localisation: Localisation
) -> dict[str, Any]:
    """Return what is wanted without the positions of faces that follow from the model, if those of the call apply.

    Parameters
    ----------
    items : mapping of str to value
        What is wanted, by name.
    surfaces_mm : float or None
        Position of the faces, as it was given. If it was, it takes the place of the model's.
    localisation : Localisation
        With whole pixels, faces are where the model has them, if nothing was given.
    """
    if surfaces_mm is None and localisation.model != "rounding":
        return dict(items)
    return {
        name: replace(item, surfaces_mm=None, surfaces_from="")
        if isinstance(item, Dimension) and item.surfaces_from
        else item
        for name, item in items.items()
    }


def localisation_or_default(
    localisation: Localisation | None, items: Iterable[Any]
) -> Localisation:
    """Return how well points are found.

    Parameters
    ----------
    localisation : Localisation or None
        As it was given.
    items : iterable
        What is wanted. Without a `Dimension`, values of edges, rims and arcs are measured as in the paper.

    Returns
    -------
    Localisation
        By default that of sub-pixel work for dimensions, otherwise whole pixels.
    """
    if localisation is not None:
        return localisation
    if any(isinstance(item, Dimension) for item in items):
        return Localisation.gaussian()
    return Localisation.rounding()


def surfaces_or_default(surfaces_mm: float | None, localisation: Localisation | None) -> float:
    """Return how far faces are off their place, one standard deviation, mm.

    Parameters
    ----------
    surfaces_mm : float or None
        As it was given.
    localisation : Localisation or None
        With whole pixels, which are the paper's model, nothing is assumed; None is whole pixels.

    Returns
    -------
    float
        0 or more, mm.

    Raises
    ------
    RequestError
        If it is negative or not finite.
    """
    if surfaces_mm is None:
        rounded = localisation is None or localisation.model == "rounding"
        return 0.0 if rounded else SURFACES_MM
    try:
        return check_not_negative(surfaces_mm, "surfaces_mm")
    except InvalidParameterError as error:
        raise RequestError.of_rule(
            "surfaces_mm", error.rule or "must be a number", error.got or repr(surfaces_mm)
        ) from None

"""Dimensions of a CAD model as a request: one characteristic for each feature of a pattern."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from aspectgraph.dimensions.records import unique_names
from planner.argument_kinds import check_kinds
from planner.exceptions import RequestError
from planner.wanted.assumed import surfaces_of_zone
from planner.wanted.dimension import QUARTER, Dimension
from planner.wanted.words.feature_counts import characteristic_name

if TYPE_CHECKING:
    from aspectgraph import ModelDimension
    from aspectgraph.dimensions.records import SurfaceZone, Way


ROLE_REASONS = {
    "reference": "it is a reference dimension, given for information only",
    "basic": "it is a basic dimension, theoretically exact and without a tolerance of its own",
}
"""Why a dimension of the model is not planned although it can be measured, by its role."""


def dimensions_to_plan(
    stated: Iterable[ModelDimension],
    *,
    share: float = QUARTER,
    one_per_pattern: bool = False,
    reference: bool = False,
    basic: bool = True,
) -> tuple[dict[str, Dimension], dict[str, str]]:
    """Turn dimensions of a CAD model into a request for `plan_inspection`.

    A characteristic is one dimension on one feature. A dimension of 30 holes becomes 30
    characteristics, such as ``"Linear Size.11 [3 of 30]"``. Each has its own entities.
    Reference dimensions are left out, because they are given for information only.

    Parameters
    ----------
    stated : iterable of ModelDimension
        The dimensions, as `aspectgraph.read_dimensions` returns them.
    share : float
        Permitted error as a share of half the tolerance's width, in (0, 1].
    one_per_pattern : bool
        Measure each dimension on one of its features. The plan then counts the others as not
        planned.
    reference : bool
        Plan reference dimensions, too.
    basic : bool
        Plan basic dimensions, which are theoretically exact. They have no tolerance of their own,
        so the accuracy of the call applies.

    Returns
    -------
    wanted : dict of str to Dimension
        The characteristics that can be measured, in the order of the model.
    left_out : dict of str to str
        The others, with the reason.

    Raises
    ------
    RequestError
        If a tolerance or the share breaks its rule, or an item is no ModelDimension.

    Examples
    --------
    >>> from aspectgraph import read_dimensions, read_solid
    >>> from planner import dimensions_to_plan
    >>> part = "examples/nist_ctc_03_ap242.stp.gz"
    >>> stated = read_dimensions(part, read_solid(part))
    >>> wanted, left_out = dimensions_to_plan(stated)
    >>> len(stated), len(wanted)
    (10, 13)
    >>> left_out
    {'Linear Size.11': 'it is a reference dimension, given for information only'}
    >>> [name for name in wanted if name.startswith("Linear Size.5")]
    ['Linear Size.5 [1 of 2]', 'Linear Size.5 [2 of 2]']
    """
    omitted = [
        role for role, planned in (("reference", reference), ("basic", basic)) if not planned
    ]
    found = [item for one in stated for item in _items(one, share, one_per_pattern, omitted)]
    # the model may already use a name that a feature of a pattern gets
    names = unique_names([name for name, _ in found])
    wanted: dict[str, Dimension] = {}
    left_out: dict[str, str] = {}
    for name, (_, item) in zip(names, found, strict=True):
        if isinstance(item, Dimension):
            wanted[name] = item
        else:
            left_out[name] = item
    return wanted, left_out


def _items(
    stated: ModelDimension, share: float, one_per_pattern: bool, omitted: Sequence[str]
) -> list[tuple[str, Dimension | str]]:
    """Return the name of each characteristic, with its request or the reason why it has none."""
    check_kinds(stated=(stated, "ModelDimension"))
    if stated.role is not None and stated.role in omitted:
        return [(stated.name, ROLE_REASONS[stated.role])]
    if stated.entities is None:
        return [(stated.name, stated.reason or "")]
    # without a list of features the entities are those of the only one
    own = [k for k, ways in enumerate(stated.features) if ways and ways[0] == stated.entities]
    first = stated.features[own[0]] if own else (stated.entities,)
    n = len(stated.features)
    # of records that were made by hand, none may be stated
    zones = stated.surfaces or (None,) * n
    if one_per_pattern or n == 1:
        zone = zones[own[0]] if own else None
        count = stated.n_features if one_per_pattern else 1
        return [(stated.name, _dimension(stated, first, share, zone, count))]
    found: list[tuple[str, Dimension | str]] = []
    for k, (ways, reason) in enumerate(zip(stated.features, stated.feature_reasons, strict=True)):
        item = _dimension(stated, ways, share, zones[k]) if ways else reason or ""
        found.append((characteristic_name(stated.name, k + 1, n), item))
    return found


def _dimension(
    stated: ModelDimension,
    ways: Sequence[Way],
    share: float,
    zone: SurfaceZone | None,
    n_features: int = 1,
) -> Dimension:
    """Return a dimension of the model, on any of the sets of entities given, with its own tolerance."""
    along = stated.direction if stated.kind in ("distance", "centre_distance") else None
    surfaces_mm, surfaces_from = surfaces_of_zone(zone)
    try:
        return Dimension(
            stated.kind,
            ways[0],
            tolerance=stated.tolerance,
            share=share,
            direction=along,
            n_features=n_features,
            alternatives=tuple(ways[1:]),
            surfaces_mm=surfaces_mm,
            surfaces_from=surfaces_from,
        )
    except RequestError as error:
        raise RequestError(f"dimension {stated.name!r}: {error}") from error

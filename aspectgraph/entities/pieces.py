"""Which parts of edges, rims and arcs are worth looking at: the default pieces of each."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

from aspectgraph.entities.parts import Run, Stretch
from aspectgraph.exceptions import EntityError
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid

MOST_PIECES = 12
"""Default for the largest number of pieces of an edge, and for the number of runs of a rim."""

COVERAGE = 0.8
"""Default for the share of a rim's chords that a run holds."""

# Parts whose coordinates are round have grids of many twos, so such a cut is a point of the grid.
_EVEN_CUTS = 1 << 8
_FACING_CUTS = 1 << 10
# of projected ends, in parts of a cut
_ROUNDING = 1e-6


def pieces_of_edge(
    solid: Solid,
    edge: int,
    length_mm: float,
    at_most: int = MOST_PIECES,
    cuts: Iterable[Fraction] = (),
) -> tuple[Stretch, ...]:
    """Cut an edge into stretches of about equal length.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : int
        Id of the edge.
    length_mm : float
        Wanted largest length of a piece in mm.
    at_most : int
        Largest number of pieces, not counting those that `cuts` make.
    cuts : iterable of Fraction
        Further shares at which to cut the edge, such as those of `facing_cuts`.

    Returns
    -------
    tuple of Stretch
        In order along the edge, without gaps. It is empty if the whole edge is one piece.

    Raises
    ------
    EntityError
        If the solid has no such edge, or a number is out of range.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid, pieces_of_edge
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> [str(piece) for piece in pieces_of_edge(box, 1, 20.0)]
    ['1[0:1/2]', '1[1/2:1]']
    """
    _check_edge(solid, edge)
    if not length_mm > 0:
        raise EntityError.of_rule("length_mm", "must be positive", str(length_mm))
    if at_most < 1:
        raise EntityError.of_rule("at_most", "must be at least 1", str(at_most))
    n = int(min(at_most, max(1, ceil(solid.edge_length_mm(edge) / length_mm - 1e-9))))
    places = {_rounded(Fraction(k, n), _EVEN_CUTS) for k in range(n + 1)}
    places |= {Fraction(cut) for cut in cuts if 0 < cut < 1}
    if len(places) == 2:
        return ()
    return tuple(Stretch(edge, *ends) for ends in pairwise(sorted(places)))


def facing_cuts(solid: Solid, edge: int, other: int) -> tuple[Fraction, ...]:
    """Return where an edge begins and ceases to face another one: the other's ends, projected on it.

    Parameters
    ----------
    solid : Solid
        The part.
    edge, other : int
        Ids of the two edges.

    Returns
    -------
    tuple of Fraction
        None, one or two shares of the edge's length from its first vertex, ascending. They are
        rounded to 1/1024 of it, into the part that faces the other edge.

    Raises
    ------
    EntityError
        If the solid has no such edge.

    Examples
    --------
    >>> from aspectgraph import facing_cuts, read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> [round(60 * cut, 2) for cut in map(float, facing_cuts(block, 0, 11))]
    [20.04, 39.96]
    """
    for edge_id in (edge, other):
        _check_edge(solid, edge_id)
    start, end = solid.edge_points(edge)
    along = end - start
    shares = sorted(
        sum(p * q for p, q in zip(point - start, along, strict=True)) / (along**2).sum()
        for point in solid.edge_points(other)
    )
    first = ceil(_FACING_CUTS * float(shares[0]) - _ROUNDING)
    last = floor(_FACING_CUTS * float(shares[1]) + _ROUNDING)
    if not max(first, 0) < min(last, _FACING_CUTS):
        return ()
    cuts = (Fraction(first, _FACING_CUTS), Fraction(last, _FACING_CUTS))
    return tuple(cut for cut in cuts if 0 < cut < 1)


def runs_of(curve: Arc, coverage: float = COVERAGE, at_most: int = MOST_PIECES) -> tuple[Run, ...]:
    """Return runs of a rim or arc that hold a share of its chords, evenly spread.

    Parameters
    ----------
    curve : Rim or Arc
        The rim or arc.
    coverage : float
        Least share of its chords that a run holds, above 0 and at most 1.
    at_most : int
        Largest number of runs.

    Returns
    -------
    tuple of Run
        In order of their first joint, without the whole curve.

    Raises
    ------
    EntityError
        If a number is out of range.

    Examples
    --------
    >>> from aspectgraph import read_solid, runs_of
    >>> rim = read_solid("examples/nist_ctc_01_ap242.stp").rims()[0]
    >>> [str(run) for run in runs_of(rim, 0.75, 2)]
    ['r0[0:9]', 'r0[6:3]']
    """
    if not 0 < coverage <= 1:
        raise EntityError.of_rule("coverage", "must be above 0 and at most 1", str(coverage))
    if at_most < 1:
        raise EntityError.of_rule("at_most", "must be at least 1", str(at_most))
    n = len(curve.edge_ids)
    held = ceil(coverage * n - 1e-9)
    if held >= n:
        return ()
    if isinstance(curve, Rim):
        at_most = min(at_most, n)
        firsts = [k * n // at_most for k in range(at_most)]
        return tuple(Run(curve.id, first, (first + held) % n) for first in firsts)
    spare = n - held
    steps = max(1, min(at_most - 1, spare))
    firsts = sorted({k * spare // steps for k in range(steps + 1)})[:at_most]
    return tuple(Run(curve.id, first, first + held) for first in firsts)


def _rounded(share: Fraction, parts: int) -> Fraction:
    return Fraction(round(share * parts), parts)


def _check_edge(solid: Solid, edge: int) -> None:
    if isinstance(edge, bool) or not 0 <= edge < len(solid.edges):
        raise EntityError.of_rule(
            "edge", f"must be one of the solid's, 0..{len(solid.edges) - 1}", repr(edge)
        )

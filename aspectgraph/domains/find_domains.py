"""Viewing domains: connected unions of equally labelled cells, and what they share.

Slivers. Where snapping displaced vertices, planes that ought to meet in one line or point miss each other and leave
cells thinner than any robot can aim. A *sliver* is a cell that holds no ball as wide as the least width at its place;
snapping turns planes, so slivers widen with distance, and so does the least width (`Ruler`). Only where a wide cell
runs out into a thinner one of its list, a *tail* (`find_tails`), the two belong together, as they do where no plane
cuts them apart. The graph is that of the partition with its slivers shrunk to nothing:

* two other cells *touch* where they share a face, and where faces of theirs lie opposite each other across slivers;
  it counts where their sets of cells do so in a plane region that holds a disc as wide as the least width;
* a domain is a component of equally labelled cells that touch, and two domains are adjacent where cells of theirs touch
  in a region half as wide again.

So a sliver neither joins nor parts anything, whatever its own label, and a cut that takes a sliver off a wide cell
changes nothing. Its volume goes to the domain with its label if that borders on it in a wide face; else it is counted,
and its volume goes to the neighbour it shares most boundary with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aspectgraph.cells.arrays import INSIDE, Complex
from aspectgraph.cells.measure import interfaces
from aspectgraph.cells.split import leaves
from aspectgraph.domains.contacts import Touching
from aspectgraph.domains.thin_ends import find_tails
from aspectgraph.domains.width import CellWidths, Ruler


@dataclass(repr=False)
class Domain:
    """One viewing domain.

    Attributes
    ----------
    label : tuple of int
        Words of the entities' bits.
    cells : ndarray of int
        Its convex cells.
    volume : float
        In cubic grid steps.
    viewpoint : ndarray, shape (3,)
        Centre of the largest ball inside one of its cells, among balls as wide as the least width at their place.
    clearance : float
        Radius of that ball, in grid steps.
    """

    label: tuple[int, ...]
    cells: np.ndarray
    volume: float
    viewpoint: np.ndarray
    clearance: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<Domain: {len(self.cells)} cells, {self.volume:.4g} cubic steps, clearance {self.clearance:.4g} steps>"


@dataclass
class Contact:
    """Common boundary of two domains: its area in squared steps, by plane."""

    area: float = 0.0
    planes: dict[int, float] = field(default_factory=dict)


@dataclass
class Domains:
    """All viewing domains of a complex.

    Attributes
    ----------
    domains : list of Domain
    contacts : dict
        Contact of each pair (i, j), i < j, of adjacent domains.
    of_cell : ndarray of int, shape (n,)
        Domain of each cell, -1 inside the solid.
    n_slivers : int
        Connected, equally labelled slivers that joined a domain with another list.
    """

    domains: list[Domain]
    contacts: dict[tuple[int, int], Contact]
    of_cell: np.ndarray
    n_slivers: int


class _Borders(NamedTuple):
    """Faces between pairs of cells: the cells (n, 2), areas, widths and distances of the farthest corner, in steps."""

    pairs: np.ndarray
    areas: np.ndarray
    widths: np.ndarray
    farthest: np.ndarray

    def at(self, chosen: np.ndarray) -> _Borders:
        """Return those with a chosen cell on a side."""
        rows = chosen[self.pairs].any(axis=1)
        return _Borders(*(column[rows] for column in self))


def find_domains(cx: Complex, ruler: Ruler) -> Domains:
    """Merge equally labelled cells that touch.

    Parameters
    ----------
    cx : Complex
        Labelled, and carved.
    ruler : Ruler
        What is too narrow to count.
    """
    present = leaves(cx)
    free = present[(cx.label[present, -1] & INSIDE) == 0]
    n = int(present.max()) + 1
    labels, label_of = np.unique(cx.label[free], axis=0, return_inverse=True)
    label = np.full(n, -1)
    label[free] = label_of.ravel()
    sides, sizes = interfaces(cx)
    keep = (label[sides[:, :2]] >= 0).all(axis=1)
    sides = sides[keep]
    sizes = sizes[keep]
    widths = CellWidths(cx, free, n)
    is_thin = widths.are_thin(ruler, sides, label)
    tails = find_tails(cx, sides, sizes[:, 0], label, is_thin, ruler)
    is_sliver = is_thin & (tails < 0)
    touching = Touching(cx, sides, sizes, is_sliver, ruler)
    of_cell, n_domains = _join(touching, label, free[~is_sliver[free]], tails)
    n_slivers = 0
    if is_sliver.any():
        borders = _Borders(sides[:, :2], *sizes.T).at(is_sliver)
        n_domains, n_slivers = _absorb(
            of_cell, n_domains, label, free, widths.volume, borders, ruler
        )
    members = _members(of_cell, free, n_domains)
    domains = [_domain(cells, labels, label, is_thin, widths, ruler) for cells in members]
    order = sorted(range(n_domains), key=lambda d: _order_key(domains[d]))
    rank = np.empty(n_domains, int)
    rank[order] = np.arange(n_domains)
    of_cell[of_cell >= 0] = rank[of_cell[of_cell >= 0]]
    return Domains(
        [domains[d] for d in order],
        _contacts(of_cell, touching.judged_by(ruler.for_contacts())),
        of_cell,
        n_slivers,
    )


def _join(
    touching: Touching, label: np.ndarray, counted: np.ndarray, tails: np.ndarray
) -> tuple[np.ndarray, int]:
    """Domain of each cell, -1 for slivers and inside the solid, and the number of domains."""
    tail = np.flatnonzero(tails >= 0)
    same = np.flatnonzero(label[touching.cells[:, 0]] == label[touching.cells[:, 1]])
    links = [
        touching.cells[same[touching.certainly_wide()[same]]],
        np.column_stack([tail, tails[tail]]),
    ]
    group = _components(np.concatenate(links), len(label))
    for k in touching.doubtful(same):
        one, other = group[touching.cells[k]]
        if one != other and touching.is_wide(k):
            group[group == other] = one
    joined = True
    while joined:
        joined = False
        for _, rows in list(_by_pair(group[touching.cells], same)):
            one, other = group[touching.cells[rows[0]]]
            if one != other and touching.are_wide_together(rows):
                group[group == other] = one
                joined = True
    of_cell = np.full(len(label), -1)
    names, of_cell[counted] = np.unique(group[counted], return_inverse=True)
    return of_cell, len(names)


def _by_pair(ends: np.ndarray, rows: np.ndarray) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
    """Yield each pair of different ends, lower first, and those of the rows that have it."""
    pairs = np.sort(ends[rows], axis=1)
    outer = pairs[:, 0] != pairs[:, 1]
    if outer.any():
        names, place = np.unique(pairs[outer], axis=0, return_inverse=True)
        order = np.argsort(place.ravel(), kind="stable")
        parts = np.split(
            rows[outer][order], np.searchsorted(place.ravel()[order], np.arange(1, len(names)))
        )
        yield from zip(map(tuple, names.tolist()), parts, strict=True)


def _components(links: np.ndarray, n: int) -> np.ndarray:
    return connected_components(
        coo_array((np.ones(len(links)), links.T), shape=(n, n)), directed=False
    )[1]


def _absorb(
    of_cell: np.ndarray,
    n_domains: int,
    label: np.ndarray,
    free: np.ndarray,
    volume: np.ndarray,
    borders: _Borders,
    ruler: Ruler,
) -> tuple[int, int]:
    """Give every sliver a domain, in place; return the number of domains and of slivers with another list than theirs.

    Slivers that border on no domain, as between displaced faces of the solid, stay without, unless there is no domain.
    """
    pairs = borders.pairs
    areas = borders.areas
    alike = (label[pairs[:, 0]] == label[pairs[:, 1]]) & (
        borders.widths >= ruler.least_width(borders.farthest)
    )
    _spread(of_cell, np.arange(len(of_cell)), pairs[alike], areas[alike])
    left = free[of_cell[free] < 0]
    sliver = _components(pairs[alike & (of_cell[pairs] < 0).all(axis=1)], len(of_cell))
    n_slivers = len(np.unique(sliver[left]))
    if n_domains == 0:
        of_cell[left[sliver[left] == np.argmax(np.bincount(sliver[left], volume[left]))]] = 0
        n_domains = 1
        n_slivers = n_slivers - 1
    _spread(of_cell, sliver, pairs, areas)
    return n_domains, n_slivers


def _spread(of_cell: np.ndarray, unit: np.ndarray, pairs: np.ndarray, areas: np.ndarray) -> None:
    """Give units of cells without a domain that of the neighbours they share most boundary with, until none is left."""
    while True:
        found = of_cell[pairs]
        rows = np.flatnonzero((found >= 0).sum(axis=1) == 1)
        if not len(rows):
            return
        column = (found[rows, 0] >= 0).astype(int)
        lacking = unit[pairs[rows, column]]
        keys, place = np.unique(
            np.column_stack([lacking, found[rows, 1 - column]]), axis=0, return_inverse=True
        )
        shared = np.bincount(place.ravel(), areas[rows])
        best = np.lexsort([shared, keys[:, 0]])
        chosen = np.full(len(unit), -1)
        chosen[keys[best, 0]] = keys[best, 1]
        open_cells = np.flatnonzero(of_cell < 0)
        open_cells = open_cells[np.isin(unit[open_cells], keys[:, 0])]
        of_cell[open_cells] = chosen[unit[open_cells]]


def _members(of_cell: np.ndarray, free: np.ndarray, n_domains: int) -> list[np.ndarray]:
    placed = free[of_cell[free] >= 0]
    order = placed[np.argsort(of_cell[placed], kind="stable")]
    return np.split(order, np.searchsorted(of_cell[order], np.arange(1, n_domains)))


def _domain(
    cells: np.ndarray,
    labels: np.ndarray,
    label: np.ndarray,
    is_thin: np.ndarray,
    widths: CellWidths,
    ruler: Ruler,
) -> Domain:
    wide = cells[~is_thin[cells]]
    own = wide if len(wide) else cells
    centre, radius = widths.largest_ball(own, ruler)
    words = tuple(int(word) for word in labels[label[own[0]]])
    return Domain(words, cells, float(widths.volume[cells].sum()), centre, radius)


def _order_key(domain: Domain) -> tuple[Any, ...]:
    """Longest lists first, then by entity, then by place: the same for the same part."""
    bits = sum(word << (64 * k) for k, word in enumerate(domain.label))
    members = [k for k in range(bits.bit_length()) if bits >> k & 1]
    return (-len(members), members, [round(float(x), 3) for x in domain.viewpoint])


def _contacts(of_cell: np.ndarray, touching: Touching) -> dict[tuple[int, int], Contact]:
    contacts = {}
    is_certain = touching.certainly_wide()
    for pair, rows in _by_pair(of_cell[touching.cells], np.arange(len(touching.cells))):
        if (
            is_certain[rows].any()
            or any(map(touching.is_wide, touching.doubtful(rows)))
            or touching.are_wide_together(rows)
        ):
            contacts[pair] = Contact(float(touching.area[rows].sum()))
            for k in rows.tolist():
                for plane in touching.planes(k):
                    contacts[pair].planes[plane] = contacts[pair].planes.get(plane, 0.0) + float(
                        touching.area[k]
                    )
    return contacts

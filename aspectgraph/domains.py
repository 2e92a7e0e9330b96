"""Viewing domains: connected unions of equally labelled cells, and what they share.

Slivers. Snapping a rotated part leaves cells thinner than any robot can aim. A domain whose inscribed radius is below
half of ``min_width`` joins the neighbour it shares most boundary with, and is counted; a contact narrower than
``min_width`` joins nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .carve import INSIDE
from .cells import leaves
from .complex import Complex
from .measure import cell_sizes, half_spaces, interfaces


@dataclass
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
        Centre of the largest ball inside one of its cells, in grid steps.
    clearance : float
        Radius of that ball, in grid steps.
    """

    label: tuple[int, ...]
    cells: np.ndarray
    volume: float
    viewpoint: np.ndarray
    clearance: float


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
        Domains that were too thin and joined a neighbour.
    """

    domains: list[Domain]
    contacts: dict[tuple[int, int], Contact]
    of_cell: np.ndarray
    n_slivers: int


def find_domains(cx: Complex, min_width: float) -> Domains:
    """Merge equally labelled cells across common faces.

    Parameters
    ----------
    cx : Complex
        Labelled, and carved.
    min_width : float
        In grid steps.
    """
    present = leaves(cx)
    free = present[(cx.label[present, -1] & INSIDE) == 0]
    n = int(present.max()) + 1
    sides, sizes = interfaces(cx)
    is_free = np.zeros(n, bool)
    is_free[free] = True
    keep = is_free[sides[:, 0]] & is_free[sides[:, 1]]
    sides, sizes = sides[keep], sizes[keep]
    labels, label_of = np.unique(cx.label[free], axis=0, return_inverse=True)
    label = np.full(n, -1)
    label[free] = label_of.ravel()
    volume = np.zeros(n)
    surface = np.zeros(n)
    volume[free], surface[free] = cell_sizes(cx, free).T
    wide = sizes[:, 1] >= min_width
    balls = _Balls(cx, volume, surface)
    links = sides[wide, :2]
    n_slivers = 0
    while True:
        of_cell, n_domains = _components(label, free, links, n)
        members = _members(of_cell, free, n_domains)
        thin = [d for d in range(n_domains) if balls.of(members[d], 0.5 * min_width)[1] < 0.5 * min_width]
        glue = _absorb(thin, members, of_cell, label, sides, sizes)
        if not len(glue):
            break
        n_slivers += len(glue)
        links = np.concatenate([links, glue])
    domains = [_domain(members[d], labels[label[members[d][0]]], volume, balls) for d in range(n_domains)]
    order = sorted(range(n_domains), key=lambda d: _order_key(domains[d]))
    rank = np.empty(n_domains, int)
    rank[order] = np.arange(n_domains)
    of_cell[of_cell >= 0] = rank[of_cell[of_cell >= 0]]
    return Domains([domains[d] for d in order], _contacts(of_cell, sides, sizes, min_width), of_cell, n_slivers)


def _components(label, free, sides, n) -> tuple[np.ndarray, int]:
    same = label[sides[:, 0]] == label[sides[:, 1]]
    links = coo_array((np.ones(same.sum()), (sides[same, 0], sides[same, 1])), shape=(n, n))
    _, component = connected_components(links, directed=False)
    names, of_free = np.unique(component[free], return_inverse=True)
    of_cell = np.full(n, -1)
    of_cell[free] = of_free
    return of_cell, len(names)


def _members(of_cell, free, n_domains) -> list[np.ndarray]:
    order = free[np.argsort(of_cell[free], kind="stable")]
    return np.split(order, np.searchsorted(of_cell[order], np.arange(1, n_domains)))


def _absorb(thin, members, of_cell, label, sides, sizes) -> np.ndarray:
    """Give thin domains the label of the neighbour they share most boundary with; return the pairs of cells to link."""
    thin_set = set(thin)
    outer = of_cell[sides[:, 0]] != of_cell[sides[:, 1]]
    pairs, areas = of_cell[sides[outer, :2]], sizes[outer, 0]
    glue = []
    for d in thin:
        shared: dict[int, float] = {}
        for end in range(2):
            rows = pairs[:, end] == d
            for other, area in zip(pairs[rows, 1 - end].tolist(), areas[rows].tolist(), strict=True):
                shared[other] = shared.get(other, 0.0) + area
        candidates = {other: area for other, area in shared.items() if other not in thin_set} or shared
        if candidates:
            target = max(candidates, key=candidates.get)
            label[members[d]] = label[members[target][0]]
            glue.append((members[d][0], members[target][0]))
    return np.array(glue, np.int64).reshape(-1, 2)


class _Balls:
    """Largest balls inside single cells, computed when needed and remembered."""

    def __init__(self, cx: Complex, volume: np.ndarray, surface: np.ndarray):
        self._cx = cx
        # a convex body's volume is at least a third of its inscribed radius times its surface
        self._bound = 3.0 * volume / np.maximum(surface, 1e-300)
        self._known: dict[int, tuple[np.ndarray, float]] = {}

    def of(self, cells: np.ndarray, enough: float = np.inf) -> tuple[np.ndarray, float]:
        """Centre and radius of the largest ball inside one of the cells, or of one of radius at least `enough`."""
        best = (np.zeros(3), -1.0)
        for cell in cells[np.argsort(-self._bound[cells], kind="stable")]:
            if self._bound[cell] <= best[1] or best[1] >= enough:
                break
            ball = self._known.get(int(cell))
            if ball is None:
                ball = self._known[int(cell)] = chebyshev_ball(half_spaces(self._cx, cell))
            best = max(best, ball, key=lambda b: b[1])
        return best


def chebyshev_ball(rows: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the largest ball in {a·x + b·y + c·z + d <= 0 for all rows}, a linear programme."""
    scale = np.abs(rows[:, 3]).max() or 1.0
    result = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.column_stack([rows[:, :3], np.ones(len(rows))]),
        b_ub=-rows[:, 3] / scale,
        bounds=[(None, None)] * 3 + [(0, None)],
        method="highs",
    )
    if not result.success:
        return np.zeros(3), 0.0
    return result.x[:3] * scale, float(result.x[3] * scale)


def _domain(cells, label, volume, balls: _Balls) -> Domain:
    centre, radius = balls.of(cells)
    return Domain(tuple(int(word) for word in label), cells, float(volume[cells].sum()), centre, radius)


def _order_key(domain: Domain) -> tuple:
    """Longest lists first, then by entity, then by place: the same for the same part."""
    bits = sum(word << (64 * k) for k, word in enumerate(domain.label))
    members = [k for k in range(bits.bit_length()) if bits >> k & 1]
    return (-len(members), members, [round(float(x), 3) for x in domain.viewpoint])


def _contacts(of_cell, sides, sizes, min_width) -> dict[tuple[int, int], Contact]:
    contacts: dict[tuple[int, int], Contact] = {}
    widest: dict[tuple[int, int], float] = {}
    outer = of_cell[sides[:, 0]] != of_cell[sides[:, 1]]
    for (positive, negative, plane), (area, width) in zip(sides[outer].tolist(), sizes[outer].tolist(), strict=True):
        pair = tuple(sorted((int(of_cell[positive]), int(of_cell[negative]))))
        contact = contacts.setdefault(pair, Contact())
        contact.area += area
        contact.planes[plane] = contact.planes.get(plane, 0.0) + area
        widest[pair] = max(widest.get(pair, 0.0), width)
    return {pair: contacts[pair] for pair in sorted(contacts) if widest[pair] >= min_width}

"""Viewing domains: connected unions of equally labelled cells, and what they share.

Slivers. Snapping a rotated part leaves cells thinner than any robot can aim. A domain whose inscribed radius is below
half of the least width joins the neighbour it shares most boundary with, and is counted; a contact narrower than that
joins nothing. Snapping turns planes, so slivers widen with distance, and so does the least width (`Ruler`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .carve import INSIDE
from .cells import leaves
from .complex import Complex
from .measure import cell_sizes, half_spaces, interfaces


class Ruler(NamedTuple):
    """The least width of domains and contacts, in grid steps.

    It is `min_width` up to the distance `reach` from the part's centre, and beyond it grows with the distance.
    """

    min_width: float
    reach: float

    def least_width(self, distance):
        """Least width at a distance, or an array of distances, from the part's centre (the grid's zero), in steps."""
        return self.min_width * np.maximum(1.0, distance / self.reach)


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


def find_domains(cx: Complex, ruler: Ruler) -> Domains:
    """Merge equally labelled cells across common faces.

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
    sides, sizes = interfaces(cx)
    is_free = np.zeros(n, bool)
    is_free[free] = True
    keep = is_free[sides[:, 0]] & is_free[sides[:, 1]]
    sides, sizes = sides[keep], sizes[keep]
    is_wide = _wide(cx, sides, sizes, ruler)
    labels, label_of = np.unique(cx.label[free], axis=0, return_inverse=True)
    label = np.full(n, -1)
    label[free] = label_of.ravel()
    volume = np.zeros(n)
    surface = np.zeros(n)
    volume[free], surface[free] = cell_sizes(cx, free).T
    balls = _Balls(cx, volume, surface, ruler)
    links = sides[is_wide, :2]
    n_slivers = 0
    while True:
        of_cell, n_domains = _components(label, free, links, n)
        members = _members(of_cell, free, n_domains)
        thin = [d for d in range(n_domains) if balls.is_thin(members[d])]
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
    return Domains([domains[d] for d in order], _contacts(of_cell, sides, sizes, is_wide), of_cell, n_slivers)


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

    def __init__(self, cx: Complex, volume: np.ndarray, surface: np.ndarray, ruler: Ruler):
        self._cx, self._ruler = cx, ruler
        # a convex body's volume is at least a third of its inscribed radius times its surface
        self._bound = 3.0 * volume / np.maximum(surface, 1e-300)
        self._known: dict[int, tuple[np.ndarray, float]] = {}
        self._roomy: dict[int, bool] = {}

    def largest(self, cells: np.ndarray) -> tuple[np.ndarray, float]:
        """Centre and radius of the largest ball inside one of the cells."""
        best = (np.zeros(3), -1.0)
        for cell in cells[np.argsort(-self._bound[cells], kind="stable")]:
            if self._bound[cell] <= best[1]:
                break
            best = max(best, self._ball(int(cell)), key=lambda b: b[1])
        return best

    def is_thin(self, cells: np.ndarray) -> bool:
        """Whether no ball inside one of the cells is as wide as the least width at its place."""
        for cell in cells[np.argsort(-self._bound[cells], kind="stable")]:
            if self._bound[cell] < 0.5 * self._ruler.min_width:
                return True
            if self._has_room(int(cell)):
                return False
        return True

    def _has_room(self, cell: int) -> bool:
        """Whether some ball in the cell is wide enough where it is; mostly the largest is."""
        if cell not in self._roomy:
            centre, radius = self._ball(cell)
            self._roomy[cell] = bool(2.0 * radius >= self._ruler.least_width(np.linalg.norm(centre))) or has_room(
                half_spaces(self._cx, cell), self._ruler
            )
        return self._roomy[cell]

    def _ball(self, cell: int) -> tuple[np.ndarray, float]:
        if cell not in self._known:
            self._known[cell] = chebyshev_ball(half_spaces(self._cx, cell))
        return self._known[cell]


def has_room(rows: np.ndarray, ruler: Ruler, normal: np.ndarray | None = None) -> bool:
    """Whether a ball inside {a·x + b·y + c·z + d <= 0 for all rows} is as wide as the least width at its place.

    With m the largest of `reach` and the coordinates' magnitudes at the ball's centre, the radius less the least radius
    at m is concave, so its maximum is a linear programme. With `normal`, the first row holds with equality and the ball
    is a disc in that plane.
    """
    slope = 0.5 * ruler.min_width / ruler.reach
    scale = np.abs(rows[:, 3]).max() or 1.0
    thickness = np.ones(len(rows)) if normal is None else np.linalg.norm(np.cross(rows[:, :3], normal), axis=1)
    first = 0 if normal is None else 1
    flat = np.zeros((2, 3)) if normal is None else rows[[0, 0], :3] * [[1], [-1]]
    unit = np.eye(3)
    columns = [
        np.column_stack([rows[first:, :3], thickness[first:], np.zeros(len(rows) - first)]),
        np.column_stack([flat, np.zeros((2, 2))]),
        np.column_stack([unit, np.zeros(3), -np.ones(3)]),
        np.column_stack([-unit, np.zeros(3), -np.ones(3)]),
    ]
    level = np.zeros(2) if normal is None else np.array([-1.0, 1.0]) * rows[0, 3]
    result = linprog(
        [0.0, 0.0, 0.0, -1.0, slope],
        A_ub=np.concatenate(columns),
        b_ub=np.concatenate([-rows[first:, 3], level, np.zeros(6)]) / scale,
        bounds=[(None, None)] * 3 + [(0, None), (ruler.reach / scale, None)],
        method="highs",
    )
    return bool(result.success and result.fun <= 0.0)


def _wide(cx: Complex, sides: np.ndarray, sizes: np.ndarray, ruler: Ruler) -> np.ndarray:
    """Whether each face is as wide as the least width somewhere on it."""
    wide = sizes[:, 1] >= ruler.least_width(sizes[:, 2])
    for k in np.flatnonzero(~wide & (sizes[:, 1] >= 0.5 * ruler.min_width)) if ruler.min_width > 0.0 else ():
        plane = cx.planes[sides[k, 2]].astype(float)
        plane /= np.linalg.norm(plane[:3])
        around = np.concatenate([half_spaces(cx, int(cell)) for cell in sides[k, :2]])
        slanted = np.linalg.norm(np.cross(around[:, :3], plane[:3]), axis=1) > 1e-9
        rows = np.concatenate([[[*plane[:3], -plane[3]]], around[slanted]])
        wide[k] = has_room(rows, ruler, plane[:3])
    return wide


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
    centre, radius = balls.largest(cells)
    return Domain(tuple(int(word) for word in label), cells, float(volume[cells].sum()), centre, radius)


def _order_key(domain: Domain) -> tuple:
    """Longest lists first, then by entity, then by place: the same for the same part."""
    bits = sum(word << (64 * k) for k, word in enumerate(domain.label))
    members = [k for k in range(bits.bit_length()) if bits >> k & 1]
    return (-len(members), members, [round(float(x), 3) for x in domain.viewpoint])


def _contacts(of_cell, sides, sizes, is_wide) -> dict[tuple[int, int], Contact]:
    contacts: dict[tuple[int, int], Contact] = {}
    wide_pairs = set()
    outer = of_cell[sides[:, 0]] != of_cell[sides[:, 1]]
    rows = zip(sides[outer].tolist(), sizes[outer, 0].tolist(), is_wide[outer].tolist(), strict=True)
    for (positive, negative, plane), area, wide in rows:
        pair = tuple(sorted((int(of_cell[positive]), int(of_cell[negative]))))
        contact = contacts.setdefault(pair, Contact())
        contact.area += area
        contact.planes[plane] = contact.planes.get(plane, 0.0) + area
        if wide:
            wide_pairs.add(pair)
    return {pair: contacts[pair] for pair in sorted(wide_pairs)}

"""A box part whose visibility is known by hand: an edge is observable from in front of either of its two faces.

The planes of the six faces cut space into 27 boxes; on each of the outer 26 the list is constant. It offers what the
planner needs of visibility regions, without the geometry engine.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from aspectgraph import Solid

_CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
_FACES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6], [1, 2, 6, 5], [0, 4, 7, 3]]


@dataclass(frozen=True)
class BoxEntity:
    name: str
    endpoints: np.ndarray


@dataclass(frozen=True)
class BoxCell:
    low: np.ndarray
    high: np.ndarray

    @property
    def half_spaces(self):
        return np.vstack(
            [np.column_stack([np.eye(3), -self.high]), np.column_stack([-np.eye(3), self.low])]
        )

    @property
    def vertices(self):
        return np.array(list(product(*zip(self.low, self.high, strict=True))))

    @property
    def volume(self):
        return float(np.prod(self.high - self.low))


class BoxCells(tuple):
    @property
    def volumes(self):
        return np.array([cell.volume for cell in self])

    @property
    def volume(self):
        return float(self.volumes.sum())

    @property
    def boxes(self):
        return np.array([[cell.low, cell.high] for cell in self]).reshape(-1, 2, 3)

    @property
    def bounds(self):
        return np.array(
            [np.min([c.low for c in self], axis=0), np.max([c.high for c in self], axis=0)]
        )

    def contains(self, points):
        points = np.asarray(points)
        inside = np.zeros(len(points), dtype=bool)
        for cell in self:
            inside |= ((points >= cell.low) & (points <= cell.high)).all(axis=1)
        return inside

    def sample(self, n, rng):
        rng = np.random.default_rng(rng)
        chosen = rng.choice(len(self), size=n, p=self.volumes / self.volume)
        low, high = (np.array([getattr(c, side) for c in self])[chosen] for side in ("low", "high"))
        return rng.uniform(low, high)


class BoxSpace:
    """Visibility of edges of an axis-parallel box with one corner at the origin."""

    def __init__(self, size, workspace, names):
        self.size = np.asarray(size, dtype=float)
        self.solid = Solid(np.array(_CORNERS) * self.size, _FACES, name="box")
        self.workspace = np.asarray(workspace, dtype=float)
        by_name = {self.name_of(edge): edge for edge in self.solid.edges}
        self._edges = {name: by_name[name] for name in names}
        self.entities = {
            name: BoxEntity(name, self.solid.edge_points(e.id)) for name, e in self._edges.items()
        }
        self.entity_names = tuple(names)

    def name_of(self, edge):
        """Two faces name an edge: "+z-y" is where the top meets the front."""
        faces = ("-z", "+z", "-y", "+y", "+x", "-x")
        return "".join(
            sorted((faces[f] for f in edge.faces), key=lambda face: "zyx".index(face[1]))
        )

    def observable(self, points, names=None):
        points = np.asarray(points, dtype=float)
        columns = [self._in_front(points, name) for name in (names or self.entity_names)]
        return np.stack(columns, axis=1)

    def _in_front(self, points, name):
        front = np.zeros(len(points), dtype=bool)
        for sign, axis in (name[:2], name[2:]):
            i = "xyz".index(axis)
            front |= points[:, i] > self.size[i] if sign == "+" else points[:, i] < 0
        return front

    def covering_cells(self, names):
        cuts = np.stack([self.workspace[0], np.zeros(3), self.size, self.workspace[1]])
        cells = []
        for i, j, k in product(range(3), repeat=3):
            low = np.array([cuts[i, 0], cuts[j, 1], cuts[k, 2]])
            high = np.array([cuts[i + 1, 0], cuts[j + 1, 1], cuts[k + 1, 2]])
            if (i, j, k) != (1, 1, 1) and self.observable([(low + high) / 2], names).all():
                cells.append(BoxCell(low, high))
        return BoxCells(cells)


EDGES = (
    "+z+y",
    "+z-y",
    "+z+x",
    "+z-x",
    "-z+y",
    "-z-y",
    "-z+x",
    "-z-x",
    "+y+x",
    "+y-x",
    "-y+x",
    "-y-x",
)

"""A box in the middle of a workspace, whose visibility can be written down: the planner's stand-in for real regions.

An edge of a box is observable exactly where one of its two faces is seen from the front. The planes of the six faces
cut the workspace into 27 boxes: the solid, and 26 cells on each of which the list of observable edges is constant.
"""

from dataclasses import dataclass
from itertools import product
from types import SimpleNamespace

import numpy as np


@dataclass(frozen=True)
class Cell:
    half_spaces: np.ndarray
    vertices: np.ndarray
    volume: float


class Cells:
    def __init__(self, corners):
        self.boxes = np.array(corners, dtype=float).reshape(-1, 2, 3)
        self.volumes = np.prod(self.boxes[:, 1] - self.boxes[:, 0], axis=1)
        self.volume = float(self.volumes.sum())

    def __len__(self):
        return len(self.boxes)

    def __iter__(self):
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k):
        low, high = self.boxes[k]
        planes = np.vstack(
            [np.column_stack([-np.eye(3), low]), np.column_stack([np.eye(3), -high])]
        )
        corners = np.array(list(product(*zip(low, high, strict=True))))
        return Cell(planes, corners, float(self.volumes[k]))

    def contains(self, points):
        points = np.asarray(points)[:, None]
        return (
            ((points >= self.boxes[:, 0]) & (points <= self.boxes[:, 1])).all(axis=-1).any(axis=1)
        )

    def sample(self, n, rng):
        rng = np.random.default_rng(rng)
        chosen = rng.choice(len(self), size=n, p=self.volumes / self.volume)
        return rng.uniform(self.boxes[chosen, 0], self.boxes[chosen, 1])


class BoxSpace:
    """The box [0, size] in the workspace box of half-width `reach` around the origin."""

    def __init__(self, size=(60.0, 40.0, 30.0), reach=900.0):
        self.size = np.array(size)
        self.workspace = (np.full(3, -reach), np.full(3, reach))
        corner = np.array(list(product((0, 1), repeat=3))) * self.size
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
        self.solid = SimpleNamespace(
            vertices=corner, triangles=triangles, bounds=np.array([0 * self.size, self.size])
        )
        self.entities = {}
        self._faces = {}
        for axis in range(3):
            i, j = [a for a in range(3) if a != axis]
            for at_i, at_j in product((0, 1), repeat=2):
                start = np.zeros(3)
                start[i] = at_i * self.size[i]
                start[j] = at_j * self.size[j]
                end = start.copy()
                end[axis] = self.size[axis]
                name = f"{'xyz'[axis]}{at_i}{at_j}"
                self.entities[name] = SimpleNamespace(
                    name=name, endpoints=np.array([start, end]), edge_ids=()
                )
                self._faces[name] = ((i, at_i), (j, at_j))

    @property
    def entity_names(self):
        return tuple(self.entities)

    def observable(self, points, names=None):
        points = np.asarray(points, dtype=float)
        inside_workspace = (points >= self.workspace[0]).all() and (
            points <= self.workspace[1]
        ).all()
        assert inside_workspace, "points outside the workspace must not be asked for"

        def in_front(axis, side):
            return points[:, axis] > self.size[axis] if side else points[:, axis] < 0

        names = self.entity_names if names is None else names
        return np.column_stack(
            [in_front(*first) | in_front(*second) for first, second in map(self._faces.get, names)]
        )

    def covering_cells(self, names):
        cuts = [(self.workspace[0][a], 0.0, self.size[a], self.workspace[1][a]) for a in range(3)]
        slabs = product(*([(c[i], c[i + 1]) for i in range(3)] for c in cuts))
        corners = [np.array(slab).T for slab in slabs]
        return Cells([c for c in corners if self.observable(c.mean(axis=0)[None], names).all()])

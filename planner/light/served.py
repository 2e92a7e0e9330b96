"""Which places of lamps make which pairs show, and where in the light regions such places are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.light.background import backdrop_contrasts, edge_steps
from planner.light.corner_light import Corners
from planner.light.demands import Pair
from planner.light.lamps import LampSpace

if TYPE_CHECKING:
    from aspectgraph.light import LightRegions
    from aspectgraph.solid.ray_scene import RayScene

Array = NDArray[np.float64]

# cells that are looked into for places, the largest first; and places that are enough
_MOST_CELLS = 200
_ENOUGH = 48
_AROUND = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step)], dtype=np.float64)
_AROUND /= np.linalg.norm(_AROUND, axis=1, keepdims=True)


@dataclass
class Served:
    """Places of lamps (n, 3), the contrast and the step (n, pairs) with which they show each pair; 0 where they do not.

    Attributes
    ----------
    light : LightRegions or None
        The exact regions; None if nothing needs a lamp.
    scene : RayScene
        Of the part.
    pairs : sequence of Pair
        What is to show.
    least, least_step : float
        Least contrast, and least step of grey values.
    clearance_mm : float
        Places nearer to the part are left out.
    tolerance_mm : float
        How far lamps may be off: all must show from 26 places so far around, too.
    corners : Corners, optional
        Lines of which one must show at each end, and beside which no shadow may end.
    """

    light: LightRegions | None
    scene: RayScene
    pairs: Sequence[Pair]
    least: float
    least_step: float
    clearance_mm: float = 0.0
    tolerance_mm: float = 0.0
    corners: Corners | None = None
    places: Array = field(default_factory=lambda: np.empty((0, 3)))
    contrast: Array = field(init=False)
    step: Array = field(init=False)

    def __post_init__(self) -> None:
        self.contrast = self.step = np.empty((0, len(self.pairs)))

    @property
    def offsets(self) -> Array:
        """Where a lamp may be, relative to its place, (n, 3) mm; the first is (0, 0, 0)."""
        none = np.zeros((1, 3))
        return (
            np.concatenate([none, self.tolerance_mm * _AROUND]) if self.tolerance_mm > 0 else none
        )

    def add(self, places: Array) -> int:
        """Add places that are clear of the part, and return how many that are."""
        clear = places[
            self.scene.signed_distance(places) >= max(self.clearance_mm, self.tolerance_mm)
        ]
        self.keep(clear)
        return len(clear)

    def keep(self, places: Array, wanted: NDArray[np.bool_] | None = None) -> None:
        """Add places, wherever they are; ``wanted`` (n, pairs) is what they are to show, all if None."""
        contrast, step = self.shown(places, wanted)
        self.places = np.concatenate([self.places, places])
        self.contrast = np.concatenate([self.contrast, contrast])
        self.step = np.concatenate([self.step, step])

    def keep_own(self, places: Array) -> None:
        """Add a place for each setting, which is to show what belongs to that setting."""
        self.keep(
            places,
            np.arange(len(places))[:, None]
            == np.array([pair.setting for pair in self.pairs], dtype=int),
        )

    def shown(self, places: Array, wanted: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """Return contrast and step (n, pairs) under lamps at places (n, 3), both 0 where a pair does not show.

        What is not wanted (n, pairs) is not asked about, and 0.
        """
        wanted = np.ones((len(places), len(self.pairs)), dtype=bool) if wanted is None else wanted
        contrast, step = self._at(places, wanted)
        for off in self.offsets[1:]:
            good = np.flatnonzero((contrast > 0).any(axis=1))
            beside = self._at(places[good] + off, contrast[good] > 0)
            contrast[good] = np.minimum(contrast[good], beside[0])
            step[good] = np.minimum(step[good], beside[1])
        return contrast, step

    def _at(self, places: Array, wanted: NDArray[np.bool_]) -> tuple[Array, Array]:
        contrast = wanted.astype(float)
        step = wanted.astype(float)
        regions: dict[str, tuple[Array, Array]] = {}
        for k, pair in enumerate(self.pairs):
            for name in pair.regions:
                if name not in regions:
                    regions[name] = self._region(name, places)
                contrast[:, k] = np.minimum(contrast[:, k], regions[name][0])
                step[:, k] = np.minimum(step[:, k], regions[name][1])
            some = np.flatnonzero(contrast[:, k])
            if pair.backdrops:
                behind = backdrop_contrasts(self.scene, pair.backdrops, places[some])
                contrast[some, k] = np.minimum(contrast[some, k], behind[0])
                step[some, k] = np.minimum(step[some, k], behind[1])
        shown = (contrast >= self.least) & (step >= self.least_step)
        rows = np.flatnonzero(shown.any(axis=1))
        if self.corners is not None and rows.size:
            each = np.arange(rows.size)[:, None]
            limits = (self.least, self.least_step)
            shown[rows] = self.corners.shown(self.scene, places[rows], each, limits, shown[rows])
        return np.where(shown, contrast, 0.0), np.where(shown, step, 0.0)

    def _region(self, name: str, places: Array) -> tuple[Array, Array]:
        assert self.light is not None
        low, high = self.light.workspace
        inside = ((places >= low) & (places <= high)).all(axis=1)
        found = np.zeros(len(places))
        found[inside] = np.abs(self.light.contrasts(places[inside], [name])[:, 0])
        return found, self.steps(name, places)

    def needs_corners(self, pair: int) -> bool:
        """Tell whether another line must show at the ends of a pair."""
        return self.corners is not None and pair in self.corners.pair

    def clear_beside(self, pair: int) -> bool:
        """Tell whether no shadow may end beside a pair."""
        beside = None if self.corners is None else self.corners.beside_edges
        return beside is not None and pair in beside.line

    def corners_under(self, places: Array, sets: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Return which pairs (n, pairs) meet what `Corners` asks for, under sets (n, size) of lamps."""
        wanted = np.ones((len(sets), len(self.pairs)), dtype=bool)
        if self.corners is None:
            return wanted
        return self.corners.shown(self.scene, places, sets, (self.least, self.least_step), wanted)

    def steps(self, name: str, places: Array) -> Array:
        """Return the step (n,) of a region's entity, without shadows."""
        assert self.light is not None
        entity = self.light.entities[name]
        silhouettes = self.light.silhouettes.get(name, {})
        return edge_steps(self.light.solid, entity, places, silhouettes)

    def search(self, space: LampSpace, pairs: Sequence[int]) -> bool:
        """Look for places of a space that show some pairs at once, and add them; return whether there are none.

        True is proven: no cell in which all the regions overlap has a place of the space. False is not: there may be
        no place clear of the part, or before a contrasting background.
        """
        names = list(dict.fromkeys(name for k in pairs for name in self.pairs[k].regions))
        if not names or self.light is None:
            self.add(space.places(_ENOUGH))
            return False
        cells = self.light.covering_cells(names)
        near = [
            int(i)
            for i in np.argsort(-cells.volumes, kind="stable")
            if not space.misses(cells[int(i)])
        ]
        found = [space.places_in(cells[i]) for i in near[:_MOST_CELLS]]
        if found:
            self.add(np.concatenate(found))
        return not near

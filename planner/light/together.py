"""Lamps that are on at the same time: what a set of them makes show, and the fewest that show all of a plan.

Under several lamps, irradiances add up. The contrast of an edge is then the mean of those under each lamp, weighted by
how bright it makes the edge, so it changes along the edge and is no wedge. It is computed at nine points of every edge,
with the shadows that rays find, for lamps of one strength: once with the fall of light with distance, once without,
and the smaller one counts.

The mean is never larger than the largest of its parts. So an edge that no lamp gives the contrast asked for cannot
have it under all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.light.background import SHARES, incidence, shadowed

if TYPE_CHECKING:
    from aspectgraph.light import LightRegions
    from aspectgraph.solid.ray_scene import RayScene
    from planner.light.demands import Pair

Array = NDArray[np.float64]

Besides = Callable[[Array, NDArray[np.int_]], NDArray[np.bool_]]

# sets that are tried, of one size after the other
_MOST_SETS = 60_000
# numbers (sets x sites) at a time
_BLOCK = 4_000_000


@dataclass(frozen=True)
class Sites:
    """Places of faces (n, 3) with normals that light falls on, and which two of them are compared for which pair.

    Attributes
    ----------
    points, normals : array (n, 3)
        Places, mm, and outward unit normals.
    compared : array of int (m, 2)
        Numbers of the two sites; the second is -1 for the dark ground.
    pair : array of int (m,)
        For which pair, in rising order.
    n_pairs : int
        Number of pairs; those without a comparison show under any lamps.
    """

    points: Array
    normals: Array
    compared: NDArray[np.int_]
    pair: NDArray[np.int_]
    n_pairs: int


def sites_of(light: LightRegions | None, pairs: Sequence[Pair]) -> Sites:
    """Return what is compared so that pairs show: both faces of a crease, or what is beside a silhouette.

    Parameters
    ----------
    light : LightRegions or None
        Has the regions that the pairs name; None if they name none.
    pairs : sequence of Pair
        Of a plan.

    Returns
    -------
    Sites
        Every site once.
    """
    numbers: dict[bytes, int] = {}
    places: list[Array] = []
    compared = []
    owner = []

    def number(point: Array, normal: Array) -> int:
        site = np.concatenate([point, normal])
        known = numbers.setdefault(site.tobytes(), len(places))
        if known == len(places):
            places.append(site)
        return known

    for k, pair in enumerate(pairs):
        both = (
            [side for name in pair.regions for side in _sides(light, name)]
            if light is not None
            else []
        )
        both += [one.sides for one in pair.backdrops]
        for one, other in both:
            compared.append((number(*one), -1 if other is None else number(*other)))
            owner.append(k)
    sides = np.array(places).reshape(-1, 6)
    return Sites(
        sides[:, :3],
        sides[:, 3:],
        np.array(compared, int).reshape(-1, 2),
        np.array(owner, int),
        len(pairs),
    )


_Side = tuple[Array, Array]


def _sides(light: LightRegions, name: str) -> Iterator[tuple[_Side, _Side | None]]:
    solid = light.solid
    silhouettes = light.silhouettes.get(name, {})
    for edge in (solid.edges[i] for i in light.entities[name].edge_ids):
        start, end = solid.vertices[list(edge.vertices)]
        for point in start + SHARES[:, None] * (end - start):
            if edge.id in silhouettes:
                yield (point, solid.normals[silhouettes[edge.id]]), None
            else:
                one, other = edge.faces
                yield (point, solid.normals[one]), (point, solid.normals[other])


class LampSets:
    """Sets of lamps, all on, over some places.

    Parameters
    ----------
    scene : RayScene
        Of the part.
    sites : Sites
        What is compared.
    places : array (n, 3)
        Of the lamps, mm.
    offsets : array (k, 3)
        Places of a lamp relative to where it should be, mm; each may be at any of them.
    besides : callable, optional
        ``besides(places, sets)`` returns which pairs (n, pairs) meet what else is asked of them.
    """

    def __init__(
        self,
        scene: RayScene,
        sites: Sites,
        places: Array,
        offsets: Array,
        besides: Besides | None = None,
    ) -> None:
        self._sites = sites
        self.n = len(places)
        self._places = places
        self._besides = besides
        # (with the fall of light and without, lamps, sites), at least and at most
        self._low = self._high = np.stack(_irradiances(scene, sites, places + offsets[0]))
        for off in offsets[1:]:
            now = np.stack(_irradiances(scene, sites, places + off))
            self._low = np.minimum(self._low, now)
            self._high = np.maximum(self._high, now)
        self.n_pairs = sites.n_pairs

    def shown(self, sets: NDArray[np.int_]) -> tuple[Array, Array]:
        """Return least contrast and step (n, pairs) under sets (n, size) of lamps that are on together.

        The step is a share of the grey value of a face that all of them light frontally, falls of light aside.
        """
        n, size = sets.shape
        contrast, step = np.ones((2, n, self.n_pairs))
        block = max(1, _BLOCK // max(1, size * len(self._sites.compared)))
        for first in range(0, n, block):
            block_of_sets = slice(first, first + block)
            contrast[block_of_sets], step[block_of_sets] = self._shown(sets[block_of_sets])
        if self._besides is not None:
            rows = np.flatnonzero((contrast > 0).any(axis=1))
            contrast[rows] *= self._besides(self._places, sets[rows])
        return contrast, step

    def _shown(self, sets: NDArray[np.int_]) -> tuple[Array, Array]:
        sites = self._sites
        contrast, step = np.ones((2, len(sets), sites.n_pairs))
        if not len(sites.compared):
            return contrast, step
        values = [_compared(low, high, sites.compared) for low, high in self._sums(sets)]
        (falling, _), (even, steps) = values
        same = falling * even > 0
        least = np.where(same, np.minimum(np.abs(falling), np.abs(even)), 0.0)
        owners, starts = np.unique(sites.pair, return_index=True)
        contrast[:, owners] = np.minimum.reduceat(least, starts, axis=1)
        step[:, owners] = np.minimum.reduceat(steps / sets.shape[1], starts, axis=1)
        return contrast, step

    def _sums(self, sets: NDArray[np.int_]) -> Iterator[tuple[Array, Array]]:
        for low, high in zip(self._low, self._high, strict=True):
            yield low[sets].sum(axis=1), high[sets].sum(axis=1)


def _irradiances(scene: RayScene, sites: Sites, places: Array) -> tuple[Array, Array]:
    """Return irradiances (lamps, sites) with the fall of light, and cosines without it; 0 in the shadow."""
    cosine, falling = np.zeros((2, len(places), len(sites.points)))
    for k, (point, normal) in enumerate(zip(sites.points, sites.normals, strict=True)):
        cosine[:, k], distance = incidence(point, normal, places)
        lit = np.flatnonzero(cosine[:, k])
        cosine[lit[shadowed(scene, point, places[lit])], k] = 0.0
        falling[:, k] = cosine[:, k] / distance**2
    return falling, cosine


def _compared(low: Array, high: Array, compared: NDArray[np.int_]) -> tuple[Array, Array]:
    """Return contrasts (n, m), with a sign, and differences of two sites, both the nearest to 0 between the limits.

    (a - b) / (a + b) rises with a and falls with b.
    """
    one, other = compared.T
    dark = other < 0
    a = low[:, one]
    a_most = high[:, one]
    b = np.where(dark, 0.0, low[:, other])
    b_most = np.where(dark, 0.0, high[:, other])
    brighter = a > b_most
    darker = a_most < b
    near = np.where(brighter, a - b_most, np.where(darker, a_most - b, 0.0))
    total = np.where(brighter, a + b_most, a_most + b)
    return near / np.where(total > 0, total, 1.0), np.abs(near)


@dataclass(frozen=True)
class Fewest:
    """The fewest lamps that show the most.

    Attributes
    ----------
    chosen : tuple of int
        Numbers of the lamps.
    contrast : array (pairs,)
        0 for what they do not show.
    listed : int
        All sets of up to so many lamps were tried.
    """

    chosen: tuple[int, ...]
    contrast: Array
    listed: int


def fewest_together(sets: LampSets, least: float, least_step: float) -> Fewest:
    """Return the fewest lamps that make the most pairs show at once; among those, the ones with the largest step.

    Sets of one size after the other are tried, all of them while there are few enough; after that, the best ones of a
    size are made larger by each lamp in turn.

    Parameters
    ----------
    sets : LampSets
        The lamps.
    least, least_step : float
        Contrast and step that are needed to show.

    Returns
    -------
    Fewest
        The same for the same arguments.
    """
    n_pairs = sets.n_pairs
    best = Fewest((), np.zeros(n_pairs), 0)
    most = 0
    listed = 0
    wide: list[tuple[int, ...]] = [()]
    for size in range(1, sets.n + 1):
        if listed == size - 1 and comb(sets.n, size) <= _MOST_SETS:
            tried = np.array(list(combinations(range(sets.n), size)))
            listed = size
        else:
            larger = sorted(
                {tuple(sorted((*some, k))) for some in wide for k in range(sets.n) if k not in some}
            )
            tried = np.array(list(islice(larger, _MOST_SETS)))
        contrast, step = sets.shown(tried)
        shows = (contrast >= least) & (step >= least_step)
        n_shown = shows.sum(axis=1)
        margin = np.where(shows, step, 1.0).min(axis=1, initial=1.0)
        order = np.lexsort((-margin, -n_shown))
        top = int(order[0])
        if n_shown[top] > most:
            most = int(n_shown[top])
            best = Fewest(
                tuple(map(int, tried[top])), np.where(shows[top], contrast[top], 0.0), listed
            )
        if most == n_pairs:
            break
        wide = [tuple(map(int, tried[i])) for i in order[: max(1, _MOST_SETS // (10 * sets.n))]]
    return Fewest(best.chosen, best.contrast, listed)

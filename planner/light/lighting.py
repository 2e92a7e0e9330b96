"""What is asked of the lamps of a plan, in one frozen value: where they may be, and how much they have to show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from aspectgraph.cells.arrays import Cell
from aspectgraph.exact.grid import as_points
from aspectgraph.light import (
    DEFAULT_CONTRAST,
    LightRegions,
    check_contrast,
    check_lamps,
    compute_light,
)
from aspectgraph.solid.solid import RayScene
from ground.convert import Plain, from_plain, to_plain
from ground.short_repr import count
from planner.argument_kinds import (
    FROM_0_BELOW_1,
    NOT_NEGATIVE,
    POSITIVE,
    check_kinds,
    check_number,
)
from planner.camera.camera import Camera
from planner.exceptions import RequestError
from planner.light.area_light import AreaLight, EdgePoints, LitSpace
from planner.light.area_lights import (
    AREA_LIGHTS,
    area_of_word,
    in_material,
    is_area_light,
    is_area_word,
)
from planner.light.corner_light import (
    DEFAULT_STEP,
    SHARES,
    Corners,
    Demands,
    Pair,
    backdrop_contrasts,
    corners_of,
    demands_of,
    edge_steps,
    rays_beside,
    sure_contrast,
)
from planner.light.light_plan import CameraWays, eyes_of
from planner.light.reflection import Glare, Material, Places
from planner.progress import Progress, TimeIsUpError, labelled, report
from planner.request.part_entities import parts_of
from planner.request.reach import PlainReach, Reach, check_reach, reach_margin
from planner.request.reads import Reads, TargetReads
from planner.request.targets import targets_of
from planner.verify.simulate_setting import Planned

if TYPE_CHECKING:
    from aspectgraph import CellSet, Edge, Solid

# Where lamps are, or may be: places of a cell, a ring on the camera, a box or a dome to choose
# from.


Array = NDArray[np.float64]

RING = "ring"
"""A ring light on the camera: a lamp at its front nodal point."""

# distance, as a share of the space's size, that says apart from touching
_APART = 1e-9
_DOME_POINTS = 20_000
# places drawn in a cell
_DRAWN = 15


@dataclass(frozen=True)
class LampBox:
    """A box in which lamps may be.

    Parameters
    ----------
    low : tuple of float
        Lowest corner (3,), mm.
    high : tuple of float
        Highest corner (3,), mm.
    clearance_mm : float
        Distance that lamps keep from the part.
    reach : ReachRegion or callable, optional
        Part of the box that a robot with the lamp reaches, as in `plan_setting`. The proof of the
        bound uses the whole box.

    Raises
    ------
    RequestError
        If a number is not finite, the clearance is negative, or `low` is not below `high` in every coordinate.

    Examples
    --------
    >>> from planner import LampBox
    >>> LampBox((-500, -500, 250), (500, 500, 900)).clearance_mm
    10.0
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    clearance_mm: float = 10.0
    reach: Annotated[Reach | None, PlainReach] = None

    def __post_init__(self) -> None:
        box = _numbers("the corners of a box of lamps", (self.low, self.high), (2, 3))
        if not (box[0] < box[1]).all():
            raise RequestError.of_rule(
                "low", "must be below high in every coordinate", f"{self.low!r} and {self.high!r}"
            )
        check_number("clearance_mm", self.clearance_mm, NOT_NEGATIVE)
        check_reach(self.reach)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return "the box of lamps"

    @property
    def bounds(self) -> Array:
        """Its corners (2, 3), mm."""
        return np.array([self.low, self.high], dtype=np.float64)

    def places(self, n: int) -> Array:
        """Return the reachable ones of n points of a Halton sequence.

        Parameters
        ----------
        n : int
            How many.

        Returns
        -------
        array, shape (n, 3)
            Positions in mm, the same in every call.
        """
        low, high = self.bounds
        # takes longer to load than all else of a small plan, and few need it
        from scipy.stats import qmc

        drawn = qmc.Halton(3, scramble=True, rng=np.random.default_rng(0)).random(n)
        return self._reached(np.asarray(low + drawn * (high - low)))

    def misses(self, cell: Cell) -> bool:
        """Return whether a convex cell lies outside the box.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        bool
            False if this is not certain.
        """
        low, high = self.bounds
        apart = _APART * float(np.linalg.norm(high - low))
        if (cell.vertices < low - apart).all(axis=0).any() or (cell.vertices > high + apart).all(
            axis=0
        ).any():
            return True
        planes = cell.half_spaces
        nearest = np.where(planes[:, :3] > 0, low, high)
        if (np.einsum("ki,ki->k", planes[:, :3], nearest) + planes[:, 3] > apart).any():
            return True
        return bool(self._deepest(cell)[1] < -apart)

    def places_in(self, cell: Cell) -> Array:
        """Return points in the box and the cell: the centre of the largest ball, and random ones.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        array, shape (m, 3)
            In mm. It may be empty although the cell contains lamp positions.
        """
        place, depth = self._deepest(cell)
        if depth <= 0:
            return np.empty((0, 3))
        (normals, offsets) = self._planes(cell)
        rng = np.random.default_rng(0)
        low = self.bounds[0]
        points = [place - low]
        for way in rng.normal(size=(_DRAWN, 3)):
            speed = normals @ way
            room = offsets - normals @ points[-1]
            last = (room[speed > 0] / speed[speed > 0]).min()
            first = (room[speed < 0] / speed[speed < 0]).max()
            points.append(points[-1] + way * rng.uniform(first, last))
        return self._reached(low + np.array(points))

    def _reached(self, places: Array) -> Array:
        return places if self.reach is None else places[reach_margin(self.reach, places) > 0]

    def _planes(self, cell: Cell) -> tuple[Array, Array]:
        """Return normals (k, 3) and offsets (k,) of box and cell about the box's lowest corner: n·x <= o inside."""
        low, high = self.bounds
        normals = np.concatenate([cell.half_spaces[:, :3], np.eye(3), -np.eye(3)])
        inside_cell = -cell.half_spaces[:, 3] - cell.half_spaces[:, :3] @ low
        return normals, np.concatenate([inside_cell, high - low, np.zeros(3)])

    def _deepest(self, cell: Cell) -> tuple[Array, float]:
        """Return the point farthest from all planes of box and cell, and how far it is inside; a linear programme."""
        (normals, offsets) = self._planes(cell)
        low = self.bounds[0]
        ball = linprog(
            [0, 0, 0, -1],
            np.column_stack([normals, np.ones(len(normals))]),
            offsets,
            bounds=(None, None),
            method="highs",
        )
        return low + ball.x[:3], float(ball.x[3])


@dataclass(frozen=True)
class LampDome:
    """A sphere around the part, above a height, on which lamps may be.

    Parameters
    ----------
    centre : tuple of float
        Its centre (3,), mm.
    radius_mm : float
        Its radius.
    lowest_mm : float
        Least height (z) of a lamp above the centre.
    clearance_mm : float
        Distance that lamps keep from the part.

    Raises
    ------
    RequestError
        If a number is not finite, the radius is not positive, or the clearance is negative. If the
        sphere has no point at the least height.

    Examples
    --------
    >>> from planner import LampDome
    >>> LampDome((0, 0, 0), radius_mm=400.0, lowest_mm=50.0).radius_mm
    400.0
    """

    centre: tuple[float, float, float]
    radius_mm: float
    lowest_mm: float = 0.0
    clearance_mm: float = 10.0

    def __post_init__(self) -> None:
        _numbers("the centre of a dome of lamps", self.centre, (3,))
        _numbers("radius_mm and lowest_mm", (self.radius_mm, self.lowest_mm), (2,))
        check_number("radius_mm", self.radius_mm, POSITIVE)
        if not self.lowest_mm < self.radius_mm:
            raise RequestError.of_rule(
                "lowest_mm", f"must be below radius_mm, {self.radius_mm:g}", repr(self.lowest_mm)
            )
        check_number("clearance_mm", self.clearance_mm, NOT_NEGATIVE)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return "the dome of lamps"

    @property
    def bounds(self) -> Array:
        """Corners of the box around it (2, 3), mm."""
        low = np.full(3, -self.radius_mm)
        low[2] = max(low[2], self.lowest_mm)
        return np.array(self.centre, dtype=np.float64) + np.array([low, np.full(3, self.radius_mm)])

    def places(self, n: int) -> Array:
        """Return n points of a spiral, spread evenly over the area.

        Parameters
        ----------
        n : int
            How many.

        Returns
        -------
        array, shape (n, 3)
            Positions in mm, the same in every call.
        """
        lowest = max(self.lowest_mm / self.radius_mm, -1.0)
        height = lowest + (1.0 - lowest) * (np.arange(n) + 0.5) / n
        turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
        flat = np.sqrt(1.0 - height**2)
        return np.array(self.centre) + self.radius_mm * np.column_stack(
            [flat * np.cos(turn), flat * np.sin(turn), height]
        )

    def misses(self, cell: Cell) -> bool:
        """Return whether a convex cell misses the dome.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        bool
            False if this is not certain.
        """
        local = cell.vertices - np.array(self.centre)
        apart = _APART * self.radius_mm
        beyond = cell.half_spaces[:, :3] @ np.array(self.centre) + cell.half_spaces[:, 3]
        inside = np.linalg.norm(local, axis=1).max() < self.radius_mm - apart
        return bool(
            inside
            or beyond.max() > self.radius_mm + apart
            or local[:, 2].max() < self.lowest_mm - apart
        )

    def places_in(self, cell: Cell) -> Array:
        """Return points of a dense spiral that are in the cell.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        array, shape (m, 3)
            In mm. It may be empty although the cell contains lamp positions.
        """
        places = self.places(_DOME_POINTS)
        inside = (places @ cell.half_spaces[:, :3].T + cell.half_spaces[:, 3] < 0).all(axis=1)
        return places[inside][:: max(1, int(inside.sum()) // 64)]


LampSpace = LampBox | LampDome
"""Where lamps may be placed."""


def check_lamps_given(lamps: Any) -> LampSpace | AreaLight | Array | str:
    """Return a space of lamps, an area light, the places (n, 3) of fixed lamps, "ring" or "backlight".

    Raises
    ------
    RequestError
        If it is none of these.
    """
    if isinstance(lamps, LampBox | LampDome):
        return lamps
    if is_area_light(lamps):
        return lamps
    if isinstance(lamps, str):
        if lamps == RING or is_area_word(lamps):
            return lamps
        rule = (
            f"must be positions, a LampBox, a LampDome, a light with an area, {RING!r}, "
            f"{', '.join(map(repr, AREA_LIGHTS))}, or such a word with a name of the catalogue"
        )
        raise RequestError.of_rule("lamps", rule, repr(lamps))
    return _numbers("lamps", lamps, (-1, 3))


def _numbers(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return finite numbers as an array of a shape; -1 stands for any number but 0."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    fits = array.ndim == len(shape) and all(
        n == m or (m == -1 and n > 0) for n, m in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        expected = str(shape).replace("-1", "n")
        raise RequestError.of_rule(
            name, f"must be finite numbers in mm, shape {expected}", repr(values)
        )
    return array


# What is asked of the lamps of a plan, in one frozen value: where they may be, and how much they
# have to show.


# Which places of lamps make which pairs show, and where in the light regions such places are.


# cells that are looked into for places, the largest first; and places that are enough
_MOST_CELLS = 200
_ENOUGH = 48
UNREAD = -1.0
"""Instead of a reserve, of what a lamp shows and `measure` does not read; -inf of what it does not show."""
_AROUND = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step)], dtype=np.float64)
_AROUND /= np.linalg.norm(_AROUND, axis=1, keepdims=True)


@dataclass(frozen=True)
class Readers:
    """What measuring will find of pairs, under one lamp at a time.

    Attributes
    ----------
    reads : Reads
        Of the part.
    settings : sequence of (array (4, 4), Camera)
        Pose and camera of each setting.
    setting : array of int (pairs,)
        The setting of each pair.
    targets : sequence of TargetReads
        Of each pair.
    background : float
        Light behind the part, 0 or 1.
    progress : callable, optional
        ``progress(done, total, label)``, of the pairs that are read and the settings that are registered.
    """

    reads: Reads
    settings: Sequence[tuple[Array, Camera]]
    setting: NDArray[np.int_]
    targets: Sequence[TargetReads]
    background: float
    progress: Progress | None = None

    @classmethod
    def of(
        cls,
        reads: Reads,
        plan: Planned,
        pairs: Sequence[Pair],
        ground: str,
        progress: Progress | None = None,
    ) -> Readers:
        """Return those of a plan's pairs."""
        background = float(ground == "bright")
        settings = [
            (np.asarray(setting.cam2world, dtype=np.float64), plan.camera)
            for setting in plan.settings
        ]
        targets: list[TargetReads] = []
        for pair in pairs:
            target = targets_of(plan.targets, plan.settings[pair.setting])[pair.name]
            targets.append(reads.of_target(*settings[pair.setting], target, background))
        numbers = np.array([pair.setting for pair in pairs], dtype=int)
        return cls(reads, settings, numbers, targets, background, progress)

    def read(self, places: Array, shown: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Array]:
        """Return which of the pairs (n, pairs) that lamps (n, 3) show will be read, and with which reserve."""
        is_read = shown.copy()
        reserve = np.where(shown, UNREAD, -np.inf)
        total = len(self.targets) + len(self.settings)
        report(self.progress, 0, total, "light that is read")
        for k, target in enumerate(self.targets):
            rows = np.flatnonzero(shown[:, k])
            if len(rows):
                is_read[rows, k] = target.shown(places[rows])
            report(self.progress, k + 1, total, "light that is read")
        for number, pose in enumerate(self.settings):
            pairs = np.flatnonzero(self.setting == number)
            rows = np.flatnonzero(is_read[:, pairs].any(axis=1))
            whites = self._whites(pairs, places[rows])
            more = self.reads.reserve(*pose, places[rows], self.background, whites)
            block = np.ix_(rows, pairs)
            reserve[block] = np.where(is_read[block], more, reserve[block])
            report(self.progress, len(self.targets) + number + 1, total, "light that is read")
        return is_read & (reserve >= 0), reserve

    def _whites(self, pairs: NDArray[np.int_], places: Array) -> Array:
        """Return what is overexposed (n, p) under lamps (n, 3) in images for each of some pairs."""
        whites = np.empty((len(places), len(pairs)))
        for column, pair in enumerate(pairs.tolist()):
            whites[:, column] = self.targets[pair].white(places)
        return whites

    def why_not(self, pair: int) -> str:
        """Say why a pair is not read under any lamp; empty if it may be."""
        return self.targets[pair].reason


@dataclass
class Served:
    """Places of lamps (n, 3), the contrast and the step (n, pairs) with which they show each pair; 0 where they do not.

    And the ``reserve`` (n, pairs) with which images of them are registered, see `Reads`.

    Attributes
    ----------
    light : LightRegions or None
        The exact regions; None if nothing needs a lamp.
    scene : RayScene
        Of the part.
    pairs : sequence of Pair
        What is to show.
    least_contrast, least_step : float
        Least contrast, and least step of grey values.
    clearance_mm : float
        Places nearer to the part are left out.
    tolerance_mm : float
        How far lamps may be off: all must show from 26 places so far around, too.
    corners : Corners, optional
        Lines of which one must show at each end, and beside which no shadow may end.
    glare : Glare, optional
        Faces of metal beside which lamps must have no mirror image.
    readers : Readers, optional
        What measuring will find of pairs.
    ways : CameraWays, optional
        Of the cameras, which lamps that are added must not be in.
    """

    light: LightRegions | None
    scene: RayScene
    pairs: Sequence[Pair]
    least_contrast: float
    least_step: float
    clearance_mm: float = 0.0
    tolerance_mm: float = 0.0
    corners: Corners | None = None
    glare: Glare | None = None
    readers: Readers | None = None
    ways: CameraWays | None = None
    places: Array = field(default_factory=lambda: np.empty((0, 3)))
    contrast: Array = field(init=False)
    step: Array = field(init=False)
    reserve: Array = field(init=False)

    def __post_init__(self) -> None:
        self.contrast = self.step = self.reserve = np.empty((0, len(self.pairs)))

    @property
    def offsets(self) -> Array:
        """Where a lamp may be, relative to its place, (n, 3) mm; the first is (0, 0, 0)."""
        none = np.zeros((1, 3))
        return (
            np.concatenate([none, self.tolerance_mm * _AROUND]) if self.tolerance_mm > 0 else none
        )

    def add(self, places: Array) -> int:
        """Add places that are clear of the part and in no camera's way, and return how many that are."""
        clear = self.scene.signed_distance(places) >= max(self.clearance_mm, self.tolerance_mm)
        if self.ways is not None:
            clear &= ~self.ways.meet(places)
        self.keep(places[clear])
        return int(clear.sum())

    def keep(self, places: Array, wanted: NDArray[np.bool_] | None = None) -> None:
        """Add places, wherever they are; ``wanted`` (n, pairs) is what they are to show, all if None."""
        contrast, step = self.shown(places, wanted)
        reserve = np.where(contrast > 0, 1.0, -np.inf)
        if self.readers is not None:
            is_read, reserve = self.readers.read(places, contrast > 0)
            contrast = np.where(is_read, contrast, 0.0)
            step = np.where(is_read, step, 0.0)
        self.reserve = np.concatenate([self.reserve, reserve])
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
        if wanted is None:
            contrast, step = self._at(places, np.ones((len(places), len(self.pairs)), dtype=bool))
        else:
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
            lit = np.flatnonzero(contrast[:, k])
            if pair.backdrops:
                behind = backdrop_contrasts(self.scene, pair.backdrops, places[lit])
                contrast[lit, k] = np.minimum(contrast[lit, k], behind[0])
                step[lit, k] = np.minimum(step[lit, k], behind[1])
        shown = (contrast >= self.least_contrast) & (step >= self.least_step)
        if self.glare is not None:
            shown &= ~self.glare.meets(places, len(self.pairs))
        rows = np.flatnonzero(shown.any(axis=1))
        if self.corners is not None and rows.size:
            each = np.arange(rows.size)[:, None]
            limits = (self.least_contrast, self.least_step)
            shown[rows] = self.corners.shown(self.scene, places[rows], each, limits, shown[rows])
        return np.where(shown, contrast, 0.0), np.where(shown, step, 0.0)

    def _region(self, name: str, places: Array) -> tuple[Array, Array]:
        assert self.light is not None
        low, high = self.light.workspace
        inside = ((places >= low) & (places <= high)).all(axis=1)
        served = np.zeros(len(places))
        served[inside] = np.abs(self.light.contrasts(places[inside], [name])[:, 0])
        return served, self.steps(name, places)

    def needs_corners(self, pair: int) -> bool:
        """Tell whether another line must show at the ends of a pair."""
        return self.corners is not None and pair in self.corners.pair

    def clear_beside(self, pair: int) -> bool:
        """Tell whether no shadow may end beside a pair."""
        beside = None if self.corners is None else self.corners.beside_edges
        return beside is not None and pair in beside.line

    def why_unread(self, pair: int) -> str:
        """Say why a pair is read under no lamp at all; empty if it may be."""
        return "" if self.readers is None else self.readers.why_not(pair)

    def read_text(self) -> str:
        """Say what else is asked so that a pair is read that lamps may show; empty if nothing is."""
        if self.readers is None:
            return ""
        return ", so that 'measure' finds enough of it and of the part's edges"

    def unread_text(self, pair: int) -> str:
        """Say what `measure` lacks of a pair that a lamp shows; empty if no lamp shows it."""
        if self.readers is None or not (self.reserve[:, pair] >= UNREAD).any():
            return ""
        if (self.reserve[:, pair] > UNREAD).any():
            return "'measure' would find too few of the part's edges to register the image"
        return "'measure' would find too little of it"

    def corners_under(self, places: Array, sets: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Return which pairs (n, pairs) meet what `Corners` asks for, under sets (n, size) of lamps."""
        every = np.ones((len(sets), len(self.pairs)), dtype=bool)
        if self.corners is None:
            return every
        return self.corners.shown(
            self.scene, places, sets, (self.least_contrast, self.least_step), every
        )

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
        places = [space.places_in(cells[i]) for i in near[:_MOST_CELLS]]
        if places:
            self.add(np.concatenate(places))
        return not near


# From where a camera with a ring light sees edges and makes them show: a space for planning.


class RingSpace(LitSpace):
    """Viewpoints from which a camera with a ring light sees entities.

    Use it as ``space`` of `plan_inspection`.

    It uses the exact light regions, in which the contrast of the faces suffices. For each viewpoint
    it also checks the step of the grey values. For silhouettes, rays at nine points of the edge
    check the contrast with the background. The covering cells are those of the regions alone, so a
    lower bound proven with them stays valid.

    Parameters
    ----------
    light : LightRegions
        From `compute_light`, in the workspace of the camera.
    camera : Camera
        The camera.
    step : float
        As in `plan_light`.

    Raises
    ------
    RequestError
        If the step is not in [0, 1).

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import compute_light
    >>> from planner import Camera, RingSpace
    >>> light = compute_light(box, {"top": 1}, 0.1)
    >>> RingSpace(light, Camera.named("basler-acA2440-20gm-8mm"))
    <RingSpace of 'box': 1 entity, contrast 0.1>
    """

    def __init__(self, light: LightRegions, camera: Camera, step: float = DEFAULT_STEP) -> None:
        check_number("step", step, FROM_0_BELOW_1)
        super().__init__(light)
        self.light = light
        self.camera = camera
        self.step = step
        self._rays: RayScene | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        size = count(len(self.entities), "entity", "entities")
        return f"<RingSpace of {self.solid.name!r}: {size}, contrast {self.contrast:g}>"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the rays' scene behind: it cannot cross a process boundary."""
        return {**self.__dict__, "_rays": None}

    @property
    def contrast(self) -> float:
        """Least contrast."""
        return self.light.contrast

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return the viewpoints where the face contrast of all named entities suffices.

        Parameters
        ----------
        names : sequence of str
            Names of entities, at least one.

        Returns
        -------
        CellSet
            As convex cells.
        """
        return self.light.covering_cells(names)

    def subset(self, names: Sequence[str]) -> RingSpace:
        """Return the space of some of the entities.

        Parameters
        ----------
        names : sequence of str
            Their names.

        Returns
        -------
        RingSpace
            For the same camera.
        """
        ring = RingSpace(self.light.subset(names), self.camera, self.step)
        ring._rays = self._rays
        return ring

    def observable(self, points: Array, names: Sequence[str] | None = None) -> NDArray[np.bool_]:
        """Whether entities are lit and visible from viewpoints.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name.
        """
        names = self.entity_names if names is None else names
        eyes = as_points(points)
        visible = np.array(self.light.observable(eyes, names))
        for k, name in enumerate(names):
            for edge_id in self.entities[name].edge_ids:
                rows = np.flatnonzero(visible[:, k])
                visible[rows, k] = self._shows(self.solid.edges[edge_id], eyes[rows])
        return visible

    def _shows(self, edge: Edge, eyes: Array) -> NDArray[np.bool_]:
        """Return from which places (n,) an edge has the step, and contrast with what is behind it."""
        start, end = self.solid.vertices[list(edge.vertices)]
        normals = self.solid.normals[list(edge.faces)]
        heights = (eyes - start) @ normals.T
        crease = heights.min(axis=1) > 0
        good = np.ones(len(eyes), dtype=bool)
        for point in (start, (start + end) / 2, end):
            towards = eyes - point
            cosines = np.maximum(towards @ normals.T, 0.0) / np.linalg.norm(
                towards, axis=1, keepdims=True
            )
            good &= (
                np.where(crease, np.abs(cosines[:, 0] - cosines[:, 1]), cosines.max(axis=1))
                >= self.step
            )
        rows = np.flatnonzero(good & ~crease)
        if len(rows):
            front = heights[rows].argmax(axis=1)
            good[rows] = self._stands_out(
                (start, end), eyes[rows], normals[front], normals[1 - front]
            )
        return good

    def _stands_out(
        self, ends: tuple[Array, Array], eyes: Array, seen: Array, hidden: Array
    ) -> NDArray[np.bool_]:
        """Return from which places (n,) a silhouette differs from what is beside it; normals (n, 3)."""
        if self._rays is None:
            self._rays = RayScene(self.solid.vertices, self.solid.triangles, n_threads=1)
        start, end = ends
        pixel = max(self.camera.pixel_pitch_mm) / self.camera.image_distance_mm
        sight = start + SHARES[:, None] * (end - start) - eyes[:, None]
        rays = rays_beside(sight, end - start, hidden[:, None], pixel)
        hit = self._rays.cast(eyes[:, None], rays)
        part = np.isfinite(hit["t_hit"])
        near = np.linalg.norm(sight, axis=2)
        length = np.linalg.norm(rays, axis=2)
        first = np.maximum(-np.einsum("nsi,ni->ns", sight, seen), 0.0) / near
        other = np.abs(np.einsum("nsi,nsi->ns", rays, hit["primitive_normals"])) / length
        far = np.where(part, hit["t_hit"], 1.0) * length
        # the lamp is where the camera is, so that nothing that is seen is in shadow
        differs = (sure_contrast((first, near), (other, far)) >= self.contrast) & (
            np.abs(first - other) >= self.step
        )
        return np.asarray((differs | ~part).all(axis=1))


Ground = Literal["dark", "bright"]
GROUNDS = get_args(Ground)
# the workspace of the regions is so much larger than the lamps' space, as a share of it
_ROOM = 0.01


def _plain_lamps(lamps: Any) -> Any:
    """Return what `Lighting` has as lamps as plain values."""
    if isinstance(lamps, LampBox | LampDome):
        return {"kind": type(lamps).__name__, **to_plain(lamps, defaults=True)}
    if is_area_light(lamps):
        return to_plain(lamps, defaults=True)
    return lamps if isinstance(lamps, str) else np.asarray(lamps).tolist()


def _lamps_from(values: Any) -> Any:
    """Return the lamps of plain values."""
    if not isinstance(values, Mapping):
        return values
    if values["kind"] in AREA_LIGHTS:
        return from_plain(AREA_LIGHTS[values["kind"]], values, RequestError)
    kind = {"LampBox": LampBox, "LampDome": LampDome}[values["kind"]]
    others = {key: item for key, item in values.items() if key != "kind"}
    return from_plain(kind, others, RequestError)


@dataclass(frozen=True, eq=False)
class Lighting:
    """The options of the lamps of a plan; `plan_light` describes them in full.

    Parameters
    ----------
    lamps : array_like, shape (n, 3), or LampBox, LampDome, Backlight, DiffuseDome, CoaxialLight, RingLight or str
        Positions of the lamps, mm, or the region where lamps may be, or a light with an area. "ring"
        is a lamp on the camera. "backlight" is one that the part lies on, as `Backlight.under`
        makes it. "diffuse-dome", "coaxial" and "ring-light" are as large as the camera needs them.
        "backlight:NAME" and so on are lights of the catalogue, see `light_names`.
    contrast, step : float
        Least contrast, and least step of grey values.
    ground : str
        "dark" or "bright".
    tolerance_mm : float
        Largest distance of a lamp from its position, mm.
    together : bool
        Whether all lamps are on in every image, as in a cell without switches. They then have equal
        strength. Otherwise one lamp is on at a time.
    material : Material, optional
        Of the part. Default: matt, or that of a `DiffuseDome`, `CoaxialLight` or `RingLight`. On metal,
        lamps are left out whose mirror image is next to an edge.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    LightError
        If the contrast is out of range.

    Examples
    --------
    >>> from planner import Lighting
    >>> Lighting("ring").is_ring
    True
    """

    lamps: Annotated[Any, Plain(_plain_lamps, _lamps_from)]
    contrast: float = DEFAULT_CONTRAST
    step: float = DEFAULT_STEP
    ground: Ground = "dark"
    tolerance_mm: float = 0.0
    together: bool = False
    material: Material | None = None

    def __post_init__(self) -> None:
        check_contrast(self.contrast)
        object.__setattr__(self, "lamps", check_lamps_given(self.lamps))
        if self.material is not None:
            check_kinds(material=(self.material, "Material"))
        if self.material is not None and self.area is not None:
            object.__setattr__(self, "lamps", in_material(self.area, self.material))
        if self.together and self.is_ring:
            rule = "must be False for a ring light, which is one lamp"
            raise RequestError.of_rule("together", rule, "True")
        if self.together and self.material is not None and self.material.kind == "metal":
            rule = "must be False for metal, on which light of several lamps does not add up"
            raise RequestError.of_rule("together", rule, "True")
        if self.together and self.is_area:
            rule = "must be False for a light that has an area, which is one lamp"
            raise RequestError.of_rule("together", rule, "True")
        if self.ground not in GROUNDS:
            raise RequestError.of_rule(
                "ground", f"must be one of {', '.join(GROUNDS)}", repr(self.ground)
            )
        check_number("tolerance_mm", self.tolerance_mm, NOT_NEGATIVE)
        check_step(self.step)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        lamps: object = self.given
        if self.is_area:
            lamps = self.area or self.lamps
        elif lamps is None:
            lamps = "a ring light"
        elif isinstance(lamps, np.ndarray):
            lamps = f"{len(lamps)} lamps"
        return f"<Lighting by {lamps}: contrast {self.contrast:g}, step {self.step:g}, {self.ground} ground>"

    @property
    def given(self) -> LampSpace | NDArray[np.float64] | None:
        """Positions (n, 3) of fixed lamps, mm, or their region, or None for a ring or an area light."""
        return None if self.is_ring or self.is_area else self.lamps

    @property
    def is_ring(self) -> bool:
        """Whether the lamp is on the camera."""
        return isinstance(self.lamps, str) and self.lamps == RING

    @property
    def is_area(self) -> bool:
        """Whether it is a light with an area, such as a backlight."""
        return is_area_word(self.lamps) or self.area is not None

    @property
    def area(self) -> AreaLight | None:
        """The light with an area; None if there is none, or if the part decides where it is."""
        return self.lamps if is_area_light(self.lamps) else None

    @property
    def limits(self) -> tuple[float, float]:
        """Least contrast and step."""
        return self.contrast, self.step

    def on_part(self, solid: Solid, camera: Camera) -> Lighting:
        """Return the same with a light that follows from part and camera.

        Parameters
        ----------
        solid : Solid
            The part.
        camera : Camera
            The camera.

        Returns
        -------
        Lighting
            Equal to this one, unless its lamps are a word such as "backlight".

        Raises
        ------
        RequestError
            If the catalogue has no such light, or the camera is focused at infinity.
        """
        if not isinstance(self.lamps, str) or not is_area_word(self.lamps):
            return self
        light = area_of_word(self.lamps, solid, camera, self.material or Material())
        return replace(self, lamps=light)

    @property
    def is_fixed(self) -> bool:
        """Whether the lamps have fixed positions."""
        return isinstance(self.lamps, np.ndarray)

    def check_part(self, solid: Solid) -> None:
        """Refuse fixed lamps inside or on the part, and a light with an area that it is in the way of.

        Parameters
        ----------
        solid : Solid
            The part.

        Raises
        ------
        LightError
            If there is a lamp inside or on the surface.
        RequestError
            If a backlight passes through the part or shines away from it, or if all positions of lamps are inside.
        """
        if self.area is not None:
            self.area.check_part(solid)
        if isinstance(self.given, np.ndarray):
            check_lamps(solid, self.given, may_touch=False)
        elif isinstance(self.given, LampBox | LampDome):
            _check_some_outside(self.given, solid)

    def served(
        self,
        plan: Planned,
        solid: Solid,
        progress: Progress | None = None,
        reads: Reads | None = None,
        executor: Executor | None = None,
        deadline: float = math.inf,
    ) -> Served:
        """Return a record of lamp positions that light the targets; it is empty at first.

        Parameters
        ----------
        plan : Planned
            Settings and their targets.
        solid : Solid
            The part.
        progress : callable, optional
            ``progress(done, total, label)``.
        reads : Reads, optional
            What measuring will find in the images; it does not count for lamps that are on together.
        executor : concurrent.futures.Executor, optional
            Computes light regions in parallel. The result does not depend on it.
        deadline : float
            Time, as `time.time` gives it, at which the regions must be complete.

        Returns
        -------
        Served
            With the pairs of the plan.

        Raises
        ------
        RequestError
            If the part is not the plan's.
        LightError
            If a fixed lamp is inside the part.
        TimeIsUpError
            If the light regions are not complete by the deadline.
        """
        self.check_part(solid)
        places = self.given
        scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        demands = demands_of(plan, solid, scene, self.ground)
        if places is None:
            room = eyes_of(plan)
        else:
            room = places if isinstance(places, np.ndarray) else places.bounds
        # a displaced camera takes its ring along
        moved = plan.requirements.get("visibility_radius_mm", 0.0) if places is None else 0.0
        off = max(self.tolerance_mm, moved)
        box_mm = _workspace(solid, room, off)
        light = _regions(solid, demands, self.contrast, box_mm, progress, executor, deadline)
        clearance = 0.0 if places is None or isinstance(places, np.ndarray) else places.clearance_mm
        names = [(pair.setting, pair.name) for pair in demands.pairs]
        corners = corners_of(plan, solid, scene, names, demands.edge_ids)
        readers = None
        if reads is not None and not self.together:
            readers = Readers.of(reads, plan, demands.pairs, self.ground, progress)
        return Served(
            light,
            scene,
            demands.pairs,
            self.contrast,
            self.step,
            clearance,
            off,
            corners,
            _glare(plan, solid, demands.pairs, self.material),
            readers,
            CameraWays.of(plan, solid) if isinstance(places, LampBox | LampDome) else None,
        )


def _glare(
    plan: Planned, solid: Solid, pairs: Sequence[Pair], material: Material | None
) -> Glare | None:
    """Return the faces of metal beside what settings measure, as their cameras see them."""
    if material is None or material.kind == "matt" or not pairs:
        return None
    eyes = eyes_of(plan)
    parts: list[Places] = []
    owner: list[int] = []
    for k, pair in enumerate(pairs):
        target = targets_of(plan.targets, plan.settings[pair.setting])[pair.name]
        for entity in parts_of(target, solid, pair.name):
            edges = EdgePoints.of(solid, entity.edge_ids)
            views = eyes[pair.setting] - edges.points
            views /= np.linalg.norm(views, axis=1, keepdims=True)
            for normals in edges.normals.swapaxes(0, 1):
                seen = (normals * views).sum(axis=1) > 0
                parts.append(Places(edges.points[seen], normals[seen], views[seen]))
                owner += [k] * int(seen.sum())
    joined = Places(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    return Glare(joined, np.array(owner, dtype=int), material.roughness)


def check_step(step: float) -> float:
    """Return the step of grey values; RequestError if it is not in [0, 1)."""
    return check_number("step", step, FROM_0_BELOW_1)


def _workspace(solid: Solid, places: ArrayLike, tolerance_mm: float) -> NDArray[np.float64]:
    """Return a box around the part and all lamps."""
    points = np.concatenate([solid.bounds, np.reshape(places, (-1, 3))])
    low = points.min(axis=0)
    high = points.max(axis=0)
    room = _ROOM * float(np.linalg.norm(high - low)) + 2 * tolerance_mm
    return np.array([low - room, high + room])


def _regions(
    solid: Solid,
    demands: Demands,
    contrast: float,
    workspace: NDArray[np.float64],
    progress: Progress | None,
    executor: Executor | None,
    deadline: float,
) -> LightRegions | None:
    if not demands.entities:
        return None
    regions = compute_light(
        solid,
        demands.entities,
        contrast,
        workspace,
        executor,
        labelled(progress, "light regions"),
        demands.silhouettes,
        deadline,
    )
    if len(regions.entities) < len(demands.entities):
        raise TimeIsUpError
    return regions


# positions of lamps that are looked at for one outside the part
_PLACES = 256


def _check_some_outside(lamps: LampBox | LampDome, solid: Solid) -> None:
    """Refuse a box whose lamps would all be inside the part, and a dome within its bounding box."""
    places = lamps.places(_PLACES)
    low, high = solid.bounds
    if not len(places) or not ((places >= low) & (places <= high)).all():
        return
    if isinstance(lamps, LampDome):
        size = " x ".join(f"{length:.3g}" for length in high - low)
        got = f"a radius of {lamps.radius_mm:g} mm at a part of {size} mm"
        raise RequestError.of_rule("lamps", "must be a dome that reaches beyond the part", got)
    depth = -RayScene(solid.vertices, solid.triangles).signed_distance(places)
    if (depth > 0).all():
        corners = [", ".join(f"{x:g}" for x in corner) for corner in lamps.bounds]
        got = f"{lamps} from ({corners[0]}) to ({corners[1]}) mm, all inside it"
        raise RequestError.of_rule("lamps", "must have positions outside the part", got)

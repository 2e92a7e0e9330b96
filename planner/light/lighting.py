"""What is asked of the lamps of a plan, in one frozen value: where they may be, and how much they have to show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aspectgraph.light import (
    DEFAULT_CONTRAST,
    LightRegions,
    check_contrast,
    check_lamps,
    compute_light,
)
from aspectgraph.solid.ray_scene import RayScene
from planner.argument_kinds import FROM_0_BELOW_1, NOT_NEGATIVE, check_number
from planner.camera.camera import Camera
from planner.exceptions import RequestError
from planner.light.background import (
    DEFAULT_STEP,
    SHARES,
    backdrop_contrasts,
    edge_steps,
    rays_beside,
    sure_contrast,
)
from planner.light.corner_light import Corners, corners_of
from planner.light.demands import Demands, Pair, PlanToLight, demands_of
from planner.light.lamps import LampSpace, LampsTogether, check_lamps_given
from planner.progress import Progress, labelled

if TYPE_CHECKING:
    from aspectgraph import CellSet, Edge, Solid


# Which places of lamps make which pairs show, and where in the light regions such places are.


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


# From where a camera with a ring light sees edges and makes them show: a space for planning.


class RingSpace:
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
    <RingSpace of 'box': 1 entities, contrast 0.1>
    """

    def __init__(self, light: LightRegions, camera: Camera, step: float = DEFAULT_STEP) -> None:
        check_number("step", step, FROM_0_BELOW_1)
        self.light = light
        self.camera = camera
        self.step = step
        self._rays: RayScene | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<RingSpace of {self.solid.name!r}: {len(self.entities)} entities, contrast {self.contrast:g}>"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the rays' scene behind: it cannot cross a process boundary."""
        return {**self.__dict__, "_rays": None}

    @property
    def solid(self) -> Solid:
        """The part."""
        return self.light.solid

    @property
    def workspace(self) -> Array:
        """Lowest and highest corner (2, 3) of the box the camera may be in, mm."""
        return self.light.workspace

    @property
    def entities(self) -> Mapping[str, Any]:
        """The entities by name."""
        return self.light.entities

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""
        return self.light.entity_names

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
        found = RingSpace(self.light.subset(names), self.camera, self.step)
        found._rays = self._rays
        return found

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
        eyes = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        found = np.array(self.light.observable(eyes, names))
        for k, name in enumerate(names):
            for edge_id in self.entities[name].edge_ids:
                rows = np.flatnonzero(found[:, k])
                found[rows, k] = self._shows(self.solid.edges[edge_id], eyes[rows])
        return found

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
        one = np.maximum(-np.einsum("nsi,ni->ns", sight, seen), 0.0) / near
        other = np.abs(np.einsum("nsi,nsi->ns", rays, hit["primitive_normals"])) / length
        far = np.where(part, hit["t_hit"], 1.0) * length
        # the lamp is where the camera is, so that nothing that is seen is in shadow
        differs = (sure_contrast((one, near), (other, far)) >= self.contrast) & (
            np.abs(one - other) >= self.step
        )
        return np.asarray((differs | ~part).all(axis=1))


GROUNDS = ("dark", "bright")
# the workspace of the regions is so much larger than the lamps' space, as a share of it
_ROOM = 0.01


@dataclass(frozen=True, eq=False)
class Lighting:
    """The options of the lamps of a plan; `plan_light` describes them in full.

    Parameters
    ----------
    lamps : array_like, shape (n, 3), or LampBox, LampDome or "ring"
        Positions of the lamps, mm, or the region where lamps may be, or a ring light.
    contrast, step : float
        Least contrast, and least step of grey values.
    ground : str
        "dark" or "bright".
    tolerance_mm : float
        Largest distance of a lamp from its position, mm.
    together : bool
        Whether all lamps are on in every image, as in a cell without switches. They then have equal
        strength. Otherwise one lamp is on at a time.

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

    lamps: Any
    contrast: float = DEFAULT_CONTRAST
    step: float = DEFAULT_STEP
    ground: str = "dark"
    tolerance_mm: float = 0.0
    together: bool = False

    def __post_init__(self) -> None:
        check_contrast(self.contrast)
        if isinstance(self.lamps, LampsTogether):
            object.__setattr__(self, "together", True)
            object.__setattr__(self, "lamps", self.lamps.lamps)
        object.__setattr__(self, "lamps", check_lamps_given(self.lamps))
        if self.together and self.is_ring:
            rule = "must be False for a ring light, which is one lamp"
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
        if lamps is None:
            lamps = "a ring light"
        elif isinstance(lamps, np.ndarray):
            lamps = f"{len(lamps)} lamps"
        return f"<Lighting by {lamps}: contrast {self.contrast:g}, step {self.step:g}, {self.ground} ground>"

    @property
    def given(self) -> LampSpace | NDArray[np.float64] | None:
        """Positions (n, 3) of fixed lamps, mm, or their region, or None for a ring light."""
        return None if self.is_ring else self.lamps

    @property
    def is_ring(self) -> bool:
        """Whether the lamp is on the camera."""
        return isinstance(self.lamps, str)

    @property
    def is_fixed(self) -> bool:
        """Whether the lamps have fixed positions."""
        return isinstance(self.lamps, np.ndarray)

    def check_part(self, solid: Solid) -> None:
        """Refuse fixed lamps inside the part.

        Parameters
        ----------
        solid : Solid
            The part.

        Raises
        ------
        LightError
            If there is one.
        """
        if isinstance(self.given, np.ndarray):
            check_lamps(solid, self.given)

    def served(self, plan: PlanToLight, solid: Solid, progress: Progress | None = None) -> Served:
        """Return a record of lamp positions that light the targets; it is empty at first.

        Parameters
        ----------
        plan : PlanToLight
            Settings and their targets.
        solid : Solid
            The part.
        progress : callable, optional
            ``progress(done, total, label)``.

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
        """
        self.check_part(solid)
        given = self.given
        scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        demands = demands_of(plan, solid, scene, self.ground)
        if given is None:
            room = eyes_of(plan)
        else:
            room = given if isinstance(given, np.ndarray) else given.bounds
        # a displaced camera takes its ring along
        moved = plan.requirements.get("visibility_radius_mm", 0.0) if given is None else 0.0
        off = max(self.tolerance_mm, moved)
        light = _regions(solid, demands, self.contrast, _workspace(solid, room, off), progress)
        clearance = 0.0 if given is None or isinstance(given, np.ndarray) else given.clearance_mm
        names = [(pair.setting, pair.name) for pair in demands.pairs]
        corners = corners_of(plan, solid, scene, names, demands.edge_ids)
        return Served(
            light, scene, demands.pairs, self.contrast, self.step, clearance, off, corners
        )


def eyes_of(plan: PlanToLight) -> NDArray[np.float64]:
    """Return where the cameras of a plan are (n, 3), mm."""
    return np.array([np.asarray(one.cam2world)[:3, 3] for one in plan.settings]).reshape(-1, 3)


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
) -> LightRegions | None:
    if not demands.entities:
        return None
    shown = labelled(progress, "light regions")
    return compute_light(
        solid, demands.entities, contrast, workspace, None, shown, demands.silhouettes
    )

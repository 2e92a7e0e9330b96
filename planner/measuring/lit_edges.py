"""What `measure` will find of a target under a lamp: the part of a plan's promise that is not geometry of errors.

Notation
--------
E   light on a place of a face, as a share of what falls on a face lit frontally there: a cosine, or 0 in a shadow
s   step of an edge: the difference of E on both of its sides

The samples are those of `measure`. One counts as found if nothing hides it, no other line is near, s is large enough,
and no shadow ends near it. A length also needs a line at each corner, of which enough is found. An image is exposed
for its targets. Other edges beside which it is overexposed then register nothing. All of this is computed for the
nominal part and the planned pose, and a reserve is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aspectgraph import Solid
from aspectgraph.light import DEFAULT_CONTRAST
from planner.camera.camera import Camera
from planner.detectability.image_check import COVERAGE_SHARE, SECTORS
from planner.light.area_light import AreaLight, EdgePoints, Sight, StandingLight
from planner.light.light_plan import WHITE_SHARE
from planner.measuring.corners import ARM_SHARE, LEAST_ANGLE_DEG, arms_of, ends_of, near_corner
from planner.measuring.registered import Faces
from planner.measuring.samples import (
    APART_PX,
    PART_WORDS,
    EdgeTable,
    PartEdge,
    PartModel,
    Samples,
    ShownEdges,
    across_of,
    numbers_of_parts,
    parts_of,
    pixels_of,
)
from planner.measuring.verdict import Sampled
from planner.request.registration import OWN_EDGES, RegistrationRecord
from planner.request.targets import Target

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAST_STEP = 0.06
"""Step, as a share of a face lit frontally, from which on an edge counts as found.

If the brightest place beside an edge has 80 % of white, this is 5 % of white at least; scans need 2 to 3 %.
"""
RESERVE = 0.08
"""A target is readable, and an image registered, if lamps show this much more than `measure` needs.

Shadows take more in images, and so does overexposure: of an image with 0.64 by count, 0.57 was found. What lies beside
other lines is no matter of lamps: the count of displaced poses holds its reserve. Of eight rims of CTC-03 with 0.80 to
0.86 apart from other lines, all were read in each registered image of three deviating parts.
"""
LEAST_OF_PART = 0.4
"""And this share of each of its twelfths, see `planner.measuring.samples.parts_of`."""
LEAST_EDGE_STEP = 0.03
"""The same as `LEAST_STEP` of the edges that an image is registered to: some of them may be missed."""
LEAST_REGISTERED = 0.6
"""Share of the part's visible edges that a lamp must show, so that its image can be registered.

From 0.6 on, `measure` is convinced by what it finds. Below, a lamp must also explain what it does not find: images of
five parts were registered with 0.36 and more, and one of a bracket was not with 0.58. With 0.28, 10 of 12 were not.
"""

# places on either side, px: the first is where the step is, and all of them are lit or none
_BESIDE_PX = (3.0, 1.5, 4.5, 6.0)
_MARGIN_PX = 4.0
# samples of an entity, and of all edges, that are looked at
_MOST_SAMPLES = 192
_MOST_OF_ALL = 240
# samples that an entity has at least, before they are thinned
_LEAST_SAMPLES = 10
# rays at a time
_RAYS = 200_000
# where places behind the camera are taken to be
_FAR_PX = -1e6


class _Seen(NamedTuple):
    """What lamps make of samples.

    Attributes
    ----------
    is_found : array of bool (n, m)
        Whether a lamp shows the sample, with no shadow that ends beside it.
    brighter : array (n, m)
        The larger irradiance of the part beside it, 1/mm².
    sides : array (n, 2, m)
        The irradiance on both sides; beside the part 0, or inf before a bright background.
    """

    is_found: Bools
    brighter: Array
    sides: Array

    def under(self, white: Array) -> Bools:
        """Return what is found where an irradiance (n,) is overexposed, 1/mm²; inf where that is not known.

        Far from a lamp an edge may be too dark for the exposure, although it has contrast.
        """
        is_known = np.isfinite(white)[:, None]
        limit = np.where(is_known, white[:, None], 1.0)
        grey = np.minimum(self.sides, limit[:, None])
        is_clear = np.abs(grey[:, 1] - grey[:, 0]) >= WHITE_SHARE * LEAST_EDGE_STEP * limit
        return np.asarray(self.is_found & (~is_known | (is_clear & (self.brighter <= limit))))


@dataclass(frozen=True)
class _Sides:
    """Places (k, 2, m) on both sides of samples, at k distances, and which are on the part."""

    faces: Faces
    on_part: Bools
    background: float
    least_step: float = LEAST_STEP

    @classmethod
    def of(
        cls,
        sampled: Sampled,
        distances: tuple[float, ...],
        background: float,
        least_step: float = LEAST_STEP,
    ) -> _Sides:
        """Return the places beside samples."""
        samples = sampled.samples
        across = across_of(samples.points, samples.tangents, sampled.pose, sampled.camera)
        both = [sampled.beside(across, distance) for distance in distances]
        first = both[0][0]
        faces = Faces(
            np.stack([faces.points for faces, _ in both]),
            np.stack([faces.normals for faces, _ in both]),
            first.eye,
            first.middle,
            first.scene,
        )
        on_part = np.stack([on_part for _, on_part in both])
        return cls(faces, on_part, background, least_step)

    def found(self, lamps: Array) -> Bools:
        """Return which samples (n, m) lamps (n, 3) show, with no shadow that ends beside them."""
        return self.seen(lamps).is_found

    def seen(self, lamps: Array) -> _Seen:
        """Return what lamps (n, 3) make of each sample."""
        n_samples = self.on_part.shape[-1]
        is_found = np.empty((len(lamps), n_samples), dtype=np.bool_)
        brighter = np.empty((len(lamps), n_samples))
        sides = np.empty((len(lamps), 2, n_samples))
        beyond = np.inf if self.background > 0 else 0.0
        block = max(1, _RAYS // self.on_part.size)
        for first in range(0, len(lamps), block):
            of_block = slice(first, first + block)
            light, length = self.faces.light(lamps[of_block, None, None, None])
            of_part = np.where(self.on_part, light / length**2, 0.0)
            brighter[of_block] = of_part[:, 0].max(axis=1)
            sides[of_block] = np.where(self.on_part[0], of_part[:, 0], beyond)
            light = np.where(self.on_part, light, self.background)
            shows = np.abs(light[:, 0, 1] - light[:, 0, 0]) >= self.least_step
            is_lit = light > 0
            even = (is_lit == is_lit[:, :1]) | ~self.on_part
            is_found[of_block] = shows & even.all(axis=(1, 2))
        return _Seen(is_found, brighter, sides)

    def brightest(self, lamps: Array, usable: Bools) -> Array:
        """Return the largest irradiance (n,) of the part beside some samples (m,), 1/mm²; 0 without any."""
        # the places nearest to the edge are enough
        faces = self.faces.chosen(0).chosen((slice(None), usable))
        on_part = self.on_part[0][:, usable]
        brightest = np.zeros(len(lamps))
        block = max(1, _RAYS // max(1, on_part.size))
        for first in range(0, len(lamps), block):
            of_block = slice(first, first + block)
            light, length = faces.light(lamps[of_block, None, None])
            of_part = np.where(on_part, light / length**2, 0.0)
            brightest[of_block] = of_part.max(axis=(1, 2), initial=0.0)
        return brightest


class Needed(NamedTuple):
    """How much of an entity must be found.

    Attributes
    ----------
    n_parts : int
        In how many parts of it something must be found.
    apart : float
        Share of its samples that must be visible and apart from other lines.
    shown : float
        Share that a lamp must show of its samples, or all that are apart.
    """

    n_parts: int = SECTORS
    apart: float = COVERAGE_SHARE
    shown: float = COVERAGE_SHARE + RESERVE

    @classmethod
    def of(cls, samples: Samples, is_arm: bool) -> Needed:
        """Return what is needed of an edge with so many samples, or of a line near a corner."""
        if is_arm:
            # no count of displaced poses holds a reserve for it
            return cls(1, ARM_SHARE + RESERVE, ARM_SHARE + RESERVE)
        return cls(parts_of(len(samples.share)))


@dataclass(frozen=True)
class EntityLight:
    """Samples (m) of an entity in an image, and places beside them.

    Attributes
    ----------
    name : str
        The entity.
    share : array (m,)
        Where the samples are on it.
    usable : array of bool (m,)
        Whether nothing hides them and no other line is near.
    sides : _Sides or None
        None of an entity with too few samples.
    needed : Needed
        How much of it must be found.
    """

    name: str
    share: Array
    usable: Bools
    sides: _Sides | None
    needed: Needed = field(default_factory=Needed)

    @cached_property
    def reason(self) -> str:
        """Why no lamp helps; empty if one may."""
        if self.sides is None:
            return f"the image of {self.name} is too short"
        if not self.is_apart:
            state = f"is visible and {APART_PX:.0f} px apart from other lines"
            return _too_little(self, self.usable, self.needed.apart, state)
        return ""

    @property
    def is_apart(self) -> bool:
        """Whether enough of it is visible and apart from other lines."""
        enough = self.usable.mean() >= self.needed.apart
        return bool(enough and (self._in_parts(self.usable[None]) >= (self._offered > 0)).all())

    def shown(self, lamps: Array) -> Bools:
        """Return under which lamps (n, 3) enough of the entity is found."""
        if self.sides is None or self.reason:
            return np.zeros(len(lamps), dtype=np.bool_)
        return self.covers(self.sides.found(lamps))

    def covers(self, found: Bools) -> Bools:
        """Tell of samples that lamps show (n, m) whether they are enough, or all of those that other lines leave."""
        usable = found & self.usable
        shown = np.minimum(self.needed.shown, self.usable.mean())
        of_parts = np.maximum(LEAST_OF_PART * self._offered, self._offered > 0)
        of_parts = np.minimum(of_parts, self._in_parts(self.usable[None])[0])
        enough = usable.mean(axis=1) >= shown
        return np.asarray(enough & (self._in_parts(usable) >= of_parts).all(axis=1))

    @cached_property
    def _holds(self) -> Bools:
        """Which samples (m, p) are in each part."""
        part = numbers_of_parts(self.share, self.needed.n_parts)
        return np.asarray(part[:, None] == np.arange(self.needed.n_parts))

    @property
    def _offered(self) -> NDArray[np.int_]:
        """How many samples are in each part (p,)."""
        return np.asarray(self._holds.sum(axis=0))

    def _in_parts(self, samples: Bools) -> NDArray[np.int_]:
        """Return how many of some samples (n, m) are in each part (n, p)."""
        return np.asarray(samples.astype(int) @ self._holds)


@dataclass(frozen=True)
class EndLight:
    """The lines that leave an end of a length at an angle in the image; one of them must be found.

    Attributes
    ----------
    name : str
        The edge.
    arms : list of EntityLight
        The lines, near the corner.
    """

    name: str
    arms: list[EntityLight]

    @cached_property
    def reason(self) -> str:
        """Why no lamp helps; empty if one may."""
        if any(not arm.reason for arm in self.arms):
            return ""
        return _no_corner(self.name, [arm.reason for arm in self.arms])

    def shown(self, lamps: Array) -> Bools:
        """Return under which lamps (n, 3) enough of a line is found."""
        readable = np.zeros(len(lamps), dtype=np.bool_)
        for arm in self.arms:
            rows = np.flatnonzero(~readable)
            if len(rows):
                readable[rows] = arm.shown(lamps[rows])
        return readable


@dataclass(frozen=True)
class TargetLight:
    """What `measure` will read of a target in a setting.

    Attributes
    ----------
    entities : list of EntityLight
        What it is a value of.
    ends : list of EndLight
        Of a length, the lines at its corners.
    """

    entities: list[EntityLight]
    ends: list[EndLight] = field(default_factory=list)

    @cached_property
    def reason(self) -> str:
        """Why no lamp helps; empty if one may."""
        reasons = (lines.reason for lines in self._lines)
        return next(filter(None, reasons), "")

    @property
    def _lines(self) -> list[EntityLight | EndLight]:
        return [*self.entities, *self.ends]

    def shown(self, lamps: Array) -> Bools:
        """Return under which lamps (n, 3) enough of the target is found."""
        readable = np.full(len(lamps), not self.reason)
        for lines in self._lines:
            rows = np.flatnonzero(readable)
            if len(rows):
                readable[rows] = lines.shown(lamps[rows])
        return readable

    def white(self, lamps: Array) -> Array:
        """Return the irradiance (n,) that is overexposed if the image is exposed for the target, 1/mm²."""
        brightest = np.zeros(len(lamps))
        for entity in self.entities:
            if entity.sides is not None:
                beside = entity.sides.brightest(lamps, entity.usable)
                brightest = np.maximum(brightest, beside)
        return brightest / WHITE_SHARE


@dataclass
class LitEdges:
    """What `measure` will find in images of a part; see the module.

    Parameters
    ----------
    solid : Solid
        The part.
    registers : bool
        Whether images are registered to the part's own edges, so that enough of these must show.
    """

    solid: Solid
    registers: bool
    _model: PartModel | None = field(default=None, init=False, repr=False)

    def __getstate__(self) -> dict[str, object]:
        """Leave the rays' scene behind: it cannot cross a process boundary."""
        return {**self.__dict__, "_model": None}

    @property
    def model(self) -> PartModel:
        """The part's edges."""
        if self._model is None:
            self._model = PartModel(self.solid, {})
        return self._model

    def of_target(
        self, cam2world: Array, camera: Camera, target: Target, background: float
    ) -> TargetLight:
        """Return what will be read of a target.

        Parameters
        ----------
        cam2world : array (4, 4)
            The planned pose.
        camera : Camera
            The camera.
        target : Target
            The target.
        background : float
            Light behind the part, 0 or 1.
        """
        entities = []
        ends = []
        for shape in target.geometry:
            edge = self.model.entity(shape, target.name)
            samples = self._samples(edge, cam2world, camera)
            entities.append(self._entity(edge, samples, cam2world, camera, background))
            if not target.has_corners:
                continue
            for end in ends_of(edge):
                arms = [
                    self._entity(arm, near, cam2world, camera, background, is_arm=True)
                    for arm, near in self._arms(edge, end, cam2world, camera)
                ]
                ends.append(EndLight(edge.name, arms))
        return TargetLight(entities, ends)

    def _samples(self, edge: PartEdge, cam2world: Array, camera: Camera) -> Samples:
        """Return the samples of an edge in an image."""
        return self.model.edges.samples(cam2world, camera, [edge], _MARGIN_PX)

    def _arms(
        self, edge: PartEdge, end: Array, cam2world: Array, camera: Camera
    ) -> list[tuple[PartEdge, Samples]]:
        """Return the lines of which one must be found at an end of a length, and their samples near it."""
        arms = []
        for arm, _ in arms_of(self.model, edge, end, cam2world, camera):
            samples = self._samples(arm, cam2world, camera)
            arms.append((arm, near_corner(samples, end, cam2world, camera)))
        return arms

    def _entity(
        self,
        edge: PartEdge,
        every: Samples,
        cam2world: Array,
        camera: Camera,
        background: float,
        is_arm: bool = False,
    ) -> EntityLight:
        """Return an edge, or a line near a corner, as an image shows it."""
        shown = self.model.shown(cam2world, camera)
        samples = _thinned(every, _MOST_SAMPLES)
        pixels = pixels_of(samples.points, cam2world, camera)
        usable = samples.visible & shown.apart([edge], samples.edge, pixels)
        sides = None
        if len(usable) >= _LEAST_SAMPLES:
            sampled = Sampled(self.model.edges.scene, camera, cam2world, [edge], samples)
            sides = _Sides.of(sampled, _BESIDE_PX, background)
        return EntityLight(edge.name, samples.share, usable, sides, Needed.of(every, is_arm))

    def unread(self, cam2world: Array, camera: Camera, target: Target, area: AreaLight) -> str:
        """Return why too little of a target is found under a light with an area; empty if enough is.

        Parameters
        ----------
        cam2world, camera, target
            As of `of_target`.
        area : AreaLight
            The light.
        """
        light = area.held(cam2world)
        for shape in target.geometry:
            edge = self.model.entity(shape, target.name)
            samples = self._samples(edge, cam2world, camera)
            text = self._unread_edge(edge, samples, cam2world, camera, light)
            if text:
                return text
            for end in ends_of(edge) if target.has_corners else ():
                reasons = [
                    self._unread_edge(arm, near, cam2world, camera, light, is_arm=True)
                    for arm, near in self._arms(edge, end, cam2world, camera)
                ]
                if all(reasons):
                    return _no_corner(edge.name, reasons)
        return ""

    def _unread_edge(
        self,
        edge: PartEdge,
        every: Samples,
        cam2world: Array,
        camera: Camera,
        light: StandingLight,
        is_arm: bool = False,
    ) -> str:
        """Return why a light with an area shows too little of an edge, or of a line near a corner; empty if enough."""
        shown = self.model.shown(cam2world, camera)
        samples = _thinned(every, _MOST_SAMPLES)
        if len(samples.share) < _LEAST_SAMPLES:
            return f"the image of {edge.name} is too short"
        lit = self._lit([edge], samples, cam2world, camera, light)
        needed = Needed.of(every, is_arm)
        entity = EntityLight(edge.name, samples.share, samples.visible, None, needed)
        if not entity.covers(lit[None])[0]:
            return _too_little(entity, samples.visible & lit, needed.shown, "is shown")
        pixels = pixels_of(samples.points, cam2world, camera)
        distance, _ = cKDTree(np.nan_to_num(pixels, nan=_FAR_PX)).query(shown.pixels)
        near = shown.samples.chosen(distance < APART_PX)
        # lines that the light does not show do not matter
        edges = self.model.edges.edges
        lines = near.chosen(self._lit(edges, near, cam2world, camera, light))
        places = pixels_of(lines.points, cam2world, camera)
        others = ShownEdges(edges, lines, places, shown.contours)
        apart = samples.visible & others.apart([edge], samples.edge, pixels)
        entity = replace(entity, usable=apart)
        if entity.is_apart and entity.covers(lit[None])[0]:
            return ""
        state = f"shows {APART_PX:.0f} px apart from other lines"
        share = min(needed.shown, float(apart.mean())) if entity.is_apart else needed.apart
        return _too_little(entity, lit & apart, share, state)

    def _lit(
        self,
        edges: Sequence[PartEdge],
        samples: Samples,
        cam2world: Array,
        camera: Camera,
        light: StandingLight,
    ) -> Bools:
        """Return which samples of edges a light with an area shows."""
        if not len(samples.share):
            return np.zeros(0, dtype=np.bool_)
        sight = Sight.of(self.solid, camera, self.model.edges.scene)
        of_edges = EdgePoints(*EdgeTable(edges).at(samples.edge, samples.share))
        contrast, _ = light.contrasts(sight, of_edges, cam2world[None, :3, 3])
        return np.asarray(contrast[0] >= DEFAULT_CONTRAST)

    def reserve(
        self, cam2world: Array, camera: Camera, lamps: Array, background: float, whites: Array
    ) -> Array:
        """Return by how much lamps show more of the part's edges than an image needs to be registered.

        Parameters
        ----------
        cam2world, camera, background
            As of `of_target`.
        lamps : array (n, 3)
            Lamps of which one is on, mm.
        whites : array (n, p)
            Irradiance that is overexposed if the image is exposed for each of p targets, 1/mm².

        Returns
        -------
        array (n, p)
            A share of the edges, for each of these exposures. It is negative where an image is not registered, and 1
            where none has to be.
        """
        if not self.registers or not len(lamps):
            return np.ones(whites.shape)
        shares = self.shown_share(cam2world, camera, lamps, background, whites)
        return shares - (LEAST_REGISTERED + RESERVE)

    def shown_share(
        self, cam2world: Array, camera: Camera, lamps: Array, background: float, whites: Array
    ) -> Array:
        """Return the share (n, p) of the part's visible edges that lamps (n, 3) show, see `reserve`."""
        edges = self.model.edges.edges
        shown = self.model.shown(cam2world, camera)
        apart = shown.apart(edges, shown.samples.edge, shown.pixels)
        samples = _thinned(shown.samples.chosen(apart), _MOST_OF_ALL)
        if not len(samples.share):
            return np.zeros(whites.shape)
        sampled = Sampled(self.model.edges.scene, camera, cam2world, edges, samples)
        sides = _Sides.of(sampled, _BESIDE_PX[:1], background, LEAST_EDGE_STEP)
        seen = sides.seen(lamps)
        shares = [seen.under(white).mean(axis=1) for white in whites.T]
        return np.stack(shares, axis=1) if shares else np.zeros(whites.shape)


def _too_little(entity: EntityLight, usable: Bools, needed: float, state: str) -> str:
    """Say that too few samples (m,) of an entity are usable, or too few of a twelfth of it."""
    share = float(usable.mean())
    if share >= needed:
        return f"too little of a {PART_WORDS[entity.needed.n_parts - 2]} of {entity.name} {state}"
    # as many digits as tell it from what is needed
    digits = 0 if round(100 * share) < round(100 * needed) else 1
    percents = f"only {100 * share:.{digits}f} %" if share >= 0.005 else "none"
    return f"{percents} of {entity.name} {state}, and {100 * needed:.0f} % must be"


def _no_corner(name: str, reasons: Sequence[str]) -> str:
    """Say that no line at an end of an edge is found, and why not."""
    if not reasons:
        return f"no straight line leaves an end of {name} at {LEAST_ANGLE_DEG:.0f}° in the image"
    return f"no line that leaves a corner of {name} is found: {'; '.join(reasons)}"


def _thinned(samples: Samples, most: int) -> Samples:
    """Return some of the samples, equally far apart, of more than so many."""
    n = len(samples.share)
    chosen = np.zeros(n, dtype=np.bool_)
    chosen[np.linspace(0, n - 1, min(n, most)).round().astype(int)] = True
    return samples.chosen(chosen)


def reads_of(solid: Solid, how: RegistrationRecord | None) -> LitEdges:
    """Return what `measure` will find in images of a plan.

    Parameters
    ----------
    solid : Solid
        The part.
    how : RegistrationRecord or None
        How poses are known when values are read; None if that is not stated: `measure` then registers images to the
        part's edges.
    """
    return LitEdges(solid, how is None or how.method == OWN_EDGES)

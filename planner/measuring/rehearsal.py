"""Images of a plan, rendered: to rehearse measuring before there is a camera.

The part may deviate from its model, and the camera from its poses. Rays with the plan's light, or with a light on the
camera, give the grey values: under small lamps of a matt part, without light from face to face; under lights with an
area of the plan's material. Edges are sharp, and lenses are left out. So the images tell whether plan, part, files and
commands fit together, and how large errors of position are; they do not tell how a real part looks.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter

from aspectgraph.entities.entity_rules import PARAMETERS, Carrier
from aspectgraph.solid.solid import RayScene
from errors.measurands import Circle, Line
from ground.convert import Meta, Shape, from_plain, to_plain
from ground.faces import program_name
from ground.short_repr import count
from planner.argument_kinds import NOT_NEGATIVE, check_count, check_kinds, check_number
from planner.camera.camera import Camera, tangents_of
from planner.camera.response import LINEAR, Response
from planner.exceptions import PlanFileError, RequestError
from planner.files import (
    absolute,
    check_path_text,
    file_digest,
    read_json,
    staged_folder,
    timestamp,
    write_text,
)
from planner.identity import PartRecord
from planner.light.area_light import AreaLight
from planner.light.light_plan import beside, white_share
from planner.measuring.advice import TRUTH as TRUTH
from planner.measuring.fit import fit_entities
from planner.measuring.images import Shot
from planner.measuring.measurer import Measurer, whole_targets, witness_key
from planner.measuring.registered import displaced
from planner.measuring.samples import PartEdge, PartModel
from planner.progress import Progress, report
from planner.request.targets import Target, targets_of
from planner.sensor_setting import setting_name

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan

Array = NDArray[np.float64]

FORMAT: Literal["aspectgraph-rehearsal"] = "aspectgraph-rehearsal"
ROUND_SHARE = 1.5
"""Deviation of bores, bosses and cones, in that of planes."""
TILT_SHARE = 0.5
"""Tilts of a plane at its extent, in its deviation."""
CHORD_MM = 0.0005
"""Chords of rims and of round faces are halved until they are at most so far from them."""
BLUR_PX = 0.7
"""Blur of lens and pixels, standard deviation."""
NOISE_SHARE = 0.005
"""Noise of grey values, standard deviation as a share of white."""
SHADOW_SHARE = 0.04
"""Grey value behind the part and in shadows, as a share of white."""
BRIGHT_GROUND = 0.85
"""Grey value behind the part on a bright ground, as a share of white."""

# grey value of full exposure, of 8 bits
_WHITE = 255
# rays along each side of a pixel where the picture changes by more than this share of the brightest place
_SAMPLES = 4
_CHANGE = 0.01
# how far rays to lamps start above a face
_LIFT_MM = 2e-3
# pixels from one to the next that a light with an area is first looked at
_EVERY = 4
# what light does not do on a smooth face from one pixel to the next, as a share of the brightest
_BENT = 0.03
# the same of the few, whose middle is off by an eighth of it
_BENT_OF_FEW = 0.06
# lights with an area take more rays each for so many pixels at a time
_FINE = 20_000
# an image of such light has so many more steps
_STEPS_OF_AREA = 2
# faces deviate by this share of the part's size at most
_MOST_OF_PART = 0.1
# vertices of a mesh are so near to the cylinder or cone that they are on, mm
_ON_WALL_MM = 1e-4
_RAYS = 400_000
# of points on an entity
_POINTS = 128
# surfaces that are nearly alike move a vertex like one
_ALIKE = 0.1
# what surfaces miss of a common point is noise of doubles below this
_MET = 1e-9
# cosine of the angle up to which a round surface counts as tangent to a plane, 8 degrees
_TANGENT = 0.99


@dataclass(frozen=True)
class Truth:
    """What rendered images show.

    Attributes
    ----------
    seed : int
        What was drawn.
    surfaces_mm : float
        Standard deviation of planes along their normals; where each face has its own, the largest.
    values : dict of str to dict of str to float
        True values of the targets in each image, in mm (angles: degrees). A target whose entities are in two images
        has the same value in both.
    poses : dict of str to array (4, 4)
        Where the camera was, by image: camera to world, mm.
    response : str
        Of the grey values: that of the plan's camera, otherwise "linear".
    white_level : int
        Grey value of full exposure.
    plan_digest : str
        Of the plan's file, SHA-256, see `InspectionPlan.digest`; empty in older files.
    joined : dict of str to float
        True values of targets that the plan does not inspect, and that `measure` may join from several images.
    date : str
        When the rehearsal was made, in the form of ISO 8601 (UTC); empty in older files, as what follows.
    program : str
        Name and version of the program.
    part, part_digest : str
        The part, and the SHA-256 of its vertices and triangles as designed.
    images : dict of str to str
        SHA-256 of each file with an image, by its name; empty before they are written, and in older files.
    """

    seed: int
    surfaces_mm: float
    values: dict[str, dict[str, float]]
    poses: dict[str, Annotated[Array, Shape(4, 4)]]
    format: Annotated[Literal["aspectgraph-rehearsal"], Meta(title="must be a rehearsal")] = field(
        default=FORMAT
    )
    version: Literal[1] = 1
    response: str = LINEAR.text
    white_level: Annotated[int, Meta(gt=0, title="must be a number above 0")] = _WHITE
    plan_digest: str = ""
    joined: dict[str, float] = field(default_factory=dict)
    date: str = ""
    program: str = ""
    part: str = ""
    part_digest: str = ""
    images: dict[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        images = count(len(self.values), "image")
        part = f" of {self.part!r}" if self.part else ""
        drawn = f"surfaces {self.surfaces_mm:g} mm, seed {self.seed}"
        return f"<Truth{part}: {images}, {drawn}>"


class Rendered(NamedTuple):
    """One image.

    Attributes
    ----------
    shot : Shot
        Which.
    grey : array (h, w)
        Of the camera's response. Of 8 bits, or of 16 where the camera's ``white_level`` is above 255.
    pose : array (4, 4)
        Where the camera was.
    """

    shot: Shot
    grey: NDArray[np.uint8 | np.uint16]
    pose: Array

    def __repr__(self) -> str:
        """Return a one-line summary."""
        height, width = self.grey.shape
        return f"<Rendered {self.shot.name!r}: {width} × {height} px, {self.grey.dtype}>"


class _Meeting(NamedTuple):
    """Points, by their numbers (n,), on the same surfaces (k,): normals (n, k, 3) and offsets (n, k, p) there."""

    rows: NDArray[np.int64]
    surfaces: NDArray[np.int64]
    normals: Array
    offsets: Array


class _RoundScene(RayScene):
    """Rays to a part whose cylinders and cones are shaded as round: deviations tilt their slender triangles.

    Parameters
    ----------
    vertices, triangles
        As of `RayScene`.
    walls : sequence of Carrier
        Cylinders and cones.
    wall_of : array of int (t,)
        Number of the wall that each triangle lies on; -1 for none.
    face_of : array of int (t,)
        Number of the face of the model that each triangle is part of.
    """

    def __init__(
        self,
        vertices: Array,
        triangles: NDArray[np.int64],
        walls: Sequence[Carrier],
        wall_of: NDArray[np.int64],
        face_of: NDArray[np.int64],
    ) -> None:
        super().__init__(vertices, triangles, n_threads=1)
        self._walls = walls
        # also for rays that meet nothing
        self._wall_of = np.append(wall_of, -1)
        corners = vertices[triangles]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sums = np.zeros((face_of.max() + 1, 3))
        np.add.at(sums, face_of, areas)
        normals = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-30)
        self._normals = np.vstack([normals[face_of], np.zeros(3)])
        self._face_of = np.append(np.where(wall_of >= 0, -2 - wall_of, face_of), -1)

    def faces_met(self, eye: Array, rays: Array) -> NDArray[np.int64]:
        """Return numbers (n,) of the faces that rays (n, 3) from an eye meet; -1 for none, less for round ones."""
        numbers = RayScene.cast(self, eye, rays)["primitive_ids"]
        return self._face_of[np.minimum(numbers, len(self._face_of) - 1)]

    def cast(self, origins: ArrayLike, directions: np.ndarray) -> dict[str, np.ndarray]:
        """Return what each ray hits first, see `RayScene.cast`; normals are those of faces, of round ones the model's.

        Slender triangles next to rims would lean out of their plane.
        """
        hits = super().cast(origins, directions)
        number = np.minimum(hits["primitive_ids"], len(self._wall_of) - 1)
        wall = self._wall_of[number]
        is_round = wall >= 0
        wall = wall[is_round]
        starts = np.broadcast_to(origins, directions.shape)[is_round]
        places = starts + hits["t_hit"][is_round, None].astype(np.float64) * directions[is_round]
        flat = hits["primitive_normals"][is_round]
        normals = np.empty_like(flat)
        for k in np.unique(wall):
            normals[wall == k] = self._walls[k].normals(places[wall == k])
        # those of the model point away from an axis, also in bores
        normals *= np.where((normals * flat).sum(axis=1) < 0, -1.0, 1.0)[:, None]
        hits["primitive_normals"] = self._normals[number].astype(np.float32)
        hits["primitive_normals"][is_round] = normals
        return hits


class DeviatingPart:
    """A part whose surfaces deviate from its model.

    Parameters
    ----------
    model : PartModel
        The part as it is designed.
    surfaces_mm : float or array (k,)
        Standard deviation of planes along their normals, of all surfaces or of each; 0 is the part as designed.
    rng : Generator
        Draws the deviations.

    Attributes
    ----------
    scene : RayScene
        The part as it is.
    largest_mm : float
        By how much a plane is moved or tilted at most, or a radius or an axis is off, mm.
    """

    def __init__(self, model: PartModel, surfaces_mm: ArrayLike, rng: np.random.Generator) -> None:
        self._model = model
        carriers = model.carriers.surfaces
        sizes = [
            [1.0, TILT_SHARE, TILT_SHARE] if carrier.is_plane else [ROUND_SHARE] * PARAMETERS
            for carrier in carriers
        ]
        drawn = rng.standard_normal((len(carriers), PARAMETERS))
        mesh = _RoundMesh(model)
        vertices = mesh.points
        carried = mesh.carried
        of_each = np.broadcast_to(np.asarray(surfaces_mm, dtype=np.float64), len(carriers))
        scales = np.reshape(sizes, (-1, PARAMETERS)) * of_each[:, None]
        self._deviations = scales * self._closed(vertices, carried, drawn, scales)
        # where faces meet at a small angle, their corner is off by more than they are
        self.largest_mm = float(np.abs(self._deviations).max(initial=0.0))
        moved = vertices + self._moves_of_mesh(mesh)
        self.scene = _RoundScene(moved, mesh.triangles, mesh.walls, mesh.wall_of, mesh.face_of)

    def value(self, name: str, target: Target) -> float:
        """Return the value of a target on the part as it is, mm (angles: degrees).

        Parameters
        ----------
        name : str
            What the model knows the target as.
        target : Target
            The target.
        """
        return self.value_of(self._model.measured[name], target)

    def value_of(self, edges: Sequence[PartEdge], target: Target) -> float:
        """Return the value of a target whose entities are these of the model, as `value` does."""
        if target.measurand.in_image:
            line = edges[0].geometry
            assert isinstance(line, Line)
            ends = np.array([line.p, line.q])
            carried = [self._carriers_at(end) for end in ends]
            moved = ends + self._moves(ends, carried)
            return float(np.linalg.norm(moved[1] - moved[0]))
        fits = []
        for edge, frame in zip(edges, target.measurand.frames, strict=True):
            points, _, _ = edge.at((np.arange(_POINTS) + 0.5) / _POINTS)
            pair = self._model.carried_by[edge.name]
            move = self._model.displacement(edge, points) @ self._deviations[list(pair)].ravel()
            local = points + move - frame.origin
            flat = np.stack([local @ frame.x, local @ frame.y], axis=-1)
            fits.append(fit_entities(edge.geometry, flat[None], np.ones(_POINTS))[0])
        return target.measurand.nominal + float(target.measurand.value(fits)[0])

    def _carriers_at(self, place: Array) -> set[int]:
        """Return the surfaces that meet in a corner."""
        vertices = self._model.solid.vertices
        nearest = int(np.argmin(np.linalg.norm(vertices - place, axis=1)))
        return _carried(self._model)[nearest]

    def _moves(self, points: Array, carried: Sequence[Set[int]]) -> Array:
        """Return how points (n, 3) move with the surfaces that they lie on: the least move that meets all of them."""
        moves = np.zeros((len(points), 3))
        for meeting in self._meetings(points, carried):
            off = np.einsum("nip,ip->ni", meeting.offsets, self._deviations[meeting.surfaces])
            inverse = np.linalg.pinv(meeting.normals, rcond=_ALIKE)
            moves[meeting.rows] = np.einsum("nij,nj->ni", inverse, off)
        return moves

    def _moves_of_mesh(self, mesh: _RoundMesh) -> Array:
        """Return how the points (n, 3) of a mesh move: those between others also slide along their surfaces with them.

        A rim slides along both of its walls where these deviate. Points between rims that stay would be passed by it,
        and the mesh would fold.
        """
        moves = self._moves(mesh.points, mesh.carried)
        free = np.broadcast_to(np.eye(3), (len(moves), 3, 3)).copy()
        for meeting in self._meetings(mesh.points, mesh.carried):
            normals = meeting.normals
            held = np.linalg.pinv(normals, rcond=_ALIKE) @ normals
            free[meeting.rows] = np.eye(3) - held
        for halving in mesh.halvings:
            rows = halving.first + np.arange(len(halving.ends))
            moves[rows] += np.einsum("nij,nj->ni", free[rows], moves[halving.ends].mean(axis=1))
        return moves

    def _meetings(self, points: Array, carried: Sequence[Set[int]]) -> Iterator[_Meeting]:
        """Yield the points (n, 3) that lie on the same surfaces."""
        groups: dict[frozenset[int], list[int]] = {}
        for index, surfaces in enumerate(carried):
            groups.setdefault(frozenset(surfaces), []).append(index)
        for group, rows in groups.items():
            if not group:
                continue
            numbers = sorted(group)
            carriers = [self._model.carriers.surfaces[k] for k in numbers]
            places = points[rows]
            normals = np.stack([carrier.normals(places) for carrier in carriers], axis=1)
            # a blend begins where its plane is, or the straight edges that end there would turn
            flat = [carrier.is_plane for carrier in carriers]
            normals[_blended(normals, np.array(flat))] = 0.0
            offsets = np.stack([carrier.offsets(places) for carrier in carriers], axis=1)
            yield _Meeting(np.array(rows), np.array(numbers), normals, offsets)

    def _closed(
        self, points: Array, carried: Sequence[Set[int]], drawn: Array, scales: Array
    ) -> Array:
        """Return standard normal deviations (k, p) given that surfaces that meet in a point still do.

        Four planes of a corner have no common point once each of them deviates on its own. What no move of the points
        (n, 3) meets is C d = 0 in the deviations d, and the drawn ones lose their part along the rows of C.
        """
        squares = np.zeros((drawn.size, drawn.size))
        for meeting in self._meetings(points, carried):
            normals = meeting.normals
            met = np.einsum("nij,njk->nik", normals, np.linalg.pinv(normals, rcond=_ALIKE))
            # a blend follows its plane
            led = (normals**2).sum(axis=2, keepdims=True) > 0
            unmet = np.where(led, np.eye(normals.shape[1]) - met, 0.0)
            if np.abs(unmet).max() < _MET:
                continue
            scaled = meeting.offsets * scales[meeting.surfaces]
            rows = np.einsum("nij,njp->nijp", unmet, scaled).reshape(-1, scaled[0].size)
            places = np.arange(drawn.size).reshape(drawn.shape)[meeting.surfaces].ravel()
            squares[np.ix_(places, places)] += rows.T @ rows
        bound = np.flatnonzero(squares.diagonal())
        if len(bound) == 0:
            return drawn
        values, vectors = np.linalg.eigh(squares[np.ix_(bound, bound)])
        along = vectors[:, values > _MET * values[-1]]
        closed = drawn.copy()
        closed.flat[bound] -= along @ (along.T @ drawn.flat[bound])
        return closed


def _blended(normals: Array, flat: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of k surfaces are round and tangent to a plane among them (n, k), given normals (n, k, 3)."""
    parallel = np.abs(np.einsum("nix,njx->nij", normals, normals)) > _TANGENT
    return np.asarray((parallel & flat).any(axis=2) & ~flat)


def _carried(model: PartModel) -> list[set[int]]:
    """Return the surfaces that each vertex of a part lies on, as far as they carry sharp edges."""
    carried: list[set[int]] = [set() for _ in model.solid.vertices]
    for edge in model.edges.edges:
        for edge_id in edge.edge_ids:
            for vertex in model.solid.edges[edge_id].vertices:
                carried[vertex].update(model.carried_by[edge.name])
    # facets of a cone may have vertices between its rims: from those to their neighbours, and on
    triangles = model.solid.triangles.tolist()
    reached = True
    while reached:
        reached = False
        for corners in triangles:
            lone = [corner for corner in corners if not carried[corner]]
            if not lone or len(lone) == len(corners):
                continue
            common = set.intersection(*(carried[k] for k in corners if carried[k]))
            walls = [k for k in common if not model.carriers.surfaces[k].is_plane]
            for wall, corner in itertools.product(walls, lone):
                if _is_on(model.carriers.surfaces[wall], model.solid.vertices[corner]):
                    carried[corner].add(wall)
                    reached = True
    return carried


def _is_on(carrier: Carrier, point: Array) -> bool:
    """Return whether a point (3,) is on a cylinder or cone."""
    off = point - carrier.point
    height = float(off @ carrier.axis)
    radius = float(np.linalg.norm(off - height * carrier.axis))
    rise = -height * carrier.lean / math.sqrt(1.0 - carrier.lean**2)
    return abs(radius - carrier.radius_mm - rise) < _ON_WALL_MM


class _Halving(NamedTuple):
    """Points of a mesh that halve sides: number of the first one, and the ends (n, 2) of their sides."""

    first: int
    ends: NDArray[np.int64]


class _RoundMesh:
    """A part's triangles, halved until those of round faces are nowhere far from their cylinders and cones.

    A side that two triangles share is halved in both, so that the mesh stays closed.

    Attributes
    ----------
    points : array (n, 3)
        Vertices, mm.
    triangles : array of int (t, 3)
        Their vertices.
    wall_of : array of int (t,)
        Number of the wall that each triangle lies on; -1 on flat faces.
    face_of : array of int (t,)
        Number of the face of the model that each triangle is part of.
    walls : list of Carrier
        Cylinders and cones.
    halvings : list of _Halving
        How points were added to those of the model, in order.
    """

    def __init__(self, model: PartModel) -> None:
        self.halvings: list[_Halving] = []
        self.points: Array = np.array(model.solid.vertices)
        self.triangles: NDArray[np.int64] = np.array(model.solid.triangles, dtype=np.int64)
        self.face_of: NDArray[np.int64] = np.array(model.solid.triangle_face, dtype=np.int64)
        self._groups: list[frozenset[int]] = []
        self._number_of: dict[frozenset[int], int] = {}
        carried = _carried(model)
        self._group_of: NDArray[np.int64] = np.array([self._group(frozenset(k)) for k in carried])
        numbers: dict[int, int] = {}
        self.walls: list[Carrier] = []
        self.wall_of: NDArray[np.int64] = np.full(len(self.triangles), -1)
        for row, (a, b, c) in enumerate(self.triangles.tolist()):
            wall = _round_carrier(model, carried[a] & carried[b] & carried[c])
            if wall is None:
                continue
            self.wall_of[row] = numbers.setdefault(wall, len(numbers))
            if len(numbers) > len(self.walls):
                self.walls.append(model.carriers.surfaces[wall])
        self._circles: list[Circle] = []
        # sides (k, 2) that are chords of circles, and of which
        self._chords: NDArray[np.int64] = np.empty((0, 2), dtype=np.int64)
        self._circle_of: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        for edge in model.edges.edges:
            if isinstance(edge.geometry, Circle):
                chords = [model.solid.edges[edge_id].vertices for edge_id in edge.edge_ids]
                self._add_chords(np.array(chords), np.full(len(chords), len(self._circles)))
                self._circles.append(edge.geometry)
        while self._halve():
            pass

    @property
    def carried(self) -> list[frozenset[int]]:
        """The surfaces that each vertex lies on."""
        return [self._groups[k] for k in self._group_of.tolist()]

    def _group(self, surfaces: frozenset[int]) -> int:
        """Return the number of a set of surfaces."""
        number = self._number_of.setdefault(surfaces, len(self._groups))
        if number == len(self._groups):
            self._groups.append(surfaces)
        return number

    def _add_chords(self, ends: NDArray[np.int64], circles: NDArray[np.int64]) -> None:
        """Remember which circles (k,) sides (k, 2) are chords of."""
        self._chords = np.vstack([self._chords, np.sort(ends, axis=1)])
        self._circle_of = np.append(self._circle_of, circles)

    def _halve(self) -> bool:
        """Halve the sides that are too far from what they are chords of; return whether there was any."""
        n_points = len(self.points)
        ends = np.sort(self._sides(), axis=1)
        keys, side_of = np.unique(ends[:, 0] * n_points + ends[:, 1], return_inverse=True)
        sides = np.stack(np.divmod(keys, n_points), axis=1)
        wall = np.full(len(sides), -1)
        np.maximum.at(wall, side_of.ravel(), np.repeat(self.wall_of, 3))
        circle = np.full(len(sides), -1)
        chords = self._chords[:, 0] * n_points + self._chords[:, 1]
        at = np.minimum(np.searchsorted(keys, chords), len(keys) - 1)
        met = keys[at] == chords
        circle[at[met]] = self._circle_of[met]
        new = np.full((len(sides), 3), np.nan)
        for number, rows in _rows_by(circle):
            new[rows] = _half_arcs(self._circles[number], *self._ends(sides[rows]))
        for number, rows in _rows_by(np.where(circle < 0, wall, -1)):
            new[rows] = _half_ways(self.walls[number], *self._ends(sides[rows]))
        is_cut = np.isfinite(new[:, 0])
        if not is_cut.any():
            return False
        middles = np.full(len(sides), -1)
        middles[is_cut] = n_points + np.arange(is_cut.sum())
        self.halvings.append(_Halving(n_points, sides[is_cut]))
        self.points = np.vstack([self.points, new[is_cut]])
        self._group_of = np.append(self._group_of, self._common(self._group_of[sides[is_cut]]))
        on_circle = is_cut & (circle >= 0)
        for end in sides[on_circle].T:
            self._add_chords(np.stack([end, middles[on_circle]], axis=1), circle[on_circle])
        self._split(middles[side_of.reshape(-1, 3)])
        return True

    def _common(self, groups: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers (n,) of what two sets of surfaces (n, 2) have in common."""
        n_groups = len(self._groups)
        pairs, pair_of = np.unique(groups[:, 0] * n_groups + groups[:, 1], return_inverse=True)
        common = [
            self._group(self._groups[pair // n_groups] & self._groups[pair % n_groups])
            for pair in pairs.tolist()
        ]
        return np.array(common)[pair_of.ravel()]

    def _sides(self) -> NDArray[np.int64]:
        """Return the ends (3 t, 2) of the sides of triangles, from each corner to the next."""
        following = np.roll(self.triangles, -1, axis=1)
        return np.stack([self.triangles, following], axis=2).reshape(-1, 2)

    def _ends(self, sides: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return both ends (n, 3) of sides (n, 2)."""
        return self.points[sides[:, 0]], self.points[sides[:, 1]]

    def _split(self, middles: NDArray[np.int64]) -> None:
        """Split triangles at the middles (t, 3) of their sides from each corner to the next; -1 is for none."""
        n_cut = (middles >= 0).sum(axis=1)
        # turned so that a single cut is first, and a single side that stays is last
        turn = np.where(n_cut == 1, np.argmax(middles >= 0, axis=1), 0)
        turn = np.where(n_cut == 2, (np.argmax(middles < 0, axis=1) + 1) % 3, turn)
        order = (turn[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(self.triangles, order, axis=1).T
        ab, bc, ca = np.take_along_axis(middles, order, axis=1).T
        whole = n_cut == 0
        once = n_cut == 1
        twice = n_cut == 2
        thrice = n_cut == 3
        to_bc = np.linalg.norm(self.points[a] - self.points[bc], axis=1)
        by_a = twice & (to_bc <= np.linalg.norm(self.points[c] - self.points[ab], axis=1))
        by_c = twice & ~by_a
        pieces = [
            (whole, a, b, c),
            (once, a, ab, c),
            (once, ab, b, c),
            (twice, ab, b, bc),
            (by_a, a, ab, bc),
            (by_a, a, bc, c),
            (by_c, a, ab, c),
            (by_c, ab, bc, c),
            (thrice, a, ab, ca),
            (thrice, ab, b, bc),
            (thrice, ca, bc, c),
            (thrice, ab, bc, ca),
        ]
        self.triangles = np.concatenate(
            [np.stack(corners, axis=1)[rows] for rows, *corners in pieces]
        )
        self.wall_of = np.concatenate([self.wall_of[rows] for rows, *_ in pieces])
        self.face_of = np.concatenate([self.face_of[rows] for rows, *_ in pieces])


def _rows_by(numbers: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield each number of an array (n,) that is not negative, with the rows that have it."""
    order = np.argsort(numbers, kind="stable")
    starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
    for rows in np.split(order, starts)[1:]:
        yield int(numbers[rows[0]]), rows


def _round_carrier(model: PartModel, common: Set[int]) -> int | None:
    """Return which cylinder or cone a triangle is on, given what carries all of its corners; None if it is flat."""
    ordered = sorted(common)
    if any(model.carriers.surfaces[k].is_plane for k in ordered):
        return None
    return ordered[0] if ordered else None


def _half_ways(carrier: Carrier, first: Array, last: Array) -> Array:
    """Return the points (n, 3) of a cylinder or cone half way between two of its points (n, 3); NaN where near both.

    The radius of a cylinder or a cone is linear in the place along its axis, as it is between the ends.
    """
    before = first - carrier.point
    after = last - carrier.point
    heights = np.stack([before @ carrier.axis, after @ carrier.axis])[..., None]
    before = before - heights[0] * carrier.axis
    after = after - heights[1] * carrier.axis
    lengths = np.stack([np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)])
    radius = lengths.mean(axis=0)
    out = (before + after) / 2
    middle = np.linalg.norm(out, axis=1)
    # ends on opposite sides of the axis have no middle
    far = (radius - middle > CHORD_MM) & (middle > _MET * radius)
    out = out * (radius / np.where(far, middle, 1.0))[:, None]
    new = carrier.point + out + heights.mean(axis=0) * carrier.axis
    return np.where(far[:, None], new, np.nan)


def _half_arcs(circle: Circle, first: Array, last: Array) -> Array:
    """Return the points (n, 3) of a circle half way between ends (n, 3) of chords; NaN where a chord is near enough."""
    out = (first + last) / 2 - circle.centre
    # a mesh's circle may stand a little off its axis, where its ends are
    lift = out @ circle.axis
    out = out - lift[:, None] * circle.axis
    middle = np.linalg.norm(out, axis=1)
    half = np.linalg.norm(last - first, axis=1) / 2
    sagitta = circle.radius_mm - np.sqrt(np.maximum(circle.radius_mm**2 - half**2, 0.0))
    far = (sagitta > CHORD_MM) & (middle > _MET * circle.radius_mm)
    out = out * (circle.radius_mm / np.where(far, middle, 1.0))[:, None]
    new = circle.centre + out + lift[:, None] * circle.axis
    return np.where(far[:, None], new, np.nan)


@dataclass(frozen=True)
class _Light:
    """Small lamps (k, 3), and what is behind the part; or a light with an area."""

    lamps: Array
    ground: float
    area: AreaLight | None = None


class _Renderer:
    """Renders light at pixels, in units of the light of a face that lamps light frontally.

    Parameters
    ----------
    scene : RayScene
        The part.
    camera : Camera
        The camera.
    middle : array (3,)
        Where lamps are of strength 1, mm.
    """

    def __init__(self, scene: _RoundScene, camera: Camera, middle: Array) -> None:
        self._scene = scene
        self._camera = camera
        self._middle = middle

    def steps(self, light: _Light) -> int:
        """Return how many steps an image takes; those with many rays come first."""
        width, height = self._camera.resolution
        of_area = 0 if light.area is None else _STEPS_OF_AREA
        return -(-width * height // _RAYS) + _SAMPLES**2 + of_area

    def image(
        self,
        pose: Array,
        light: _Light,
        rng: np.random.Generator,
        on_step: Callable[[], None] = lambda: None,
    ) -> Array:
        """Return the light at each pixel (h, w), several rays for each where it changes, and tell of each step."""
        if light.area is None:
            grey = self._each(pose, light, on_step)
            change = maximum_filter(grey, 3) - minimum_filter(grey, 3) > _CHANGE
            again = np.flatnonzero(binary_dilation(change, iterations=2))
            total = np.zeros(len(again))
            for places in self._within(again, rng):
                total += self._at(places, pose, light)
                on_step()
            grey.flat[again] = total / _SAMPLES**2
        else:
            grey, face = self._smooth(pose, light, on_step)
            # light that rises evenly over a pixel is as in its middle
            bent = _bends(grey) > _BENT * grey.max()
            again = np.flatnonzero(bent | _differs(face, 1))
            places = np.stack(list(self._within(again, rng)), axis=1)
            for block in np.array_split(np.arange(len(again)), _SAMPLES**2):
                grey.flat[again[block]] = self._by_faces(places[block], pose, light)
                on_step()
        return np.asarray(gaussian_filter(grey, BLUR_PX, mode="nearest"))

    def _within(self, numbers: NDArray[np.int64], rng: np.random.Generator) -> Iterator[Array]:
        """Yield places (n, 2) in pixels (n,), one for each part of a pixel."""
        pixels = self._pixels()[numbers]
        cells = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
        for step in np.stack(np.meshgrid(cells, cells), axis=-1).reshape(-1, 2):
            jitter = rng.uniform(-0.5, 0.5, pixels.shape) / _SAMPLES
            yield pixels + step + jitter

    def _by_faces(self, places: Array, pose: Array, light: _Light) -> Array:
        """Return the means (n,) of the light at places (n, k, 2): of each face that is met, one of them counts.

        Of a pixel within one face two count: there, a light may have an edge.
        """
        n, k, _ = places.shape
        eye = pose[:3, 3]
        flat = places.reshape(-1, 2)
        faces = self._scene.faces_met(eye, self._rays(flat, pose)).reshape(n, k)
        order = np.argsort(faces, axis=1, kind="stable")
        ordered = np.take_along_axis(faces, order, axis=1)
        starts = np.ones((n, k), dtype=bool)
        starts[:, 1:] = ordered[:, 1:] != ordered[:, :-1]
        first = np.flatnonzero(starts)
        counts = np.diff(np.append(first, n * k))
        numbers = (np.arange(n)[:, None] * k + order).ravel()
        is_whole = counts == k
        chosen = numbers[np.where(is_whole, first, first + counts // 2)]
        chosen = np.append(chosen, numbers[first[is_whole] + k - 1])
        weights = np.append(np.where(is_whole, 0.5, counts / k), np.full(is_whole.sum(), 0.5))
        means: Array = np.zeros(n)
        np.add.at(means, chosen // k, weights * self._at(flat[chosen], pose, light, _FINE))
        return means

    def _pixels(self) -> Array:
        """Return all pixels (h * w, 2)."""
        width, height = self._camera.resolution
        v, u = np.mgrid[:height, :width]
        return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)

    def _each(self, pose: Array, light: _Light, on_step: Callable[[], None]) -> Array:
        """Return the light (h, w) in the middle of each pixel."""
        pixels = self._pixels()
        light_at = np.empty(len(pixels))
        for start in range(0, len(pixels), _RAYS):
            part = slice(start, start + _RAYS)
            light_at[part] = self._at(pixels[part], pose, light)
            on_step()
        return light_at.reshape(self._camera.resolution[::-1])

    def _smooth(
        self, pose: Array, light: _Light, on_step: Callable[[], None]
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return the light in the middle of pixels (h, w), and the number of the face there.

        A light with an area takes many rays for each pixel, and makes no sharp shadows. So pixels are between few
        others that are on the same face, where light rises evenly from one to the next.
        """
        width, height = self._camera.resolution
        rows = _spread(height)
        columns = _spread(width)
        few = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
        coarse = self._at(few, pose, light, _FINE).reshape(len(rows), len(columns))
        on_step()
        between = RegularGridInterpolator((rows, columns), coarse)
        pixels = self._pixels()
        faces = np.empty(len(pixels), dtype=np.int64)
        grey = np.empty(len(pixels))
        for start in range(0, len(pixels), _RAYS):
            part = slice(start, start + _RAYS)
            grey[part] = between(pixels[part, ::-1])
            faces[part] = self._scene.faces_met(pose[:3, 3], self._rays(pixels[part], pose))
            on_step()
        face = faces.reshape(height, width)
        bent = maximum_filter(_bends(coarse), 3) > _BENT_OF_FEW * coarse.max()
        near = np.ix_(np.arange(height) // _EVERY, np.arange(width) // _EVERY)
        # a face may end between a pixel and the next of the few, on either side
        uneven = np.flatnonzero(_differs(face, _EVERY) | (bent[near] & (face >= 0)))
        grey[uneven] = self._at(pixels[uneven], pose, light, _FINE)
        on_step()
        return grey.reshape(height, width), face

    def _rays(self, pixels: Array, pose: Array) -> Array:
        """Return the rays (n, 3) of pixels (n, 2)."""
        tangents = tangents_of(self._camera, pixels)
        return np.column_stack([tangents, np.ones(len(tangents))]) @ pose[:3, :3].T

    def _at(self, pixels: Array, pose: Array, light: _Light, block: int = _RAYS) -> Array:
        starts = range(0, len(pixels), block)
        parts = [self._shaded(pixels[start : start + block], pose, light) for start in starts]
        return np.concatenate(parts) if parts else np.empty(0)

    def _shaded(self, pixels: Array, pose: Array, light: _Light) -> Array:
        rays = self._rays(pixels, pose)
        eye = pose[:3, 3]
        if light.area is not None:
            return np.asarray(light.area.held(pose).brightness(self._scene, eye, rays))
        hit = self._scene.cast(eye, rays)
        depth = hit["t_hit"].astype(np.float64)
        met = np.isfinite(depth)
        shade = np.where(met, SHADOW_SHARE, light.ground)
        places = eye + depth[met, None] * rays[met]
        normals = hit["primitive_normals"][met].astype(np.float64)
        normals *= np.where((normals * rays[met]).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        places += _LIFT_MM * normals
        for lamp in light.lamps:
            way = lamp - places
            distance = np.linalg.norm(way, axis=1)
            cosine = np.maximum((normals * way).sum(axis=1) / distance, 0.0)
            strength = (np.linalg.norm(lamp - self._middle) / distance) ** 2 / len(light.lamps)
            shade[met] += np.where(self._scene.blocked(places, way), 0.0, cosine * strength)
        return shade


def _spread(n_pixels: int) -> NDArray[np.int64]:
    """Return every few pixels of a row, and the last."""
    return np.unique(np.append(np.arange(0, n_pixels, _EVERY), n_pixels - 1))


def _differs(face: NDArray[np.int64], reach_px: int) -> NDArray[np.bool_]:
    """Return which pixels (h, w) are so near to one of another face."""
    size = 2 * reach_px + 1
    return np.asarray(maximum_filter(face, size) != minimum_filter(face, size))


def _bends(grey: Array) -> Array:
    """Return how far each value of an image (h, w) is off an even rise, in any direction: twice its distance."""
    padded = np.pad(grey, 1, mode="reflect", reflect_type="odd")
    height, width = grey.shape
    bends = np.zeros_like(grey)
    for v, u in ((0, 1), (1, 0), (1, 1), (1, -1)):
        ahead = padded[1 + v : 1 + v + height, 1 + u : 1 + u + width]
        behind = padded[1 - v : 1 - v + height, 1 - u : 1 - u + width]
        bends = np.maximum(bends, np.abs(ahead + behind - 2 * grey))
    return bends


def _stated_surfaces_mm(plan: InspectionPlan, measurer: Measurer) -> Array:
    """Return the deviation (k,) of each surface: the least that its targets state, otherwise the largest of the plan.

    A surface of two targets keeps both tolerances. Registration counts on the largest everywhere.
    """
    model = measurer.model
    stated = {name: plan.targets[name].surfaces_mm for name in plan.promises}
    largest = max(stated.values(), default=0.0)
    of_each = np.full(len(model.carriers.surfaces), largest)
    for setting in plan.settings:
        for name in stated.keys() & {*setting.entities, *setting.ends}:
            for edge in model.measured[witness_key(setting, name)]:
                carriers = list(model.carried_by[edge.name])
                of_each[carriers] = np.minimum(of_each[carriers], stated[name])
    return of_each


class Rehearsal:
    """Renders the images that a plan takes of a part.

    Parameters
    ----------
    plan : InspectionPlan
        The plan. Its lamps or its backlight light the part; without any, a light on the camera does.
    solid : Solid
        Its part, as designed.
    surfaces_mm : float, optional
        Standard deviation of planes along their normals; that of bores, bosses and cones is half as large again.
        Default: on faces of targets, the least that a target on them states; on others, the largest that the plan's
        targets state.
    seed : int
        Draws the part, the poses and the noise.
    exact_poses : bool
        Whether the camera is where the plan says; otherwise it is drawn from the plan's pose uncertainty.

    Attributes
    ----------
    truth : Truth
        What the images show.
    largest_mm : float
        By how much a plane of the part is moved or tilted at most, or a radius or an axis is off, mm.

    Raises
    ------
    RequestError
        If the part is not the plan's, the plan has no settings, or a number breaks its rule.

    Examples
    --------
    >>> from aspectgraph import Solid
    >>> from planner import Rehearsal, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> rehearsal = Rehearsal(plan, Solid.read("examples/two_pocket_block.off"), seed=3)
    >>> sorted(rehearsal.truth.values)
    ['setting_01']
    """

    def __init__(
        self,
        plan: InspectionPlan,
        solid: Solid,
        *,
        surfaces_mm: float | None = None,
        seed: int = 0,
        exact_poses: bool = False,
    ) -> None:
        check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"))
        check_count("seed", seed, 0)
        measurer = Measurer(plan, solid)
        if surfaces_mm is None:
            of_each = _stated_surfaces_mm(plan, measurer)
        else:
            check_number("surfaces_mm", surfaces_mm, NOT_NEGATIVE)
            largest_mm = _MOST_OF_PART * float(np.linalg.norm(np.ptp(solid.vertices, axis=0)))
            if surfaces_mm > largest_mm:
                rule = f"must be at most {largest_mm:.3g} mm, a tenth of the part's size"
                raise RequestError.of_rule("surfaces_mm", rule, f"{surfaces_mm:g} mm")
            of_each = np.full(len(measurer.model.carriers.surfaces), float(surfaces_mm))
        self._plan = plan
        self._shots = measurer.shots
        self._rng = np.random.default_rng(seed)
        part = DeviatingPart(measurer.model, of_each, self._rng)
        self.largest_mm = part.largest_mm
        poses = [self._drawn_pose(k, exact_poses) for k in range(len(plan.settings))]
        middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
        self._renderer = _Renderer(part.scene, plan.camera, middle)
        self._response = LINEAR
        if plan.camera.response is not None:
            self._response = Response.of(plan.camera.response)
        self.truth = Truth(
            seed,
            float(of_each.max(initial=surfaces_mm or 0.0)),
            {shot.name: self._values(part, shot) for shot in self._shots},
            {shot.name: poses[shot.setting] for shot in self._shots},
            response=self._response.text,
            white_level=plan.camera.white_level or _WHITE,
            plan_digest=plan.digest,
            joined={
                name: part.value_of([end.edge for end in ends], plan.targets[name])
                for name, ends in measurer.ends.items()
                if name in plan.uninspectable
            },
            date=timestamp(),
            program=program_name(),
            part=solid.name,
            part_digest=PartRecord.of(solid).digest,
        )

    def __repr__(self) -> str:
        """Return a one-line summary."""
        size = count(len(self._shots), "image")
        drawn = f"surfaces {self.truth.surfaces_mm:g} mm, seed {self.truth.seed}"
        return f"<Rehearsal of {self._plan.part!r}: {size}, {drawn}>"

    @property
    def unlit(self) -> bool:
        """Whether the plan has no lamps, so that a light on the camera stands for them."""
        return self._plan.light is None

    def images(self, progress: Progress | None = None) -> Iterator[Rendered]:
        """Render one image after the other, in the order of the plan.

        Parameters
        ----------
        progress : callable, optional
            Takes how many percent of all images are done, 100, and a label.

        Yields
        ------
        Rendered
            Image, what it is of, and its pose.
        """
        lights = [self._light(shot, self.truth.poses[shot.name]) for shot in self._shots]
        every = sum(self._renderer.steps(light) for light in lights)
        steps = itertools.count()
        label = f"rendering {count(len(self._shots), 'image')}, percent"

        def tell() -> None:
            # steps are no unit that means anything to who waits
            report(progress, 100 * next(steps) // every, 100, label)

        tell()
        for shot, light in zip(self._shots, lights, strict=True):
            pose = self.truth.poses[shot.name]
            grey = self._renderer.image(pose, light, self._rng, tell)
            # as a person sets the exposure: by the brightest place beside what is measured
            grey /= max(self._bright(shot, grey, pose), 1e-9)
            if light.area is not None:
                # of the grey values, as lights with an area differ in how much of theirs reaches the camera
                grey = SHADOW_SHARE + (1.0 - SHADOW_SHARE) * grey
            yield Rendered(shot, self._levels(white_share(grey) * grey), pose)

    def _levels(self, light: Array) -> NDArray[np.uint8 | np.uint16]:
        """Return grey values as the camera states them: of its response, up to its white."""
        share = light
        if not self._response.is_linear:
            share = self._response.level(light)
        share = share + NOISE_SHARE * self._rng.standard_normal(light.shape)
        white = self.truth.white_level
        depth = np.uint8 if white <= _WHITE else np.uint16
        return np.clip(np.rint(white * share), 0, white).astype(depth)

    def write(
        self,
        folder: str | os.PathLike[str],
        progress: Progress | None = None,
    ) -> list[str]:
        """Write the images, as `measure` reads them, and ``truth.json``.

        Parameters
        ----------
        folder : path
            Images of an earlier rehearsal there are replaced, also those that this plan does not take. A file that
            changed since it was written stays, unless it has the name of a new one.
        progress : callable, optional
            Takes how many percent of all images are done, 100, and a label.

        Returns
        -------
        list of str
            The files.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        return write_images(self, folder, "folder", progress)

    def _drawn_pose(self, setting: int, exact: bool) -> Array:
        pose = np.asarray(self._plan.settings[setting].cam2world, dtype=np.float64)
        if exact:
            return pose
        covariance = self._plan.pose_uncertainty.covariance
        move = self._rng.multivariate_normal(np.zeros(len(covariance)), covariance)
        return np.asarray(displaced(pose, move[None])[0])

    def _values(self, part: DeviatingPart, shot: Shot) -> dict[str, float]:
        """Return the true values of what is measured in an image."""
        setting = self._plan.settings[shot.setting]
        targets = whole_targets(self._plan, setting)
        return {
            name: part.value(witness_key(setting, name), targets[name])
            for name in (*shot.targets, *setting.ends)
        }

    def _light(self, shot: Shot, pose: Array) -> _Light:
        """Return the lamps of an image."""
        light = self._plan.light
        if light is None:
            return _Light(pose[None, :3, 3], SHADOW_SHARE)
        if light.area is not None:
            return _Light(np.empty((0, 3)), SHADOW_SHARE, light.area)
        ground = BRIGHT_GROUND if light.ground == "bright" else SHADOW_SHARE
        lit = light.images[shot.setting]
        if not lit:
            # nothing is lit there: any light shows it
            return _Light(pose[None, :3, 3], ground)
        number = 0
        if len(lit) > 1:
            names = [setting_name(shot.setting, k) for k in range(len(lit))]
            number = names.index(shot.name)
        return _Light(light.lamps[list(lit[number].lamps)], ground)

    def _bright(self, shot: Shot, grey: Array, pose: Array) -> float:
        """Return the light of the brightest places beside what is measured in an image."""
        setting = self._plan.settings[shot.setting]
        targets = targets_of(self._plan.targets, setting)
        height, width = grey.shape
        levels = []
        for name in (*shot.targets, *setting.ends):
            pixels = np.rint(beside(self._plan.camera, pose, targets[name].points)).reshape(-1, 2)
            inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
            u, v = pixels[inside].astype(int).T
            levels.append(grey[v, u])
        values = np.concatenate(levels) if levels else grey.ravel()
        return float(values.max(initial=0.0)) or float(grey.max())


def write_images(
    rehearsal: Rehearsal,
    folder: str | os.PathLike[str],
    parameter: str,
    progress: Progress | None = None,
) -> list[str]:
    """Write a rehearsal, see `Rehearsal.write`, into a folder that the caller knows by the name of a parameter."""
    from PIL import Image

    check_path_text(Path(folder), parameter)
    names = [TRUTH, *(f"{name}.png" for name in rehearsal.truth.poses)]
    former = _unchanged_images(absolute(folder))
    with staged_folder(folder, [*names, *former], parameter) as staging:
        digests = {}
        for rendered in rehearsal.images(progress):
            path = staging / rendered.shot.file
            Image.fromarray(rendered.grey).save(path)
            digests[path.name] = file_digest(path)
        rehearsal.truth = replace(rehearsal.truth, images=digests)
        text = json.dumps(to_plain(rehearsal.truth), indent=1, allow_nan=False, ensure_ascii=False)
        write_text(staging / TRUTH, text + "\n")
    return [str(Path(folder) / name) for name in names]


def _unchanged_images(folder: Path) -> list[str]:
    """Return the files of an earlier rehearsal in a folder that are as it wrote them: no other may be removed."""
    try:
        truth = from_plain(Truth, read_json(folder / TRUTH, "file"), PlanFileError)
    except PlanFileError:
        return []
    # a name with a folder in it is none that a rehearsal writes
    inside = {name: digest for name, digest in truth.images.items() if Path(name).name == name}
    return [
        name for name, digest in inside.items() if digest and file_digest(folder / name) == digest
    ]

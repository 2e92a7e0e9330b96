"""Images of a whole part that is not as its model says, from camera poses that are not as planned.

The referee of `planner.measuring`: it shares no code with it. Surfaces are those of the STEP file (planes, cylinders
and cones of the kernel), each with a deviation of its own: offset and tilts of a plane, radius and centre of a
cylinder or cone. Vertices of a fine mesh are moved to where their surfaces meet. Rays with lamps and cast shadows give
the grey values: one for each pixel, and several where the picture changes. The true value of a dimension is that of its
moved entities.
"""

from __future__ import annotations

import gzip
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import open3d as o3d
from rendered_images import Lamp, Measured
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter, zoom
from scipy.spatial import cKDTree

_ON_MM = 2e-3
_DARK = 0.04
# grey values of neighbours that differ by more, of 1, are rendered again with several rays a pixel
_CHANGE = 0.008
_CHUNK = 500_000


@dataclass
class Surface:
    """A plane (normal), cylinder (axis, radius) or cone (axis, half its angle) through a point, mm.

    And its deviation (3,): a plane is off by d[0] along its normal and tilted by d[1] and d[2], mm at its extent; a
    round surface by d[0] along its normal, and its axis by d[1] and d[2], mm. The point of a cone is its tip.
    """

    point: np.ndarray
    axis: np.ndarray
    radius: float
    angle: float
    extent: float
    deviation: np.ndarray

    @property
    def is_round(self):
        """Whether it is no plane."""
        return bool(self.radius or self.angle)

    def basis(self):
        """Two unit vectors across the axis."""
        x = np.cross(self.axis, np.eye(3)[np.argmin(np.abs(self.axis))])
        x /= np.linalg.norm(x)
        return x, np.cross(self.axis, x)

    def normals(self, points):
        """Unit normals (n, 3) at points (n, 3)."""
        if not self.is_round:
            return np.broadcast_to(self.axis, points.shape)
        off = points - self.point
        off = off - (off @ self.axis)[:, None] * self.axis
        # the tip of a cone has no such direction
        out = off / np.maximum(np.linalg.norm(off, axis=1, keepdims=True), 1e-9)
        return np.cos(self.angle) * out - np.sin(self.angle) * self.axis

    def moved_by(self, points):
        """How far the surface is off along its normal at points (n, 3)."""
        x, y = self.basis()
        d = self.deviation
        if self.is_round:
            out = self.normals(points)
            return d[0] + d[1] * (out @ x) + d[2] * (out @ y)
        off = (points - self.point) / self.extent
        return d[0] + d[1] * (off @ x) + d[2] * (off @ y)


class DeviatingPart:
    """A part of a STEP file whose surfaces deviate; `vertices` (v, 3) and `triangles` (t, 3) are the moved mesh."""

    def __init__(self, path: Path, chord_mm: float = 0.004, turn_rad: float = 0.03):
        self.surfaces: list[Surface] = []
        faces = _faces(path, chord_mm, turn_rad)
        points = np.concatenate([nodes for nodes, _, _ in faces])
        starts = np.cumsum([0] + [len(nodes) for nodes, _, _ in faces])
        self.triangles = np.concatenate(
            [corners + start for (_, corners, _), start in zip(faces, starts, strict=False)]
        )
        keys = np.round(points, 5) + 0.0
        self.nominal, self.unique = np.unique(keys, axis=0, return_inverse=True)
        self.unique = self.unique.ravel()
        self.nominal = self.nominal.copy()
        self.nominal[self.unique] = points
        self.carried: list[set[int]] = [set() for _ in self.nominal]
        for (nodes, _, shape), start in zip(faces, starts, strict=False):
            if shape is None:
                continue
            k = self._surface(shape, nodes)
            for i in range(start, start + len(nodes)):
                self.carried[self.unique[i]].add(k)
        self.groups: dict[tuple[int, ...], list[int]] = {}
        for i, own in enumerate(self.carried):
            self.groups.setdefault(tuple(sorted(own)), []).append(i)
        self._moved = self.nominal
        self.vertices = self.nominal[self.unique]

    def _surface(self, shape, nodes) -> int:
        point, axis, radius, angle = shape
        is_round = bool(radius or angle)
        for k, one in enumerate(self.surfaces):
            if abs(abs(one.axis @ axis) - 1) > 1e-9:
                continue
            if abs(one.radius - radius) > 1e-6 or abs(one.angle - angle) > 1e-9:
                continue
            across = point - one.point
            along = (across @ axis) * axis
            if radius:
                across = across - along
            elif not angle:
                across = along
            elif one.axis @ axis < 0:
                continue
            if np.linalg.norm(across) < 1e-5:
                if not is_round:
                    one.extent = max(one.extent, np.linalg.norm(nodes - one.point, axis=1).max())
                return k
        middle = point if is_round else nodes.mean(axis=0)
        extent = max(1.0, float(np.linalg.norm(nodes - middle, axis=1).max()))
        self.surfaces.append(Surface(middle, axis, radius, angle, extent, np.zeros(3)))
        return len(self.surfaces) - 1

    @property
    def moved(self):
        """Its distinct vertices as they are, in the order of `nominal`."""
        return self._moved

    def deviate(self, rng, planes_mm: float, round_mm: float, tilts_mm: float = 0.0) -> None:
        """Draw deviations of all surfaces, and move the mesh."""
        for one in self.surfaces:
            scale = [round_mm] * 3 if one.is_round else [planes_mm, tilts_mm, tilts_mm]
            one.deviation = rng.normal(0.0, 1.0, 3) * scale
        self._move()

    def _move(self) -> None:
        moved = self.nominal.copy()
        for own, rows in self.groups.items():
            if own:
                moved[rows] += self.displaced(self.nominal[rows], own)
        self._moved = moved
        self.vertices = moved[self.unique]

    def displaced(self, points, own) -> np.ndarray:
        """How points (n, 3) that lie on surfaces move with them: the least move that meets all."""
        normals = np.stack([self.surfaces[k].normals(points) for k in own], axis=1)
        off = np.stack([self.surfaces[k].moved_by(points) for k in own], axis=1)
        return np.einsum("nij,nj->ni", np.linalg.pinv(normals, rcond=0.1), off)

    def true_value(self, measured: Measured) -> float:
        """Return how far a dimension is off its nominal value on the part as it is, mm (angles: degrees)."""
        entities = [own for own, _ in measured.points(256)]
        moved = [own + self._entity_move(own) for own in entities]
        return measured.value(moved) - measured.value(entities)

    def _entity_move(self, points) -> np.ndarray:
        """How points (n, 3) of an entity in order are moved: as the mesh's vertices on it are, and between them evenly.

        A line that ends in a tangent arc moves with both surfaces at its end, so what carries it does not say it all.
        Where an arc ends in one, the joint is no part of its radius: only vertices that move as most of it do count.
        """
        spread = np.linalg.norm(points[1] - points[0])
        distance, nearest = cKDTree(points).query(self.nominal, distance_upper_bound=spread)
        close = np.flatnonzero(np.isfinite(distance))
        on = [i for i in close if _off_path(points, self.nominal[i], int(nearest[i])) < _ON_MM]
        if _is_round(points):
            most = Counter(frozenset(self.carried[i]) for i in on).most_common(1)[0][0]
            on = [i for i in on if self.carried[i] == most]
        share = np.array([_share(points, self.nominal[i], int(nearest[i])) for i in on])
        move = (self._moved - self.nominal)[on]
        order = np.argsort(share)
        at = np.arange(len(points))
        return np.stack([np.interp(at, share[order], move[order, k]) for k in range(3)], axis=1)


def _is_round(points) -> bool:
    """Whether points (n, 3) in order are of a circle or an arc."""
    first, second = np.diff(points[:3], axis=0)
    return bool(np.linalg.norm(np.cross(first, second)) > 1e-6 * (first @ second))


def _step(points, k):
    j = min(max(k, 0), len(points) - 2)
    return points[j], points[j + 1] - points[j], j


def _share(points, place, k) -> float:
    """Return where along points (n, 3) in order a place is, in their numbers."""
    start, step, j = _step(points, k)
    return j + float((place - start) @ step / (step @ step))


def _off_path(points, place, k) -> float:
    """Return how far a place is from the path through points; arcs bulge by little between them."""
    start, step, _ = _step(points, k)
    along = (place - start) @ step / (step @ step)
    bulge = 0.0
    if 1 <= k < len(points) - 1:
        bulge = float(np.linalg.norm(points[k - 1] - 2 * points[k] + points[k + 1]))
    return max(float(np.linalg.norm(place - start - along * step)) - bulge, 0.0)


def _faces(path: Path, chord_mm: float, turn_rad: float):
    """Return nodes, triangles and (point, axis, radius, half angle) or None of each face of a STEP file."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    reader = STEPControl_Reader()
    with tempfile.TemporaryDirectory() as folder:
        plain = path
        if path.suffix == ".gz":
            plain = Path(folder) / path.stem
            plain.write_bytes(gzip.decompress(path.read_bytes()))
        reader.ReadFile(str(plain))
        reader.TransferRoots()
    solids = TopExp_Explorer(reader.OneShape(), TopAbs_ShapeEnum.TopAbs_SOLID)
    result = []
    while solids.More():
        BRepMesh_IncrementalMesh(solids.Current(), chord_mm, False, turn_rad, False)
        faces = TopExp_Explorer(solids.Current(), TopAbs_ShapeEnum.TopAbs_FACE)
        while faces.More():
            face = TopoDS.Face(faces.Current())
            place = TopLoc_Location()
            mesh = BRep_Tool.Triangulation_s(face, place)
            move = place.Transformation()
            nodes = [mesh.Node(i + 1).Transformed(move) for i in range(mesh.NbNodes())]
            corners = [mesh.Triangle(i + 1) for i in range(mesh.NbTriangles())]
            surface = BRepAdaptor_Surface(face)
            result.append(
                (
                    np.array([(node.X(), node.Y(), node.Z()) for node in nodes]),
                    np.array([[t.Value(k) for k in (1, 2, 3)] for t in corners]) - 1,
                    _shape(surface),
                )
            )
            faces.Next()
        solids.Next()
    return result


def _shape(surface):
    """Return (point, axis, radius, half angle) of a surface of the kernel; None if it is none of the simple ones."""
    from OCP.GeomAbs import GeomAbs_SurfaceType

    kind = surface.GetType()
    if kind == GeomAbs_SurfaceType.GeomAbs_Plane:
        frame = surface.Plane().Position()
        return _xyz(frame.Location()), _xyz(frame.Direction()), 0.0, 0.0
    if kind == GeomAbs_SurfaceType.GeomAbs_Cylinder:
        frame = surface.Cylinder().Position()
        return _xyz(frame.Location()), _xyz(frame.Direction()), surface.Cylinder().Radius(), 0.0
    if kind == GeomAbs_SurfaceType.GeomAbs_Cone:
        cone = surface.Cone()
        angle = cone.SemiAngle()
        # it becomes wider along its axis
        axis = np.sign(angle) * _xyz(cone.Position().Direction())
        return _xyz(cone.Apex()), axis, 0.0, abs(angle)
    return None


def _xyz(of) -> np.ndarray:
    return np.array([of.X(), of.Y(), of.Z()])


@dataclass
class Optics:
    """What an image is made with: camera matrix, size in px, blur, noise and exposure of it.

    The lens distorts by coefficients in OpenCV's order; none are of a lens without distortion.
    """

    matrix: np.ndarray
    size: tuple[int, int]
    blur_px: float = 0.76
    noise: float = 0.008
    exposure: float = 1.0
    samples: int = 4
    gloss: float = 0.0
    # rays for every so many pixels where the picture is smooth; 1: for each
    every: int = 1
    distortion: tuple[float, ...] = ()

    @classmethod
    def of(cls, camera, **others) -> Optics:
        """Those of a camera, with its distortion."""
        lens = camera.distortion
        coefficients = (lens.k1, lens.k2, lens.p1, lens.p2, lens.k3) if lens else ()
        return cls(camera.matrix, camera.resolution, distortion=coefficients, **others)

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Directions (n, 3) of the rays through pixels (n, 2), of depth 1 in the camera's frame."""
        if self.distortion:
            # OpenCV's inverse, which shares no code with that of the planner
            stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-10)
            lens = np.array(self.distortion)
            flat = cv2.undistortPoints(pixels[:, None], self.matrix, lens, criteria=stop)
            return np.c_[flat[:, 0], np.ones(len(flat))]
        return np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(self.matrix).T


def _changes(grey) -> np.ndarray:
    """Where grey values differ from those beside them."""
    return maximum_filter(grey, 3) - minimum_filter(grey, 3) > _CHANGE


class PartImages:
    """Grey images of triangles (t, 3) over vertices (v, 3), mm."""

    def __init__(self, vertices, triangles, optics: Optics):
        self.optics = optics
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            o3d.core.Tensor(np.asarray(vertices, np.float32)),
            o3d.core.Tensor(np.asarray(triangles, np.uint32)),
        )

    def image(self, cam2world, lamps: list[Lamp], rng) -> np.ndarray:
        """Return an image (h, w) of 8 bits from a pose (4, 4)."""
        grey = self.light(cam2world, lamps, rng)
        return np.clip(np.rint(grey * 255), 0, 255).astype(np.uint8)

    def light(self, cam2world, lamps: list[Lamp], rng) -> np.ndarray:
        """Return the light (h, w) on a sensor with noise, as a share of full exposure."""
        one = self.optics
        width, height = one.size
        v, u = np.mgrid[:height, :width]
        pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
        grey = self._once(cam2world, pixels, lamps)
        change = _changes(grey)
        again = np.flatnonzero(binary_dilation(change, iterations=2).ravel())
        cells = (np.arange(one.samples) + 0.5) / one.samples - 0.5
        total = np.zeros(len(again))
        for dx in cells:
            for dy in cells:
                jitter = rng.uniform(-0.5, 0.5, (len(again), 2)) / one.samples
                total += self._grey(cam2world, pixels[again] + [dx, dy] + jitter, lamps)
        grey.ravel()[again] = total / one.samples**2
        grey = gaussian_filter(one.exposure * grey, one.blur_px, mode="nearest")
        grey += rng.normal(0.0, one.noise, grey.shape)
        return grey

    def _once(self, cam2world, pixels, lamps) -> np.ndarray:
        """Grey values (h, w) of one ray for each pixel (h * w, 2), or of fewer where the picture is smooth."""
        width, height = self.optics.size
        every = self.optics.every
        if every == 1:
            return self._grey(cam2world, pixels, lamps).reshape(height, width)
        rows, columns = (-(-(n - 1) // every) + 1 for n in (height, width))
        v, u = np.mgrid[:rows, :columns] * every
        coarse = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
        few = self._grey(cam2world, coarse, lamps).reshape(rows, columns)
        size = (rows - 1) * every + 1, (columns - 1) * every + 1
        grey = zoom(few, np.divide(size, few.shape), order=1)[:height, :width].copy()
        near = binary_dilation(_changes(few), iterations=1)
        at_row, at_column = (np.rint(np.arange(n) / every).astype(int) for n in (height, width))
        full = np.flatnonzero(near[np.ix_(at_row, at_column)].ravel())
        grey.ravel()[full] = self._grey(cam2world, pixels[full], lamps)
        return grey

    def _grey(self, cam2world, pixels, lamps) -> np.ndarray:
        parts = [
            self._shade(cam2world, pixels[i : i + _CHUNK], lamps)
            for i in range(0, len(pixels), _CHUNK)
        ]
        return np.concatenate(parts)

    def _shade(self, cam2world, pixels, lamps) -> np.ndarray:
        turned = self.optics.directions(pixels) @ cam2world[:3, :3].T
        start = np.broadcast_to(cam2world[:3, 3], turned.shape)
        rays = np.concatenate([start, turned], axis=1).astype(np.float32)
        hit = self._scene.cast_rays(o3d.core.Tensor(rays))
        depth = hit["t_hit"].numpy().astype(float)
        normal = hit["primitive_normals"].numpy().astype(float)
        seen = np.isfinite(depth)
        grey = np.full(len(rays), _DARK)
        points = cam2world[:3, 3] + depth[seen, None] * turned[seen]
        way = turned[seen] / np.linalg.norm(turned[seen], axis=1, keepdims=True)
        normal = normal[seen] * -np.sign((normal[seen] * way).sum(axis=1, keepdims=True))
        shade = np.full(len(points), lamps[0].ambient)
        for lamp in lamps:
            to_lamp = lamp.place - points
            to_lamp /= np.linalg.norm(to_lamp, axis=1, keepdims=True)
            facing = np.maximum((normal * to_lamp).sum(axis=1), 0.0)
            lit = facing * (0.9 - lamp.ambient) / len(lamps)
            if self.optics.gloss:
                half = to_lamp - way
                half /= np.linalg.norm(half, axis=1, keepdims=True)
                shine = np.maximum((normal * half).sum(axis=1), 0.0) ** 40
                lit = lit + self.optics.gloss * shine * (facing > 0)
            rays = np.concatenate([points + 2e-3 * normal, to_lamp], axis=1).astype(np.float32)
            shadow = self._scene.test_occlusions(o3d.core.Tensor(rays)).numpy()
            shade += lit * ~shadow
        grey[seen] = shade
        return grey

"""The image a setting will take, predicted: hidden lines removed, faces shaded, entities highlighted; as SVG.

Visibility of lines is decided by casting rays at points along them, a few pixels apart. That is for looking at; what is
observable was decided exactly, by the regions.
"""

from __future__ import annotations

import base64
import io
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from aspectgraph.plot.traces import is_feature
from aspectgraph.solid.solid import RayScene
from ground.templates import render
from planner.argument_kinds import check_kinds, suggests_names
from planner.camera.camera import Camera, image_of, tangents_of
from planner.camera.pose import world_to_cam
from planner.exceptions import RequestError
from planner.light.area_light import AreaLight
from planner.report.figure import Circles, chord_circles, on_circles

if TYPE_CHECKING:
    from markupsafe import Markup

    from aspectgraph import Solid


_STEP_PX = 5.0
_NEAREST_MM = 1.0
# a ray that ends this fraction before the point has been stopped by something else
_HIT_TOLERANCE = 4e-4
_SHADED_WIDTH = 560
# the same for shadows, whose rays end on the face they ask for
_SHADOW_TOLERANCE = 1e-3
# grey values under a lamp: what is no part, what no light reaches, and the most
_GROUND = 12
_AMBIENT = 30
_BRIGHTEST = 235
# pieces a highlighted segment is bent into by distortion, and where points are put that have no image
_BENDS = 32
_FAR_PX = 1e5
# a chord this near to its circle is drawn straight
_STRAIGHT_PX = 0.2

# beyond so many names in a picture they are smaller
_MANY_NAMES = 8

SIMPLER = 2.5e-4
"""Lines of a picture may lie off by this share of its width, which no screen shows."""

Window = tuple[int, int, int, int]
"""Part of the sensor: its left and upper side, width and height, px."""


@suggests_names
def predicted_image(
    solid: Solid,
    camera: Camera,
    cam2world: ArrayLike,
    entities: Mapping[str, ArrayLike] | None = None,
    color: str = "#0072b2",
    lamp: ArrayLike | None = None,
) -> str:
    """Draw the image that a camera will take: shaded faces, visible edges, marked entities.

    Parameters
    ----------
    solid : Solid
        The part.
    camera : Camera
        The camera.
    cam2world : array_like, shape (4, 4)
        Its pose, OpenCV axes, mm.
    entities : mapping of str to array_like (2, 3) or (s, 2, 3), optional
        Entities to highlight, by name: ends of an edge, or segments of a dimension's lines and
        circles, mm.
    color : str
        Colour of the highlights, as an SVG colour.
    lamp : array_like, shape (3,) or (n, 3), optional
        Position of the lamp, or of lamps of equal strength that are on together, mm. The faces are
        then matt and cast shadows. Default: shades that only distinguish faces.

    Returns
    -------
    str
        A complete SVG file in pixels of the sensor. ``IPython.display.SVG`` shows it in a notebook.

    Raises
    ------
    RequestError
        If an array has another shape or holds a number that is not finite.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Camera, look_at, predicted_image
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> predicted_image(block, camera, look_at([[55, 30, 400]], [55, 30, 10])[0])[:4]
    '<svg'
    """
    check_kinds(solid=(solid, "Solid"), camera=(camera, "Camera"))
    pose = _array("cam2world", cam2world, ("(4, 4)",))
    ends = {}
    for name, points in (entities or {}).items():
        ends[name] = _array(f"entities[{name!r}]", points, ("(2, 3)", "(s, 2, 3)"))
    place = None if lamp is None else _array("lamp", lamp, ("(3,)", "(n, 3)"))
    return str(PictureMaker(solid, camera).image_svg(pose, ends, color, place))


def _array(name: str, values: ArrayLike, shapes: Sequence[str]) -> np.ndarray:
    """Return finite numbers as an array of one of some shapes, such as "(n, 3)", or raise `RequestError`."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        array = np.empty(0)
    # letters stand for any number
    sizes = [str(size) for size in array.shape]
    for shape in shapes:
        numbers = shape.strip("(,)").split(", ")
        fits = len(numbers) == len(sizes) and all(
            size == number or not number.isdigit()
            for size, number in zip(sizes, numbers, strict=True)
        )
        if fits and np.isfinite(array).all():
            return array
    rule = f"must be finite numbers of the shape {' or '.join(shapes)}"
    raise RequestError.of_rule(name, rule, " ".join(reprlib.repr(values).split()))


class _Label(NamedTuple):
    """A name in a picture: where it begins or ends, and its height, px."""

    text: str
    u: float
    v: float
    size: float
    anchor: str


class SharedLines(NamedTuple):
    """Lines that several pictures of a setting show: the first one holds them, the others refer to them.

    Attributes
    ----------
    name : str
        Ending of their identifiers in the page.
    edges : str
        Visible edges, as the data of an SVG path.
    targets : list of str
        The same of each target.
    """

    name: str
    edges: str
    targets: list[str]


class PictureMaker:
    """Predicts images of a part.

    Parameters
    ----------
    solid : Solid
    camera : Camera
    """

    def __init__(self, solid: Solid, camera: Camera) -> None:
        self.solid = solid
        self.camera = camera
        self._scene = RayScene(solid.vertices, solid.triangles)
        self._edge_vertices = np.array([edge.vertices for edge in solid.edges])
        self._edge_faces = np.array([edge.faces for edge in solid.edges])
        self._feature = np.array([is_feature(solid, edge) for edge in solid.edges])
        self._circle_of_edge, self._circles = chord_circles(solid)

    def image_svg(
        self,
        cam2world: np.ndarray,
        entities: dict[str, Any],
        color: str,
        lamp: np.ndarray | AreaLight | None = None,
        *,
        window: Window | None = None,
        outlined: Window | None = None,
        shared: SharedLines | None = None,
    ) -> Markup:
        """Return the predicted image: shaded faces, visible edges, entities in a colour.

        These are ends (2, 3) or segments (s, 2, 3) by name. With a window only that part of the sensor; with one that
        is outlined the whole, without names, as they are for the picture of that window. Without shared lines, the
        picture stands alone and brings its lines and styles.
        """
        part = window or (0, 0, *self.camera.resolution)
        return render(
            "planner",
            "report/templates/predicted.svg",
            shared=shared,
            is_near=window is not None,
            lines=self.shared_lines(cam2world, entities, part[2]) if shared is None else shared,
            window=part,
            png=png_data(self.shaded(cam2world, lamp, window=part)),
            labels=[] if outlined else self._labels(cam2world, entities, part),
            color=color,
            frame=outlined,
        )

    def shared_lines(
        self, cam2world: np.ndarray, entities: dict[str, Any], width: float, name: str = ""
    ) -> SharedLines:
        """Return the lines of pictures of which the narrowest part of the sensor is so wide, px."""
        images = self._project_entities(cam2world, entities)
        targets = [path_data(_joined(lines), SIMPLER * width) for _, lines in images]
        return SharedLines(name, self.edge_path(cam2world, width), targets)

    def window(self, cam2world: np.ndarray, entities: dict[str, Any]) -> Window:
        """Return the part of the sensor around entities, of the sensor's shape and with room for their names."""
        width, height = self.camera.resolution
        pixels = np.concatenate(
            [uv.reshape(-1, 2) for uv, _ in self._project_entities(cam2world, entities)]
        )
        low = np.clip(pixels.min(axis=0), 0, (width, height))
        high = np.clip(pixels.max(axis=0), 0, (width, height))
        share = float(np.clip(1.3 * ((high - low) / (width, height)).max(), 40 / width, 1.0))
        size = np.round([share * width, share * height])
        corner = np.clip(np.round((low + high - size) / 2), 0, np.array([width, height]) - size)
        return int(corner[0]), int(corner[1]), int(size[0]), int(size[1])

    def edge_map_svg(
        self,
        cam2world: np.ndarray,
        entities: dict[str, Any],
        shared: SharedLines,
        *,
        window: Window | None = None,
    ) -> Markup:
        """Return the edge map: visible edges as thin lines, the measured ones bold, with the ends of edges marked."""
        images = self._project_entities(cam2world, entities)
        return render(
            "planner",
            "report/templates/edge_map.svg",
            window=window or (0, 0, *self.camera.resolution),
            shared=shared,
            # of dimensions no ends are looked for
            ends=[end for uv, _ in images if uv.ndim == 2 for end in uv.tolist()],
        )

    def _labels(
        self, cam2world: np.ndarray, entities: dict[str, Any], window: Window
    ) -> list[_Label]:
        """Return the names of entities, which lie inside the window and apart from each other."""
        column, row, width, height = window
        size = width / (42 if len(entities) <= _MANY_NAMES else 54)
        labels: list[_Label] = []
        taken: list[tuple[float, ...]] = []
        images = self._project_entities(cam2world, entities)
        for name, (uv, _) in zip(entities, images, strict=True):
            u, v = uv.reshape(-1, 2).mean(axis=0)
            length = 0.6 * size * len(name)
            is_left = u > column + 0.75 * width or column + width - u < length < u - column
            v = min(max(v - 0.4 * size, row + 1.2 * size), row + height - 0.6 * size)
            v = _free_line(taken, u - length if is_left else u, v, size, length)
            labels.append(_Label(name, u, v, size, "end" if is_left else "start"))
        return labels

    def _project_entities(
        self, cam2world: np.ndarray, entities: dict[str, Any]
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the images of the points of entities, and lines (l, 2, 2) to be drawn through them."""
        return [self._bent(world_to_cam(np.asarray(ends), cam2world)) for ends in entities.values()]

    def _bent(self, points_cam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        uv = self.project(points_cam)
        if self.camera.distortion is None:
            return uv, uv.reshape(-1, 2, 2)
        # a straight edge is imaged as a curve
        first, last = np.moveaxis(points_cam.reshape(-1, 2, 3), 1, 0)
        share = np.linspace(0.0, 1.0, _BENDS + 1)[:, None, None]
        curve = self.project((1 - share) * first + share * last)
        return uv, np.stack([curve[:-1], curve[1:]], axis=2).reshape(-1, 2, 2)

    def project(self, points_cam: np.ndarray) -> np.ndarray:
        """Return the images of points in px; a lens with distortion has none off the sensor, where they are put."""
        matrix = self.camera.matrix
        if self.camera.distortion is None:
            return (
                points_cam[..., :2] / points_cam[..., 2:] * [matrix[0, 0], matrix[1, 1]]
                + matrix[:2, 2]
            )
        pixels = image_of(self.camera, points_cam / points_cam[..., 2:])
        return np.where(np.isnan(pixels), -_FAR_PX, pixels)

    def edge_path(self, cam2world: np.ndarray, width: float) -> str:
        """Return the visible edges as the data of an SVG path, for a picture of so many px from left to right."""
        return path_data(_joined(self.edge_lines(cam2world)), SIMPLER * width)

    def edge_lines(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the visible pieces of the part's edges in px, (n, 2, 2).

        Drawn are edges where the surface turns by 20 degrees or more, and outlines of smooth surfaces.
        """
        solid = self.solid
        first = solid.vertices[self._edge_vertices[:, 0]]
        facing = (
            np.einsum(
                "nfi,nfi->nf", solid.normals[self._edge_faces], cam2world[:3, 3] - first[:, None]
            )
            > 0
        )
        outline = facing[:, 0] != facing[:, 1]
        drawn = np.flatnonzero(facing.any(axis=1) & (self._feature | outline))
        segments = world_to_cam(solid.vertices[self._edge_vertices[drawn]], cam2world)
        sampled = self._sampled(segments)
        if not len(sampled.segment):
            return np.empty((0, 2, 2))
        visible = self._visible(cam2world, sampled.points)
        images, is_bent = self._images(sampled, drawn, cam2world)
        # a sample and the next one of the same segment
        together = visible[:-1] & visible[1:] & (sampled.segment[:-1] == sampled.segment[1:])
        begins = np.flatnonzero(together & ~np.append(False, together[:-1]))
        ends = np.flatnonzero(together & ~np.append(together[1:], False)) + 1
        straight = ~is_bent[begins]
        steps = np.flatnonzero(together & is_bent[:-1])
        pieces = np.concatenate(
            [
                np.column_stack([begins, ends])[straight],
                np.column_stack([steps, steps + 1]),
            ]
        )
        return np.asarray(images[pieces[np.argsort(pieces[:, 0], kind="stable")]])

    def _images(
        self, sampled: _Sampled, drawn: np.ndarray, cam2world: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the images (m, 2) of samples of edges, and of which edges they lie on a curve: (m,) bool.

        A chord lies on its circle, and is drawn straight where nobody sees the difference.
        """
        edges = drawn[sampled.segment]
        places = self._circle_of_edge[edges]
        is_chord = places >= 0
        points = sampled.points.copy()
        if is_chord.any():
            circles = Circles(*(values[places[is_chord]] for values in self._circles))
            moved = on_circles(points[is_chord], circles, cam2world)
            points[is_chord] = world_to_cam(moved, cam2world)
        if self.camera.distortion is not None:
            return self.project(points), np.ones(len(points), bool)
        images = np.where(is_chord[:, None], self.project(points), sampled.pixels)
        off = np.abs(images - sampled.pixels).max(axis=1)
        starts = np.flatnonzero(np.append(True, sampled.segment[1:] != sampled.segment[:-1]))
        farthest = np.repeat(np.maximum.reduceat(off, starts), np.diff(np.append(starts, len(off))))
        is_bent = farthest >= _STRAIGHT_PX
        return np.where(is_bent[:, None], images, sampled.pixels), is_bent

    def visible(self, cam2world: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return which points (n, 3) on the part, mm, no face hides from the camera; (n,) bool."""
        return self._visible(cam2world, world_to_cam(points, cam2world))

    def _sampled(self, segments_cam: np.ndarray) -> _Sampled:
        """Clip segments (n, 2, 3) to the image and sample them evenly in pixels."""
        in_front, segments = _clip_near(segments_cam)
        matrix = self.camera.matrix
        scale = np.diag(matrix)[:2]
        centre = matrix[:2, 2]
        pixels = segments[..., :2] / segments[..., 2:] * scale + centre
        low = np.full(2, -0.5)
        high = np.array(self.camera.resolution) - 0.5
        if self.camera.distortion is not None:
            # what is clipped is the undistorted image, where segments are straight
            low, high = np.array(self.camera.field().outer).reshape(2, 2) * scale + centre
        inside, spans = _clip_rectangle(pixels, low, high)
        length = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1) * (spans[:, 1] - spans[:, 0])
        steps = np.clip(length / _STEP_PX, 2, 500).astype(int)
        n_samples = np.where(inside, steps + 1, 0)
        k = np.repeat(np.arange(len(segments)), n_samples)
        rank = np.arange(len(k)) - np.repeat(np.cumsum(n_samples) - n_samples, n_samples)
        share = rank / np.maximum(steps[k], 1)
        s = ((1 - share) * spans[k, 0] + share * spans[k, 1])[:, None]
        # the inverse depth, not the depth, is linear along the image of a segment
        begin, end = np.moveaxis(segments[k], 1, 0)
        inverse = (1 - s) / begin[:, 2:] + s / end[:, 2:]
        points = ((1 - s) * begin / begin[:, 2:] + s * end / end[:, 2:]) / inverse
        first, last = np.moveaxis(pixels[k], 1, 0)
        return _Sampled(in_front[k], points, first + s * (last - first))

    def _visible(self, cam2world: np.ndarray, points_cam: np.ndarray) -> np.ndarray:
        directions = points_cam @ cam2world[:3, :3].T
        return self._cast(cam2world, directions)["t_hit"] >= 1.0 - _HIT_TOLERANCE

    def _cast(self, cam2world: np.ndarray, directions: np.ndarray) -> dict[str, np.ndarray]:
        return self._scene.cast(cam2world[:3, 3], directions)

    def shaded(
        self,
        cam2world: np.ndarray,
        lamp: np.ndarray | AreaLight | None = None,
        *,
        window: Window | None = None,
    ) -> np.ndarray:
        """Return a small grey image (h, w) of uint8: by lamps (3,) or (n, 3), an area light, or from its left."""
        matrix = self.camera.matrix
        (column, row, width, height) = window or (0, 0, *self.camera.resolution)
        scale = width / _SHADED_WIDTH
        u, v = np.meshgrid(
            (np.arange(_SHADED_WIDTH) + 0.5) * scale,
            (np.arange(round(height / scale)) + 0.5) * scale,
        )
        u = u + column
        v = v + row
        if self.camera.distortion is None:
            x = (u - matrix[0, 2]) / matrix[0, 0]
            y = (v - matrix[1, 2]) / matrix[1, 1]
        else:
            x, y = np.moveaxis(tangents_of(self.camera, np.stack([u, v], axis=-1)), -1, 0)
        rays = np.stack([x, y, np.ones_like(u)], axis=-1) @ cam2world[:3, :3].T
        if lamp is not None and not isinstance(lamp, np.ndarray):
            bright = lamp.held(cam2world).brightness(self._scene, cam2world[:3, 3], rays)
            brightest = max(bright.max(initial=0.0), 1e-300)
            return (_GROUND + (_BRIGHTEST - _GROUND) * bright / brightest).astype(np.uint8)
        hit = self._cast(cam2world, rays)
        if lamp is not None:
            return self._lit(cam2world[:3, 3], rays, hit, lamp)
        normals = hit["primitive_normals"] @ cam2world[:3, :3]
        light = np.array([-0.35, -0.5, -0.8]) / np.linalg.norm([0.35, 0.5, 0.8])
        brightness = 0.50 + 0.42 * np.clip(normals @ light, 0.0, 1.0)
        return np.where(np.isfinite(hit["t_hit"]), 255 * brightness, 250).astype(np.uint8)

    def _lit(
        self, eye: np.ndarray, rays: np.ndarray, hit: dict[str, np.ndarray], lamp: np.ndarray
    ) -> np.ndarray:
        """Return grey values under point lamps, with cast shadows, before a dark ground; the brightest is 235."""
        seen = np.isfinite(hit["t_hit"])
        points = eye + hit["t_hit"][seen, None] * rays[seen]
        normals = hit["primitive_normals"][seen].astype(np.float64)
        # of the side that is seen, however the triangle is turned
        normals *= -np.sign(np.einsum("ni,ni->n", normals, rays[seen]))[:, None]
        irradiance = np.zeros(len(points))
        for place in np.atleast_2d(lamp):
            towards = place - points
            cosines = np.maximum(np.einsum("ni,ni->n", normals, towards), 0.0)
            direct = cosines / np.linalg.norm(towards, axis=1) ** 3
            reached = self._scene.cast(place, -towards)["t_hit"] >= 1.0 - _SHADOW_TOLERANCE
            irradiance += np.where(reached, direct, 0.0)
        # a little of all sides' light, so that shadows are no holes
        grey = np.full(seen.shape, _GROUND, np.uint8)
        grey[seen] = _AMBIENT + (_BRIGHTEST - _AMBIENT) * irradiance / max(
            irradiance.max(initial=0.0), 1e-300
        )
        return grey


class _Sampled(NamedTuple):
    """Samples of segments, one segment after the other.

    Attributes
    ----------
    segment : ndarray of int, shape (m,)
        Of which segment each sample is.
    points : ndarray, shape (m, 3)
        In the camera's frame, mm.
    pixels : ndarray, shape (m, 2)
        Where they are in the image without distortion, px.
    """

    segment: np.ndarray
    points: np.ndarray
    pixels: np.ndarray


def png_data(image: np.ndarray) -> str:
    """Return a grey image (h, w) of uint8 as the data URI of a PNG."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def path_data(lines: Iterable[np.ndarray], tolerance: float) -> str:
    """Return lines (n, 2) as the data of an SVG path, without points that it needs not within a tolerance.

    Coordinates are tenths, or whole numbers if the tolerance is larger. All but the first of a line are steps from the
    one before, which are short.
    """
    per_unit = 1 if tolerance >= 1.0 else 10
    parts = []
    for line in lines:
        points = np.asarray(line)
        if len(points) > 2:
            simple = shapely.simplify(
                shapely.LineString(points), tolerance, preserve_topology=False
            )
            points = shapely.get_coordinates(simple)
        places = np.rint(per_unit * points).astype(np.int64)
        steps = np.diff(places, axis=0)
        moves = steps[steps.any(axis=1)] if steps.any() else steps[:1]
        parts += ["M", _numbers_text(places[0], per_unit)]
        parts += ["l", _numbers_text(moves.ravel(), per_unit)]
    return "".join(parts)


def _numbers_text(numbers: np.ndarray, per_unit: int) -> str:
    """Return whole multiples of a unit's part as decimals, with blanks only where no sign parts them."""
    texts = [f"{number / per_unit:.10g}" for number in numbers.tolist()]
    return " ".join(texts).replace(" -", "-")


def _joined(lines: Iterable[np.ndarray]) -> list[np.ndarray]:
    """Return segments (2, 2) as polylines (n, 2), joined where two of them meet in tenths."""
    segments = np.round(np.reshape(list(lines), (-1, 2, 2)), 1)
    proper = segments[(segments[:, 0] != segments[:, 1]).any(axis=1)]
    if not len(proper):
        return list(segments[:1])
    merged = shapely.line_merge(shapely.multilinestrings(shapely.linestrings(proper)))
    return [shapely.get_coordinates(part) for part in shapely.get_parts(merged)]


def _free_line(taken: list[Any], u: float, v: float, size: float, length: float) -> float:
    """Return a height for a name that begins at u, as near to v as leaves the names before readable; remember it."""
    steps = [v + sign * k * 1.3 * size for k in range(len(taken) + 1) for sign in (1, -1)]

    def is_free(height: float) -> bool:
        return all(
            abs(height - y) >= 1.25 * size or u >= x + wide or x >= u + length
            for x, y, wide in taken
        )

    free = next((height for height in steps if height > size and is_free(height)), v)
    taken.append((u, free, length))
    return free


def _clip_near(segments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Clip segments (n, 2, 3) in the camera frame; return which have a part in front of the camera, and these parts."""
    depth = segments[..., 2] - _NEAREST_MM
    in_front = np.flatnonzero((depth > 0).any(axis=1))
    clipped = segments[in_front].copy()
    depth = depth[in_front]
    for behind in range(2):
        rows = np.flatnonzero(depth[:, behind] < 0)
        step = clipped[rows, 1] - clipped[rows, 0]
        share = depth[rows, 0] / (depth[rows, 0] - depth[rows, 1])
        clipped[rows, behind] = clipped[rows, 0] + share[:, None] * step
    return in_front, clipped


def _clip_rectangle(
    pixels: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which lines (n, 2, 2) meet a rectangle, and their parameters inside (n, 2) (Liang and Barsky 1984)."""
    start = pixels[:, 0]
    step = pixels[:, 1] - start
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.stack([(lower - start) / step, (upper - start) / step])
    is_still = step == 0
    outside = is_still & ((start < lower) | (start > upper))
    enters = np.where(is_still, -np.inf, crossings.min(axis=0)).max(axis=1)
    leaves = np.where(is_still, np.inf, crossings.max(axis=0)).min(axis=1)
    spans = np.clip(np.column_stack([enters, leaves]), 0.0, 1.0)
    inside = (spans[:, 0] < spans[:, 1]) & ~outside.any(axis=1)
    return inside, spans

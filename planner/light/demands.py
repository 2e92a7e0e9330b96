"""What each setting of a plan asks of its lamp: which edges must show there, and whether as creases or silhouettes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity import Entity, resolve_entities
from aspectgraph.solid.rims import Arc, Rim
from errors.measurands import Circle
from planner.camera.camera import Camera
from planner.exceptions import RequestError
from planner.light.background import Backdrop, backdrops
from planner.request.targets import targets_of

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.solid.ray_scene import RayScene
    from planner.request.targets import Target


Silhouettes = dict[int, int]
# a circle of a plan is that of a rim if they differ by less than this share of the part's size
_SAME = 1e-6


class ViewToLight(Protocol):
    """A pose and what is measured from it, such as a `SensorSetting`."""

    @property
    def cam2world(self) -> NDArray[np.float64]:
        """The pose, (4, 4)."""

    @property
    def entities(self) -> Sequence[str]:
        """Names of what is measured."""


class PlanToLight(Protocol):
    """Settings and what they measure, such as an `InspectionPlan`."""

    @property
    def settings(self) -> Sequence[ViewToLight]:
        """The settings, in order."""

    @property
    def targets(self) -> Mapping[str, Target]:
        """What is measured, by name."""

    @property
    def camera(self) -> Camera:
        """The camera."""

    @property
    def requirements(self) -> Mapping[str, float]:
        """Limits of the plan by name."""


@dataclass(frozen=True)
class Pair:
    """What one setting measures: the light regions that must hold its lamp, and what is behind its silhouettes.

    Attributes
    ----------
    setting : int
        Number of the setting.
    name : str
        What it measures.
    regions : tuple of str
        Names of light regions.
    silhouette : bool
        Whether an edge of it is a silhouette.
    backdrops : tuple of Backdrop
        Behind them, where that is a face of the part.
    """

    setting: int
    name: str
    regions: tuple[str, ...]
    silhouette: bool = False
    backdrops: tuple[Backdrop, ...] = ()


@dataclass
class Demands:
    """All pairs of settings and what they measure, the regions they name, and the edges of those that are lengths."""

    pairs: list[Pair] = field(default_factory=list)
    entities: dict[str, Entity] = field(default_factory=dict)
    silhouettes: dict[str, Silhouettes] = field(default_factory=dict)
    edge_ids: list[tuple[int, ...]] = field(default_factory=list)

    def region(self, name: str, entity: Entity, silhouettes: Silhouettes) -> str:
        """Return the name of a light region, a new one if it was not asked for before."""
        for known, other in self.entities.items():
            if other.edge_ids == entity.edge_ids and self.silhouettes[known] == silhouettes:
                return known
        label = f"{name} {len(self.entities)}"
        # an entity of its own, as a region is found by it
        self.entities[label] = replace(entity, name=label)
        self.silhouettes[label] = silhouettes
        return label


def demands_of(plan: PlanToLight, solid: Solid, scene: RayScene, ground: str) -> Demands:
    """Return what a plan asks of its lamps.

    Parameters
    ----------
    plan : PlanToLight
        The plan.
    solid : Solid
        Its part.
    scene : RayScene
        Of the part.
    ground : str
        "dark" or "bright".

    Returns
    -------
    Demands
        Pairs in the order of the settings.

    Raises
    ------
    RequestError
        If the part lacks an edge, rim or arc of the plan.
    """
    known: dict[tuple[str, int], tuple[Entity, ...]] = {}
    radius = plan.requirements.get("visibility_radius_mm", 0.0)
    pixel = max(plan.camera.pixel_pitch_mm) / plan.camera.image_distance_mm
    demands = Demands()
    for k, setting in enumerate(plan.settings):
        eye = np.asarray(setting.cam2world, dtype=np.float64)[:3, 3]
        targets = targets_of(plan.targets, setting)
        for name in setting.entities:
            key = name, id(targets[name])
            if key not in known:
                known[key] = _parts(targets[name], solid, name)
            parts = known[key]
            regions = []
            behind = []
            has_silhouette = False
            for entity in parts:
                for seen in seen_as(solid, entity, eye, radius):
                    own = backdrops(solid, scene, eye, entity, seen, pixel)
                    has_silhouette |= bool(seen)
                    if (
                        seen
                        and ground == "bright"
                        and not own
                        and set(seen) == set(entity.edge_ids)
                    ):
                        # all of it in front of the back light
                        continue
                    behind += own
                    regions.append(demands.region(name, entity, seen))
            demands.pairs.append(
                Pair(k, name, tuple(dict.fromkeys(regions)), has_silhouette, tuple(behind))
            )
            demands.edge_ids.append(parts[0].edge_ids if targets[name].in_image else ())
    return demands


def seen_as(
    solid: Solid, entity: Entity, eye: NDArray[np.float64], radius_mm: float
) -> Iterator[Silhouettes]:
    """Yield the silhouettes of an entity, once or twice: edge to the face that is seen, from around a camera's place.

    Where the plane of a face passes by the camera within the radius, an edge is taken as a crease and as a silhouette.
    """
    sure: Silhouettes = {}
    open_ones: Silhouettes = {}
    for edge in (solid.edges[i] for i in entity.edge_ids):
        heights = solid.normals[list(edge.faces)] @ (eye - solid.vertices[edge.vertices[0]])
        front = edge.faces[int(heights.argmax())]
        if heights.min() <= -radius_mm:
            sure[edge.id] = front
        elif heights.min() <= radius_mm:
            open_ones[edge.id] = front
    yield sure
    if open_ones:
        yield sure | open_ones


def _parts(target: Target, solid: Solid, name: str) -> tuple[Entity, ...]:
    """Return the edges, rims and arcs that something measured consists of."""
    return tuple(
        _curve(solid, name, item)
        if isinstance(item, Circle)
        else _line(solid, name, (item.p, item.q))
        for item in target.geometry
    )


def _line(solid: Solid, name: str, ends: Any) -> Entity:
    from aspectgraph.exceptions import EntityError

    points = np.asarray(ends, dtype=np.float64)
    try:
        return resolve_entities(solid, {name: points})[name]
    except EntityError as error:
        # a stretch is lit where the whole edge is
        edge = _edge_through(solid, points)
        if edge is not None:
            return resolve_entities(solid, {name: edge})[name]
        raise RequestError(f"solid must be the plan's part. {error}") from error


def _edge_through(solid: Solid, points: NDArray[np.float64]) -> int | None:
    """Return the id of an edge that both points (2, 3) lie on; None if there is none."""
    size = _SAME * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    for edge in solid.edges:
        start, end = solid.edge_points(edge.id)
        along = end - start
        shares = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        if np.linalg.norm(start + shares[:, None] * along - points, axis=1).max() <= size:
            return edge.id
    return None


def _curve(solid: Solid, name: str, circle: Circle) -> Entity:
    """Return the rim or arc with a circle."""
    size = _SAME * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    around = [arc for arc in (*solid.arcs(), *solid.rims()) if _is_on(arc, circle, size)]
    for arc in around:
        if (circle.start is None) != isinstance(arc, Rim):
            continue
        entity = resolve_entities(solid, {name: arc.id})[name]
        if (
            circle.start is None
            or np.linalg.norm(entity.points[0] - circle.points(np.zeros(1))[0]) < 1e3 * size
        ):
            return entity
    if around and circle.start is not None:
        # a run is lit where the whole rim or arc is
        return resolve_entities(solid, {name: around[-1].id})[name]
    raise RequestError(
        f"solid must be the plan's part. Got no rim or arc of {name!r} in {solid.name!r}."
    )


def _is_on(arc: Arc, circle: Circle, size: float) -> bool:
    """Tell whether an arc or rim lies on a circle, to within a size, mm."""
    off = max(
        float(np.linalg.norm(arc.centre - circle.centre)), abs(arc.radius_mm - circle.radius_mm)
    )
    return bool(off <= size and abs(abs(arc.axis @ circle.axis) - 1) <= _SAME)

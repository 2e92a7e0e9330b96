"""From where a camera with a ring light sees edges and makes them show: a space for planning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.ray_scene import RayScene
from planner.argument_kinds import FROM_0_BELOW_1, check_number
from planner.camera.camera import Camera
from planner.light.background import DEFAULT_STEP, SHARES, rays_beside, sure_contrast

if TYPE_CHECKING:
    from aspectgraph import CellSet, Edge, Solid
    from aspectgraph.light import LightRegions

Array = NDArray[np.float64]


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

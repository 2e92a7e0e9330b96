"""Light domains of entities: where a lamp lights all of an edge with enough contrast, exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.cell_set import CellSet
from aspectgraph.entities.straight_edges import Entity
from aspectgraph.exact.grid import Grid
from aspectgraph.light.contrast import NONE, check_contrast, check_lamps, face_contrast
from aspectgraph.light.wedges import light_sets
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.deadline import check_deadline
from aspectgraph.visibility.entity_region import Region, carved_region
from aspectgraph.visibility.scene import Scene
from aspectgraph.visibility.united_sets import Blockers
from aspectgraph.visibility.visibility_regions import (
    Progress,
    VisibilityRegions,
    laid_out,
    regions_of,
)

_Task = tuple[Entity, Mapping[int, int]]

DEFAULT_CONTRAST = 0.1
"""A fifth of the brighter face's grey value: 20 of 255 grey levels where that one has 110, far above noise of 1.5 %."""


class LightRegions(VisibilityRegions):
    """The exact regions of lamp positions that light each entity as a whole with contrast.

    `compute_light` makes it. Its methods are those of `VisibilityRegions`, with lamps instead of
    viewpoints and *is lit* instead of *is observable*. A lit entity has at least the least
    contrast.

    Parameters
    ----------
    scene : Scene
        The solid on its grid.
    regions : mapping of str to Region
        The region of each entity, on the same grid.
    contrast : float
        Least contrast.
    silhouettes : mapping of str to mapping, optional
        See `compute_light`.

    Attributes
    ----------
    solid : Solid
        The part.
    workspace : ndarray, shape (2, 3)
        Lowest and highest corner of the space of lamps in mm.
    entities : dict of str to Entity
        By name, in the order given.
    grid : Grid
        Integer grid of all geometry.
    contrast : float
        Least contrast.
    silhouettes : dict of str to mapping
        Per entity, its edges that the camera sees as silhouettes, and the visible face of each.
    listed_as : str
        Name of a graph's attribute for the list of a domain.
    """

    listed_as: ClassVar[str] = "showing"

    def __init__(
        self,
        solid: Solid,
        workspace: np.ndarray,
        entities: dict[str, Entity],
        grid: Grid,
        scene: Scene,
        regions: Mapping[str, Region],
        contrast: float,
        silhouettes: Mapping[str, Mapping[int, int]] | None = None,
    ) -> None:
        super().__init__(solid, workspace, entities, grid, scene, regions)
        self.contrast = contrast
        self.silhouettes = dict(silhouettes or {})

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<LightRegions of {self.solid.name!r}: {len(self.entities)} entities, contrast {self.contrast:g}>"

    def showing(self, lamps: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether lamps, each alone, light entities as a whole with the least contrast.

        Parameters
        ----------
        lamps : array_like, shape (n, 3)
            Positions of the lamps in mm, inside the workspace. They are rounded as viewpoints are.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name; False inside the solid.

        Raises
        ------
        WorkspaceError
            If a lamp lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        return self.observable(lamps, names)

    def contrasts(self, lamps: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Contrast of entities under lamps, each alone.

        It is 0 if a piece of the entity is in shadow or dark.

        Parameters
        ----------
        lamps : array_like, shape (n, 3)
            Positions of the lamps in mm, inside the workspace.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of float64, shape (n, k)
            In [-1, 1]; see `contrast`. Values below the least contrast are also 0.

        Raises
        ------
        LightError
            If a lamp lies inside the part.
        WorkspaceError
            If a lamp lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        names = self.check_names(self.entity_names if names is None else names)
        places = check_lamps(self.solid, lamps)
        values = [self._values(name, places) for name in names]
        return np.where(
            self.showing(places, names), np.reshape(values, (len(names), len(places))).T, 0.0
        )

    def _sets(self, entity: Entity) -> Blockers:
        seen = next(
            (self.silhouettes.get(n, NONE) for n, one in self.entities.items() if one is entity),
            NONE,
        )
        return light_sets(self._scene, self.grid, self.solid, entity, self.contrast, seen)

    def _values(self, name: str, places: np.ndarray) -> np.ndarray:
        return face_contrast(
            self.solid, self.entities[name], places, self.silhouettes.get(name, NONE)
        )

    def _holds_besides(self, points: np.ndarray) -> np.ndarray:
        values = np.array([self._values(name, points) for name in self.entities])
        return self.contrast <= np.abs(values).T


def compute_light(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    contrast: float = DEFAULT_CONTRAST,
    workspace: ArrayLike | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    silhouettes: Mapping[str, Mapping[int, int]] | None = None,
    deadline: float = math.inf,
) -> LightRegions:
    """Compute the lamp positions that light each entity with contrast.

    The model assumes a matt part of one albedo, point lamps, and no light between faces.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping of str to edge id, id of a rim or arc, or pair of points, or sequence of ids
        See `resolve_entities`. Resolved entities are used without change.
    contrast : float
        Least contrast (absolute value of `contrast`) between the two faces of an edge, strictly between 0 and 1.
    workspace : array_like, shape (2, 3), optional
        Corners of the space of lamps in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    executor : concurrent.futures.Executor, optional
        Computes entities in parallel. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total, label)`` after each of the entities; the label is the name of the entity.
    silhouettes : mapping of str to mapping of int to int, optional
        Per entity, ids of its edges that a camera sees as silhouettes, and the face it sees
        (`silhouettes_from`). A silhouette is visible against a dark background where that face is
        lit. Default: all edges are creases.
    deadline : float
        Time, as `time.time` gives it, at which the computation ends. Default: never.

    Returns
    -------
    LightRegions
        In the order of the entities. Entities whose region is not complete by the deadline are
        missing.

    Raises
    ------
    LightError
        If the contrast is out of range.
    EntityError
        If an entity is not a sharp straight edge, rim or arc.
    WorkspaceError
        If the workspace is not a box around the part.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import compute_light
    >>> light = compute_light(box, {"top": [[0, 0, 20], [40, 0, 20]]}, contrast=0.2)
    >>> light.showing([[20, -100, 120], [20, -300, 120]]).tolist()
    [[False], [True]]
    """
    contrast = check_contrast(contrast)
    given = laid_out(solid, entities, workspace)
    solid, box_mm, resolved, grid, scene = given
    seen = silhouettes or {}
    box = grid.cube_planes(box_mm)
    make = partial(_lamp_region, scene, grid, solid, contrast, box, deadline)
    tasks: dict[str, _Task] = {
        name: (entity, seen.get(name, {})) for name, entity in resolved.items()
    }
    regions = regions_of(tasks, make, executor, progress)
    complete = {name: entity for name, entity in resolved.items() if name in regions}
    return LightRegions(solid, box_mm, complete, grid, scene, regions, contrast, seen)


def light_region(
    solid: Solid, edge: Any, contrast: float = DEFAULT_CONTRAST, workspace: ArrayLike | None = None
) -> CellSet:
    """Return all lamp positions that light one edge with contrast, as convex cells.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : int, str, pair of points, or Entity
        The edge, as an entity of `resolve_entities`.
    contrast : float
        Least contrast, strictly between 0 and 1; see `compute_light`.
    workspace : array_like, shape (2, 3), optional
        Corners of the space of lamps in mm. Default: the part's box,
        extended by ten diagonals in all directions.

    Returns
    -------
    CellSet
        Empty if there are none.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import light_region
    >>> region = light_region(box, [[0, 0, 20], [40, 0, 20]], contrast=0.2)
    >>> region.contains([[20, -100, 120], [20, -300, 120]]).tolist()
    [False, True]
    """
    return compute_light(solid, {"edge": edge}, contrast, workspace).covering_cells(["edge"])


def _lamp_region(
    scene: Scene,
    grid: Grid,
    solid: Solid,
    contrast: float,
    box: np.ndarray,
    deadline: float,
    task: _Task,
) -> Region:
    entity, silhouettes = task
    check_deadline(deadline)
    sets = light_sets(scene, grid, solid, entity, contrast, silhouettes)
    return carved_region(sets, box, deadline)

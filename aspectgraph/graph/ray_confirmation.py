"""Confirm viewing domains with Open3D's ray casting.

From each domain's viewpoint, rays go to points spread along every entity. All of them arriving means the entity is
seen, one of them stopped means it is not. Rays are float32 and sample the entity, so an answer that disagrees with the
domain's list is a doubt, not a verdict: doubts are settled exactly, by asking each blocked set of the entity whether it
holds the viewpoint. A list that is wrong by that test raises.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import networkx as nx
import numpy as np

from aspectgraph.entities.straight_edges import Entity
from aspectgraph.exact.predicates import sign_at_point
from aspectgraph.exceptions import ContradictionError
from aspectgraph.solid.ray_scene import RayScene
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.visibility_regions import VisibilityRegions
from compiled.decorators import entry_kernel

RAYS_PER_ENTITY = 32

# a ray is stopped if it hits before this share of the way to the entity
_ARRIVED = 1.0 - 1e-4
_RAYS_AT_ONCE = 1 << 20


class Confirmation(NamedTuple):
    """What ray casting found for each viewpoint.

    Attributes
    ----------
    n_rays : int
        Rays cast from every viewpoint.
    n_arbitrated : ndarray of int, shape (n,)
        Entities whose answer was settled exactly.
    """

    n_rays: int
    n_arbitrated: np.ndarray


class SightLines:
    """Ray casting from viewpoints to the entities of a solid.

    Parameters
    ----------
    solid : Solid
    entities : sequence of Entity
    rays_per_entity : int
    """

    def __init__(
        self, solid: Solid, entities: Sequence[Entity], rays_per_entity: int = RAYS_PER_ENTITY
    ) -> None:
        self._scene = RayScene(solid.vertices, solid.triangles)
        along = (np.arange(rays_per_entity) + 0.5) / rays_per_entity
        # shape (k, rays, 3)
        self._targets = np.array([_spread(entity, along) for entity in entities])

    def arrive(self, viewpoints: np.ndarray) -> np.ndarray:
        """Whether every ray from (n, 3) viewpoints in mm to each of k entities arrives, as (n, k) bool."""
        k, rays, _ = self._targets.shape
        result = np.empty((len(viewpoints), k), bool)
        rows = max(1, _RAYS_AT_ONCE // (k * rays))
        for start in range(0, len(viewpoints), rows):
            eyes = viewpoints[start : start + rows, None, None]
            hits = self._scene.cast(eyes, self._targets[None] - eyes)["t_hit"]
            result[start : start + rows] = (hits >= _ARRIVED).all(axis=-1)
        return result


def _spread(entity: Entity, along: np.ndarray) -> np.ndarray:
    """Points of an entity at shares of its length, shape (n, 3)."""
    if entity.kind == "edge":
        start, end = entity.endpoints
        return start + along[:, None] * (end - start)
    line = entity.outline
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return np.column_stack([np.interp(along * run[-1], run, line[:, axis]) for axis in range(3)])


@entry_kernel
def is_blocked(sets, query):
    """Whether one of the blocked sets holds an int64 query point (`Grid.to_points`) in its interior, exactly."""
    for k in range(len(sets.first) - 1):
        holds = True
        for j in range(sets.first[k], sets.first[k + 1]):
            if sign_at_point(sets.planes, sets.plane[j], query) * sets.side[j] <= 0:
                holds = False
                break
        if holds:
            return True
    return False


def confirm_nodes(regions: VisibilityRegions, graph: nx.Graph) -> None:
    """Cast rays from near every node's viewpoint and note the result on the node.

    Not from the viewpoint itself: in symmetric parts it lies on partition planes and on seams between blocked sets. Any
    other point of its ball, which lies in one cell, is as good a witness.

    Raises
    ------
    ContradictionError
        If a node's list is wrong.
    """
    names = regions.entity_names
    viewpoints, clearances = (
        np.array([graph.nodes[k][key] for k in graph]) for key in ("viewpoint", "clearance")
    )
    aside = np.random.default_rng(0).normal(size=viewpoints.shape)
    viewpoints = viewpoints + 0.25 * clearances[:, None] * aside / np.linalg.norm(
        aside, axis=1, keepdims=True
    )
    listed = np.array(
        [[name in graph.nodes[node][regions.listed_as] for name in names] for node in graph]
    )
    found = confirm(regions, viewpoints, listed.reshape(len(graph), -1))
    for node in graph:
        graph.nodes[node].update(
            confirmed=True, n_rays=found.n_rays, n_arbitrated=int(found.n_arbitrated[node])
        )


def confirm(
    regions: VisibilityRegions, viewpoints: np.ndarray, observable: np.ndarray
) -> Confirmation:
    """Check the lists of domains against rays cast from their viewpoints.

    Parameters
    ----------
    regions : VisibilityRegions
        Of k entities.
    viewpoints : ndarray, shape (n, 3)
        One per domain, in mm.
    observable : ndarray of bool, shape (n, k)
        The domains' lists.

    Raises
    ------
    ContradictionError
        If a list is wrong, naming domain and entity.
    """
    entities = regions.entities
    if not entities or not len(viewpoints):
        return Confirmation(0, np.zeros(len(viewpoints), int))
    seen = SightLines(regions.solid, list(entities.values())).arrive(
        viewpoints
    ) & regions._holds_besides(viewpoints)
    doubts = seen != observable
    queries = regions.grid.to_points(viewpoints)
    for column in np.flatnonzero(doubts.any(axis=0)):
        name, entity = list(entities.items())[column]
        sets = regions._sets(entity)
        for row in np.flatnonzero(doubts[:, column]):
            if is_blocked(sets, queries[row]) == observable[row, column]:
                raise ContradictionError(
                    f"domain {row} must list exactly the entities {regions.listed_as} from {viewpoints[row].tolist()} "
                    f"mm. Its list {'holds' if observable[row, column] else 'lacks'} {name!r}."
                )
    return Confirmation(RAYS_PER_ENTITY * len(entities), doubts.sum(axis=1))

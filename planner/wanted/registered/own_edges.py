"""How surely poses and values are known after registration to the part's own edges, at any planned pose.

What registration measures is predicted by `errors.registration.known_poses`; here is what belongs to a request: the
edges of the part, the camera, and how surfaces move the entities of targets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from errors.registration import Imaging, KnownPoses, Stretches, Values, known_poses

Array = NDArray[np.float64]
Key = tuple[str, ...]


@dataclass(frozen=True)
class Lifts:
    """How the entities (e) of a target move with the surfaces that carry them.

    Attributes
    ----------
    surfaces : array of int (e, 2)
        Numbers of the surfaces.
    motions : array (e, 2, 3, 6)
        Vector and turn of each entity for each of their numbers.
    """

    surfaces: NDArray[np.int64]
    motions: Array


@dataclass(frozen=True, eq=False)
class OwnEdges:
    """Registration to the part's own edges, for poses that are planned.

    Attributes
    ----------
    pose_covariance : array (6, 6)
        Of the camera's displacement before the image.
    stretches : Stretches
        Of the part's edges.
    imaging : Imaging
        How the camera shows them.
    lifts : mapping of tuple of str to Lifts
        By the key of a target, see `key_of`.
    """

    pose_covariance: Array
    stretches: Stretches
    imaging: Imaging
    lifts: Mapping[Key, Lifts]

    def known(
        self, world_to_camera: Array, rows: NDArray[np.int64], keys: Sequence[Key], gradient: Array
    ) -> KnownPoses:
        """Return what is known of poses, and of values there.

        Parameters
        ----------
        world_to_camera : array (n, 4, 4)
            The poses.
        rows : array of int (t,)
            The pose of each value, ascending.
        keys : sequence of tuple of str (t,)
            The target of each value.
        gradient : array (t, e, 6)
            By the displacement of the camera, of each entity alone; zeros behind the entities of a target.
        """
        size = gradient.shape[1]
        surfaces = np.full((len(rows), size, 2), -1, dtype=np.int64)
        motions = np.zeros((len(rows), size, 2, 3, 6))
        for t, key in enumerate(keys):
            lifts = self.lifts[key]
            count = len(lifts.surfaces)
            surfaces[t, :count] = lifts.surfaces
            motions[t, :count] = lifts.motions
        values = Values(rows, gradient, surfaces, motions)
        return known_poses(
            world_to_camera, self.pose_covariance, self.stretches, self.imaging, values
        )

    def poses(self, world_to_camera: Array) -> KnownPoses:
        """Return what is known of poses (n, 4, 4) alone."""
        return self.known(world_to_camera, np.zeros(0, dtype=np.int64), (), np.zeros((0, 1, 6)))


def key_of(name: str, entities: Sequence[str]) -> Key:
    """Return the key of a target that is measured by entities: its witnesses have one name or several."""
    return (name.partition(" \x1f")[0], *entities)

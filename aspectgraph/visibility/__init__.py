"""From where entities are observable as a whole.

For every viewpoint on none of a region's planes, the region holds it if and only if the open triangle of viewpoint and
entity misses the interior of the solid. Several regions lie over each other in one convex partition.
"""

from aspectgraph.visibility.blocked_sets import blockers
from aspectgraph.visibility.entity_region import Region
from aspectgraph.visibility.overlay import SharedPlanes, overlay, share_planes
from aspectgraph.visibility.scene import Scene, make_scene, own_order
from aspectgraph.visibility.visibility_regions import (
    Progress,
    VisibilityRegions,
    check_workspace,
    compute_regions,
)

__all__ = [
    "Progress",
    "Region",
    "Scene",
    "SharedPlanes",
    "VisibilityRegions",
    "blockers",
    "check_workspace",
    "compute_regions",
    "make_scene",
    "overlay",
    "own_order",
    "share_planes",
]

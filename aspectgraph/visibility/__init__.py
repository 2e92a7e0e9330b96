"""From where entities are observable as a whole.

For every viewpoint on none of a region's planes, the region holds it if and only if the open triangle of viewpoint and
entity misses the interior of the solid. Several regions lie over each other in one convex partition.
"""

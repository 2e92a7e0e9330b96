"""A convex cell complex, cut by planes exactly.

The leaves always tile the starting box without gap or overlap, neighbours share their faces, and where a point lies is
decided without rounding. Sizes are doubles, for weighting and for users' eyes, and decide no topology.
"""

"""The part: a closed, oriented surface of planar faces.

Whoever holds a `Solid` may rely on its rules, for its constructor checked them all: every edge runs once in each
direction, faces are planar and have an area, shells face outwards, and the surface neither crosses nor touches itself.
What breaks a rule is refused with its place.
"""

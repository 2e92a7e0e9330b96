"""Dimensions that a CAD model states: values, tolerances, and the entities of the solid that measure them.

Every stated value is compared with the geometry it is attached to. What disagrees, or cannot be measured by sharp
edges, rims and arcs in one image, says why.
"""

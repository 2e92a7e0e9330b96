"""A block of 40 × 30 × 20 mm with a round hole of radius 5 mm, as a mesh knows it."""

import itertools
import math

import numpy as np

from aspectgraph import Solid

N = 32


def block():
    return with_hole([(5.0, 0.0), (5.0, 20.0)])


def countersunk_block():
    """Above 14 mm, the hole widens by 45°, to a radius of 11 mm."""
    return with_hole([(5.0, 0.0), (5.0, 14.0), (11.0, 20.0)])


def with_hole(rings):
    """A block whose hole has these radii at these heights, from the lowest."""
    outline = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]
    angles = -2 * math.pi * np.arange(N) / N
    vertices = [(*p, z) for z in (0.0, 20.0) for p in outline]
    loops = [list(range(4)), list(range(4, 8))]
    holes = []
    for radius, z in rings:
        holes.append([len(vertices) + i for i in range(N)])
        vertices += [(20 + radius * math.cos(a), 15 + radius * math.sin(a), z) for a in angles]
    faces = [(loops[1], [holes[-1]]), (loops[0][::-1], [holes[0][::-1]])]
    for bottom, top in [tuple(loops), *itertools.pairwise(holes)]:
        n = len(bottom)
        for i in range(n):
            j = (i + 1) % n
            faces.append([bottom[i], bottom[j], top[j], top[i]])
    return Solid(np.array(vertices), faces, name="block")

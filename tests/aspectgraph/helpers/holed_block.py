"""A block of 40 × 30 × 20 mm with a round hole of radius 5 mm, as a mesh knows it."""

import math

import numpy as np

from aspectgraph import Solid

N = 32


def block():
    outline = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]
    angles = -2 * math.pi * np.arange(N) / N
    hole = [(20 + 5 * math.cos(a), 15 + 5 * math.sin(a)) for a in angles]
    vertices = []
    loops = []
    for loop in (outline, hole):
        start = len(vertices)
        n = len(loop)
        vertices += [(*p, z) for z in (0.0, 20.0) for p in loop]
        loops.append(([start + i for i in range(n)], [start + n + i for i in range(n)]))
    (low, high), (low_hole, high_hole) = loops
    faces = [(high, [high_hole]), (low[::-1], [low_hole[::-1]])]
    for bottom, top in loops:
        n = len(bottom)
        for i in range(n):
            j = (i + 1) % n
            faces.append([bottom[i], bottom[j], top[j], top[i]])
    return Solid(np.array(vertices), faces, name="block")

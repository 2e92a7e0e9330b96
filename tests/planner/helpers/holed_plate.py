"""A plate with two round holes, as a mesh knows them: circles by their chords."""

import math

import numpy as np

from aspectgraph import Solid
from planner import Camera, Effort, PoseUncertainty

SIZE = (80.0, 50.0)
HEIGHT = 10.0
N = 24
HOLES = {"left": ((20.0, 25.0), 8.0), "right": ((60.0, 25.0), 6.0)}
CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
QUICK = Effort(
    viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=2000, margin_generations=3
)
# edges of the top, by their ends
FRONT = [[0, 0, 10], [80, 0, 10]]
BACK = [[0, 50, 10], [80, 50, 10]]
LEFT = [[0, 0, 10], [0, 50, 10]]


def holed_plate(holes=HOLES):
    """The plate from the origin to (80, 50, 10), with holes by name: centre (x, y) and radius."""
    x, y = SIZE
    loops = [[(0, 0), (x, 0), (x, y), (0, y)]]
    for (cx, cy), r in holes.values():
        angles = -2 * math.pi * np.arange(N) / N
        loops.append([(cx + r * math.cos(a), cy + r * math.sin(a)) for a in angles])
    vertices = []
    bottom = []
    top = []
    for loop in loops:
        start = len(vertices)
        vertices += [(*p, z) for z in (0.0, HEIGHT) for p in loop]
        bottom.append(list(range(start, start + len(loop))))
        top.append(list(range(start + len(loop), start + 2 * len(loop))))
    faces = [(top[0], top[1:]), (bottom[0][::-1], [hole[::-1] for hole in bottom[1:]])]
    for low, high in zip(bottom, top, strict=True):
        n = len(low)
        faces += [[low[i], low[(i + 1) % n], high[(i + 1) % n], high[i]] for i in range(n)]
    return Solid(np.array(vertices), faces, name="plate")


def upper_rims(solid):
    """Ids of the upper rims of the left and the right hole."""
    rims = [rim for rim in solid.rims() if abs(rim.centre[2] - HEIGHT) < 1e-6]
    return tuple(rim.id for rim in sorted(rims, key=lambda rim: rim.centre[0]))

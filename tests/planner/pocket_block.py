"""The block with two pockets that stands for the paper's Table II: a reconstruction, its drawing has no dimensions."""

import numpy as np

from aspectgraph import Solid

# per pocket two rim edges that meet, and the pocket's depth edge at their corner
ENTITIES = {
    "e1": ((6, 2, 1), (6, 4, 1)),
    "e2": ((6, 2, 1), (6, 2, 3)),
    "e3": ((6, 2, 1), (5, 2, 1)),
    "e4": ((2, 6, 1), (4, 6, 1)),
    "e5": ((2, 6, 1), (2, 6, 3)),
    "e6": ((2, 6, 1), (2, 5, 1)),
}


def two_pocket_block(scale=10.0):
    """A block 6 x 6 x 4 with a pocket 2 x 2, 1 deep, in the faces x = 6 and y = 6; units of `scale` mm."""
    points, faces = [], []

    def face(outer, *holes):
        def loop(corners):
            for corner in corners:
                if corner not in points:
                    points.append(corner)
            return [points.index(corner) for corner in corners]

        faces.append((loop(outer), [loop(hole) for hole in holes]))

    face([(0, 0, 0), (0, 0, 4), (0, 6, 4), (0, 6, 0)])
    face([(0, 0, 0), (6, 0, 0), (6, 0, 4), (0, 0, 4)])
    face([(0, 0, 0), (0, 6, 0), (6, 6, 0), (6, 0, 0)])
    face([(0, 0, 4), (6, 0, 4), (6, 6, 4), (0, 6, 4)])
    rim = [(6, 2, 1), (6, 4, 1), (6, 4, 3), (6, 2, 3)]
    pocket(face, [(6, 0, 0), (6, 6, 0), (6, 6, 4), (6, 0, 4)], rim, (-1, 0, 0))
    rim = [(2, 6, 1), (2, 6, 3), (4, 6, 3), (4, 6, 1)]
    pocket(face, [(0, 6, 0), (0, 6, 4), (6, 6, 4), (6, 6, 0)], rim, (0, -1, 0))
    return Solid(np.array(points) * scale, faces, name="two-pocket block")


def pocket(face, outer, rim, inwards):
    """Add a side with a pocket; `rim` runs the same way around as `outer`."""
    floor = [tuple(np.add(corner, inwards).tolist()) for corner in rim]
    face(outer, rim[::-1])
    face(floor)
    for k in range(4):
        m = (k + 1) % 4
        face([rim[k], rim[m], floor[m], floor[k]])


def entities(scale=10.0):
    return {name: np.array(ends) * scale for name, ends in ENTITIES.items()}

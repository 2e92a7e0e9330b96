"""The part's own axes: a frame that turns with the part, so that a turned copy is laid on its grid the same way.

The first axis is the direction in which most of the surface looks; the second, across it, that in which most of the
rest does, or else the longest edges run. Of directions that tie, and of the two senses of each, those are taken in
which a generic sum over the edges, the entities among them counting more, is largest; where the sums tie too, the part
is symmetric and any will do.

Tolerances stand here only to tell equal from different in the presence of rounding. They choose between frames that are
all valid: whatever the choice, everything after it is exact, and none of them decides topology.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aspectgraph.solid.solid import Solid

# Directions closer than this (radians) are one; sums of areas or lengths closer than this share tie.
_SAME_DIRECTION = 1e-7
_TIE = 1e-7
# entries of the frame that differ from 0 or 1 by less are rounding
_AXIS_ALIGNED = 1e-12
_MAX_CANDIDATES = 4096

# generic linear forms of the two ends of an edge
_FORMS = np.array(
    [
        [1.618034, 0.701711, 2.236068, 0.447214, 1.154701, 0.309017],
        [0.577350, 1.879385, 0.267949, 1.414214, 0.351207, 2.080084],
        [2.094551, 0.414214, 1.324718, 0.754878, 1.732051, 0.861500],
    ]
)


def own_frame(solid: Solid, marks: Sequence[Sequence[int]] = ()) -> np.ndarray:
    """Rows are the part's own axes in the user's frame: own = frame @ user, a rotation, shape (3, 3).

    Of an axis-aligned part it is exactly a signed permutation.

    Parameters
    ----------
    solid : Solid
    marks : sequence of sequence of int
        Groups of edges, each told from all others: what the part is symmetric but for.
    """
    directions, weights = _classes(_area_vectors(solid))
    edges = np.array([edge.vertices for edge in solid.edges])
    runs = solid.vertices[edges[:, 1]] - solid.vertices[edges[:, 0]]
    frames: list[np.ndarray] = []
    for first in directions[_ties(weights)]:
        across = np.abs(directions @ first) < _SAME_DIRECTION
        seconds = directions[across]
        their_weights = weights[across]
        if not len(seconds):
            lengths = np.linalg.norm(runs, axis=1)
            seconds, their_weights = _classes(
                runs[np.abs(runs @ first) < _SAME_DIRECTION * lengths]
            )
        for second in seconds[_ties(their_weights)]:
            frames += _right_handed(first, second)
    candidates = np.array(frames[:_MAX_CANDIDATES])
    ends = solid.vertices[edges]
    ends = ends - ends.mean(axis=(0, 1))
    weights = np.ones(len(edges))
    for k, mark in enumerate(marks):
        weights[list(mark)] += (k + 1) / len(marks)
    return _exact_where_aligned(candidates[np.argmax(_signatures(candidates, ends, weights))])


def _area_vectors(solid: Solid) -> np.ndarray:
    corners = solid.vertices[solid.triangles]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(solid.faces), 3))
    np.add.at(total, solid.triangle_face, 0.5 * doubled)
    return total


def _classes(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of vectors, up to sign, and the sum of lengths of each."""
    lengths = np.linalg.norm(vectors, axis=1)
    left = np.argsort(-lengths, kind="stable")
    directions = []
    weights = []
    while len(left):
        leader = vectors[left[0]] / lengths[left[0]]
        cosine = vectors[left] @ leader
        off = np.linalg.norm(vectors[left] - cosine[:, None] * leader, axis=1)
        alike = off <= _SAME_DIRECTION * lengths[left]
        total = (vectors[left[alike]] * np.sign(cosine[alike])[:, None]).sum(axis=0)
        directions.append(total / np.linalg.norm(total))
        weights.append(lengths[left[alike]].sum())
        left = left[~alike]
    return np.array(directions), np.array(weights)


def _ties(weights: np.ndarray) -> np.ndarray:
    return weights >= (1.0 - _TIE) * weights.max()


def _right_handed(first: np.ndarray, second: np.ndarray) -> list[np.ndarray]:
    """The four frames with z along the first and x along the second direction."""
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    third = np.cross(first, second)
    return [np.array([s * second, r * s * third, r * first]) for r in (1, -1) for s in (1, -1)]


def _signatures(candidates: np.ndarray, ends: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """A generic smooth function of each edge in each frame, weighted and summed over the edges of the part."""
    size = np.linalg.norm(ends, axis=-1).max()
    sums = np.empty(len(candidates))
    for k, frame in enumerate(candidates):
        own = (ends @ frame.T) / size
        forward = own.reshape(-1, 6)
        backward = own[:, ::-1].reshape(-1, 6)
        sums[k] = weights @ (
            np.sin(forward @ _FORMS.T + 0.3) + np.sin(backward @ _FORMS.T + 0.3)
        ).sum(axis=1)
    return sums


def _exact_where_aligned(frame: np.ndarray) -> np.ndarray:
    rounded = np.rint(frame)
    return rounded if np.abs(frame - rounded).max() < _AXIS_ALIGNED else frame

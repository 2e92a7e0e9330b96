"""The loops of all faces as arrays: what holds for every face is computed for all of them at once.

Notation
--------
Half-edge h is a directed edge of a loop. Half-edges are numbered face by face, loop by loop, and
along each loop, outer loops first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain
from typing import Protocol

import numpy as np


class _LoopedFace(Protocol):
    """What this module needs to know of a `Face`."""

    @property
    def loops(self) -> tuple[tuple[int, ...], ...]:
        """All loops, the outer one first."""


class FaceLoops:
    """Loops of faces.

    Parameters
    ----------
    start : ndarray of int, shape (h,)
        The vertex where each half-edge starts.
    size : ndarray of int, shape (l,)
        The number of half-edges of each loop.
    loop_face : ndarray of int, shape (l,)
        The face of each loop, in rising order; every face has a loop.

    Attributes
    ----------
    start, size, loop_face
        As given.
    """

    def __init__(self, start: np.ndarray, size: np.ndarray, loop_face: np.ndarray) -> None:
        self.start = start
        self.size = size
        self.loop_face = loop_face

    @classmethod
    def of(cls, faces: Sequence[_LoopedFace] | FaceLoops) -> FaceLoops:
        """Return the loops of faces; loops are returned as they are."""
        if isinstance(faces, FaceLoops):
            return faces
        return cls.of_cycles([face.loops for face in faces])

    @classmethod
    def of_cycles(cls, cycles: Sequence[Sequence[Sequence[int]]]) -> FaceLoops:
        """Return the loops of faces, each given as its loops of vertex indices."""
        loops = list(chain.from_iterable(cycles))
        size = _integers(map(len, loops))
        n_loops = _integers(map(len, cycles))
        start = _integers(chain.from_iterable(loops))
        return cls(start, size, np.repeat(np.arange(len(n_loops)), n_loops))

    @classmethod
    def of_triangles(cls, triangles: np.ndarray) -> FaceLoops:
        """Return the loops of triangles, shape (t, 3)."""
        n = len(triangles)
        return cls(triangles.astype(np.int64).ravel(), np.full(n, 3), np.arange(n))

    @cached_property
    def first(self) -> np.ndarray:
        """The first half-edge of each loop, shape (l,)."""
        return np.cumsum(self.size) - self.size

    @cached_property
    def following(self) -> np.ndarray:
        """The next half-edge of the same loop, shape (h,)."""
        following = np.arange(1, len(self.start) + 1)
        following[self.first + self.size - 1] = self.first
        return following

    @cached_property
    def preceding(self) -> np.ndarray:
        """The half-edge before, of the same loop, shape (h,)."""
        preceding = np.arange(-1, len(self.start) - 1)
        preceding[self.first] = self.first + self.size - 1
        return preceding

    @cached_property
    def end(self) -> np.ndarray:
        """The vertex where each half-edge ends, shape (h,)."""
        return self.start[self.following]

    @cached_property
    def face(self) -> np.ndarray:
        """The face of each half-edge, shape (h,)."""
        return np.repeat(self.loop_face, self.size)

    @cached_property
    def outer(self) -> np.ndarray:
        """The outer loop of each face, shape (f,)."""
        return np.flatnonzero(np.diff(self.loop_face, prepend=-1))

    @cached_property
    def n_loops(self) -> np.ndarray:
        """The number of loops of each face, shape (f,)."""
        return np.bincount(self.loop_face)

    @cached_property
    def is_triangle(self) -> np.ndarray:
        """Which faces are triangles without holes, shape (f,)."""
        return (self.n_loops == 1) & (self.size[self.outer] == 3)

    @cached_property
    def groups(self) -> tuple[np.ndarray, np.ndarray]:
        """Half-edges sorted by the two vertices they join, lower ones first, and where each group begins."""
        low = np.minimum(self.start, self.end)
        high = np.maximum(self.start, self.end)
        key = low * (int(high.max(initial=0)) + 1) + high
        order = np.argsort(key, kind="stable")
        return order, np.flatnonzero(np.diff(key[order], prepend=-1))

    @cached_property
    def twin(self) -> np.ndarray:
        """The half-edge on the other side, shape (h,); for loops whose edges pair up."""
        order = self.groups[0]
        twin = np.empty_like(order)
        twin[order[0::2]] = order[1::2]
        twin[order[1::2]] = order[0::2]
        return twin

    def only(self, chosen: np.ndarray) -> FaceLoops:
        """Return the loops of some faces, numbered anew; `chosen` says which, shape (f,)."""
        number = np.cumsum(chosen) - 1
        which = chosen[self.loop_face]
        return FaceLoops(
            self.start[chosen[self.face]], self.size[which], number[self.loop_face[which]]
        )

    def loops_of(self, face: int) -> list[tuple[int, ...]]:
        """Return the loops of one face, the outer one first."""
        loop = int(self.outer[face])
        return [
            tuple(self.start[self.first[k] : self.first[k] + self.size[k]].tolist())
            for k in range(loop, loop + int(self.n_loops[face]))
        ]

    def by_size(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Go through the loops, those of one size k at a time.

        Yields
        ------
        tuple of ndarray of int, shapes (m,) and (m, k)
            The loops, and their half-edges.
        """
        for k in np.unique(self.size).tolist():
            which = np.flatnonzero(self.size == k)
            yield which, self.first[which][:, None] + np.arange(k)


def _integers(values: Iterable[int]) -> np.ndarray:
    return np.fromiter(values, dtype=np.int64)

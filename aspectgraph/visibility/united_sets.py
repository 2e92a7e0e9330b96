"""Blocked sets of several straight pieces as those of one entity.

The planes stay as they were cast for each piece, so the region carved by all sets is exactly the intersection of the
pieces' regions; only planes that are equal become one, and sets that several pieces have in common are kept once.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np


class Blockers(NamedTuple):
    """Convex sets {side · (plane) > 0 for all their planes}, largest first.

    Attributes
    ----------
    first : ndarray of int32, shape (n + 1,)
        Where each set's planes start.
    plane, side : ndarray, shape (m,)
        Plane number and the side (1 or -1) the set lies on.
    planes : ndarray of int64, shape (p, 4)
        The planes: those of the faces, then those cast for this entity.
    origin : ndarray of int32, shape (p, 4)
        How each plane came about: kind and three vertex or face numbers.
    """

    first: np.ndarray
    plane: np.ndarray
    side: np.ndarray
    planes: np.ndarray
    origin: np.ndarray


def united(parts: Sequence[Blockers]) -> Blockers:
    """Return the sets of all parts under one table of planes, the largest of every part first, and so on.

    Parameters
    ----------
    parts : sequence of Blockers
        Of one solid, so that their tables start with the same planes of faces.
    """
    planes = np.concatenate([part.planes for part in parts])
    origin = np.concatenate([part.origin for part in parts])
    leading = np.take_along_axis(planes, np.argmax(planes != 0, axis=1)[:, None], axis=1)
    canonical = planes * np.sign(leading)
    _, first, number = np.unique(canonical, axis=0, return_index=True, return_inverse=True)
    # in the order in which the planes come first, so that those of the faces keep their numbers
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    number = rank[number.ravel()]
    kept = first[order]
    flip = np.where((planes == planes[kept][number]).all(axis=1), 1, -1)
    offsets = np.cumsum([0] + [len(part.planes) for part in parts])
    sets: dict[tuple[tuple[int, int], ...], int] = {}
    for part, offset in zip(parts, offsets, strict=False):
        plane = number[offset + part.plane].tolist()
        side = (flip[offset + part.plane] * part.side).tolist()
        bounds = part.first.tolist()
        for k, (i, j) in enumerate(pairwise(bounds)):
            key = tuple(zip(plane[i:j], side[i:j], strict=True))
            sets[key] = min(k, sets.get(key, k))
    largest_first = sorted(sets, key=sets.__getitem__)
    flat = np.array([half for key in largest_first for half in key]).reshape(-1, 2)
    return Blockers(
        np.cumsum([0] + [len(key) for key in largest_first]).astype(np.int32),
        flat[:, 0].astype(np.int32),
        flat[:, 1].astype(np.int8),
        planes[kept],
        origin[kept],
    )

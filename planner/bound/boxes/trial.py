"""Poses of a box that are tried. Compiled loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from compiled.decorators import kernel, kernel_without_refcounts, put, put_table
from planner.bound.boxes.visibility import hidden_around, holds_point
from planner.bound.boxes.windows import farthest, rotation, seen_from, turned_back

# what a member that should be inspected is lost for
SIGHT, LENGTH, VIEW = range(3)


class Trial(NamedTuple):
    """What comes out when a pose is tried.

    Attributes
    ----------
    pose : array (4, 4)
        Camera to part.
    inspected : array of bool (e,)
        What it inspects.
    lost : array (3,)
        The weight of the members that are not visible, whose image is too short, or that are out of view: SIGHT,
        LENGTH, VIEW.
    look : array (3,)
        The point it looks at.
    """

    pose: np.ndarray
    inspected: np.ndarray
    lost: np.ndarray
    look: np.ndarray


@kernel
def try_pose(stack, i, chart, x, meets, entities, view, work, trial):
    """Try the pose of box i at x = (w, d), see `planner.bound.boxes.linear_sides`.

    Its nodal point is moved into the box if it is not there. Of the members only those are asked that should meet.

    Parameters
    ----------
    trial : Trial
        Is written to.

    Returns
    -------
    float
        The weight of what it inspects.
    """
    pose, inspected, lost, look = trial
    matrix = np.empty((3, 3))
    zero = np.zeros(3)
    s = np.empty((2, 3))
    far = np.empty(2)
    opened = np.empty(2)
    rotation(chart, stack.turn[i] + x[3:], matrix)
    for k in range(3):
        look[k] = stack.look[i, k] + (
            matrix[k, 0] * x[0] + matrix[k, 1] * x[1] + matrix[k, 2] * x[2]
        )
    eye = np.empty((2, 3))
    at = np.minimum(np.maximum(look - view.middle * matrix[:, 2], stack.eye[i, 0]), stack.eye[i, 1])
    put(eye[0], at)
    put(eye[1], at)
    put(look, at + view.middle * matrix[:, 2])
    put_table(pose, matrix)
    put(pose[:3, 3], at)
    inspected[:] = False
    lost[:] = 0.0
    total = 0.0
    # of members that exclude each other one counts, as of the witnesses of a target
    counted = np.zeros(stack.n_members[i], np.bool_)
    for a in range(stack.n_members[i]):
        if not meets[a]:
            continue
        e = stack.members[i, a]
        if not _in_view(entities.ends[e], look, matrix, view):
            lost[VIEW] += work.y[a]
            continue
        seen_from(entities.ends[e], look, matrix, s)
        farthest(s, entities.lengths[e], entities.length_ratio[e], 0.0, zero, view, far, opened)
        if s[0, 2] + view.middle > far[0] or s[1, 2] + view.middle > far[1]:
            lost[LENGTH] += work.y[a]
        elif _sees(
            entities,
            stack.cells[i, stack.start[i, a] : stack.start[i, a + 1]],
            eye,
            stack.sure[i, a],
        ):
            inspected[e] = True
            total += 0.0 if counted[work.group[a]] else work.y[a]
            counted[work.group[a]] = True
        else:
            lost[SIGHT] += work.y[a]
    return total


@kernel_without_refcounts
def _sees(entities, cells, eye, sure):
    """Tell whether a nodal point lies in one of the cells, and all points around it do."""
    if sure:
        return True
    for cell in cells:
        if holds_point(entities, cell, eye[0]):
            return not hidden_around(entities, cells, eye)
    return False


@kernel
def _in_view(ends, look, matrix, view):
    """Tell whether both ends are in focus and on the sensor."""
    for i in range(2):
        x, y, z = turned_back(
            matrix, ends[i, 0] - look[0], ends[i, 1] - look[1], ends[i, 2] - look[2]
        )
        z += view.middle
        if z < view.near or z > view.far or abs(x) > view.tan_x * z or abs(y) > view.tan_y * z:
            return False
    return True

"""Boxes of poses whose turns are small: whether heavy windows meet there, and how such a box is halved. Compiled loops.

The windows are linear in the point looked at and the turn together (`planner.bound.boxes.linear_sides`,
`planner.bound.boxes.linear_windows`).
"""

from __future__ import annotations

import numpy as np

from compiled.decorators import kernel
from planner.bound.boxes.exclusive_groups import exclusive_groups
from planner.bound.boxes.linear_sides import find_apart, linear_sides
from planner.bound.boxes.linear_windows import YES, Members, Seat, Sides, may_meet
from planner.bound.boxes.trial import LENGTH, SIGHT, VIEW
from planner.bound.boxes.view import OF_NODAL, OF_TURN
from planner.bound.boxes.windows import most_turn, turned_back


@kernel
def is_small(stack, i, small_turns):
    """Tell whether the turns of box i are small enough for linear windows."""
    v = stack.turn[i]
    return most_turn(v, stack.span[i], 1.0 + np.sum(v * v))[0] <= small_turns.turn


@kernel
def may_see(stack, i, entities, view, task, work, rest, x, meets):
    """Answer whether windows heavier than the limit may meet in box i, and where; see `linear_windows.may_meet`."""
    m = stack.n_members[i]
    u = stack.span[i]
    eye = stack.eye[i]
    n = linear_sides(stack, i, entities, view, work, rest)
    apart = work.apart[:m, :m]
    for a in range(m):
        for b in range(m):
            apart[a, b] = task.conflict[stack.members[i, a], stack.members[i, b]]
    find_apart(work, n, u, apart)
    exclusive_groups(np.arange(m), apart, work.group[:m])
    sides = Sides(work.rows[:n], work.rhs[:n], work.owner[:n])
    members = Members(work.group[:m], work.y[:m])
    low = np.empty(6)
    high = np.empty(6)
    slope = np.zeros((3, 3))
    # with a turn, w is tried such that the nodal point stays in the middle
    for j in range(3):
        high[j] = work.room[j]
        high[3 + j] = u[j]
        low[j] = -work.room[j]
        low[3 + j] = -u[j]
        for k in range(3):
            for c in range(3):
                slope[j, k] += work.matrix[c, j] * work.swing[k, c] / u[k]
    point = np.empty(3)
    away = (eye[0] + eye[1]) / 2 - work.nodal
    point[0], point[1], point[2] = turned_back(work.matrix, away[0], away[1], away[2])
    seat = Seat(point, slope)
    return may_meet(sides, members, task.limit, (low, high), seat, task.effort, x, meets[:m])


@kernel
def nodal_or_turn(stack, i, rest, answer, lost, small_turns):
    """Return along which coordinate box i is to be halved; -1 if it is too small for that.

    The nodal points decide visibility and length, and tie the points looked at to the turn. What the turn makes
    uncertain of that should not be more than there is of them.
    """
    u = stack.span[i]
    half = (stack.eye[i, 1] - stack.eye[i, 0]) / 2
    if rest > small_turns.turn_share * half.max() or (
        answer == YES and lost[VIEW] > max(lost[SIGHT], lost[LENGTH])
    ):
        return OF_TURN + np.argmax(u) if u.max() > small_turns.least_turn else -1
    return OF_NODAL + np.argmax(half) if half.max() > small_turns.least_mm else -1

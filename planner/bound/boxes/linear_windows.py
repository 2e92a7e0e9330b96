"""Whether windows that are linear in all six coordinates of a small box of poses meet. Compiled loops.

The sides of the windows (`planner.bound.boxes.linear_sides`) are rows . x <= rhs. The box of x is halved. Sides that no
point of a part breaks are not looked at again there. Members without which the weight would not exceed the limit are
needed: their sides shrink the part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from compiled.decorators import kernel, kernel_without_refcounts, put

NO, YES, UNDECIDED = range(3)


# for rounding, as a share of the room there is
_EPS = 1e-12


class Sides(NamedTuple):
    """Sides rows . x <= rhs: rows (r, 6), right-hand sides (r,), and owners (r,), the member whose side it is.

    The owner -1 stands for all: every pose satisfies such a side.
    """

    rows: np.ndarray
    rhs: np.ndarray
    owner: np.ndarray


class Members(NamedTuple):
    """Groups (m,) of which one member counts, and weights (m,) in descending order."""

    group: np.ndarray
    y: np.ndarray


class Seat(NamedTuple):
    """Where w is tried, given d: a point (3,) and slopes (3, 3)."""

    point: np.ndarray
    slope: np.ndarray


@kernel
def may_meet(sides, members, limit, box, seat, effort, x, meets):
    """Tell whether members heavier than a limit may have all their sides satisfied at one point of a box.

    Parameters
    ----------
    sides : Sides
    members : Members
    limit : float
    box : tuple
        Lowest and highest coordinates, (6,) each.
    seat : Seat
    effort : BoxEffort
        How many parts of the box are looked at, at most, and how.
    x : array (6,)
        The heaviest point that was tried is written here.
    meets : array of bool (m,)
        Becomes whose sides are all satisfied there.

    Returns
    -------
    answer : int
        NO is a proof. YES: they meet at x. UNDECIDED: more parts would be needed.
    made : int
        Parts looked at.
    """
    group, y = members
    m = len(y)
    n_rows = len(sides.rhs)
    low = np.empty((effort.shrinking.levels, 6))
    high = np.empty((effort.shrinking.levels, 6))
    live = np.empty((effort.shrinking.levels, n_rows), np.int32)
    n_live = np.zeros(effort.shrinking.levels, np.int64)
    alive = np.ones((effort.shrinking.levels, m), np.bool_)
    put(low[0], box[0])
    put(high[0], box[1])
    put(live[0], np.arange(n_rows))
    n_live[0] = n_rows
    put(x, (box[0] + box[1]) / 2)
    meets[:] = False
    tried = np.empty(6)
    there = np.zeros(m, np.bool_)
    best = -1.0
    loss = np.empty(m)
    scores = np.empty(6)
    first = np.empty(m, np.int64)
    size = 1
    made = 0
    answer = NO
    while size > 0:
        size -= 1
        i = size
        again = True
        while again:
            made += 1
            if made > effort.small_turns.parts:
                return UNDECIDED, made
            n_live[i] = _keep(sides, live[i], n_live[i], alive[i], low[i], high[i], y, scores)
            rows = live[i, : n_live[i]]
            total = _weight(alive[i], group, y, first, loss) if n_live[i] >= 0 else 0.0
            if total <= limit:
                break
            again = _shrink(sides, rows, alive[i], loss, total - limit, low[i], high[i], effort)
        if total <= limit:
            continue
        _try(sides, live[i, : n_live[i]], alive[i], low[i], high[i], seat, tried, there)
        here = _weight(there, group, y, first, loss)
        if here > best:
            best = here
            put(x, tried)
            put(meets, there)
        if here > limit:
            return YES, made
        axis = np.argmax(scores)
        if size + 2 > effort.shrinking.levels:
            answer = UNDECIDED
            continue
        for field in (low, high):
            put(field[i + 1], field[i])
        put(alive[i + 1], alive[i])
        n_live[i + 1] = n_live[i]
        put(live[i + 1], live[i, : n_live[i]])
        low[i + 1, axis] = high[i, axis] = (low[i, axis] + high[i, axis]) / 2
        size += 2
    return answer, made


@kernel_without_refcounts
def _keep(sides, live, n_live, alive, low, high, y, scores):
    """Drop the members that a part excludes and the sides that all of it satisfies; return how many sides are left.

    -1 if there can be no pose. ``scores`` (6,) become how much each coordinate leaves open.
    """
    rows, rhs, owner = sides
    scores[:] = 0.0
    kept = 0
    for k in range(n_live):
        r = live[k]
        e = owner[r]
        if e >= 0 and not alive[e]:
            continue
        value = -rhs[r]
        spread = 0.0
        for j in range(6):
            value += rows[r, j] * (low[j] + high[j]) / 2
            spread += abs(rows[r, j]) * (high[j] - low[j]) / 2
        if value > spread:
            if e < 0:
                return -1
            alive[e] = False
            continue
        if value > -spread:
            live[kept] = r
            kept += 1
            weight = y[max(e, 0)] / spread
            for j in range(6):
                scores[j] += weight * abs(rows[r, j]) * (high[j] - low[j])
    return kept


@kernel_without_refcounts
def _weight(alive, group, y, first, loss):
    """Return the weight alive, of each group the first; write what would be lost with each member."""
    total = 0.0
    first[:] = -1
    for a in range(len(y)):
        loss[a] = 0.0
        if not alive[a]:
            continue
        b = first[group[a]]
        if b < 0:
            first[group[a]] = a
            loss[a] = y[a]
            total += y[a]
        elif loss[b] == y[b]:
            # this one would take its place
            loss[b] -= y[a]
    return total


@kernel_without_refcounts
def _shrink(sides, live, alive, loss, spare, low, high, effort):
    """Shrink a part to where the sides of needed members can be satisfied; tell whether by much.

    Where they cannot, it is left such that the next look at it drops the member.
    """
    rows, rhs, owner = sides
    much = False
    for r in live:
        e = owner[r]
        if e >= 0 and (not alive[e] or loss[e] < spare):
            continue
        room = rhs[r]
        for j in range(6):
            room -= rows[r, j] * (low[j] if rows[r, j] > 0.0 else high[j])
        if room < 0.0:
            return True
        for j in range(6):
            a = rows[r, j]
            wide = high[j] - low[j]
            if abs(a) * wide <= room * (1.0 + _EPS):
                continue
            if a > 0.0:
                high[j] = low[j] + room / a * (1.0 + _EPS)
            else:
                low[j] = high[j] + room / a * (1.0 + _EPS)
            much = much or high[j] - low[j] < effort.shrinking.much * wide
    return much


@kernel
def _try(sides, live, alive, low, high, seat, tried, there):
    """Choose a point of a part and write which members have all sides satisfied there; none, if it is no pose."""
    rows, rhs, owner = sides
    for j in range(3):
        tried[3 + j] = (low[3 + j] + high[3 + j]) / 2
    for j in range(3):
        at = seat.point[j]
        for k in range(3):
            at += seat.slope[j, k] * tried[3 + k]
        tried[j] = min(max(at, low[j]), high[j])
    put(there, alive)
    for r in live:
        e = owner[r]
        value = -rhs[r]
        for j in range(6):
            value += rows[r, j] * tried[j]
        if value > 0.0 and e < 0:
            there[:] = False
            return
        if value > 0.0:
            there[e] = False

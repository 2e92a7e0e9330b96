"""How much the windows of a box of poses weigh where they meet. Compiled loops.

A window (`planner.bound.boxes.windows`) is given by the least values (6,) of x - tan_x z, -x - tan_x z, y - tan_y z, -y
- tan_y z, -z and z. The room is the box |w_i| <= room_i in which they are asked to meet. It is halved where a heavy
enough set of windows remains, the sides that most of them cut first.
"""

from __future__ import annotations

import numpy as np

from compiled.decorators import kernel, kernel_without_refcounts, put
from planner.bound.boxes.view import BOTTOM, FAR, LEFT, NEAR, RIGHT, TOP


@kernel
def weight_at(least, group, y, w, view):
    """Return the weight of the windows (m, 6) that contain w, of each group only the first one's."""
    total = 0.0
    x_z = view.tan_x * w[2]
    y_z = view.tan_y * w[2]
    seen = np.zeros(len(y), np.bool_)
    for a in range(len(y)):
        if (
            not seen[group[a]]
            and least[a, FAR] <= w[2] <= -least[a, NEAR]
            and least[a, RIGHT] + x_z <= w[0] <= -least[a, LEFT] - x_z
            and least[a, BOTTOM] + y_z <= w[1] <= -least[a, TOP] - y_z
        ):
            seen[group[a]] = True
            total += y[a]
    return total


@kernel
def may_exceed(least, group, y, limit, room, view, w, meeting):
    """Tell whether windows (m, 6) heavier than a limit may meet in the room; if so, write where into ``w`` (3,).

    ``y`` (m,) descends; of each group only the first window counts. The answer no is a proof; with the answer yes they
    meet at w, or nearly. ``meeting`` says how closely this is asked.
    """
    m = len(y)
    low = np.empty((meeting.deepest + 2, 3))
    high = np.empty((meeting.deepest + 2, 3))
    live = np.empty((meeting.deepest + 2, m), np.int16)
    n_live = np.empty(meeting.deepest + 2, np.int64)
    level = np.zeros(meeting.deepest + 2, np.int64)
    stamp = np.zeros(m, np.int64)
    cuts = np.empty(3)
    n_live[0] = m
    for k in range(3):
        low[0, k] = -room[k]
        high[0, k] = room[k]
    for a in range(m):
        live[0, a] = a
    size = 1
    n_seen = 0
    n_doubtful = 0
    middle = np.empty(3)
    while size > 0:
        size -= 1
        n_seen += 1
        n_live[size], total = _meeting(
            (least, group, y),
            live[size],
            n_live[size],
            low[size],
            high[size],
            view,
            stamp,
            n_seen,
            cuts,
        )
        if total <= limit:
            continue
        for k in range(3):
            middle[k] = (low[size, k] + high[size, k]) / 2
        if cuts.max() <= 0.0 or weight_at(least, group, y, middle, view) > limit:
            put(w, middle)
            return True
        if level[size] >= meeting.deepest:
            put(w, middle)
            n_doubtful += 1
            if n_doubtful == meeting.doubtful:
                return True
            continue
        axis = np.argmax(cuts)
        for field in (low, high):
            put(field[size + 1], field[size])
        n_live[size + 1] = n_live[size]
        put(live[size + 1], live[size, : n_live[size]])
        low[size, axis] = high[size + 1, axis] = middle[axis]
        level[size] += 1
        level[size + 1] = level[size]
        size += 2
    return n_doubtful > 0


@kernel_without_refcounts
def _meeting(windows, live, n_live, low, high, view, stamp, n_seen, cuts):
    """Keep the live windows that meet a part of the room; return how many, and their weight.

    ``cuts`` (3,) becomes how many sides of windows cut the part across each axis, times its width.
    """
    least, group, y = windows
    kept = 0
    total = 0.0
    cuts[:] = 0.0
    for i in range(n_live):
        a = live[i]
        # the window is widest at its least z
        z = max(least[a, FAR], low[2])
        x = view.tan_x * z
        y_ = view.tan_y * z
        if (
            z > min(-least[a, NEAR], high[2])
            or max(least[a, RIGHT] + x, low[0]) > min(-least[a, LEFT] - x, high[0])
            or max(least[a, BOTTOM] + y_, low[1]) > min(-least[a, TOP] - y_, high[1])
        ):
            continue
        live[kept] = a
        kept += 1
        if stamp[group[a]] < n_seen:
            stamp[group[a]] = n_seen
            total += y[a]
        x = view.tan_x * high[2]
        y_ = view.tan_y * high[2]
        cuts[0] += least[a, RIGHT] + x > low[0] or -least[a, LEFT] - x < high[0]
        cuts[1] += least[a, BOTTOM] + y_ > low[1] or -least[a, TOP] - y_ < high[1]
        cuts[2] += least[a, FAR] > low[2] or -least[a, NEAR] < high[2]
    cuts[0] *= (high[0] - low[0]) / (view.tan_x * view.middle)
    cuts[1] *= (high[1] - low[1]) / (view.tan_y * view.middle)
    cuts[2] *= (high[2] - low[2]) / ((view.far - view.near) / 2)
    return kept, total

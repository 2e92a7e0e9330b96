"""Groups of entities that all exclude each other: of each group one pose inspects one at most. Compiled loops."""

from __future__ import annotations

import numpy as np

from compiled.decorators import kernel


@kernel
def exclusive_groups(members, conflict, group):
    """Write a group for each member such that those of one group all exclude each other; numbered from 0."""
    m = len(members)
    # the last member that a group has no room for
    barred = np.full(m + 1, -1)
    for a in range(m):
        for b in range(a):
            if not conflict[members[a], members[b]]:
                barred[group[b]] = a
        g = 0
        while barred[g] == a:
            g += 1
        group[a] = g

"""Cliques are cliques, and on small graphs the largest ones."""

import networkx as nx
import numpy as np
import pytest

from planner.bound.lower_bound import large_clique


@pytest.mark.parametrize("density", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_a_clique_is_one_and_as_large_as_any(density):
    rng = np.random.default_rng(4)
    for n in (1, 2, 7, 16, 24):
        upper = np.triu(rng.random((n, n)) < density, k=1)
        conflict = upper | upper.T
        found = large_clique(conflict)
        assert (conflict[np.ix_(found, found)] | np.eye(len(found), dtype=bool)).all()
        assert len(set(found.tolist())) == len(found)
        assert len(found) == max(
            len(clique) for clique in nx.find_cliques(nx.from_numpy_array(conflict))
        )

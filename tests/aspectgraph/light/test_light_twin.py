"""Light domains against the exact twin: no pair of lamp and edge may differ."""

import numpy as np
import pytest
from generated_solids import generated_solid
from light_twin import compare_light

# a fault that one solid in thirty shows is missed by 3 % of such draws
N_SOLIDS = 100
N_POINTS = 150
N_EDGES = 8
CONTRASTS = ("0.1", "0.2", "0.05", "0.37")


@pytest.mark.parametrize("first", range(0, N_SOLIDS, 20))
def test_engine_never_disagrees_with_the_twin(first):
    shares = []
    n = 0
    for seed in range(first, first + 20):
        contrast = CONTRASTS[seed % len(CONTRASTS)]
        engine, twin, may_differ = compare_light(
            generated_solid(seed), seed, N_POINTS, N_EDGES, (contrast, contrast)
        )
        assert ((engine == twin) | may_differ).all(), (
            seed,
            np.argwhere((engine != twin) & ~may_differ)[:3],
        )
        assert may_differ.mean() < 0.05
        shares.append(twin.mean())
        n += engine.size
    assert n >= 15_000
    assert 0.1 < np.mean(shares) < 0.9, "the comparison must see both answers"


def test_the_comparison_sees_a_wrong_contrast():
    wrong = 0
    for seed in range(10):
        engine, twin, may_differ = compare_light(
            generated_solid(seed), seed, N_POINTS, N_EDGES, ("0.101", "0.1")
        )
        wrong += int(((engine != twin) & ~may_differ).sum())
    assert wrong > 10

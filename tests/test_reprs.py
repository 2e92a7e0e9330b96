"""What a notebook shows first of a result: one true line."""

from pathlib import Path

from aspectgraph import build_aspect_graph, read_entities, read_solid
from ga import maximize

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_results_of_the_geometry_say_what_they_are():
    solid = read_solid(EXAMPLES / "slotted_block.off")
    eag = build_aspect_graph(solid, read_entities(EXAMPLES / "slotted_block_entities.toml", solid))
    size = f"{len(eag.graph)} domains, {eag.graph.number_of_edges()} adjacencies"
    assert repr(eag) == f"<EntityAspectGraph of 'slotted_block': 4 entities, {size}>"
    cells = eag.covering_cells(["e1"])
    assert repr(cells).startswith(f"<CellSet: {len(cells)} cells, ")
    for shown in (eag.regions, cells, next(iter(cells))):
        assert "\n" not in repr(shown)
        assert repr(shown).startswith(f"<{type(shown).__name__}")


def test_a_result_of_the_genetic_algorithm_fits_in_a_line():
    result = maximize(lambda bits: bits.sum(axis=1).astype(float), 12, rng=0)
    assert len(repr(result)) < 200
    assert "\n" not in repr(result)

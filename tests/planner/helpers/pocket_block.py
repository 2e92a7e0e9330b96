"""The block with two pockets that stands for the paper's Table II, as the examples have it."""

from pathlib import Path

from aspectgraph import read_entities, read_solid

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


def two_pocket_block():
    return read_solid(EXAMPLES / "two_pocket_block.off")


def entities():
    found = read_entities(EXAMPLES / "two_pocket_block_entities.toml", two_pocket_block())
    return {name: entity.endpoints for name, entity in found.items()}

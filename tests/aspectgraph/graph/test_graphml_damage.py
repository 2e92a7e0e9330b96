"""No damage to a GraphML file leads to anything but a graph or the package's own error, and no warning."""

import numpy as np
import pytest
from graph_examples import small_graph
from part_mutants import damaged_bytes, damaged_encoding, damaged_numbers, damaged_xml

from aspectgraph import GraphMLError, read_graphml, write_graphml


@pytest.mark.parametrize("damage", [damaged_bytes, damaged_encoding, damaged_numbers, damaged_xml])
def test_damage(tmp_path, damage):
    rng = np.random.default_rng(20240229)
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    data = path.read_bytes()
    messages = []
    for _ in range(250):
        path.write_bytes(damage(data, rng))
        try:
            assert len(read_graphml(path)) <= len(small_graph()) + 1
        except GraphMLError as error:
            messages.append(str(error))
    assert len(messages) > 80
    assert not any("\n" in message for message in messages)


@pytest.mark.parametrize("declared", ["utf-9", "hex", "unicode_escape", "undefined"])
def test_an_encoding_that_is_none(tmp_path, declared):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    path.write_bytes(
        path.read_bytes().replace(b"encoding='utf-8'", f"encoding='{declared}'".encode())
    )
    with pytest.raises(GraphMLError, match="must be GraphML with integer node ids"):
        read_graphml(path)


def test_a_missing_type_is_not_guessed(tmp_path):
    path = tmp_path / "g.graphml"
    write_graphml(small_graph(), path)
    path.write_bytes(path.read_bytes().replace(b' attr.type="double"', b"", 1))
    with pytest.raises(GraphMLError, match="No key type"):
        read_graphml(path)


def test_a_packed_file_that_is_cut_off(tmp_path):
    write_graphml(small_graph(), tmp_path / "g.graphml.gz")
    for data in (b"\x1f\x8b\x08\x00cut", b"plain"):
        (tmp_path / "g.graphml.gz").write_bytes(data)
        with pytest.raises(GraphMLError, match="must be GraphML"):
            read_graphml(tmp_path / "g.graphml.gz")

"""Dimensions of patterns: every item of an aspect counts, however the file attaches it.

The plate has holes at (20, 20) and (60, 20), of radius 6, and is placed twice. The face of the first hole is #481, that
of the second one #508; #335 is the cylinder below the second face, which no shape of the part is made from by itself.
"""

from __future__ import annotations

import pytest
from assemblies import CASES
from one_kernel import one_kernel

from aspectgraph import read_dimensions, read_solid
from aspectgraph.read.step.semantic_dimensions import list_attached_items
from aspectgraph.read.step.text import parse_entities

USAGE = "GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#481);"
ALSO = "#900 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#{item});"
PARTS = """#900 = SHAPE_ASPECT('','',#30,.T.);
#901 = SHAPE_ASPECT('','',#30,.T.);
#902 = SHAPE_ASPECT_RELATIONSHIP('','',#551,#900);
#903 = SHAPE_ASPECT_RELATIONSHIP('','',#900,#901);
#904 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#901,#36,#481);
#905 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#901,#36,#508);"""


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    pytest.importorskip("OCP")
    with one_kernel():
        yield


def plate(usages):
    """The file with these statements in place of what attaches its dimension."""
    text = (CASES / "dim_two_instances.step").read_text()
    number = text[: text.index(USAGE)].rsplit("#", 1)[1]
    return text.replace(f"#{number}{USAGE}", usages)


def dimensions_of(folder, usages):
    path = folder / "plate.step"
    path.write_text(plate(usages))
    solid = read_solid(path)
    return {rim.id: rim for rim in solid.rims()}, read_dimensions(path, solid)


def holes(rims, dimension):
    """The places of the holes of each feature, as (x, y)."""
    return [
        {tuple(rims[way[0]].centre[:2].round(6).tolist()) for way in ways}
        for ways in dimension.features
    ]


@pytest.mark.parametrize(
    "usages",
    [f"#552 = {USAGE}\n{ALSO.format(item=508)}", PARTS],
    ids=["two usages of one aspect", "two usages of a part of a part"],
)
def test_all_items_of_an_aspect_are_features(usages, tmp_path):
    rims, dimensions = dimensions_of(tmp_path, usages)
    assert len(dimensions) == 2
    for dimension, y in zip(dimensions, (20.0, 80.0), strict=True):
        assert (dimension.n_features, dimension.reason, dimension.note) == (2, None, "")
        assert sorted(map(sorted, holes(rims, dimension))) == [[(20.0, y)], [(60.0, y)]]


def test_an_item_that_no_shape_is_made_from_counts_and_is_told(tmp_path):
    rims, dimensions = dimensions_of(tmp_path, f"#552 = {USAGE}\n{ALSO.format(item=335)}")
    for dimension, y in zip(dimensions, (20.0, 80.0), strict=True):
        assert dimension.n_features == 2
        assert holes(rims, dimension) == [{(20.0, y)}, set()]
        assert dimension.note == (
            "1 item that it is attached to could not be read; 1 of its 2 features cannot be measured"
        )
        assert dimension.feature_reasons == (
            None,
            "the file attaches it to an item of this feature that could not be read",
        )


def test_an_item_that_is_stated_twice_counts_once(tmp_path):
    _, dimensions = dimensions_of(tmp_path, f"#552 = {USAGE}\n{ALSO.format(item=481)}")
    assert [one.n_features for one in dimensions] == [1, 1]


def items(statements):
    text = "DATA;\n#30=PRODUCT_DEFINITION_SHAPE('','',$);\n" + statements + "\nENDSEC;"
    return list_attached_items(parse_entities(text.encode()))


def test_items_in_the_text():
    """An aspect with items of its own is not asked for parts; circles of aspects end."""
    usages = (
        "#1=SHAPE_ASPECT('','',#30,.T.);#2=SHAPE_ASPECT('','',#30,.T.);"
        "#3=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#1,#7,#11);"
        "#4=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#1,#7,#12);"
        "#5=SHAPE_ASPECT_RELATIONSHIP('','',#2,#1);#6=SHAPE_ASPECT_RELATIONSHIP('','',#1,#2);"
        "#8=CENTRE_OF_SYMMETRY('','',#30,.F.);"
        "#9=SHAPE_ASPECT_DERIVING_RELATIONSHIP('','',#8,#2);"
    )
    assert items(usages + "#20=DIMENSIONAL_SIZE(#1,'');") == [[[11, 12]]]
    assert items(usages + "#20=DIMENSIONAL_LOCATION('','',#8,#1);") == [[[11, 12], [11, 12]]]
    assert items(usages + "#20=DIMENSIONAL_SIZE_WITH_DATUM_FEATURE('','',#30,.T.,#2,'');") == [
        [[11, 12]]
    ]
    assert items("#1=SHAPE_ASPECT('','',#30,.T.);#20=DIMENSIONAL_SIZE(#1,'');") == [[[]]]

"""Names of solids: what the text says, what XCAF says, and what may be typed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from aspectgraph import ReadError, SolidChoice, SolidEntry, list_solids, read_solid
from aspectgraph.files import list_text, numbers_of, with_labels
from aspectgraph.read.step.names import decode_text, read_names
from aspectgraph.read.step.text import list_solids as solids_of_text
from aspectgraph.read.step.text import parse_entities

pytest.importorskip("OCP")

from named_assemblies import corner, write_assembly, xcaf_names
from step_in_process import KernelInProcess, read_in_process

CASES = Path(__file__).parents[2] / "cases"
EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module")
def assembly(tmp_path_factory):
    path = tmp_path_factory.mktemp("assembly") / "assembly.step"
    write_assembly(path)
    return path


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        (r"Geh\X2\00E4\X0\use", "Gehäuse"),
        (r"\X2\00C400D6\X0\ and \X2\20AC\X0", r"ÄÖ and \X2\20AC\X0"),
        (r"\X4\0001F529\X0\ bolt", "🔩 bolt"),
        (r"Geh\S\duse", "Gehäuse"),
        # ISO 8859-2: š is B9, and the letter 9 is 39
        (r"\PB\ko\S\9", "koš"),
        (r"Geh\X\E4use", "Gehäuse"),
        (r"C:\\parts", r"C:\parts"),
        ("Gehäuse".encode().decode("latin-1"), "Gehäuse"),
        ("Geh\xe4use", "Gehäuse"),
        ("long \r\nname", "long name"),
    ],
)
def test_texts_are_decoded_as_the_standard_says(text, meant):
    assert decode_text(text) == meant


def named_rows(path):
    """Return product, instances and corner of each solid, as the reader of the text has them."""
    kernel = KernelInProcess(path.name, None)
    kernel.ask("load", path=str(path), name=path.name)
    rows = kernel.ask("list")[0]["solids"]
    return [
        (row["product"], row["instance"], corner(slot.shape))
        for row, slot in zip(rows, kernel.part.slots, strict=True)
    ]


def test_names_and_places_agree_with_xcaf(assembly):
    expected = [(product, "/".join(names), low) for product, names, low in xcaf_names(assembly)]
    assert len(expected) == 10
    assert sorted(named_rows(assembly)) == sorted(expected)


@pytest.mark.parametrize(
    "path",
    [
        CASES / "dim_two_instances.step",
        CASES / "dim_cover_on_base.step",
        CASES / "dim_part_moved.step",
    ],
    ids=lambda path: path.stem,
)
def test_products_of_files_agree_with_xcaf(path):
    expected = sorted((product, low) for product, _, low in xcaf_names(path))
    assert sorted((product, low) for product, _, low in named_rows(path)) == expected


def test_list_states_names_sizes_and_places(assembly, monkeypatch):
    read_in_process(monkeypatch)
    entries = {entry.label: entry for entry in list_solids(assembly)}
    housing = entries["Gehäuse, groß"]
    assert housing.size_mm == pytest.approx((30, 20, 10))
    assert (housing.n_faces, housing.n_placed, housing.instance) == (6, 1, "inst0")
    assert {"12:1", "12:6", "twin:1", "twin:2", 'sub "A"'} <= set(entries)
    assert entries["12:1"].n_placed == 6
    assert entries["twin:1"].n_placed == 1
    assert entries["12:1"].instance == "group-0/pin-1"


@pytest.mark.parametrize(
    ("solids", "size"),
    [
        (["Gehäuse, groß"], (30, 20, 10)),
        (["inst1"], (5, 5, 6)),
        ("Gehäuse, groß", (30, 20, 10)),
        ("twin:2", (9, 8, 7)),
        (SolidChoice("inst1", ["12:all"]), (62, 63, 46)),
        (["group-50/pin-2"], (2, 3, 4)),
        (["twin:2"], (9, 8, 7)),
        (["12:all"], (62, 3, 4)),
        (SolidChoice(["inst1"], ["12:all"]), (62, 63, 46)),
    ],
)
def test_solids_are_read_by_name(assembly, monkeypatch, solids, size):
    read_in_process(monkeypatch)
    solid = read_solid(assembly, solids=solids)
    low, high = solid.bounds
    assert (high - low).tolist() == pytest.approx(size)
    assert len(solid.file_solids.entries) == 10


def test_wrong_names_are_refused_with_the_list(assembly, monkeypatch):
    read_in_process(monkeypatch)
    with pytest.raises(
        ReadError, match=r"solids must name solids of the file.*'Gehause'.*'Gehäuse, groß'"
    ):
        read_solid(assembly, solids=["Gehause"])
    with pytest.raises(
        ReadError, match=r"'12', which stands for 6 solids; write one of 12:1 \(0\), "
    ):
        read_solid(assembly, solids=["12"])
    with pytest.raises(
        ReadError, match=r"solids must name some of 0..9 .*Got \[12\]; it holds 0 '12:1'"
    ):
        read_solid(assembly, solids=[12])
    with pytest.raises(ReadError, match="occluders must name solids"):
        read_solid(assembly, solids=SolidChoice([0], ["nut"]))
    # one name is refused like a list of it
    with pytest.raises(ReadError, match=r"solids must name solids of the file.*'Gehause'"):
        read_solid(assembly, solids="Gehause")
    assert read_solid(assembly, solids=0).file_solids.measured == (0,)
    with pytest.raises(ReadError, match="each solid once"):
        read_solid(assembly, solids=["inst0", "Gehäuse, groß"])


def entries_of(*names):
    return with_labels([SolidEntry(k, product=name) for k, name in enumerate(names)])


def test_every_label_names_its_solid_alone():
    entries = entries_of("bolt", "", "bolt", "bolt:1", "7", "nut", "")
    assert [entry.label for entry in entries] == ["0", "1", "bolt:2", "bolt:1", "7", "nut", "6"]
    for entry in entries:
        if entry.label != str(entry.number) or entry.label in entry.names:
            assert numbers_of("solids", entry.label, entries) == [entry.number]


def test_a_name_of_its_own_goes_before_a_counted_one():
    entries = entries_of("bolt", "bolt", "bolt:2")
    assert numbers_of("solids", "bolt:2", entries) == [2]
    assert numbers_of("solids", "bolt:1", entries) == [0]
    with pytest.raises(ReadError, match="must name solids"):
        numbers_of("solids", "bolt:3", entries)


def test_long_lists_are_cut_in_errors():
    assert list_text(entries_of(*"abcdefghijk")).endswith("7 'h' (0 faces), and 3 more")


def test_bodies_of_one_product_have_their_own_names():
    entries = with_labels(
        [
            SolidEntry(0, product="plate", body="Cut, 1"),
            SolidEntry(1, product="plate", body="Cut, 2"),
        ]
    )
    assert [entry.label for entry in entries] == ["Cut, 1", "Cut, 2"]


def test_missing_and_quoted_names_are_read(tmp_path):
    text = (CASES / "dim_cover_on_base.step").read_text(encoding="latin-1")
    products = re.findall(r"PRODUCT\('[^']*','[^']*'", text)
    text = text.replace(products[1], "PRODUCT('part-9',$", 1).replace(
        products[1], "PRODUCT('x','it''s'", 1
    )
    data = text.encode("latin-1")
    entities = parse_entities(data)
    numbers = [solid.number for solid in solids_of_text(entities)]
    assert sorted(read_names(data, entities, numbers).products.values()) == ["it's", "part-9"]


def test_other_files_have_no_list(tmp_path):
    with pytest.raises(ReadError, match="path must name a STEP file"):
        list_solids(EXAMPLES / "two_pocket_block.off")


@pytest.mark.parametrize("solids", [1.5, [1.5], True, b"bolt", ["bolt", None], [[0]], {"bolt": 1}])
@pytest.mark.parametrize("parameter", ["solids", "occluders"])
def test_solids_are_numbers_or_names(solids, parameter):
    given = {"measured" if parameter == "solids" else parameter: solids}
    with pytest.raises(ReadError, match=rf"^{parameter} must be numbers or names of solids\. Got "):
        SolidChoice(**given)


def test_numbers_of_other_kinds_are_solids():
    assert SolidChoice(np.array([2, 0])).measured == (2, 0)
    assert SolidChoice(np.int64(1)).measured == (1,)
    assert SolidChoice("bolt", [np.int32(3)]).occluders == (3,)

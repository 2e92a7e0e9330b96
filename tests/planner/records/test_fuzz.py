"""Every reader gives a result or one of the package's own errors of one line, whatever the file; see `make fuzz`."""

from __future__ import annotations

import os

import pytest
from fuzzing import OWN, READERS, mutant, outcome
from plan_examples import plan

from aspectgraph import ReadLimits, files, read_solid
from aspectgraph.exceptions import ReadError
from planner.plan import read_plan

MUTANTS = 40

# mutants that once ended otherwise
KEPT = {
    "binary.ply": (1604, 4350),
    "entities.toml": (1292, 1308, 1504),
    "entities.json": (129, 1136, 1385, 1996),
    "entities.csv": (1325,),
    "wanted.toml": (1069, 1231, 1539),
    "wanted.json": (143, 147, 670, 752, 1120),
}


@pytest.mark.parametrize("name", [name for name in READERS if name != "part.step"])
def test_damaged_files_are_read_or_refused(tmp_path, name):
    path = tmp_path / name
    good = READERS[name].good()
    path.write_bytes(good)
    assert outcome(name, path) == "read"
    found = []
    for seed in (*range(MUTANTS), *KEPT.get(name, ())):
        path.write_bytes(mutant(name, seed, good))
        found.append(outcome(name, path))
    assert found.count("refused") > MUTANTS / 3


@pytest.mark.parametrize("name", [name for name in READERS if READERS[name].read is not read_solid])
def test_every_reader_has_a_limit_of_size(tmp_path, monkeypatch, name):
    path = tmp_path / name
    good = READERS[name].good()
    path.write_bytes(good)
    if name == "part.step":
        with pytest.raises(ReadError, match=r"must have at most file_mb=0\.001 MB"):
            read_solid(path, limits=ReadLimits(file_mb=0.001))
        return
    monkeypatch.setattr(files, "SMALL_FILE_BYTES", len(good) - 1)
    monkeypatch.setattr(files, "LARGE_FILE_BYTES", len(good) - 1)
    with pytest.raises(OWN, match=r"it has more than .* MB"):
        READERS[name].read(path)


@pytest.mark.parametrize("name", [name for name in READERS if READERS[name].read is read_solid])
def test_every_mesh_has_a_limit_of_size(tmp_path, name):
    path = tmp_path / name
    good = READERS[name].good()
    path.write_bytes(good)
    with pytest.raises(ReadError, match=r"must have at most file_mb=0\.0001 MB"):
        read_solid(path, limits=ReadLimits(file_mb=0.0001))


def test_a_part_whose_name_is_no_unicode_has_a_name_that_can_be_written(tmp_path):
    path = tmp_path / os.fsdecode(b"part\xff\xed\xa0\x80.off")
    path.write_bytes(READERS["part.off"].good())
    name = read_solid(path).name
    assert name == r"part\xff\xed\xa0\x80"
    plan(part=name).write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json").part == name


@pytest.mark.parametrize("name", READERS)
def test_half_a_character_is_no_name_of_a_file(tmp_path, name):
    before, after = name.split(".")
    with pytest.raises((*OWN, FileNotFoundError)):
        READERS[name].read(tmp_path / f"{before}\ud800.{after}")


def test_mutants_are_the_same_everywhere():
    good = READERS["part.off"].good()
    assert mutant("part.off", 7, good) == mutant("part.off", 7, good) != good
    assert len({mutant("part.off", seed, good) for seed in range(100)}) > 90


def test_a_damaged_step_file_is_read_or_refused(tmp_path):
    pytest.importorskip("OCP")
    path = tmp_path / "part.step"
    good = READERS["part.step"].good()
    for seed in range(2):
        path.write_bytes(mutant("part.step", seed, good))
        assert outcome("part.step", path) in ("read", "refused")

"""Visible regions that an interrupted computation has left: used again, and never for anything else."""

import numpy as np
import pytest

from aspectgraph import compute_regions, read_solid
from aspectgraph.cells.arrays import allocate
from aspectgraph.visibility.visibility_regions import KeptRegions

pytestmark = pytest.mark.uncompiled

EDGES = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
BOX = [[-200.0, -200, -200], [200, 200, 200]]


@pytest.fixture
def block(request):
    return read_solid(request.config.rootpath / "examples/two_pocket_block.off")


def same(one, other):
    return all(
        np.array_equal(a, b)
        for name in EDGES
        for a, b in zip(arrays(one._regions[name]), arrays(other._regions[name]), strict=True)
    )


def arrays(region):
    return [*region.tree, region.origin, region.observable]


def refuse(*arguments, **options):
    raise RuntimeError("computed again")


def test_what_is_kept_is_not_computed_again(block, tmp_path, monkeypatch):
    kept = KeptRegions(tmp_path / "kept")
    assert not kept
    first = compute_regions(block, EDGES, BOX, kept=kept)
    assert kept
    assert len(list(kept.folder.iterdir())) == 2
    monkeypatch.setattr("aspectgraph.visibility.visibility_regions.observable_region", refuse)
    assert same(compute_regions(block, EDGES, BOX, kept=KeptRegions(kept.folder)), first)
    kept.remove()
    assert not kept


def test_another_request_is_computed(block, tmp_path, monkeypatch):
    kept = KeptRegions(tmp_path)
    compute_regions(block, EDGES, BOX, kept=kept)
    monkeypatch.setattr("aspectgraph.visibility.visibility_regions.observable_region", refuse)
    larger = [[-300.0, -200, -200], [200, 200, 200]]
    for edges, box in (
        (EDGES, larger),
        ({"e1": EDGES["e1"]}, BOX),
        ({"other": EDGES["e1"], "e4": EDGES["e4"]}, BOX),
    ):
        with pytest.raises(RuntimeError, match="computed again"):
            compute_regions(block, edges, box, kept=kept)


def test_regions_of_another_request_are_not_taken_and_say_whose_they_are(
    block, tmp_path, monkeypatch
):
    kept = KeptRegions(tmp_path / "kept", {"seed": 1})
    first = compute_regions(block, EDGES, BOX, kept=kept)
    assert kept.owner() == {"seed": 1}
    assert KeptRegions(tmp_path / "kept").owner() == {"seed": 1}
    assert KeptRegions(tmp_path / "none").owner() is None
    monkeypatch.setattr("aspectgraph.visibility.visibility_regions.observable_region", refuse)
    again = KeptRegions(kept.folder, {"seed": 1})
    assert same(compute_regions(block, EDGES, BOX, kept=again), first)
    with pytest.raises(RuntimeError, match="computed again"):
        compute_regions(block, EDGES, BOX, kept=KeptRegions(kept.folder, {"seed": 2}))


def test_regions_of_other_code_are_not_taken(block, tmp_path, monkeypatch):
    kept = KeptRegions(tmp_path)
    compute_regions(block, EDGES, BOX, kept=kept)
    monkeypatch.setattr(
        "aspectgraph.visibility.visibility_regions.code_digest", lambda names: "other"
    )
    monkeypatch.setattr("aspectgraph.visibility.visibility_regions.observable_region", refuse)
    with pytest.raises(RuntimeError, match="computed again"):
        compute_regions(block, EDGES, BOX, kept=kept)


def test_nothing_is_read_or_written_through_a_link(block, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine").write_text("mine")
    (tmp_path / "kept").symlink_to(elsewhere)
    kept = KeptRegions(tmp_path / "kept", {"seed": 1})
    assert not kept
    compute_regions(block, EDGES, BOX, kept=kept)
    assert kept.get("e1") is None
    kept.remove()
    assert not (tmp_path / "kept").is_symlink()
    assert [path.name for path in elsewhere.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    "damage", [lambda b: b"", lambda b: b[:-40], lambda b: b[:200] + b"x" + b[201:], lambda b: b"x"]
)
def test_what_is_damaged_is_computed_again(block, tmp_path, damage):
    kept = KeptRegions(tmp_path)
    first = compute_regions(block, EDGES, BOX, kept=kept)
    for path in tmp_path.iterdir():
        path.write_bytes(damage(path.read_bytes()))
    assert same(compute_regions(block, EDGES, BOX, kept=kept), first)
    # and whole again
    assert all(kept.get(name) is not None for name in EDGES)


def test_a_region_does_not_depend_on_what_its_memory_held_before(block, monkeypatch):
    def held(value):
        def allocated(*arguments):
            cx = allocate(*arguments)
            cx.cell[:] = cx.face[:] = cx.edge[:] = cx.vertex[:] = value
            return cx

        monkeypatch.setattr("aspectgraph.visibility.entity_region.allocate", allocated)
        return compute_regions(block, EDGES, BOX)

    assert same(held(7), held(8))


def test_other_arrays_are_no_region(block, tmp_path):
    kept = KeptRegions(tmp_path)
    compute_regions(block, EDGES, BOX, kept=kept)
    for path in tmp_path.iterdir():
        data = dict(np.load(path))
        np.savez(path, **{**data, "plane": data["plane"].astype(np.float64)})
    assert all(kept.get(name) is None for name in EDGES)


def test_a_folder_that_cannot_be_made_keeps_nothing(block, tmp_path):
    (tmp_path / "file").write_text("in the way")
    kept = KeptRegions(tmp_path / "file" / "kept")
    assert same(compute_regions(block, EDGES, BOX, kept=kept), compute_regions(block, EDGES, BOX))
    assert not kept


def trees(arrays):
    """Arrays that are no tree: compiled loops would read beyond them, or never end."""
    child = arrays["child"]
    plane = arrays["plane"]
    inner = int(np.flatnonzero(plane >= 0)[-1])

    def changed(field, index, value):
        array = arrays[field].copy()
        array[index] = value
        return {field: array}

    yield {"child": np.full_like(child, 2_000_000_000)}
    yield {"child": np.full_like(child, -2_000_000_000)}
    yield {"child": np.zeros_like(child)}
    yield changed("child", (inner, 0), inner)
    yield changed("child", (inner, 0), child[inner, 1])
    yield changed("child", (inner, 0), -1)
    yield changed("plane", inner, len(arrays["planes"]))
    yield changed("plane", inner, -2)
    yield {field: array[:0] for field, array in arrays.items()}
    for field in arrays:
        yield {field: arrays[field][:-1]}
    yield {"planes": arrays["planes"][:, :3]}


def test_what_is_no_tree_is_computed_again_whatever_its_digest_says(block, tmp_path):
    kept = KeptRegions(tmp_path)
    first = compute_regions(block, EDGES, BOX, kept=kept)
    name = next(iter(EDGES))
    path = kept._path(name)
    stored = dict(np.load(path))
    del stored["digest"]
    for change in trees(stored):
        wrong = {**stored, **change}
        np.savez(path, **wrong, digest=np.array(kept._digest(name, wrong)))
        assert kept.get(name) is None, {field: array.shape for field, array in change.items()}
    np.savez(path, **stored, digest=np.array(kept._digest(name, stored)))
    assert kept.get(name) is not None
    assert same(compute_regions(block, EDGES, BOX, kept=kept), first)


def test_a_changed_region_is_computed_again(block, tmp_path):
    """All of a region's arrays are in its digest, and another entity's region is not its own."""
    kept = KeptRegions(tmp_path)
    first = compute_regions(block, EDGES, BOX, kept=kept)
    name, other, *_ = EDGES
    path = kept._path(name)
    stored = dict(np.load(path))
    np.savez(path, **{**stored, "observable": ~stored["observable"]})
    assert kept.get(name) is None
    path.write_bytes(kept._path(other).read_bytes())
    assert kept.get(name) is None
    assert same(compute_regions(block, EDGES, BOX, kept=kept), first)


def test_mutated_files_raise_nothing(block, tmp_path):
    """Whatever byte of a file is another one, its region is the same, or is computed again."""
    kept = KeptRegions(tmp_path)
    compute_regions(block, EDGES, BOX, kept=kept)
    name = next(iter(EDGES))
    path = kept._path(name)
    whole = path.read_bytes()
    true = arrays(kept.get(name))
    rng = np.random.default_rng(1)
    for _ in range(400):
        content = bytearray(whole)
        for k in rng.integers(len(content), size=rng.integers(1, 4)):
            content[k] = rng.integers(256)
        path.write_bytes(content)
        region = kept.get(name)
        assert region is None or all(map(np.array_equal, arrays(region), true))

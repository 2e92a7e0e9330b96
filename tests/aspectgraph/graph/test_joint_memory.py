"""Memory of a joint graph: refused with an estimate before the work or while it grows, never a bare MemoryError."""

import itertools
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

from aspectgraph import (
    AspectGraphError,
    JointForecast,
    MemoryLimitError,
    Solid,
    build_aspect_graph,
    compute_regions,
    estimate_graph,
    graph_of,
    read_solid,
)
from aspectgraph.cells import arrays
from aspectgraph.cells.arrays import RoomFullError
from aspectgraph.graph import aspect_graph
from aspectgraph.graph import aspect_graph as joint_memory
from aspectgraph.graph.build_graph import ERROR, estimate_joint_graph
from aspectgraph.visibility import visibility_regions

PART = "examples/two_pocket_block.off"
_MIB = 2**20


@pytest.fixture(scope="module")
def regions():
    solid = read_solid(PART)
    return compute_regions(solid, {f"e{edge.id}": edge.id for edge in solid.straight_edges()[:12]})


def test_a_graph_that_fits_is_the_same_with_and_without_a_limit(regions):
    told = []
    free = graph_of(regions)
    limited = graph_of(
        regions, memory_limit_bytes=1e12, progress=lambda *values: told.append(values)
    )
    assert list(limited.graph.nodes(data="observable")) == list(free.graph.nodes(data="observable"))
    joined = [(done, 12, "joint graph") for done in range(1, 13)]
    assert told == [*joined, *((done, 3, "domains of the graph") for done in range(1, 4))]


def test_a_graph_far_too_large_is_refused_before_the_work(regions, monkeypatch):
    monkeypatch.setattr(aspect_graph, "overlay", lambda *_, **__: pytest.fail("the work has begun"))
    with pytest.raises(
        MemoryLimitError,
        match=r"12 entities must fit memory_limit_bytes.*estimated.*fewer entities",
    ):
        graph_of(regions, memory_limit_bytes=1000)


def test_a_graph_that_grows_beyond_the_limit_ends_on_the_way(regions, monkeypatch):
    within = estimate_joint_graph(list(regions._regions.values())).memory_bytes / ERROR
    monkeypatch.setattr("aspectgraph.graph.build_graph._OF_OVERLAY", 1e6)
    with pytest.raises(MemoryLimitError, match=r"about .* GiB after \d+ of 12 entities"):
        graph_of(regions, memory_limit_bytes=2 * within)


def test_running_out_of_memory_is_an_error_of_the_package(regions, monkeypatch):
    def exhausted(*_, **__):
        raise MemoryError("Unable to allocate 7 GiB")

    monkeypatch.setattr(aspect_graph, "carve", exhausted)
    with pytest.raises(
        AspectGraphError,
        match=r"12 entities cannot be built: .* no memory .*Unable to allocate 7 GiB\).*fewer entities",
    ):
        graph_of(regions)


def prism(n_sides):
    """A regular prism: an edge of its top has a region of a few cells, but the part has many facets."""
    turns = np.arange(n_sides) * (2 * np.pi / n_sides)
    ring = np.column_stack([50.0 * np.cos(turns), 50.0 * np.sin(turns)])
    vertices = np.vstack([np.column_stack([ring, np.full(n_sides, z)]) for z in (0.0, 20.0)])
    bottom = tuple(range(n_sides - 1, -1, -1))
    top = tuple(range(n_sides, 2 * n_sides))
    sides = [
        (k, (k + 1) % n_sides, n_sides + (k + 1) % n_sides, n_sides + k) for k in range(n_sides)
    ]
    return Solid(vertices, [bottom, top, *sides])


def test_the_graph_of_one_edge_of_a_part_with_many_facets(monkeypatch):
    """Room for the cells of one region does not hold the facets of the part: more room is made, and no memory lacks."""
    monkeypatch.setattr(import_module("aspectgraph.visibility.entity_region"), "_ROOM", 64)
    monkeypatch.setattr(aspect_graph, "_ROOM_PER_CELL", 0)
    solid = prism(240)
    edge = next(edge for edge in solid.straight_edges() if set(edge.vertices) <= {240, 241})
    found = graph_of(compute_regions(solid, {"top": edge.id}))
    # seen from in front of the top or of the side; the rest is one domain, too
    assert sorted(found.graph.nodes(data="observable")) == [(0, ("top",)), (1, ())]
    box = np.prod(np.ptp(found.workspace, axis=0))
    area = 0.5 * 240 * 50.0**2 * np.sin(2 * np.pi / 240)
    volumes = [volume for _, volume in found.graph.nodes(data="volume")]
    assert sum(volumes) == pytest.approx(box - 20.0 * area)


def test_too_many_cells_are_not_told_as_no_memory(regions, monkeypatch):
    def full(*_):
        raise RoomFullError

    monkeypatch.setattr(aspect_graph, "carve", full)
    with pytest.raises(MemoryLimitError) as error:
        graph_of(regions)
    assert str(error.value).startswith(
        "the joint graph of 12 entities cannot be built: the cell complex must have at most 16777216 cells. "
        "Got more. Ask for fewer entities"
    )


def test_covering_cells_make_room_for_the_workspace(regions, monkeypatch):
    """The workspace is cut out after the regions are joined, in room of its own."""
    names = regions.entity_names[:2]
    free = regions.subset(names).covering_cells(names)
    calls = []

    def cut_further(cx, cut, n_cells=1024):
        calls.append(n_cells)
        return arrays.cut_further(cx, cut, 1)

    monkeypatch.setattr(visibility_regions, "cut_further", cut_further)
    narrow = regions.subset(names).covering_cells(names)
    assert calls
    assert [cell.volume for cell in narrow] == [cell.volume for cell in free]


def test_covering_cells_come_out_of_the_least_room_that_suffices(regions, monkeypatch):
    """What is asked of the cells after the last cut takes no more room than the cut was given."""

    def one_more(build, n_cells=1024, limit=1 << 24):
        for room in range(1, limit):
            try:
                return build(room)
            except RoomFullError:
                continue
        raise AssertionError

    for names in itertools.combinations(regions.entity_names[:6], 2):
        free = regions.subset(names).covering_cells(names)
        with monkeypatch.context() as patch:
            patch.setattr(arrays, "with_room", one_more)
            narrow = regions.subset(names).covering_cells(names)
        assert [cell.volume for cell in narrow] == [cell.volume for cell in free]


@pytest.mark.parametrize("limit", [0, -1.0, np.nan])
def test_a_limit_must_be_positive(regions, limit):
    with pytest.raises(MemoryLimitError, match="memory_limit_bytes must be a positive number"):
        graph_of(regions, memory_limit_bytes=limit)


def test_building_takes_a_limit(regions):
    with pytest.raises(MemoryLimitError, match="joint graph of 2 entities"):
        build_aspect_graph(
            regions.solid, dict(list(regions.entities.items())[:2]), memory_limit_bytes=1
        )


def test_regions_of_a_graph_that_cannot_fit_are_not_all_computed(regions):
    told = []

    def progress(done, *_):
        told.append(done)

    with pytest.raises(
        MemoryLimitError, match=r"12 entities must fit .*estimated from the first 10 regions"
    ):
        compute_regions(
            regions.solid, regions.entities, progress=progress, kept=JointForecast(1000)
        )
    assert told[-1] < 12


def test_regions_of_a_graph_that_may_fit_are_computed(regions):
    """The first regions may be the largest ones: only a graph that is far too large is refused by them."""
    about = estimate_graph(regions).memory_bytes
    assert compute_regions(
        regions.solid, regions.entities, kept=JointForecast(about / ERROR)
    ).entities


def test_the_estimate_of_some_entities_is_that_of_their_regions(regions):
    names = regions.entity_names[:3]
    assert estimate_graph(regions, names) == estimate_joint_graph(
        [regions._regions[name] for name in names]
    )


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel tells of limits in its own way")
def test_what_a_process_may_take_counts_as_free():
    """``ulimit -v`` of the shell: the machine may have more."""
    script = (
        "import resource; from aspectgraph.graph.aspect_graph import free_bytes; "
        "resource.setrlimit(resource.RLIMIT_AS, (2**45, resource.RLIM_INFINITY)); wide = free_bytes(); "
        "taken = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize(); "
        "resource.setrlimit(resource.RLIMIT_AS, (taken + 10**8, resource.RLIM_INFINITY)); print(wide, free_bytes())"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    wide, narrow = map(float, run.stdout.split())
    assert 0.5e8 < narrow <= 1.01e8 < wide


def test_what_a_container_may_take_counts_as_free(tmp_path, monkeypatch):
    monkeypatch.setattr(joint_memory, "_GROUP", tmp_path)
    wide = joint_memory.free_bytes()
    (tmp_path / "memory.max").write_text("5000000\n")
    (tmp_path / "memory.current").write_text("4000000\n")
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 2000000\n")
    assert joint_memory.free_bytes() == 3_000_000 < wide
    (tmp_path / "memory.max").write_text("max\n")
    assert joint_memory.free_bytes() > 3_000_000

"""Queries on regions and graphs: what each promises, and bad input."""

import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import solids

from aspectgraph import (
    ContradictionError,
    EntityError,
    WorkspaceError,
    build_aspect_graph,
    compute_light,
    compute_regions,
    graph_of,
    read_solid,
)
from aspectgraph.cells.arrays import allocate
from aspectgraph.graph.build_graph import confirm
from aspectgraph.visibility import scene as clock
from aspectgraph.visibility.visibility_regions import _COVERINGS_KEPT, KeptRegions

WORKSPACE = ((-60, -60, -60), (60, 60, 60))


@pytest.fixture(scope="module")
def slot():
    return build_aspect_graph(solids.slotted_block(), solids.SLOT_ENTITIES, WORKSPACE)


@pytest.fixture(scope="module")
def viewpoints():
    rng = np.random.default_rng(0)
    return np.concatenate(
        [rng.uniform(-60, 60, (2000, 3)), rng.uniform([-3, -3, -3], [13, 6, 9], (2000, 3))]
    )


def inside_slotted_block(points):
    """Point in profile by hand: the block's columns of equal height."""
    x, y, z = points.T
    top = np.select([(x > 8) | (x < 2), (x > 4) & (x < 6)], [1.0, 2.0], 3.0)
    return (x > 0) & (x < 10) & (y > 0) & (y < top) & (z > 0) & (z < 6)


@pytest.mark.parametrize("n", [-1, 2.5, "3", True])
def test_a_number_of_viewpoints_that_cannot_be(slot, n):
    message = f"n must be an integer of at least 0. Got {n!r}."
    for draw in (lambda: slot.sample([], n), lambda: slot.cells(0).sample(n)):
        with pytest.raises(WorkspaceError) as refused:
            draw()
        assert str(refused.value) == message
    assert slot.sample([], 0).shape == (0, 3)


def test_one_viewpoint_is_one_row_and_other_shapes_are_refused(slot):
    point = [5.0, 50.0, 3.0]
    assert slot.domain_of(point).tolist() == slot.domain_of([point]).tolist()
    for points in ([1.0, 2.0], [[1.0, 2.0]] * 3, [[point, point]], 3.0):
        shape = re.escape(str(np.shape(points)))
        for call in (slot.domain_of, slot.observable):
            with pytest.raises(WorkspaceError, match=rf"shape \(n, 3\)\. Got {shape}"):
                call(points)


@pytest.mark.uncompiled
def test_domain_of_agrees_with_observable(slot, viewpoints):
    nodes = slot.domain_of(viewpoints)
    lists = np.array(
        [
            [name in listed for name in slot.entity_names]
            for _, listed in slot.graph.nodes(data="observable")
        ]
    )
    outside = nodes >= 0
    assert (lists[nodes[outside]] == slot.observable(viewpoints[outside])).all()
    assert (outside == ~inside_slotted_block(viewpoints)).all()


@pytest.mark.uncompiled
def test_nothing_is_observable_from_inside_the_solid(slot, viewpoints):
    inside = inside_slotted_block(viewpoints)
    assert inside.sum() > 100
    assert not slot.observable(viewpoints[inside]).any()


@pytest.mark.uncompiled
def test_domain_of_is_minus_one_outside_the_workspace(slot):
    assert slot.domain_of([[0, 0, 61], [0, 50, 0]]).tolist()[0] == -1


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([0, 0], "points must have the shape (n, 3). Got (2,)."),
        # six numbers, which are no two points
        ([[1, 2], [3, 4], [5, 6]], "points must have the shape (n, 3). Got (3, 2)."),
        (5, "points must have the shape (n, 3). Got ()."),
        ("here", "points must be an array of numbers. Got 'here'."),
    ],
)
def test_points_of_another_shape_are_refused(slot, points, message):
    cells = slot.covering_cells(["e1"])
    for call in (slot.observable, slot.domain_of, slot.regions.observable, cells.contains):
        with pytest.raises(WorkspaceError) as caught:
            call(points)
        assert str(caught.value) == message
        assert len(call([])) == 0
        assert len(call([20, 1, 3])) == 1


@pytest.mark.parametrize("node", [-1, 10**6, "0", 1.5, None, True])
def test_cells_of_no_domain_are_refused(slot, node):
    with pytest.raises(EntityError, match=r"^node must be a domain of the graph, 0 to \d+\. Got "):
        slot.cells(node)


@pytest.mark.uncompiled
def test_on_a_partition_surface_the_observing_side_counts(slot):
    # e3 at (8, 1) lies between the floor y = 1 and the wall x = 8; e1 and e2 lie in the floor of the slot, y = 2
    assert slot.observable([[20, 1, 3]], ["e3"]).all()
    assert slot.observable([[8, 20, 3]], ["e3"]).all()
    assert not slot.observable([[20, 1 - 1e-6, 3]], ["e3"]).any()


@pytest.mark.uncompiled
def test_sample_stays_in_covering_domains_and_fills_them(slot):
    points = slot.sample(["e2"], 4000, rng=1)
    covering = slot.covering(["e2"])
    nodes = slot.domain_of(points)
    assert set(nodes) <= set(covering)
    volumes = np.array([slot.graph.nodes[node]["volume"] for node in covering])
    counts = np.array([(nodes == node).sum() for node in covering])
    expected = 4000 * volumes / volumes.sum()
    assert (np.abs(counts - expected) <= 5 * np.sqrt(expected) + 1).all()


def test_sample_is_uniform_within_a_cell(slot):
    """Mean and covariance of samples against the moments of the cell's tetrahedra, by a second decomposition."""
    cells = slot.covering_cells(["e1", "e2"])
    points = cells.sample(20000, rng=3)
    grid = np.random.default_rng(5).uniform(*cells.bounds, size=(200000, 3))
    expected = grid[cells.contains(grid)]
    spread = expected.std(axis=0)
    assert (np.abs(points.mean(axis=0) - expected.mean(axis=0)) < 0.05 * spread).all()
    assert points.std(axis=0) == pytest.approx(spread, rel=0.05)


@pytest.mark.uncompiled
def test_covering_cells_hold_exactly_the_covering_viewpoints(slot, viewpoints):
    for names in (["e1"], ["e1", "e2"], ["e2", "e3"], ["e1", "e3"]):
        cells = slot.covering_cells(names)
        assert (cells.contains(viewpoints) == slot.observable(viewpoints, names).all(axis=1)).all()
        covering = [slot.graph.nodes[node]["volume"] for node in slot.covering(names)]
        assert cells.volume == pytest.approx(sum(covering), rel=1e-9)


def test_coverings_do_not_pile_up():
    """Every set of entities asked for has a covering of its own; only the last few stay."""
    regions = compute_regions(solids.two_pocket_block(), solids.TWO_POCKET_ENTITIES, WORKSPACE)
    names = regions.entity_names
    sets = [
        [name for k, name in enumerate(names) if bits >> k & 1]
        for bits in range(1, 2 ** len(names))
    ]
    first = regions.covering_cells(sets[0])
    assert regions.covering_cells(sets[0]) is first
    for one in sets:
        regions.covering_cells(one)
    assert len(regions._covering) == _COVERINGS_KEPT < len(sets)
    assert regions.covering_cells(sets[0]) is not first
    assert regions.covering_cells(sets[0]).volume == first.volume


@pytest.mark.uncompiled
def test_cells_are_polytopes_whose_half_spaces_hold_their_vertices(slot):
    for node in slot.graph:
        cells = slot.cells(node)
        assert cells.volume == pytest.approx(slot.graph.nodes[node]["volume"])
        for cell in list(cells)[:5]:
            heights = cell.vertices @ cell.half_spaces[:, :3].T + cell.half_spaces[:, 3]
            assert heights.max() <= 1e-9
            assert (heights >= -1e-9).sum(axis=0).min() >= 3


def test_viewpoints_of_nodes_have_their_clearance(slot):
    for node, data in slot.graph.nodes(data=True):
        around = np.random.default_rng(node).normal(size=(200, 3))
        around *= 0.999 * data["clearance"] / np.linalg.norm(around, axis=1, keepdims=True)
        assert set(slot.domain_of(data["viewpoint"] + around)) == {node}
        assert data["confirmed"]
        assert data["n_rays"] == 32 * 4


@pytest.mark.uncompiled
def test_surfaces_pass_through_their_entity_and_separate_the_lists(slot):
    for one, other, data in slot.graph.edges(data=True):
        changed = set(slot.graph.nodes[one]["observable"]) ^ set(
            slot.graph.nodes[other]["observable"]
        )
        assert changed == {surface.entity for surface in data["surfaces"]}
        for surface in data["surfaces"]:
            ends = slot.entities[surface.entity].endpoints
            heights = ends @ np.array(surface.plane[:3]) - surface.plane[3]
            # type A and planes through the entity hold both ends, planes through an end hold one
            assert np.abs(heights).min() < 1e-9
            if surface.type == "A":
                assert np.abs(heights).max() < 1e-9
                assert set(surface.faces) & set(
                    slot.solid.edges[slot.entities[surface.entity].edge_ids[0]].faces
                )


@pytest.mark.uncompiled
def test_subset_needs_no_new_regions(slot):
    direct = build_aspect_graph(
        slot.solid, {name: solids.SLOT_ENTITIES[name] for name in ("e3", "e1")}, WORKSPACE
    ).graph
    assert graph_of(slot.regions, ["e3", "e1"]).graph.nodes == direct.nodes
    assert graph_of(slot.regions, ["e3", "e1"]).graph.edges == direct.edges


@pytest.mark.parametrize("make", [lambda: ProcessPoolExecutor(2), lambda: ThreadPoolExecutor(2)])
def test_executor_changes_nothing(slot, make):
    with make() as executor:
        other = build_aspect_graph(slot.solid, solids.SLOT_ENTITIES, WORKSPACE, executor)
    assert_same(other, slot)


def test_dask_cluster_changes_nothing(slot):
    distributed = pytest.importorskip("distributed")
    with distributed.Client(n_workers=1, threads_per_worker=1, dashboard_address=":0") as client:
        other = build_aspect_graph(
            slot.solid, solids.SLOT_ENTITIES, WORKSPACE, client.get_executor()
        )
    assert_same(other, slot)


def assert_same(one, other):
    """Everything the graphs hold agrees to the last bit."""
    assert dict(one.graph.nodes(data=True)) == dict(other.graph.nodes(data=True))
    assert list(one.graph.edges(data=True)) == list(other.graph.edges(data=True))


def test_progress_counts_entities():
    seen = []
    compute_regions(
        solids.cube(),
        range(5),
        progress=lambda done, total, label: seen.append((done, total, label)),
    )
    assert seen == [(k + 1, 5, f"e{k}") for k in range(5)]


@pytest.mark.uncompiled
def test_a_wrong_list_is_a_contradiction(slot):
    observable = np.array([[True, True, False, True]])
    with pytest.raises(ContradictionError, match=r"domain 0 must list .* Its list holds 'e4'"):
        confirm(slot.regions, np.array([[5.0, 50, 3]]), observable)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda eag: eag.observable([[0, 0, 100]]),
            WorkspaceError,
            r"points must lie in the workspace .* 100.0",
        ),
        (
            lambda eag: eag.observable([[0, np.nan, 0]]),
            WorkspaceError,
            "points must lie in the workspace .* nan",
        ),
        (
            lambda eag: eag.observable([[0, 0, 9]], ["e9"]),
            EntityError,
            "names must be names of entities.* Got 'e9'",
        ),
        (lambda eag: eag.covering(["x"]), EntityError, "Got 'x'"),
        (lambda eag: eag.covering_cells([]), EntityError, "names must hold at least one entity"),
        (
            lambda eag: eag.sample(["e1", "e3"], 5),
            EntityError,
            "observable together from somewhere. Got e1, e3",
        ),
    ],
)
def test_bad_queries(slot, call, error, message):
    with pytest.raises(error, match=message):
        call(slot)


@pytest.mark.parametrize(
    ("workspace", "message"),
    [
        (((0, 0, 0), (1, 1, 1), (2, 2, 2)), r"must have shape \(2, 3\).* Got shape \(3, 3\)"),
        (((0, 0, 0), (np.inf, 1, 1)), "must be finite"),
        (((5, 5, 5), (-5, -5, -5)), "lower corner first"),
        (((-5, -5, 1), (50, 50, 50)), "must contain the part"),
    ],
)
def test_bad_workspaces(workspace, message):
    with pytest.raises(WorkspaceError, match=message):
        compute_regions(solids.slotted_block(), solids.SLOT_ENTITIES, workspace)


@pytest.mark.uncompiled
def test_disjoint_solids_hide_each_other():
    edge = {"e": ((2, 0, 0), (2, 0, 2))}
    seen = []
    for solid in (solids.cube(2.0), solids.two_boxes(gap=1.0)):
        nodes = build_aspect_graph(solid, edge, WORKSPACE).graph.nodes.values()
        seen.append(sum(node["volume"] for node in nodes if node["observable"]))
    assert 0.5 * seen[0] < seen[1] < 0.99 * seen[0]


def test_cells_of_one_entity_are_where_it_is_observable_on_a_displaced_part():
    pytest.importorskip("OCP")
    solid = read_solid(Path(__file__).parents[3] / "examples" / "nist_ctc_01_ap242.stp")
    low, high = workspace = solid.bounds + np.array([[-1500.0], [1500.0]])
    space = compute_regions(solid, [1093], workspace)
    names = space.entity_names
    rng = np.random.default_rng(0)
    cells = space.covering_cells(names)
    # next to a wall that is parallel to another one only up to how vertices are displaced, then next to all walls
    viewpoints = [np.array([[50.09937933485045, 28.924702377390805, 4.303609978555029]])]
    for cell in cells:
        inside = rng.dirichlet(np.ones(len(cell.vertices)), 5) @ cell.vertices
        for wall in np.asarray(cell.half_spaces):
            normal = wall[:3] / np.linalg.norm(wall[:3])
            foot = inside - np.outer(
                (inside @ wall[:3] + wall[3]) / np.linalg.norm(wall[:3]), normal
            )
            viewpoints += [foot - 1e-5 * normal, foot + 1e-5 * normal]
    viewpoints = np.concatenate(viewpoints)
    viewpoints = viewpoints[((low < viewpoints) & (viewpoints < high)).all(axis=1)]
    assert (cells.contains(viewpoints) == space.observable(viewpoints, names)[:, 0]).all()
    assert space.observable(viewpoints[:1], names).all()


# Visible regions that an interrupted computation has left: used again, and never for anything
# else.


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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_regions_of_other_code_are_not_taken(block, tmp_path, monkeypatch):
    kept = KeptRegions(tmp_path)
    compute_regions(block, EDGES, BOX, kept=kept)
    monkeypatch.setattr(
        "aspectgraph.visibility.visibility_regions.code_digest", lambda names: "other"
    )
    monkeypatch.setattr("aspectgraph.visibility.visibility_regions.observable_region", refuse)
    with pytest.raises(RuntimeError, match="computed again"):
        compute_regions(block, EDGES, BOX, kept=kept)


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_a_region_does_not_depend_on_what_its_memory_held_before(block, monkeypatch):
    def held(value):
        def allocated(*arguments):
            cx = allocate(*arguments)
            cx.cell[:] = cx.face[:] = cx.edge[:] = cx.vertex[:] = value
            return cx

        monkeypatch.setattr("aspectgraph.visibility.entity_region.allocate", allocated)
        return compute_regions(block, EDGES, BOX)

    assert same(held(7), held(8))


@pytest.mark.uncompiled
def test_other_arrays_are_no_region(block, tmp_path):
    kept = KeptRegions(tmp_path)
    compute_regions(block, EDGES, BOX, kept=kept)
    for path in tmp_path.iterdir():
        data = dict(np.load(path))
        np.savez(path, **{**data, "plane": data["plane"].astype(np.float64)})
    assert all(kept.get(name) is None for name in EDGES)


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


# Regions that are not complete by a deadline are left out; the others are what they are without
# one.


@pytest.fixture
def passing_time(monkeypatch):
    """A clock that goes on by a second with every look."""
    seconds = iter(range(10_000))
    monkeypatch.setattr(clock.time, "time", lambda: float(next(seconds)))


@pytest.mark.uncompiled
@pytest.mark.parametrize("compute", [compute_regions, compute_light])
def test_after_the_deadline_nothing_is_computed(block, compute):
    regions = compute(block, EDGES, workspace=BOX, deadline=0.0)
    assert regions.entity_names == ()
    assert regions.observable([[0, 0, 100]]).shape == (1, 0)


@pytest.mark.uncompiled
def test_what_is_complete_by_the_deadline_is_kept(block, passing_time):
    """The first edge takes two looks at the clock: before its chord, and before its sets."""
    regions = compute_regions(block, EDGES, BOX, deadline=1.0)
    assert regions.entity_names == ("e1",)
    points = np.random.default_rng(1).uniform(*BOX, (500, 3))
    whole = compute_regions(block, EDGES, BOX)
    assert np.array_equal(regions.observable(points)[:, 0], whole.observable(points)[:, 0])


@pytest.mark.uncompiled
def test_a_region_is_ended_between_its_sets(block, monkeypatch):
    """With one set between two looks, the end comes within the first region, and cells do not depend on it."""
    whole = compute_regions(block, EDGES, BOX)
    monkeypatch.setattr("aspectgraph.visibility.entity_region._SETS_AT_A_TIME", 1)
    same = compute_regions(block, EDGES, BOX)
    for name in EDGES:
        for ours, theirs in zip(same._regions[name].tree, whole._regions[name].tree, strict=True):
            assert np.array_equal(ours, theirs)
    seconds = iter(range(10_000))
    monkeypatch.setattr(clock.time, "time", lambda: float(next(seconds)))
    assert compute_regions(block, EDGES, BOX, deadline=2.0).entity_names == ()

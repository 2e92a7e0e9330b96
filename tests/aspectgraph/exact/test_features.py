"""Details near the grid's step: answered right, or refused; never answered wrong."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from engine_pairs import sharp_edges, solid_of, uniform_viewpoints, workspace_of
from exact_checker import ExactChecker
from fine_parts import THIN, TINY, fine_part
from scipy.spatial.transform import Rotation
from solids import FaceBuilder, add_prism, prism

from aspectgraph.exact.canonical import EDGE_EDGE, LEAST_STEPS, VERTEX_FACE, nearest_features
from aspectgraph.exact.grid import GRID_BITS, POINT_BITS
from aspectgraph.exceptions import ResolutionError, SolidError
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.scene import make_scene
from aspectgraph.visibility.visibility_regions import compute_regions

SHARES = (1e-9, 1e-7, 1e-6, 3e-6, 6e-6, 1e-5, 2e-5, 5e-5, 3e-4)
N_POINTS = 60
N_EDGES = 12


class Outcome(NamedTuple):
    """Whether a part was refused; else how many answers differ from the referee's on given and on snapped vertices."""

    refused: bool
    n: int = 0
    wrong_as_given: int = 0
    wrong_as_snapped: int = 0


def outcome(kind: str, share: float, seed: int, turned: bool) -> Outcome:
    part = fine_part(kind, share, seed, turned)
    rng = np.random.default_rng([seed, 7])
    referee = ExactChecker(part.vertices, part.faces)
    pairs = [
        sharp_edges(part, referee)[i]
        for i in rng.permutation(len(sharp_edges(part, referee)))[:N_EDGES]
    ]
    workspace = workspace_of(part)
    points = uniform_viewpoints(rng, workspace, N_POINTS, 1)
    points = points[referee.generic(points)]
    try:
        solid = solid_of(part)
        number = {tuple(sorted(edge.vertices)): edge.id for edge in solid.edges}
        regions = compute_regions(
            solid, {f"e{i}": number[pair] for i, pair in enumerate(pairs)}, workspace
        )
    except SolidError:
        return Outcome(True)
    engine = regions.observable(points)
    snapped = ExactChecker(regions.grid.points, part.faces)
    # the engine's viewpoints on the grid of the part, so that both programs get the same numbers
    whole = np.rint(regions.grid.to_points(points) / 2.0**POINT_BITS).astype(np.int64)
    on_grid = regions.grid.to_mm(whole)
    inside = ((on_grid >= workspace[0]) & (on_grid <= workspace[1])).all(axis=1) & snapped.generic(
        whole
    )
    as_snapped = regions.observable(on_grid[inside]) != snapped.observable(whole[inside], pairs)
    return Outcome(
        False,
        engine.size,
        int((engine != referee.observable(points, pairs)).sum()),
        int(as_snapped.sum()),
    )


@pytest.mark.parametrize("turned", [False, True], ids=["straight", "turned"])
@pytest.mark.parametrize("kind", THIN)
def test_thin_details_are_right_or_refused(kind, turned):
    outcomes = {share: outcome(kind, share, 1, turned) for share in SHARES}
    assert [
        share
        for share, result in outcomes.items()
        if result.wrong_as_given or result.wrong_as_snapped
    ] == []
    assert not any(result.refused for share, result in outcomes.items() if share >= 5e-5)
    if kind not in ("stack", "plate", "wedge"):  # thin sides have a finer grid
        assert all(result.refused for share, result in outcomes.items() if share <= 3e-6)


@pytest.mark.parametrize("turned", [False, True], ids=["straight", "turned"])
@pytest.mark.parametrize("kind", TINY)
def test_tiny_details_are_right_for_the_snapped_part_or_refused(kind, turned):
    """Snapping changes the proportions of a detail of k steps by up to 2/k, so answers are those for such a detail."""
    outcomes = {share: outcome(kind, share, 1, turned) for share in SHARES}
    assert [share for share, result in outcomes.items() if result.wrong_as_snapped] == []
    assert sum(result.wrong_as_given for result in outcomes.values()) <= 1e-3 * sum(
        r.n for r in outcomes.values()
    )
    assert all(result.refused for share, result in outcomes.items() if share <= 3e-6)
    assert not any(result.refused for share, result in outcomes.items() if share >= 5e-5)


@pytest.mark.parametrize("gap", [1e-7, 1e-6, 1e-5])
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_mating_boxes_are_refused_with_place_distance_and_step(gap, seed):
    boxes = _two_boxes(gap, seed)
    with pytest.raises(ResolutionError) as raised:
        compute_regions(boxes, [0])
    text = str(raised.value)
    assert text.startswith(f"parts of the surface must be at least {LEAST_STEPS:g} grid steps of ")
    assert f"Got {gap:.3g} mm between vertex (" in text or f"Got {gap:.3g} mm between edge" in text
    assert f"{20 * (1 + gap / 20) / 2**GRID_BITS:.3g}" in text
    assert text.endswith("merge the solids in the CAD model, leave one out, or widen the gap.")


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_a_gap_in_round_numbers_is_no_detail_too_small(seed):
    """10 µm between boxes of 10 mm: a grid of 10⁻⁵ mm displaces nothing, so nothing is too near."""
    regions = compute_regions(_two_boxes(1e-5, seed, size=5.0), [0])
    assert regions.grid.resolution == 0.0


def test_a_small_detail_of_one_solid_is_named():
    part = fine_part("step", 1e-6, 0, False)
    with pytest.raises(
        ResolutionError,
        match=r"between edge .* and edge .*; leave the detail out, or make it larger",
    ):
        make_scene(solid_of(part))


def test_plates_get_a_finer_grid_across():
    """A gap of 2 to 4·10⁻⁶ is 12 steps at most of the usual grid; the side across is a hundredth of the long one."""
    grid, _ = make_scene(solid_of(fine_part("stack", 2e-6, 3, False)))
    assert grid.scale.min() < 0.05
    assert np.ptp(grid.points, axis=0).tolist() == [1 << GRID_BITS] * 3


def test_nearest_features_by_hand():
    """The shortest edge of a box of 10 x 20 x 30; nothing else is as near."""
    one = prism([(0, 0), (10, 0), (10, 20), (0, 20)], 30)
    assert nearest_features(one, one.vertices, within=10.5).steps == 10.0
    assert nearest_features(one, one.vertices, within=10.0).n == 0


@pytest.mark.parametrize(
    ("shift", "kind"),
    [
        ((10.5, 2, 3), VERTEX_FACE),  # a corner over the inside of a face
        ((10.3, 2, 30.4), EDGE_EDGE),  # edges side by side
        ((10.3, 20.4, 3), EDGE_EDGE),
    ],
)
def test_nearest_features_of_two_boxes_by_hand(shift, kind):
    """Boxes of 10 x 20 x 30 and 5 x 6 x 7, half a unit apart."""
    builder = FaceBuilder()
    add_prism(builder, [(0, 0), (10, 0), (10, 20), (0, 20)], 30)
    x, y, z = shift
    add_prism(builder, [(x, y), (x + 5, y), (x + 5, y + 6), (x, y + 6)], 7, base=z)
    solid = builder.solid("two boxes")
    nearest = nearest_features(solid, solid.vertices, within=1.0)
    assert nearest.steps == pytest.approx(0.5)
    assert nearest.kind == kind


def _two_boxes(gap: float, seed: int | None, size: float = 10.0) -> Solid:
    turn = np.eye(3) if seed is None else Rotation.random(random_state=seed).as_matrix()
    box = prism([(0, 0), (size, 0), (size, size), (0, size)], size)
    faces = [
        *(face.outer for face in box.faces),
        *(tuple(v + 8 for v in face.outer) for face in box.faces),
    ]
    return Solid(
        np.concatenate([box.vertices, box.vertices + np.array([size + gap, 0, 0])]) @ turn.T, faces
    )

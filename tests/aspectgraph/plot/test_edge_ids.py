"""Pictures name every edge that can be seen, and only those."""

from __future__ import annotations

import builtins

import numpy as np
import pytest
from solids import cube, hollow_box, l_block, plate, prism, ring, two_pocket_block

from aspectgraph import (
    EntityError,
    MissingExtraError,
    OutputError,
    PictureError,
    SolidError,
    edge_figure,
    write_edge_picture,
)
from aspectgraph.plot.picker import (
    VIEWS,
    ParallelView,
    Spot,
    _matched,
    _slots,
    draw_edges,
    view_axes,
)

figure = pytest.importorskip("matplotlib.figure")
FigureCanvasAgg = pytest.importorskip("matplotlib.backends.backend_agg").FigureCanvasAgg


def named(solid, direction, edge_ids=None):
    ax = figure.Figure().subplots()
    draw_edges(solid, edge_ids, direction, ax=ax)
    texts = [text.get_text() for text in ax.texts]
    assert all(text.startswith("e") for text in texts)
    return {int(text[1:]) for text in texts}


def test_a_cube_shows_nine_edges_in_each_view_and_all_in_the_four():
    views = [named(cube(), direction) for direction in VIEWS.values()]
    assert [len(ids) for ids in views] == [9, 9, 9, 9]
    assert set.union(*views) == set(range(12))


def test_the_lower_edges_behind_the_part_are_hidden():
    solid = cube()
    ids = named(solid, (0.3, -0.2, 1))
    for edge in solid.edges:
        x, y, z = solid.edge_points(edge.id).T
        if (z == 2).all():
            assert edge.id in ids
        elif (z == 0).all():
            assert (edge.id in ids) == ((y == 0).all() or (x == 2).all())


def test_the_edges_of_a_closed_void_are_never_named():
    solid = hollow_box()
    inner = {e.id for e in solid.edges if solid.face_shell[e.faces[0]] == 1}
    assert len(inner) == 12
    for direction in VIEWS.values():
        assert not inner & named(solid, direction)


def test_chosen_edges_only():
    assert named(cube(), (1, 1, 1), [0, 1]) <= {0, 1}
    with pytest.raises(EntityError, match=r"edge id must be in 0..11. Got 12"):
        edge_figure(cube(), [12])


def test_view_axes_are_a_right_handed_frame():
    for direction in [*VIEWS.values(), (0, 0, 1), (0, 0, -2), (1, 0, 0)]:
        axes = view_axes(direction)
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert axes[2] == pytest.approx(np.array(direction) / np.linalg.norm(direction))


TWO_LAYERS = np.array(
    [[(0, 0, 1), (4, 0, 1), (0, 4, 1)], [(0, 0, 2), (2, 0, 2), (0, 2, 2)]], dtype=float
)


def test_seen_and_hidden_points():
    points = np.array(
        [(0.5, 0.5, 1), (0.5, 0.5, 2), (1.5, 1.5, 1), (1.5, 1.5, 0), (5, 5, 0)], dtype=float
    )
    assert ParallelView(TWO_LAYERS).is_seen(points).tolist() == [False, True, True, False, True]


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_the_nearest_triangle_is_painted_on_top(order):
    image, (left, right, bottom, top) = ParallelView(TWO_LAYERS[order]).render(
        np.array([0.25, 0.75])[order]
    )

    def at(x, y):
        h, w = image.shape
        return image[int((y - bottom) / (top - bottom) * h), int((x - left) / (right - left) * w)]

    assert (at(0.5, 0.5), at(1.5, 1.5), at(3.5, 3.5)) == (0.75, 0.25, 1.0)


def test_png_and_html(tmp_path):
    png = write_edge_picture(two_pocket_block(), tmp_path / "edges.png")
    assert png.read_bytes().startswith(b"\x89PNG")
    html = write_edge_picture(two_pocket_block(), tmp_path / "edges.html", [3, 5]).read_text(
        encoding="utf-8"
    )
    assert '"edge 3"' in html
    assert '"edge 4"' not in html
    assert sorted(path.name for path in tmp_path.iterdir()) == ["edges.html", "edges.png"]


@pytest.mark.parametrize("name", ["edges.gif", "edges.bmp", "edges", ".png", ""])
def test_other_suffixes_are_refused(tmp_path, name):
    with pytest.raises(PictureError, match=r"^path must end in \.png or \.html\. Got '.*'\.$"):
        write_edge_picture(cube(), tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["png", "html"])
@pytest.mark.parametrize(
    ("folder", "reason"), [("nowhere", "No such file or directory"), ("file", "Not a directory")]
)
def test_a_folder_is_not_made(tmp_path, folder, reason, suffix):
    (tmp_path / "file").touch()
    with pytest.raises(
        OutputError,
        match=rf"^path must be a file that can be written\. Got '.*\.{suffix}': {reason}",
    ):
        write_edge_picture(cube(), tmp_path / folder / f"edges.{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("suffix", ["png", "html"])
def test_a_picture_that_fails_leaves_the_old_one(tmp_path, suffix):
    path = tmp_path / f"edges.{suffix}"
    path.write_text("old")
    with pytest.raises(EntityError):
        write_edge_picture(cube(), path, [99])
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def engraved_plate(n=6):
    """A plate with n × n small square pockets close together: more labels than room beside them."""
    holes = [
        [(x, y), (x, y + 0.5), (x + 0.5, y + 0.5), (x + 0.5, y)]
        for x, y in np.argwhere(np.ones((n, n))).astype(float) - n / 2
    ]
    half = 12
    return prism([(-half, -half), (half, -half), (half, half), (-half, half)], 2, holes)


@pytest.mark.parametrize(
    "solid",
    [cube(), two_pocket_block(), plate(4), engraved_plate()],
    ids=["cube", "two pockets", "plate", "engraved"],
)
def test_no_label_covers_another_and_all_are_inside(solid):
    fig = figure.Figure(figsize=(9, 7), dpi=100)
    FigureCanvasAgg(fig)
    fig.subplots_adjust(left=0, right=1, bottom=0, top=1)
    ax = draw_edges(solid, None, (0.6, -0.8, 0.7), ax=fig.subplots())
    fig.canvas.draw()
    boxes = [text.get_window_extent() for text in ax.texts]
    assert len(boxes) > 6
    frame = fig.bbox
    for n, box in enumerate(boxes):
        assert frame.x0 <= box.x0 < box.x1 <= frame.x1
        assert frame.y0 <= box.y0 < box.y1 <= frame.y1
        assert not any(box.overlaps(other) for other in boxes[:n])


def test_figure_has_one_line_for_each_candidate():
    traces = edge_figure(l_block()).data
    lines = [trace for trace in traces if trace.name.startswith("edge ")]
    assert len(lines) == 18
    assert {line.hovertemplate.split("<br>")[0] for line in lines} == {
        f"edge {i}" for i in range(18)
    }
    (labels,) = [trace for trace in traces if trace.name == "ids"]
    assert labels.text == tuple(f"e{i}" for i in range(18))


def test_without_matplotlib(tmp_path, monkeypatch):
    real = builtins.__import__

    def no_matplotlib(name, *args, **kwargs):
        if name.split(".")[0] == "matplotlib":
            raise ImportError("No module named 'matplotlib'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_matplotlib)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[plot\]'"):
        write_edge_picture(cube(), tmp_path / "edges.png")
    assert not (tmp_path / "edges.png").exists()


def test_rims_are_named_where_they_are_seen():
    """From above, the upper rim of a through hole; both from a slant, where a part of the lower one shows."""
    solid = prism([(-10, -10), (10, -10), (10, 10), (-10, 10)], 5, [ring(4.0, 12, clockwise=True)])
    upper = next(rim.id for rim in solid.rims() if rim.centre[2] == 5)
    ax = figure.Figure().subplots()
    draw_edges(solid, [], (0.6, -0.8, 0.2), ax=ax, curve_ids=["r0", "r1"])
    assert {text.get_text() for text in ax.texts} == {upper}
    assert "rim r0<br>diameter 8 mm" in str(edge_figure(solid).to_dict())
    with pytest.raises(EntityError, match=r"that of a rim or arc, r0, r1\. Got 'r5'"):
        edge_figure(solid, [], ["r5"])


def test_every_small_edge_that_is_seen_has_its_label():
    """From almost straight above, all upper edges of a plate with holes are seen."""
    solid = engraved_plate(5)
    fig = figure.Figure(figsize=(11, 8), dpi=100)
    ax = draw_edges(solid, None, (0.05, -0.04, 1), ax=fig.subplots())
    upper = {f"e{e.id}" for e in solid.edges if (solid.edge_points(e.id)[:, 2] == 2).all()}
    assert len(upper) == 4 + 4 * 25
    assert upper <= {text.get_text() for text in ax.texts}


def crossing(a, b, c, d):
    """Whether the segments ab and cd cross."""
    side = lambda p, q, r: np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))  # noqa: E731
    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def test_leaders_to_the_frame_do_not_cross():
    rng = np.random.default_rng(5)
    spots = [Spot(str(n), "k", rng.uniform(4, 6, (1, 2)) + np.zeros((3, 2))) for n in range(60)]
    slots = _slots(np.zeros(2), np.full(2, 10.0), np.array([0.8, 0.4]), 1)
    found = _matched(spots, list(range(60)), slots)
    assert len({tuple(place) for place in found.values()}) == 60
    leaders = [(spots[n].middle, place) for n, place in found.items()]
    assert not any(crossing(*one, *other) for i, one in enumerate(leaders) for other in leaders[:i])


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda path: edge_figure(3), "Got 3; read_solid reads one from a file."),
        (
            lambda path: write_edge_picture("x.html", cube()),
            "Got 'x.html'; the order of the arguments is solid, path.",
        ),
        (
            lambda path: write_edge_picture(None, path),
            "Got None; read_solid reads one from a file.",
        ),
    ],
)
def test_what_is_no_solid_is_refused(draw, message, tmp_path):
    with pytest.raises(SolidError) as info:
        draw(tmp_path / "edges.html")
    assert str(info.value) == f"solid must be a Solid. {message}"
    assert not list(tmp_path.iterdir())


def test_what_is_no_path_is_refused():
    with pytest.raises(PictureError, match=r"^path must be a path\. Got 3\.$"):
        write_edge_picture(cube(), 3)

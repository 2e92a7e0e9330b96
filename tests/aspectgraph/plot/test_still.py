"""Still pictures of figures: they show what the figure shows, where a page draws no plotly."""

import base64
import copy
import io
import pickle

import numpy as np
import plotly.io as pio
import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from PIL import Image

from aspectgraph import Solid, edge_figure, read_solid
from aspectgraph.plot.still import PNG, SIZE_PX, still_picture
from aspectgraph.solid.solid import PLOTLY
from planner import plan_figure, read_plan

BLUE = (0, 114, 178)


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


@pytest.fixture(scope="module")
def plan():
    return read_plan("examples/two_pocket_block_plan.json")


@pytest.fixture
def mimetype_renderer():
    """As in a kernel of Jupyter."""
    before = pio.renderers.default
    pio.renderers.default = "plotly_mimetype"
    yield
    pio.renderers.default = before


def pixels(figure):
    picture = Image.open(io.BytesIO(base64.b64decode(still_picture(figure))))
    assert picture.size == SIZE_PX
    return np.asarray(picture.convert("RGB")).astype(int)


def shown(values):
    """Return what a cell with these values shows in a notebook."""
    InteractiveShell.instance()
    with capture_output() as captured:
        values._ipython_display_()
    (output,) = captured.outputs
    return output.data


def near(image, color):
    return np.abs(image - color).sum(axis=2) < 60


def test_a_notebook_gets_figure_and_picture(plan, block, mimetype_renderer):
    for figure in (plan_figure(plan, block), block.plot(), edge_figure(block)):
        data = shown(figure)
        assert data.keys() == {PLOTLY, PNG, "text/plain"}
        assert {trace["type"] for trace in data[PLOTLY]["data"]} == {"mesh3d", "scatter3d"}
        assert base64.b64decode(data[PNG]).startswith(b"\x89PNG")


def test_what_the_user_chose_to_draw_figures_with_stays(block, mimetype_renderer):
    pio.renderers.default = "notebook_connected"
    assert PNG not in block.plot()._repr_mimebundle_()
    pio.renderers.default = "plotly_mimetype"
    pio.renderers.render_on_display = False
    with capture_output() as captured:
        block.plot()._ipython_display_()
    pio.renderers.render_on_display = True
    assert captured.outputs == []


def test_figures_are_copied_and_stored(block):
    figure = block.plot()
    for other in (copy.deepcopy(figure), pickle.loads(pickle.dumps(figure))):
        assert still_picture(other) == still_picture(figure)


def test_a_picture_of_a_plan_shows_part_and_camera(plan, block):
    with_part = pixels(plan_figure(plan, block))
    without = pixels(plan_figure(plan))
    # the camera's pyramid is blue and spans most of the height
    rows, _ = np.nonzero(near(without, BLUE))
    assert np.ptp(rows) > 0.6 * SIZE_PX[1]
    # the part hides what is behind it, and is grey
    grey = (np.ptp(with_part, axis=2) < 30) & (with_part.mean(axis=2) < 230)
    assert grey.sum() > 2000
    assert grey.sum() > 5 * ((np.ptp(without, axis=2) < 30) & (without.mean(axis=2) < 230)).sum()


def test_what_is_clicked_in_the_legend_is_not_in_the_picture_at_first(plan, block):
    figure = plan_figure(plan, block)
    before = still_picture(figure)
    figure.add_mesh3d(
        x=[-500, 500, 0], y=[0, 0, 500], z=[0, 0, 500], i=[0], j=[1], k=[2], visible="legendonly"
    )
    assert still_picture(figure) == before


def test_a_view_in_parallel_fits_and_hides_edges_behind():
    """Of a cube seen from a corner nine edges are in front, and their hexagon is in the middle."""
    corners = np.array([[x, y, z] for x in (0, 9) for y in (0, 9) for z in (0, 9)], dtype=float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [face[:3] for face in faces] + [[face[0], *face[2:]] for face in faces]
    figure = Solid(corners, triangles).plot()
    figure.update_scenes(camera={"eye": {"x": 1, "y": 1, "z": 1}})
    image = pixels(figure)
    dark = image.sum(axis=2) < 300
    rows, columns = np.nonzero(image.min(axis=2) < 250)
    assert abs(rows.mean() - SIZE_PX[1] / 2) < 5
    assert abs(columns.mean() - SIZE_PX[0] / 2) < 5
    assert 0.85 < np.ptp(rows) / SIZE_PX[1] < 0.99
    # a regular hexagon on a corner
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(np.sqrt(3) / 2, abs=0.01)
    # from the near corner in the middle edges go down and to both sides above, and not straight up
    middle = SIZE_PX[0] // 2
    below = dark[SIZE_PX[1] // 2 + 20 : rows.max() - 20, middle - 4 : middle + 4].any(axis=1)
    above = dark[rows.min() + 20 : SIZE_PX[1] // 2 - 20, middle - 4 : middle + 4].any(axis=1)
    assert below.mean() > 0.9
    assert above.mean() < 0.1

"""Draw a box of poses and the windows of four edges in it: a section through the camera's axis, y = 0.

The windows are those that `planner.bound.windows.window` computes. Run from the repository's root; writes
``box_of_poses.svg`` and ``box_of_poses.png`` beside this file, always the same bytes with the same matplotlib.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from planner.bound.view import View
from planner.bound.windows import Turn, extent, most_turn, window

STYLE = {"svg.hashsalt": "box of poses", "svg.fonttype": "none", "font.size": 9}

VIEW = View(near=340.0, far=460.0, middle=400.0, tan_x=0.25, tan_y=0.2, radius=150.0)
HALF = np.full(3, 60.0)
TURN = np.full(3, 0.02)
# ends of the edges as (x, z) from the middle point looked at
EDGES = {
    "A": ((-85.0, 5.0), (-40.0, 5.0)),
    "B": ((-25.0, -25.0), (45.0, -25.0)),
    "C": ((50.0, 30.0), (85.0, 0.0)),
    "D": ((98.0, -15.0), (102.0, 25.0)),
}
COLOURS = {"A": "#0072b2", "B": "#d55e00", "C": "#009e73", "D": "#777777"}


def section(ends, turn: np.ndarray) -> np.ndarray:
    """Return the corners (4, 2), as (w_x, w_z), of the window of an edge in a box with turns up to so much."""
    s = np.array([[x, 0.0, z] for x, z in ends])
    n = 1.0
    room = np.empty(3)
    least = np.empty(6)
    v = np.zeros(3)
    t, nu = most_turn(v, turn, n)
    extent(np.eye(3), HALF, t, room)
    window(s, np.full(2, VIEW.far), Turn(v, turn, n, t, nu), VIEW, room, least, 1.0, np.zeros(9))
    z = np.array([least[5], -least[4]])
    left = least[0] + VIEW.tan_x * z
    right = -least[1] - VIEW.tan_x * z
    return np.array([[left[0], z[0]], [right[0], z[0]], [right[1], z[1]], [left[1], z[1]]])


def draw_scene(ax) -> None:
    """Draw the camera, its view, the box of points looked at, and the edges."""
    depth = np.array([VIEW.near, VIEW.far])
    side = VIEW.tan_x * depth
    outline = [[-side[0], depth[0]], [side[0], depth[0]], [side[1], depth[1]], [-side[1], depth[1]]]
    ax.add_patch(
        plt.Polygon(np.array(outline) - [0, VIEW.middle], facecolor="#eeeeee", edgecolor="black")
    )
    eye = [0.0, -VIEW.middle]
    for corner in (-side[1], side[1]):
        ax.plot([0, corner], [eye[1], depth[1] - VIEW.middle], color="black", lw=0.5)
    ax.add_patch(plt.Rectangle(-HALF[:2], *(2 * HALF[:2]), fill=False, ls="--"))
    ax.plot(0, 0, "k+", ms=9)
    ax.plot(*eye, "ko", ms=4)
    ax.annotate(r"$q_0$", (4, 5))
    ax.annotate(r"$c = q - z_0 a$", (10, eye[1]))
    ax.annotate(r"box of $q$", (-58, -54))
    for name, ends in EDGES.items():
        ax.plot(*np.transpose(ends), color=COLOURS[name], lw=2.5)
        x, z = np.mean(ends, axis=0)
        ax.annotate(
            name,
            (x, z + (9 if name != "D" else 25)),
            color=COLOURS[name],
            ha="center",
            weight="bold",
        )
    ax.set(
        xlabel="across, mm",
        ylabel="along the axis, mm",
        title="The middle pose of the box, and its view",
    )


def draw_windows(ax) -> None:
    """Draw the room of w, and each edge's window without and with the turn."""
    ax.add_patch(
        plt.Rectangle(-HALF[:2], *(2 * HALF[:2]), facecolor="#f7f7f7", edgecolor="black", ls="--")
    )
    for name, ends in EDGES.items():
        exact = section(ends, np.full(3, 1e-9))
        grown = section(ends, TURN)
        ax.add_patch(plt.Polygon(exact, facecolor=COLOURS[name], alpha=0.22, edgecolor="none"))
        ax.add_patch(plt.Polygon(exact, fill=False, edgecolor=COLOURS[name]))
        ax.add_patch(plt.Polygon(grown, fill=False, edgecolor=COLOURS[name], ls=":"))
        x, z = exact[[2, 3]].mean(axis=0)
        ax.annotate(name, (x, z + 4), color=COLOURS[name], ha="center", weight="bold")
    ax.annotate("room", (-58, 47))
    ax.set(
        xlabel=r"$w_x$, mm",
        ylabel=r"$w_z$, mm",
        title="Windows of $w$: solid without turn, dotted with all turns",
    )
    ax.set_xlim(-150, 215)
    ax.set_ylim(-110, 115)


def main() -> None:
    """Write both files."""
    plt.switch_backend("Agg")
    plt.rcParams.update(STYLE)
    figure, axes = plt.subplots(1, 2, figsize=(10.5, 5.2), layout="constrained")
    draw_scene(axes[0])
    draw_windows(axes[1])
    for ax in axes:
        ax.set_aspect("equal")
    target = Path(__file__).with_suffix("")
    figure.savefig(target.with_suffix(".svg"), metadata={"Date": None})
    figure.savefig(target.with_suffix(".png"), dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()

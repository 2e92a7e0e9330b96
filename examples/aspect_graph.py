"""Draws the picture in README.md: the two-pocket block, its viewing domains in cross-section, its aspect graph."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patheffects import withStroke

from aspectgraph import build_aspect_graph, plot_graph, plot_section, read_entities, read_solid
from aspectgraph.plot.picker import ParallelView, view_axes

HERE = Path(__file__).parent
DIRECTION = (0.9, 1.0, 0.75)
ACCENT, INK = "#c0152f", "#2b3138"

# where the names go, in mm from the middles of the edges
OFFSETS = {
    "e1": (0, -4),
    "e2": (-4.5, 0),
    "e3": (5, 1.5),
    "e4": (0, -4),
    "e5": (4.5, 0),
    "e6": (-5, 1.5),
}


def draw_part(eag, ax):
    """Draw a parallel view of the part: shaded faces, visible edges, named entities."""
    solid, axes = eag.solid, view_axes(DIRECTION)
    points = solid.vertices @ axes.T
    front = solid.normals[np.asarray(solid.triangle_face)] @ axes[2]
    view = ParallelView(points[np.asarray(solid.triangles)[front > 1e-9]])
    light = solid.normals[np.asarray(solid.triangle_face)][front > 1e-9] @ np.array(
        [0.15, 0.35, 0.8]
    )
    image, extent = view.render(0.74 + 0.2 * light)
    ax.imshow(
        image,
        cmap="gray",
        vmin=0.25,
        vmax=1.0,
        extent=extent,
        origin="lower",
        interpolation="bilinear",
    )
    for edge in solid.edges:
        draw_seen(solid.edge_points(edge.id) @ axes.T, view, ax, color=INK, linewidth=1.0)
    for name, entity in eag.entities.items():
        ends = entity.endpoints @ axes.T
        draw_seen(ends, view, ax, color=ACCENT, linewidth=3.5, solid_capstyle="round")
        halo = [withStroke(linewidth=3, foreground="white")]
        place = ends.mean(axis=0)[:2] + OFFSETS[name]
        ax.text(
            *place,
            name,
            color=INK,
            fontsize=11,
            weight="bold",
            ha="center",
            va="center",
            path_effects=halo,
        )
    ax.set_axis_off()


def draw_seen(ends, view, ax, **style):
    """Draw the parts of an edge that no face hides."""
    samples = ends[0] + np.linspace(0.002, 0.998, 200)[:, None] * (ends[1] - ends[0])
    visible = np.where(view.is_seen(samples)[:, None], samples[:, :2], np.nan)
    ax.plot(*visible.T, **style)


def main():
    """Write aspect_graph.png beside this file."""
    solid = read_solid(HERE / "two_pocket_block.off")
    eag = build_aspect_graph(solid, read_entities(HERE / "two_pocket_block_entities.toml", solid))
    figure, axes = plt.subplots(
        1, 3, figsize=(15, 5), layout="constrained", width_ratios=(1.0, 1.15, 1.25)
    )
    draw_part(eag, axes[0])
    plot_section(eag, ax=axes[1])
    plot_graph(eag, ax=axes[2])
    titles = ("part and edges to measure", "viewing domains at half the height", "aspect graph")
    for ax, title in zip(axes, titles, strict=True):
        ax.set_title(title, fontsize=12, pad=22)
    figure.savefig(HERE / "aspect_graph.png", dpi=96, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main()

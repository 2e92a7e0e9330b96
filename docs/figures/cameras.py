"""Draw the first picture of README.md: a part, the edges to be measured, and a camera at each setting of the plan.

Run from anywhere; plans the example of `make demo` and writes ``cameras.png`` next to this file.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from PIL import Image

from aspectgraph import Solid, read_entities, read_solid
from aspectgraph.plot.picker import ParallelView, view_axes
from planner import Camera, Effort, InspectionPlan, PoseUncertainty, plan_inspection
from planner.report.figure import color_of

FIGURES = Path(__file__).parent
EXAMPLES = FIGURES.parents[1] / "examples"
# towards the viewer, in the part's frame
DIRECTION = (0.75, -1.0, 0.62)
LIGHT = (-0.3, -0.35, 0.9)
INK = "#2b3138"
# how far in front of its nodal point a camera's picture is drawn
FRUSTUM_MM = 90.0
# edges at which the surface turns less are not drawn
LEAST_TURN_DEG = 20.0
SIZE_INCHES = (9.6, 5.4)
DPI = 165
COLOURS = 128


def draw_part(solid: Solid, axes: np.ndarray, ax: Axes) -> ParallelView:
    """Draw the shaded faces and the visible edges of the part; return the view."""
    points = solid.vertices @ axes.T
    normals = solid.normals[np.asarray(solid.triangle_face)]
    front = normals @ axes[2] > 1e-9
    view = ParallelView(points[np.asarray(solid.triangles)[front]])
    light = np.asarray(LIGHT) / np.linalg.norm(LIGHT)
    shades = 0.72 + 0.22 * (normals[front] @ light)
    image, extent = view.render(shades)
    style = {"cmap": "gray", "vmin": 0.2, "vmax": 1.0, "origin": "lower"}
    ax.imshow(image, extent=extent, interpolation="bilinear", **style)
    for edge in solid.edges:
        if abs(edge.dihedral_deg) > LEAST_TURN_DEG:
            ends = solid.edge_points(edge.id) @ axes.T
            draw_edge(ends, view, ax, color=INK, linewidth=0.7, hidden=False)
    return view


def draw_edge(ends: np.ndarray, view: ParallelView, ax: Axes, *, hidden: bool, **style) -> None:
    """Draw the visible part of an edge, and the rest as dots if asked for."""
    samples = ends[0] + np.linspace(0.002, 0.998, 200)[:, None] * (ends[1] - ends[0])
    seen = view.is_seen(samples)[:, None]
    ax.plot(*np.where(seen, samples[:, :2], np.nan).T, solid_capstyle="round", **style)
    if hidden:
        style = {**style, "linewidth": 0.5 * style["linewidth"]}
        ax.plot(*np.where(seen, np.nan, samples[:, :2]).T, linestyle=(0, (2, 1.5)), **style)


def draw_camera(plan: InspectionPlan, k: int, view: ParallelView, axes: np.ndarray, ax: Axes):
    """Draw the camera of a setting, the edges it measures and the lines of sight to them."""
    setting = plan.settings[k]
    colour = color_of(k)
    nodal = setting.cam2world[:3, 3]
    eye = (axes @ nodal)[:2]
    half = 0.5 * np.asarray(plan.camera.resolution) * plan.camera.pixel_pitch_mm
    half = half / plan.camera.image_distance_mm
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    corners = FRUSTUM_MM * np.column_stack([corners, np.ones(4)])
    corners = (corners @ setting.cam2world[:3, :3].T + nodal) @ axes.T
    for name in setting.entities:
        ends = plan.entities[name] @ axes.T
        sight = np.vstack([eye, ends[:, :2]])
        ax.add_patch(Polygon(sight, facecolor=colour, alpha=0.13, linewidth=0, zorder=3))
        draw_edge(ends, view, ax, color=colour, linewidth=4.0, hidden=True, zorder=5)
    for i in range(4):
        face = np.vstack([eye, corners[i, :2], corners[(i + 1) % 4, :2]])
        ax.add_patch(Polygon(face, facecolor=colour, alpha=0.25, edgecolor=colour, zorder=6))
    ax.plot(*eye, "o", color=colour, markersize=8, zorder=7)
    # the number stands behind the camera
    away = eye - corners[:, :2].mean(axis=0)
    away /= max(np.linalg.norm(away), 1e-9)
    halo = [withStroke(linewidth=4, foreground="white")]
    style = {"fontsize": 15, "weight": "bold", "ha": "center", "va": "center", "zorder": 8}
    ax.annotate(
        str(k + 1),
        eye,
        15 * away,
        textcoords="offset points",
        color=colour,
        path_effects=halo,
        **style,
    )


def make_plan(solid: Solid) -> InspectionPlan:
    """Plan the sixteen edges of `make demo`."""
    return plan_inspection(
        solid,
        read_entities(EXAMPLES / "nist_ctc_01_corners.toml", solid),
        Camera.from_toml(EXAMPLES / "camera.toml"),
        PoseUncertainty.isotropic(translation_mm=0.2, rotation_rad=0.002),
        accuracy=0.99,
        probability=0.9,
        effort=Effort.named("quick"),
    )


def main() -> None:
    """Write cameras.png."""
    solid = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
    plan = make_plan(solid)
    axes = view_axes(DIRECTION)
    figure, ax = plt.subplots(figsize=SIZE_INCHES)
    view = draw_part(solid, axes, ax)
    for k in range(len(plan.settings)):
        draw_camera(plan, k, view, axes, ax)
    ax.set_axis_off()
    ax.set_aspect("equal")
    ax.autoscale_view()
    path = FIGURES / "cameras.png"
    figure.savefig(path, dpi=DPI, bbox_inches="tight", pad_inches=0.05, facecolor="white")
    Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    print(f"{len(plan.entities)} edges from {len(plan.settings)} settings")


if __name__ == "__main__":
    main()

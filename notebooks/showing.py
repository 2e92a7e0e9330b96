# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Can the edge be found in the image?
#
# An edge that is not hidden may still not be found: another line runs next to it, it ends in a
# tangent arc, or hardly any light falls on it. Plans require corners, a distance from other lines,
# and surroundings, and they choose lamps. Here images of planned settings are rendered under
# several lamps and measured from displaced poses, by a program that shares no code with the
# planner.

# %%
import csv
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

root = next(
    folder for folder in (Path.cwd(), *Path.cwd().parents) if (folder / "benchmarks").is_dir()
)
sys.path.insert(0, str(root / "benchmarks" / "images"))

from edge_images import ACCURACIES, Lines, crossing, fitted, pairs, show
from rendered_images import Lamp, Renderer, found_points
from scipy.spatial.transform import Rotation

from aspectgraph import read_entities, read_solid
from planner import (
    Camera,
    Detectability,
    Effort,
    LampBox,
    PoseUncertainty,
    plan_inspection,
    plan_light,
)

plt.rcParams.update({"figure.constrained_layout.use": True, "font.size": 9})
EXAMPLES = root / "examples"

# %% [markdown]
# ## A plan and its lamps
#
# Six edges of the boss of NIST's part CTC-01, with the default conditions.

# %%
solid = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
named = read_entities(EXAMPLES / "nist_ctc_01_corners.toml", solid)
edges = {name: entity for name, entity in named.items() if name.startswith("boss")}
camera = Camera.from_toml(EXAMPLES / "camera.toml")
uncertainty = PoseUncertainty.isotropic(translation_mm=0.2, rotation_rad=0.002)
plan = plan_inspection(
    solid, edges, camera, uncertainty, accuracy=0.99, effort=Effort.named("quick")
)
light = plan_light(plan, solid, LampBox((-500, -500, 250), (500, 500, 900)))
print(Detectability())
print(plan)
print(light)
assert plan.complete
assert light.complete

# %% [markdown]
# ## The same view under three lamps
#
# At the camera, at an unplanned position, and at the planned position. Circles show where a line
# fit finds a grey step of five levels of 255 or more along the measured edges. Crosses show where
# it does not.

# %%
setting = max(plan.settings, key=lambda one: len(one.entities))
pose = np.asarray(setting.cam2world)
k = plan.settings.index(setting)
(image, *_) = light.images[k]
lamps = {
    "at the camera": pose[:3, 3],
    "straight above": np.array([0.0, 0.0, 900.0]),
    "planned": light.lamps[image.lamps[0]],
}
renderer = Renderer(solid.vertices, solid.triangles, camera.matrix, noise=0.015)


def picture(lamp, low, high, step):
    """Return grey values of a part of the image."""
    u, v = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    rays = (
        np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ np.linalg.inv(camera.matrix).T
    )
    return renderer._grey(pose, rays, lamp).reshape(u.shape)


ends = np.array([plan.entities[name] for name in setting.entities])
corners = renderer.projected(ends.reshape(-1, 3), pose)
low, high = (
    np.maximum(corners.min(axis=0) - 60, 0),
    np.minimum(corners.max(axis=0) + 60, camera.resolution),
)
fig, axes = plt.subplots(1, 3, figsize=(12, 4.2))
steps = {}
for ax, (name, place) in zip(axes, lamps.items(), strict=True):
    lamp, rng = Lamp(place), np.random.default_rng(0)
    ax.imshow(
        picture(lamp, low, high, 2),
        cmap="gray",
        vmin=0,
        vmax=1,
        extent=(low[0], high[0], high[1], low[1]),
    )
    steps[name] = []
    for a, b in ends:
        points = a + np.linspace(0.06, 0.94, 12)[:, None] * (b - a)
        pixels, step = found_points(
            renderer, pose, points, np.tile((b - a) / np.linalg.norm(b - a), (12, 1)), lamp, rng
        )
        steps[name].append(np.quantile(step, 0.1))
        ax.plot(*pixels[step >= 5].T, "C1o", ms=3, mfc="none")
        ax.plot(*pixels[step < 5].T, "C3x", ms=5)
    ax.set(title=f"lamp {name}", xticks=[], yticks=[])
plt.show()
for name, least in steps.items():
    print(f"lamp {name:<16} weakest edge: {min(least):5.1f} grey levels")
assert min(steps["planned"]) >= 5

# %% [markdown]
# ## A displaced camera
#
# The image moves by pixels. Lines are fitted to the points found along the edge and along the line
# that leaves each of its ends. The edge ends where they cross.

# %%
rng, lamp = np.random.default_rng(3), Lamp(lamps["planned"])
a, b = np.asarray(plan.entities[setting.entities[0]])
move = np.eye(4)
move[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.002, 3)).as_matrix()
move[:3, 3] = rng.normal(0, 0.2, 3)
real = pose @ move
lines = Lines(solid)
own = set(edges[setting.entities[0]].edge_ids)


def line(start, end, low, high):
    """Find points between two shares of a line in the displaced image."""
    points = start + np.linspace(low, high, 12)[:, None] * (end - start)
    along = np.tile((end - start) / np.linalg.norm(end - start), (12, 1))
    pixels, step = found_points(renderer, real, points, along, lamp, rng)
    return pixels[step >= 5]


along = line(a, b, 0.06, 0.94)
fig, axes = plt.subplots(1, 2, figsize=(9, 4))
for ax, end, other in zip(axes, (a, b), (b, a), strict=True):
    leaving = [
        arm for arm in lines.arms(real, renderer, end, other, own) if 25 <= arm.seen_deg <= 155
    ]
    arms = [line(end, arm.tip, 0.1, 0.5) for arm in leaving]
    arm = max(arms, key=len)
    corner = crossing(fitted(along), fitted(arm))
    exact, planned = renderer.projected(end[None], real)[0], renderer.projected(end[None], pose)[0]
    ax.plot(*along.T, "C0.", label="found along the edge")
    ax.plot(*arm.T, "C2.", label="found along the other line")
    ax.plot(*corner, "C1o", mfc="none", ms=10, label="corner found")
    ax.plot(*exact, "k+", ms=10, label="where it is")
    ax.plot(*planned, "C3x", ms=8, label="where it was planned")
    ax.set(
        xlim=planned[0] + np.array([-40, 40]), ylim=planned[1] + np.array([40, -40]), aspect="equal"
    )
    ax.set_title(
        f"off by {np.linalg.norm(corner - exact):.2f} px, moved by {np.linalg.norm(exact - planned):.1f} px"
    )
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
plt.show()

# %% [markdown]
# ## Stated against measured
#
# Every edge of this setting from four displaced poses, then what `benchmarks/images/edge_images.py`
# stored for whole plans. A measurement is *clean* if both ends are corners with 40 px around them,
# no other line is within 5 px, and the step is five grey levels or more. The stated probability is
# for ends rounded to pixels. *Fit* counts the lines' crossings as they are, *rounded* those rounded
# to pixels. *Corner* counts the points of OpenCV's `cornerSubPix`, *Canny* the ends of the traces
# of its edges. The plan states nothing for these two.

# %%
from dataclasses import replace

part_of_it = replace(
    plan,
    settings=(setting,),
    light=replace(light, images=(light.images[k],), unlit=(light.unlit[k],)),
)
measured = list(pairs(part_of_it, solid, 4, 0))
show(measured)
assert {one.kind for one in measured} == {"clean"}
assert all(one.worst <= 3 for one in measured)

# %%
with open(root / "notebooks" / "edge_images.csv", encoding="utf-8", newline="") as file:
    rows = list(csv.DictReader(file))
WHICH = ("promised", "measured", "rounded", "corner", "canny")
print(
    f"{'plan':<22}{'class':<12}{'pairs':>6}{'images':>8}"
    + "".join(f"   A = {a:<6} promised    fit rounded corner  Canny" for a in ACCURACIES)
)
for name in dict.fromkeys(row["plan"] for row in rows):
    for kind in sorted({row["kind"] for row in rows if row["plan"] == name}):
        some = [row for row in rows if (row["plan"], row["kind"]) == (name, kind)]
        means = [
            [np.mean([float(row[f"{which} {a}"]) for row in some]) for which in WHICH]
            for a in ACCURACIES
        ]
        told = "".join(
            f"{p:22.3f}{fit:7.3f}{r:8.3f}{corner:7.3f}{canny:7.3f}"
            for p, fit, r, corner, canny in means
        )
        print(f"{name:<22}{kind:<12}{len(some):>6}{sum(int(row['n']) for row in some):>8}{told}")


# %%
def too_high(row, a):
    """By how many standard errors of the promise it is above the share that the fit measured."""
    promised, measured, n = float(row[f"promised {a}"]), float(row[f"measured {a}"]), int(row["n"])
    return (promised - measured) / np.sqrt(max(promised * (1 - promised), 1 / n) / n)


kept = [row for row in rows if row["plan"].startswith("conditions") and row["kind"] == "clean"]
wrong = [row for row in kept if max(too_high(row, a) for a in ACCURACIES[:2]) > 3]
print(
    f"{len(kept)} clean pairs under the conditions, {len(wrong)} promised too much at A = .98 or .99:"
)
for row in wrong:
    told = ", ".join(
        f"{float(row[f'promised {a}']):.3f} and {float(row[f'measured {a}']):.3f}"
        for a in ACCURACIES[:2]
    )
    print(f"{row['plan']}, setting {row['setting']} {row['name']}: promised and measured {told}")
assert not wrong

# %% [markdown]
# For no clean measurement is the stated probability at A = .98 or .99 too high by three standard
# errors. A corner detector that does not use the part, and the ends of traces, are less accurate
# than crossings of fitted lines, more so on small parts. Under the paper's constraints most edges
# of CTC-01 end in tangent arcs, and the measured shares do not reach the stated ones. *Not lit* are
# the edges that the plan lists as unlit. They are measured with a lamp next to the camera.
#
# The plans are the demo's under the lamps of `dome:0,0,0,900`, and all edges of mfcad_4-5-5-6-9-23
# and of D2MI under lamps of a dome of 900 mm. The last is `examples/nist_ctc_01_entities.toml` with
# all conditions at 0 and a lamp next to the camera.

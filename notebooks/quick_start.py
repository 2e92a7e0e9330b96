# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Quick start on a real part
#
# From a CAD file to camera poses: NIST's test part CTC-01, a plate of 800 mm, and the twelve long edges of the boss in
# its middle. From where can they all be measured to one percent, and how sure is that?

# %%
from pathlib import Path

from IPython.display import SVG

from aspectgraph import read_solid, select_entities
from errors.checks import probability_text
from planner import Camera, Effort, PoseUncertainty, plan_figure, plan_inspection, predicted_image

EXAMPLES = Path("../examples") if Path("../examples").is_dir() else Path("examples")

solid = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
edges = select_entities(solid, "near 0,0,50 < 120 and length > 40")
print(f"{len(edges)} edges: {edges}")
solid

# %% [markdown]
# ## The request
#
# A camera of the catalogue, and how far its real pose may be from the planned one: 0.1 mm along each axis and 1 mrad
# about each axis, one standard deviation. Each length shall be right to one percent with probability 0.9.

# %%
camera = Camera.named("basler-acA2440-20gm-8mm")
uncertainty = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001)
plan = plan_inspection(
    solid, edges, camera, uncertainty, accuracy=0.99, effort=Effort.named("quick")
).simulated()
plan

# %% [markdown]
# One pose is enough, and that is proven. *Smallest P_all* is the stated probability that a displaced camera measures
# the least sure edge; *simulated* is how often 10,000 displaced cameras measured it well enough.
#
# This plan asks nothing of light, so an edge that your lamps do not show is not measured. `lamps="ring"` plans for a
# lamp on the camera, and `lamps=LampDome(...)` looks for places of lamps.

# %%
assert plan.complete
assert plan.minimal
assert plan.simulation.confirmed

# %% [markdown]
# ## What the camera will see

# %%
setting = plan.settings[0]
SVG(predicted_image(solid, camera, setting.cam2world, plan.entities))

# %% [markdown]
# ## All numbers
#
# `plan.rows()` is a list of records, for a data frame or a CSV file (`plan.to_csv("plan.csv")`).

# %%
rows = plan.rows()
print(", ".join(rows[0]))
for row in rows[:3]:
    print(
        f"\n{row['name']}: {row['kind']} {row['nominal']:.2f} mm, u = {row['standard_uncertainty']:.3f} mm, "
        f"P {probability_text(row['probability'])}, search within ±{row['search_window_px']:.1f} px"
    )
assert len(rows) == len(edges)

# %% [markdown]
# ## In space

# %%
plan_figure(plan, solid)

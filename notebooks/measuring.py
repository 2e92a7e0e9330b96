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
# # From images to values
#
# A plan says from where to measure. This notebook takes the images of such a plan and gets values
# from them, with their uncertainties and decisions. The part is NIST's CTC-01. Its two images are
# rendered from a part that deviates, so the true values are known.

# %%
from pathlib import Path

import matplotlib.pyplot as plt

from aspectgraph import read_solid
from planner import Registration, measure, read_plan

examples = Path("../examples")
plan = read_plan(examples / "measured/plan.json")
solid = read_solid(examples / "nist_ctc_01_ap242.stp")
plan

# %% [markdown]
# ## Measure
#
# The pose of each image and the deviations of the part's surfaces are estimated together, from all
# visible edges. The bores that are measured are free: nothing pulls them to their nominal size.

# %%
results = measure(plan, solid, examples / "measured/images")
true = {"bore_25": 24.810, "bore_35": 34.984, "slot_width": 49.998, "bore_35_back": 34.859}
for one in results:
    print(
        f"{one.name:13} {one.value:8.3f} ± {one.expanded_uncertainty:.3f} mm"
        f"   true {true[one.name]:8.3f}   {one.decision.value}"
    )
    assert abs(one.value - true[one.name]) < one.expanded_uncertainty
results

# %% [markdown]
# The robot is off by 0.2 mm and 2 mrad, so the images are some pixels off their prediction. After
# the registration, found edges and the part agree to a fraction of a pixel.

# %%
for name, image in results.images.items():
    print(
        f"{name}: {image.shift_px:.1f} px off its prediction, {image.misfit_px:.2f} px after it; "
        f"{image.used} of {image.offered} samples of edges agree"
    )
    assert image.misfit_px < 0.2

# %% [markdown]
# ## Look at a bore
#
# Each sample of the rim has a state. Green points were found. Samples that have another line next
# to them, or whose light is unclear, are left out with their reason.

# %%
reading = results["bore_25"].readings[0]
points = reading.points[0]
picture = results.pictures[reading.image]
found = points["state"] == 0
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2))
left.imshow(picture.grey, cmap="gray", vmin=0, vmax=255)
left.plot(points["u"][found], points["v"][found], ".", color="#1fae54", markersize=4)
left.plot(points["u"][~found], points["v"][~found], "x", color="#e5332a", markersize=5)
left.set_xlim(points["u"].min() - 12, points["u"].max() + 12)
left.set_ylim(points["v"].max() + 12, points["v"].min() - 12)
left.set_title(", ".join(f"{n} {what}" for what, n in reading.counts.items()))
right.plot(points["share"][found], points["residual_px"][found], ".", color="#1fae54")
right.axhline(0, color="0.6")
right.set_xlabel("along the rim")
right.set_ylabel("distance from the fit, px")
figure.tight_layout()

# %% [markdown]
# ## Where the uncertainty comes from
#
# The budget holds variances, here printed as standard deviations. The largest part is the response:
# nothing states how the camera turns light into grey values, and a pixel is half a millimetre.

# %%
for source, variance in reading.budget.items():
    print(f"{source:20} {variance**0.5 * 1000:6.1f} µm")
print(f"{'u':20} {reading.standard_uncertainty * 1000:6.1f} µm")
print(f"U by drawing: {reading.drawn_uncertainty * 1000:.1f} µm")

# %% [markdown]
# ## What the registration is worth
#
# With the planned poses, values are far less certain. Some targets lie closer to other lines than
# the search window of a poor robot. They get a reason instead of a value.

# %%
planned = measure(plan, solid, examples / "measured/images", registration=Registration.none())
for one, other in zip(results, planned, strict=True):
    before = f"± {other.expanded_uncertainty:.3f} mm" if other.measured else other.reason
    print(f"{one.name:13} ± {one.expanded_uncertainty:.3f} mm, with planned poses {before}")

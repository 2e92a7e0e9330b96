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
# # Measurement error of an edge's image length
#
# How sure is a length taken from an image? This notebook draws the densities of C. C. Yang and F. W. Ciarallo,
# "Optimized sensor placement for active visual inspection" (*J. Robotic Systems* 18, 2001; its Figs. 2, 4 and 7),
# compares the three models of `errors.success_probability`, and tests the prediction on synthetic pixel images.
#
# Everything is in millimetres and radians. The camera frame is the paper's: $C_1$ right, $C_2$ up, $C_3$ backwards,
# image plane at $C_3 = 0$, lens centre at $C_3 = f$. The paper's parameters are used throughout: pixel pitch 0.010 ×
# 0.013 mm, displacement variances 0.03 mm² and 0.003 rad² (that is 0.17 mm and 3.1°); the focal length of 25 mm is
# ours.

# %%
import matplotlib.pyplot as plt
import numpy as np

from errors import (
    AxisQuantization,
    SegmentDisplacement,
    SegmentError,
    SegmentQuantization,
    coverage_image,
    displace,
    image_segment,
    length_expansion,
    measure_lengths,
    point_displacement,
    project,
    simulate_measurement,
    simulate_success,
    success_probability,
)
from errors.checks import probability_text

F = 25.0
PITCH = (0.010, 0.013)
PAPER = np.diag([0.03] * 3 + [0.003] * 3)
CAMERA = {"focal_length_mm": F, "pixel_pitch_mm": PITCH}
rng = np.random.default_rng(2001)
plt.rcParams.update(
    {"figure.constrained_layout.use": True, "axes.grid": True, "grid.alpha": 0.3, "font.size": 9}
)


def edge_at(depth, angle_deg, length=50.0, tilt=0.2, centre=(0.0, 0.0)):
    """An edge `depth` mm in front of the lens, at an angle in the image, tilted towards the viewer."""
    angle, lateral = np.radians(angle_deg), np.sqrt(1.0 - tilt**2)
    direction = np.array([np.cos(angle) * lateral, np.sin(angle) * lateral, tilt])
    return np.array([*centre, F - depth]) + np.array([[-0.5], [0.5]]) * length * direction


# %% [markdown]
# ## Quantization along one axis (eqs 1–2, Fig. 2)
#
# A pixel belongs to the edge when more than half of it is covered, so each end moves to the grid by an error uniform
# in $\pm r/2$. The distance between two ends then has the triangular density $(1/r)(1-|\varepsilon|/r)$.

# %%
fig, axes = plt.subplots(1, 2, figsize=(8.5, 3), sharey=True)
for ax, pitch, name in zip(axes, PITCH, ("horizontal, $r_x$", "vertical, $r_y$"), strict=True):
    law = AxisQuantization(pitch)
    error = np.linspace(-0.016, 0.016, 401)
    ax.hist(law.sample(1_000_000, rng), bins=80, density=True, color="0.85", label="10⁶ samples")
    ax.plot(error, law.pdf(error), label="eq. 2")
    ax.set(xlabel="quantization error ε (mm)", title=f"{name} = {pitch} mm")
axes[0].set_ylabel("probability density (1/mm)")
axes[0].legend()
fig.suptitle("Fig. 2: quantization error of a distance along one image axis")
plt.show()

# %% [markdown]
# ## Quantization of a segment at an angle (eq 3, Fig. 4)
#
# $\varepsilon = \varepsilon_x\cos\gamma + \varepsilon_y\sin\gamma$ is a sum of four uniform errors: a piecewise cubic
# density, given in closed form for every angle, 0° and 90° included.

# %%
fig, axes = plt.subplots(1, 3, figsize=(11, 3), sharey=True)
error = np.linspace(-0.018, 0.018, 601)
for ax, degrees in zip(axes, (40.0, 50.0), strict=False):
    law = SegmentQuantization(np.radians(degrees), PITCH)
    ax.hist(law.sample(1_000_000, rng), bins=100, density=True, color="0.85", label="10⁶ samples")
    ax.plot(error, law.pdf(error), label="eq. 3")
    ax.set(
        xlabel="quantization error ε (mm)", title=f"γ = {degrees:.0f}°", xticks=[-0.01, 0.0, 0.01]
    )
axes[0].set_ylabel("probability density (1/mm)")
axes[0].legend()
for degrees in (0.0, 1.0, 10.0, 45.0, 90.0):
    axes[2].plot(
        error,
        SegmentQuantization(np.radians(degrees), PITCH).pdf(error),
        label=f"γ = {degrees:.0f}°",
    )
axes[2].set(xlabel="quantization error ε (mm)", title="towards the axes", xticks=[-0.01, 0.0, 0.01])
axes[2].legend()
fig.suptitle("Fig. 4: quantization error of a segment's length, pixels of 0.010 × 0.013 mm")
plt.show()

# %% [markdown]
# ## Displacement of one image point (eqs 10–11, Fig. 7)
#
# When the camera is displaced, a point's image moves by a ratio of two correlated normal variables. The paper does
# not give the point of its figure; this one lies 300 mm in front of the lens. The histogram holds 10⁶ poses with the
# *exact* rotation; even at 3.1° the small-angle density of the paper follows it.

# %%
point = np.array([30.0, -20.0, F - 300.0])
delta = rng.multivariate_normal(np.zeros(6), PAPER, size=1_000_000)
shift = project(displace(point, delta), focal_length_mm=F) - project(point, focal_length_mm=F)
fig, axes = plt.subplots(1, 2, figsize=(8.5, 3), sharey=True)
laws = point_displacement(point, focal_length_mm=F, pose_covariance=PAPER)
for ax, law, moved, name in zip(axes, laws, shift.T, "uv", strict=True):
    w = np.linspace(-6.0, 6.0, 601)
    ax.hist(
        moved, bins=np.linspace(-6, 6, 121), density=True, color="0.85", label="10⁶ exact poses"
    )
    ax.plot(w, law.pdf(w), label="eq. 11" if name == "v" else "eq. 10")
    ax.set(xlabel=f"displacement of the image point along {name} (mm)")
    ax.legend()
axes[0].set_ylabel("probability density (1/mm)")
fig.suptitle(
    "Fig. 7: displacement of the image of the point (30, −20, −275) mm, σ² = 0.03 mm² and 0.003 rad²"
)
plt.show()

# %% [markdown]
# ## A segment: the paper takes its ends as independent (eqs 12–15)
#
# Each end of an edge moves by more than a millimetre in the image, as above. But one displaced pose moves *both*, and
# a length only feels the difference. Eq. 12 takes the two ends as independent and so loses the cancellation.

# %%
edge = edge_at(300.0, 20.0)
length = float(image_segment(edge, focal_length_mm=F)[0])
images = project(displace(edge, delta[:, None, :]), focal_length_mm=F)
true_error = np.linalg.norm(images[:, 1] - images[:, 0], axis=1) - length
independent = SegmentDisplacement(edge, focal_length_mm=F, pose_covariance=PAPER)
total = SegmentError(edge, **CAMERA, pose_covariance=PAPER)
fig, axes = plt.subplots(1, 2, figsize=(10, 3.2))
wide = np.linspace(-6.0, 6.0, 801)
axes[0].hist(
    true_error,
    bins=np.linspace(-6, 6, 801),
    density=True,
    color="C1",
    label="true: 10⁶ exact poses",
)
axes[0].plot(wide, independent.pdf(wide), label="eq. 14, independent ends")
axes[0].plot(wide, total.pdf(wide), "C3--", label="eq. 15, with quantization")
axes[0].set(
    yscale="log",
    ylim=(1e-3, 1e2),
    xlabel="error of the image length ε (mm)",
    ylabel="probability density (1/mm)",
)
axes[0].legend()
narrow = np.linspace(-0.15, 0.2, 351)
axes[1].hist(true_error, bins=narrow, density=True, color="C1", label="true: 10⁶ exact poses")
axes[1].plot(narrow, independent.pdf(narrow), label="eq. 14, independent ends")
axes[1].axvspan(-0.02 * length, 0.02 * length, color="C2", alpha=0.15, label="allowed at 98 %")
axes[1].set(xlabel="error of the image length ε (mm)", ylabel="probability density (1/mm)")
axes[1].legend()
fig.suptitle(
    f"Error of a {length:.2f} mm image length (50 mm edge at 300 mm): the same, wide and close up"
)
plt.show()
print(
    f"standard deviation: true {true_error.std():.3f} mm, independent ends {float(independent.std):.3f} mm"
)
for model in ("joint", "independent", "montecarlo"):
    p = success_probability(edge, **CAMERA, pose_covariance=PAPER, accuracy=0.98, model=model)
    print(f"P(|ε| ≤ 2 %) by model {model:12s} {probability_text(float(p))}")

# %% [markdown]
# ## The three models over rotation and distance
#
# Twelve edges of 50 mm at random angles and tilts, accuracy 98 %. `joint` lies on the Monte Carlo points everywhere;
# `independent` has lost the measurement at a rotation s.d. of a few thousandths of a radian, where in truth it is
# certain.

# %%
rotations = np.geomspace(3e-4, 0.1, 21)
distances = np.linspace(120.0, 1500.0, 21)
shapes = [(rng.uniform(0, 90), rng.uniform(-0.6, 0.6), rng.uniform(-20, 20, 2)) for _ in range(12)]


def edges_at(depth):
    """The twelve edges at a depth, (12, 2, 3) in mm."""
    return np.array(
        [edge_at(depth, angle, tilt=tilt, centre=centre) for angle, tilt, centre in shapes]
    )


def compare(ax, x, cases):
    """Plot mean and range over the twelve edges; cases: (edges, covariance) per x."""
    for model, style in (("joint", "C0-"), ("independent", "C3--"), ("montecarlo", "ko")):
        p = np.array(
            [
                success_probability(
                    e, **CAMERA, pose_covariance=c, accuracy=0.98, model=model, samples=20_000
                )
                for e, c in cases
            ]
        )
        ax.plot(x, p.mean(axis=1), style, markersize=3.5, markerfacecolor="none", label=model)
        if model != "montecarlo":
            ax.fill_between(x, p.min(axis=1), p.max(axis=1), color=style[:2], alpha=0.15)


fig, axes = plt.subplots(1, 2, figsize=(10, 3.6), sharey=True)
compare(
    axes[0], rotations, [(edges_at(300.0), np.diag([0.03] * 3 + [s**2] * 3)) for s in rotations]
)
axes[0].axvline(np.sqrt(0.003), color="0.5", linewidth=0.8)
axes[0].text(np.sqrt(0.003), 0.3, " paper's\n value", color="0.4")
axes[0].set(
    xscale="log", xlabel="rotation s.d. (rad), at 300 mm", ylabel="P(|ε| ≤ 2 % of the length)"
)
compare(axes[1], distances, [(edges_at(d), PAPER) for d in distances])
axes[1].set(xlabel="distance of the edge (mm), at the paper's variances", ylim=(-0.02, 1.02))
axes[1].legend(loc="center right")
fig.suptitle("Probability of 98 % accuracy: mean (line, points) and range (band) over twelve edges")
plt.show()

# %% [markdown]
# ### How close is `joint`?
#
# Forty random edges with random *correlated* covariances against 200,000 exact poses each. The second column is the
# s.d. of Monte Carlo's own noise at the worst edge: up to 0.03 rad the differences are no larger than what that noise
# explains.


# %%
def random_covariance(rotation_std):
    """A correlated covariance (6, 6) with the given standard deviation, rad, of every rotation."""
    factor = rng.normal(size=(6, 12))
    covariance = factor @ factor.T
    std = np.array([np.sqrt(0.03)] * 3 + [rotation_std] * 3) / np.sqrt(np.diag(covariance))
    return covariance * std[:, None] * std


def random_edge():
    """An edge of 20 to 80 mm, 200 to 600 mm away, anyhow turned."""
    depth, lateral = rng.uniform(200, 600), rng.uniform(-0.2, 0.2, 2)
    return edge_at(
        depth, rng.uniform(0, 360), rng.uniform(20, 80), rng.uniform(-0.9, 0.9), lateral * depth
    )


forty = np.array([random_edge() for _ in range(40)])
samples = 200_000
print("rotation s.d. (rad)   MC noise   largest difference   smallest P")
for rotation_std in (0.002, 0.01, 0.03, 0.055):
    covariance = np.array([random_covariance(rotation_std) for _ in forty])
    call = {**CAMERA, "pose_covariance": covariance, "accuracy": 0.98}
    joint, referee = (
        success_probability(forty, **call),
        simulate_success(forty, **call, samples=samples).probability,
    )
    noise = np.sqrt((referee * (1 - referee)).max() / samples)
    print(
        f"{rotation_std:19.3f}   {noise:8.4f}   {np.abs(joint - referee).max():18.4f}   {joint.min():10.3f}"
    )

# %% [markdown]
# ## Is the probability true? A digital twin
#
# The twin draws a displaced pose and makes the pixel image of the edge on the sensor's one fixed
# grid. It finds the ends by the paper's rule and measures. `axes` applies the rule per axis (whole
# columns and rows); `area` thresholds the covered area of a three-pixel band and follows the chain
# of pixels, as a detector would.

# %%
segment = np.array([[-0.083, -0.031], [0.087, 0.064]])
image, (i0, j0) = coverage_image(segment, pixel_pitch_mm=PITCH)
extent = [
    i0 * PITCH[0],
    (i0 + image.shape[1]) * PITCH[0],
    j0 * PITCH[1],
    (j0 + image.shape[0]) * PITCH[1],
]
fig, axes = plt.subplots(1, 2, figsize=(10, 3), sharey=True)
for ax, picture, title in zip(
    axes, (image, image > 0.5), ("covered area", "more than half covered"), strict=True
):
    ax.imshow(picture, origin="lower", extent=extent, cmap="gray_r", vmin=0, vmax=1.6)
    ax.plot(*segment.T, "C3o-", markersize=4)
    ax.grid(False)
    ax.set(xlabel="u (mm)", title=title)
axes[0].set_ylabel("v (mm)")
fig.suptitle("Synthetic image of an edge (red: where it really is)")
plt.show()
true_length = np.linalg.norm(segment[1] - segment[0])
for detector in ("axes", "area"):
    measured = measure_lengths(segment, pixel_pitch_mm=PITCH, detector=detector)
    print(f"{detector}: measured {float(measured):.4f} mm, true {true_length:.4f} mm")

# %% [markdown]
# ### Over distances and angles
#
# Success frequency (4,000 images per cell) minus predicted probability, for two required accuracies, at a good
# robot's uncertainty (0.1 mm, 0.01 rad). The 50 mm edge is nearly frontal, so its length hardly moves with the pose.

# %%
depths, angles = (
    np.array([150, 300, 450, 600, 900, 1200]),
    np.array([0, 10, 20, 30, 45, 60, 75, 90]),
)
good = np.diag([0.1**2] * 3 + [0.01**2] * 3)
fig, axes = plt.subplots(2, 2, figsize=(10.5, 6), sharex=True)
for row, accuracy in zip(axes, (0.99, 0.995), strict=True):
    for ax, detector in zip(row, ("axes", "area"), strict=True):
        gap = np.empty((len(depths), len(angles)))
        for i, depth in enumerate(depths):
            for j, angle in enumerate(angles):
                call = {**CAMERA, "pose_covariance": good, "accuracy": accuracy}
                nominal = edge_at(depth, angle)
                twin = simulate_measurement(nominal, **call, samples=4000, detector=detector, rng=1)
                gap[i, j] = twin.probability - success_probability(nominal, **call)
        picture = ax.imshow(gap, origin="lower", cmap="RdBu", vmin=-0.3, vmax=0.3, aspect="auto")
        ax.grid(False)
        for i, j in np.ndindex(gap.shape):
            ax.text(j, i, f"{gap[i, j]:+.2f}", ha="center", va="center", fontsize=7)
        tolerances = (1 - accuracy) * 50 * F / depths / PITCH[0]
        labels = [f"{d} ({t:.1f})" for d, t in zip(depths, tolerances, strict=True)]
        ax.set_xticks(range(len(angles)), angles)
        ax.set_yticks(range(len(depths)), labels)
        ax.set_title(f"accuracy {accuracy:.1%}, detector {detector}")
for ax in axes[:, 0]:
    ax.set_ylabel("distance in mm (tolerance in units of $r_x$)")
for ax in axes[1]:
    ax.set_xlabel("angle of the edge in the image (degrees)")
fig.colorbar(picture, ax=axes, label="frequency − prediction")
fig.suptitle("Digital twin against model joint: rotation s.d. 0.01 rad, translation s.d. 0.1 mm")
plt.show()

# %% [markdown]
# ### What decides: tolerance and spread, in pixels
#
# 300 random edges, angles, tilts and uncertainties, each with tolerance and spread (s.d. of the displaced length,
# without quantization) chosen at random. One number per dot: by how much the frequency (3,000 images) misses the
# prediction.

# %%
tolerance_px, spread_px = 10 ** rng.uniform(-0.5, 0.9, 300), 10 ** rng.uniform(-1.5, 0.7, 300)
misses = {"axes": [], "area": []}
for tolerance, spread in zip(tolerance_px, spread_px, strict=True):
    nominal = edge_at(
        rng.uniform(150, 600), rng.uniform(0, 90), rng.uniform(30, 60), rng.uniform(0.0, 0.6)
    )
    size, gradient, hessian = length_expansion(nominal, focal_length_mm=F)
    angle = float(image_segment(nominal, focal_length_mm=F)[1])
    pixel = np.hypot(PITCH[0] * np.cos(angle), PITCH[1] * np.sin(angle))
    shape = np.diag([1.0] * 3 + [0.003**2] * 3)
    # Scaled so that the length has the wanted spread.
    covariance = shape * (spread * pixel) ** 2 / (gradient @ shape @ gradient)
    call = {
        **CAMERA,
        "pose_covariance": covariance,
        "accuracy": 1.0 - tolerance * pixel / float(size),
    }
    p = success_probability(nominal, **call)
    for detector, values in misses.items():
        twin = simulate_measurement(nominal, **call, samples=3000, detector=detector, rng=rng)
        values.append(abs(float(twin.probability - p)))

fig, axes = plt.subplots(1, 2, figsize=(10, 3.8), sharey=True)
for ax, (detector, values) in zip(axes, misses.items(), strict=True):
    dots = ax.scatter(
        tolerance_px,
        spread_px,
        c=np.clip(values, 1e-3, None),
        norm="log",
        vmin=1e-3,
        vmax=0.6,
        s=18,
    )
    ax.set(xscale="log", yscale="log", xlabel="tolerance (pixels)", title=f"detector {detector}")
    ax.set_xticks([0.5, 1, 2, 4, 8], ["0.5", "1", "2", "4", "8"])
    ax.set_xticks([], minor=True)
axes[0].set_ylabel("s.d. of the displaced length (pixels)")
fig.colorbar(dots, ax=axes, label="|frequency − prediction|")
fig.suptitle("Where the quantization model holds (3,000 images each: noise up to 0.009)")
plt.show()

print("                                     root mean square (largest) of frequency − prediction")
print("tolerance (px)   spread (px)   dots   axes              area")
for low, high in ((0.3, 1), (1, 2), (2, 8)):
    for lowest, highest in ((0.03, 0.3), (0.3, 1), (1, 5)):
        chosen = (
            (tolerance_px >= low)
            & (tolerance_px < high)
            & (spread_px >= lowest)
            & (spread_px < highest)
        )
        columns = ""
        for values in misses.values():
            chosen_values = np.array(values)[chosen]
            columns += f"{np.sqrt(np.mean(chosen_values**2)):8.3f} ({chosen_values.max():.3f})  "
        print(f"{low:5} to {high:<5} {lowest:8} to {highest:<5} {chosen.sum():4d} {columns}")

# %% [markdown]
# **Where the model holds.** With a tolerance of two pixels or more the frequency agrees with the
# prediction to a few hundredths at worst. When the length moves by less than a pixel, they agree
# within the precision of this many images. Between one and two pixels the differences are a few
# hundredths for `axes`, up to about 0.15 for `area` on oblique edges.
#
# **Where it does not.** Suppose the tolerance is below a pixel and the length moves by less than
# about a pixel. Then the two ends are not quantized independently: the length can take only the few
# values of the grid. The position of the *nominal* length on the grid decides whether one of them
# lies within the tolerance. The prediction can then be wrong by more than a half. Eq. 3 is right on
# the average over lengths, but not for each one. A detector that follows a chain of pixels (`area`)
# also has a larger error on oblique edges than eq. 3 says, because its errors along u and v go
# together.
#
# So plan with a tolerance of at least two pixels. The tolerance is (1 − A) times the image length.
# A lens or a distance that gives less needs a subpixel detector, and a smaller effective pixel
# pitch in the prediction.

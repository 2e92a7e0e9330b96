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
# # A robot that reaches every setting
#
# A plan says where the camera is. This notebook plans for the robot that carries it. NIST's test
# part CTC-01 lies on a table, an arm of six joints has the camera at its flange, and two edges are
# measured: one on top of the part and one below.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from aspectgraph import read_solid
from errors.checks import frequency_text, probability_text
from planner import (
    ArmUncertainty,
    Camera,
    Cell,
    Effort,
    Fixturing,
    PoseUncertainty,
    plan_inspection,
    program_text,
    robot_program,
)

EXAMPLES = Path("../examples") if Path("../examples").is_dir() else Path("examples")

solid = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
edges = [1086, 525]
camera = Camera.named("basler-acA2440-20gm-8mm")
uncertainty = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001)


def planned(cell=None):
    """Plan the two edges, for a cell or for no robot."""
    effort = Effort.named("quick")
    return plan_inspection(
        solid, edges, camera, uncertainty, accuracy=0.99, effort=effort, cell=cell
    )


# %% [markdown]
# ## The cell
#
# The cell file holds the robot as a URDF, the hand-eye calibration, the camera's body, obstacles, and two fixturings:
# the part lies on the table as it is, or turned over.

# %%
cell = Cell.from_toml(EXAMPLES / "cell.toml")
print(cell)
print(f"not compared, because the arm is built so: {cell.pairs_left_out}")

# %% [markdown]
# ## Without the robot
#
# A plan for no robot looks up at the lower edge from below. With the part lying on the table as it is, no robot gets
# there. `reachability` lists the joints of each setting in each fixturing, in degrees, or what is in the way.

# %%
alone = planned()
told = cell.reachability(alone, solid)
for row in told.rows():
    print(*row, sep=" | ")

# %% [markdown]
# ## With the robot
#
# With the cell, planning refuses every pose that the robot does not reach, and each setting has its fixturing and
# joints. The cell only forbids poses, so the lower bound holds that is proven without it: this plan needs no setting
# more.

# %%
plan = planned(cell)
for number, setting in enumerate(plan.settings, start=1):
    degrees = np.degrees(setting.joints).round(1) + 0.0
    print(f"setting {number}: {setting.fixturing!r}, joints {degrees.tolist()}")
    print(f"  {setting.arm['clearance_robot_mm']:.0f} mm between {setting.arm['closest']}")
assert plan.complete
assert plan.lower_bound == alone.lower_bound == len(plan.settings)
assert cell.reachability(plan, solid).complete


# %% [markdown]
# This is the arm at both settings, with the camera in blue and the part in grey. Links count as their convex hulls. So
# two links of the arm itself may be the nearest pair, as at setting 1: their hulls leave less room than the links do.


# %%
def draw(axes, known, setting):
    """Draw a robot as it stands in a setting."""
    for name, moves, corners, triangles in known.shapes(setting.axes, setting.fixturing):
        if name == "floor":
            continue
        color = {"camera": "#3d9be0", "part": "#9aa7b5"}.get(
            name, "#e0862b" if moves else "#cfd3d8"
        )
        faces = Poly3DCollection(corners[triangles], facecolors=color, shade=True)
        faces.set_alpha(1.0 if moves or name == "part" else 0.3)
        axes.add_collection3d(faces)
    axes.set(xlim=(-150, 1150), ylim=(-550, 750), zlim=(-400, 800))
    axes.set_box_aspect((1, 1, 0.92), zoom=1.5)
    axes.view_init(elev=22, azim=-50)
    axes.set_axis_off()


def figure_of(known, settings):
    """Draw a robot in several settings."""
    inside = known.with_part(solid)
    figure, axes = plt.subplots(
        1,
        len(settings),
        figsize=(10, 4.6),
        subplot_kw={"projection": "3d", "computed_zorder": True},
    )
    for one, setting in zip(axes, settings, strict=True):
        draw(one, inside, setting)
        turned = "" if setting.angle_deg is None else f", turned by {setting.angle_deg:g}°"
        one.set_title(f"{setting.fixturing}{turned}")
    figure.tight_layout()
    plt.show()


figure_of(cell, plan.settings)

# %% [markdown]
# ## A program
#
# `robot_program` chooses the fixturings, the joints and the order. Every move is proven free of collisions in the model
# of the cell. With the uncertainty of the joints, it states P for each setting with *this* arm and checks it by
# simulation.

# %%
arm = ArmUncertainty(0.0001, PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005))
program = robot_program(plan, solid, cell, speed=0.5, uncertainty=arm)
print(program)
for tour in program.tours:
    for stop in tour.stops:
        rates = ", ".join(
            frequency_text(rate.successes, rate.n) for rate in stop.simulated.values()
        )
        smallest = min(stop.probability.values())
        print(
            f"{tour.fixturing!r}: setting {stop.setting_idx + 1}, P {probability_text(smallest)}, "
            f"simulated {rates}"
        )
assert program.complete

# %% [markdown]
# The text for a controller holds joint targets only, since a pose would leave the choice of the configuration to the
# controller. It begins by asking whether the robot stands at home.

# %%
lines = program_text(program, "urscript").splitlines()
# the day and the digests change
print(*(line for line in lines if "movej([" in line or 'take_image("' in line), sep="\n")

# %% [markdown]
# ## A positioner instead of a second fixturing
#
# Held on a horizontal axis above the table, the part is turned to the camera by a motor. Nobody has to turn it over.
# The angle is one more choice for each setting, and one more axis of the program.

# %%
part2base = np.eye(4)
part2base[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
part2base[:3, 3] = [900.0, 0.0, 300.0]
middle = part2base[:3, :3] @ np.mean(solid.bounds, axis=0) + part2base[:3, 3]
table = cell.fixturings["up"].obstacles
positioner = Fixturing(part2base, table, axis=(middle, (0.0, 1.0, 0.0)), angles=8)
turning = cell.with_fixturings({"positioner": positioner})
turned = planned(turning)
driven = robot_program(turned, solid, turning, speed=0.5)
print(f"angles: {[setting.angle_deg for setting in turned.settings]} degrees")
print(driven)
assert turned.complete
assert driven.complete
assert len(driven.tours) == 1

# %%
figure_of(turning, turned.settings)

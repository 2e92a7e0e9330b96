"""Small models of makers' arms: their lengths by Denavit and Hartenberg, links as cylinders; nothing of a maker's file.

A row is that of Craig's convention: the frame of a joint is Rx(alpha) · Tx(a) · Tz(d) · Rz(theta) from the one before,
mm and degrees, then the limits and the largest speed, degrees. Lengths are those that the makers publish in data sheets
and manuals, limits are rounded. Of FANUC's CRX see Abbes and Poisson, Robotics 13 (2024), 91; of Franka's arm the FCI
documentation, "Denavit-Hartenberg parameters"; of UR5e "DH parameters for calculations of kinematics and dynamics".
ABB's IRB 2400 and FANUC's M-20iD/25 count axis 3 from the horizon.
"""

from __future__ import annotations

import math
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from planner import Robot

IIWA = [
    (0, 0, 360, 0, -170, 170, 85),
    (0, -90, 0, 0, -120, 120, 85),
    (0, 90, 420, 0, -170, 170, 100),
    (0, 90, 0, 0, -120, 120, 75),
    (0, -90, 400, 0, -170, 170, 130),
    (0, -90, 0, 0, -120, 120, 135),
    (0, 90, 0, 0, -175, 175, 135),
]
FRANKA = [
    (0, 0, 333, 0, -166, 166, 125),
    (0, -90, 0, 0, -101, 101, 125),
    (0, 90, 316, 0, -166, 166, 125),
    (82.5, 90, 0, 0, -176, -4, 125),
    (-82.5, -90, 384, 0, -166, 166, 150),
    (0, 90, 0, 0, -1, 215, 150),
    (88, 90, 0, 0, -166, 166, 150),
]
KINOVA = [
    (0, 180, -284.8, 0, -180, 180, 79),
    (0, 90, -11.8, 0, -128, 128, 79),
    (0, -90, -420.8, 0, -180, 180, 79),
    (0, 90, -12.8, 0, -147, 147, 79),
    (0, -90, -314.3, 0, -180, 180, 69),
    (0, 90, 0, 0, -120, 120, 69),
    (0, 90, 167.4, 0, -180, 180, 69),
]
SAWYER = [
    (0, 0, 317, 0, -175, 175, 100),
    (81, -90, 192.5, 0, -219, 131, 76),
    (0, 90, 400, 0, -175, 175, 113),
    (0, -90, -168.5, 0, -175, 175, 113),
    (0, 90, 400, 0, -170, 170, 200),
    (0, -90, 136.3, 0, -170, 170, 200),
    (0, 90, 133.75, 0, -270, 270, 260),
]
YUMI = [
    (0, 0, 166, 0, -168, 168, 180),
    (-30, -90, 0, 180, -143, 43, 180),
    (30, 90, 251.5, 0, -168, 168, 180),
    (40.5, -90, 0, 0, -123, 80, 180),
    (40.5, 90, 265, 180, -290, 290, 400),
    (27, -90, 0, 0, -88, 138, 400),
    (27, 90, 36, 180, -229, 229, 400),
]
UR5E = [
    (0, 0, 162.5, 0, -360, 360, 180),
    (0, 90, 0, 0, -360, 360, 180),
    (-425, 0, 0, 0, -180, 180, 180),
    (-392.2, 0, 133.3, 0, -360, 360, 180),
    (0, 90, 99.7, 0, -360, 360, 180),
    (0, -90, 99.6, 0, -360, 360, 180),
]
CRX = [
    (0, 0, 245, 0, -190, 190, 120),
    (0, -90, 0, -90, -180, 180, 120),
    (540, 180, 0, 0, -270, 270, 180),
    (0, -90, -540, 0, -190, 190, 180),
    (0, 90, 150, 0, -180, 180, 180),
    (0, -90, 0, 0, -225, 225, 180),
]


def _spherical(base, a1, a2, a3, d4, limits, speed, d3=0.0):
    """Rows of an arm with a spherical wrist: height of the shoulder, its offset, upper arm, elbow, forearm."""
    rows = [
        (0, 0, base, 0),
        (a1, -90, 0, -90),
        (a2, 0, d3, 0),
        (a3, -90, d4, 0),
        (0, 90, 0, 0),
        (0, -90, 0, 0),
    ]
    return [(*row, -limit, limit, speed) for row, limit in zip(rows, limits, strict=True)]


ARMS = {
    "abb_irb120": (
        _spherical(290, 0, 270, 70, 302, (165, 110, 90, 160, 120, 400), 250),
        72.0,
        50.0,
    ),
    "abb_irb2400": (
        _spherical(615, 100, 705, 135, 755, (180, 100, 60, 200, 120, 400), 150),
        85.0,
        80.0,
    ),
    "fanuc_m20id25": (
        _spherical(425, 75, 840, 215, 890, (185, 100, 150, 200, 180, 360), 200),
        90.0,
        80.0,
    ),
    "denso_vs060": (
        _spherical(345, 0, 305, -10, 300, (170, 120, 125, 270, 120, 360), 300),
        70.0,
        40.0,
    ),
    "doosan_m1013": (
        _spherical(152.5, 0, 620, 0, 559, (360, 95, 135, 360, 135, 360), 120, 34.5),
        121.0,
        50.0,
    ),
    "fanuc_lr_mate_200id": (
        _spherical(330, 50, 330, 35, 335, (170, 120, 140, 190, 125, 360), 350),
        80.0,
        40.0,
    ),
    "kuka_kr6_r900": (
        _spherical(400, 25, 455, 35, 420, (170, 120, 150, 185, 120, 350), 300),
        80.0,
        50.0,
    ),
    "staubli_tx2_60": (
        _spherical(375, 0, 290, 0, 310, (180, 127, 142, 270, 120, 270), 300, 20),
        70.0,
        40.0,
    ),
    "yaskawa_gp8": (
        _spherical(330, 40, 345, 40, 340, (170, 145, 140, 190, 135, 360), 400),
        80.0,
        40.0,
    ),
    "ur5e": (UR5E, 0.0, 45.0),
    "fanuc_crx10ia": (CRX, 160.0, 50.0),
    "abb_yumi": (YUMI, 0.0, 15.0),
    "franka": (FRANKA, 107.0, 50.0),
    "kinova_gen3": (KINOVA, 0.0, 35.0),
    "kuka_iiwa": (IIWA, 126.0, 60.0),
    "sawyer": (SAWYER, 110.0, 50.0),
}
"""Rows, the flange beyond the last joint, mm, and the radius of the links, mm, by name."""


COUPLED = {"abb_irb2400": ((3, 2, 1.0),), "fanuc_m20id25": ((3, 2, 1.0),)}
"""Axes that the makers' controllers count in another way than these models."""


def urdf_of(name, rows, flange_mm, radius_mm):
    """Return the URDF of an arm; its tip is ``tool0``."""
    poses = [_pose(row) for row in rows]
    ends = [*(pose[:3, 3] for pose in poses[1:]), np.array([0.0, 0.0, flange_mm])]
    parts = [f'<robot name="{name}">', _link("base_link", poses[0][:3, 3], radius_mm, 0.7)]
    parent = "base_link"
    for number, (row, pose, end) in enumerate(zip(rows, poses, ends, strict=True), 1):
        link = f"link_{number}"
        low, high, speed = map(math.radians, row[4:])
        parts += [
            _link(link, end, radius_mm, 0.75),
            f'<joint name="axis_{number}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
            f'{_origin(pose)}<axis xyz="0 0 1"/>'
            f'<limit lower="{low!r}" upper="{high!r}" velocity="{speed!r}" effort="1"/></joint>',
        ]
        parent = link
    parts += [
        '<link name="tool0"/>',
        f'<joint name="flange" type="fixed"><parent link="{parent}"/><child link="tool0"/>'
        f'<origin xyz="0 0 {flange_mm / 1000!r}"/></joint>',
        "</robot>",
    ]
    return "\n".join(parts)


def joint_poses(name):
    """Return the poses (k, 4, 4) of the joints at zero, each in the one before, mm."""
    return np.array([_pose(row) for row in ARMS[name][0]])


def _pose(row):
    a, alpha, d, theta = row[:4]
    pose = np.eye(4)
    turn = Rotation.from_euler("x", alpha, degrees=True)
    pose[:3, :3] = (turn * Rotation.from_euler("z", theta, degrees=True)).as_matrix()
    pose[:3, 3] = np.array([a, 0.0, 0.0]) + turn.apply([0.0, 0.0, d])
    return pose


def _origin(pose):
    xyz = " ".join(repr(float(v)) for v in np.round(pose[:3, 3] / 1000, 9))
    turn = pose[:3, :3]
    pitch = math.asin(max(-1.0, min(1.0, -turn[2, 0])))
    roll = math.atan2(turn[2, 1], turn[2, 2])
    yaw = math.atan2(turn[1, 0], turn[0, 0])
    if abs(turn[2, 0]) > 1 - 1e-12:
        roll = 0.0
        yaw = math.atan2(-turn[0, 1], turn[1, 1])
    angles = (roll, pitch, yaw)
    return f'<origin xyz="{xyz}" rpy="{" ".join(repr(float(v)) for v in angles)}"/>'


def _link(name, end, radius_mm, share):
    """Return a link as a cylinder along a share of the way to the next joint, or as a ball where that is none."""
    length = float(np.linalg.norm(end)) * share
    radius = radius_mm / 1000
    if length < radius_mm:
        body = f'<geometry><sphere radius="{radius!r}"/></geometry>'
    else:
        pose = np.eye(4)
        pose[:3, 3] = end * share / 2
        side, _ = Rotation.align_vectors([end / np.linalg.norm(end)], [[0.0, 0.0, 1.0]])
        pose[:3, :3] = side.as_matrix()
        body = (
            f"{_origin(pose)}<geometry>"
            f'<cylinder radius="{radius!r}" length="{length / 1000!r}"/></geometry>'
        )
    return f'<link name="{name}"><collision>{body}</collision></link>'


def dh_forward(name, joints):
    """Poses (n, 4, 4) of the tip by the matrices of Denavit and Hartenberg, without planner.robotcell, mm."""
    rows, flange_mm, _ = ARMS[name]
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    for k, (a, alpha, d, theta, *_) in enumerate(rows):
        c = np.cos(joints[:, k] + math.radians(theta))
        s = np.sin(joints[:, k] + math.radians(theta))
        ca = math.cos(math.radians(alpha))
        sa = math.sin(math.radians(alpha))
        step = np.zeros((len(joints), 4, 4))
        step[:, 0] = np.stack([c, -s, 0 * c, 0 * c + a], axis=1)
        step[:, 1] = np.stack([s * ca, c * ca, 0 * c - sa, 0 * c - sa * d], axis=1)
        step[:, 2] = np.stack([s * sa, c * sa, 0 * c + ca, 0 * c + ca * d], axis=1)
        step[:, 3, 3] = 1.0
        poses = poses @ step
    tip = np.eye(4)
    tip[2, 3] = flange_mm
    return poses @ tip


@cache
def made_arm(name, around=None, within=0.0, **options):
    """Return one of the arms; limits may be narrowed around joints, rad."""
    rows, flange_mm, radius_mm = ARMS[name]
    if around is not None:
        middle = np.degrees(around)
        rows = [
            (*row[:4], q - math.degrees(within), q + math.degrees(within), row[6])
            for row, q in zip(rows, middle, strict=True)
        ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.urdf"
        path.write_text(urdf_of(name, rows, flange_mm, radius_mm), encoding="utf-8")
        return Robot.from_urdf(path, **{"coupled": COUPLED.get(name, ()), **options})

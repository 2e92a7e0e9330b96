"""Small models of makers' arms: their lengths by Denavit and Hartenberg, links as cylinders; nothing of a maker's file.

A row is that of Craig's convention: the frame of a joint is Rx(alpha) · Tx(a) · Tz(d) · Rz(theta) from the one before,
mm and degrees, then the limits and the largest speed, degrees. Sources: KUKA, LBR iiwa 14 R820, assembly instructions;
Franka Robotics, FCI documentation, "Denavit-Hartenberg parameters" and "Limits for Franka Research 3".
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
    (0, -90, -167.4, 0, -180, 180, 69),
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
ARMS = {
    "kinova_gen3": (KINOVA, 0.0, 40.0),
    "sawyer": (SAWYER, 110.0, 50.0),
    "kuka_iiwa": (IIWA, 126.0, 60.0),
    "franka": (FRANKA, 107.0, 50.0),
}
"""Rows, the flange beyond the last joint, mm, and the radius of the links, mm, by name."""


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
            _link(link, end, radius_mm, 1.0),
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
        return Robot.from_urdf(path, **options)

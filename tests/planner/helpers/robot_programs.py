"""A plan of a block whose poses a made robot reaches, in two fixturings, and its program."""

from functools import cache

import numpy as np
from plan_examples import CAMERA, plan_with, setting
from robot_cells import TABLE, made_cell, pose, views
from scipy.spatial.transform import Rotation

from aspectgraph import Solid
from planner import (
    ArmUncertainty,
    Fixturing,
    PoseUncertainty,
    default_workspace,
    robot_program,
)
from planner.identity import PartRecord

SIZE = np.array([200.0, 120.0, 80.0])
HOME = (0.0, -1.9, 1.7, 0.0, 1.57, 0.0)
ENTITIES = {"near": [[0.0, 0.0, 80.0], [200.0, 0.0, 80.0]], "far": [[0, 120, 80], [200, 120, 80]]}
TURNED = pose((700.0, 60.0, 200.0), Rotation.from_rotvec([np.pi, 0, 0]).as_matrix())
FIXTURINGS = {
    "up": Fixturing(pose((700.0, 0.0, 20.0)), {"table": TABLE}),
    "turned over": Fixturing(TURNED, {"table": TABLE}),
}


def block():
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return Solid(corners * SIZE, faces)


@cache
def cell(name="made_parallel"):
    return made_cell(name, fixturings=FIXTURINGS, home=HOME)


def plan_of(poses, **changes):
    """A plan with a setting at each pose."""
    settings = []
    for cam2world in poses:
        one = setting((0.0, 0.0, 1.0), list(ENTITIES))
        settings.append(type(one)(**{**one.__dict__, "cam2world": cam2world}))
    known = {
        "settings": tuple(settings),
        "lower_bound": 1,
        "uninspectable": {},
        "entities": ENTITIES,
        "workspace": default_workspace(block(), CAMERA),
        "part": PartRecord.of(block()),
    }
    return plan_with(**(known | changes))


@cache
def reached_poses(n_up=3, n_over=2):
    """Poses that only the first fixturing reaches, and poses that only the second one does."""
    rng = np.random.default_rng(5)
    poses = views(rng, 60, SIZE)
    poses[30:, 2, :] *= -1.0
    poses[30:, 1, :] *= -1.0
    poses[30:, :3, 3] += [0.0, 120.0, 80.0]
    known = cell().with_part(block())
    up = np.array([one.reached for one in known.reach(poses, "up")])
    over = np.array([one.reached for one in known.reach(poses, "turned over")])
    first = np.flatnonzero(up & ~over)[:n_up]
    second = np.flatnonzero(over & ~up)[:n_over]
    mixed = np.concatenate([second[:1], first, second[1:]])
    return poses[mixed]


@cache
def program():
    hand_eye = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005)
    return robot_program(
        plan_of(reached_poses()),
        block(),
        cell(),
        speed=0.5,
        uncertainty=ArmUncertainty(1e-4, hand_eye),
    )

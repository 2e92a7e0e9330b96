"""What rounds and ways around cost in a cluttered cell: processor time, ways found, length of the rounds.

A UR10e before a block on a table, between posts, a wall over the block and a plate above. Run from the folder of the
project: ``python benchmarks/running/robot_rounds.py [--settings 10 40] [--pairs 30]
[--seeds 2 3 4 5]``.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "tests" / "planner" / "helpers"))

from robot_cells import TABLE, made_cell, pose, views
from robot_programs import HOME, SIZE, block, plan_of

from planner import Box, Fixturing, robot_program
from planner.robotprogram.moves import Detours, FixturedArm, check_move
from planner.robotprogram.program import JointRates

POSTS = {
    "post 1": Box((430.0, 230.0, 20.0), (470.0, 270.0, 800.0)),
    "post 2": Box((430.0, -270.0, 20.0), (470.0, -230.0, 700.0)),
    "post 3": Box((880.0, -320.0, 20.0), (920.0, -280.0, 600.0)),
    "post 4": Box((930.0, 230.0, 20.0), (970.0, 270.0, 750.0)),
    "post 5": Box((580.0, -350.0, 20.0), (620.0, -310.0, 500.0)),
    "post 6": Box((280.0, -370.0, 20.0), (320.0, -330.0, 900.0)),
    "post 7": Box((280.0, 330.0, 20.0), (320.0, 370.0, 900.0)),
    "wall": Box((500.0, 59.5, 120.0), (950.0, 60.5, 620.0)),
    "plate": Box((500.0, -500.0, 1000.0), (1000.0, 500.0, 1020.0)),
}


def cluttered_cell():
    """Return the cell."""
    fixturing = Fixturing(pose((700.0, 0.0, 20.0)), {"table": TABLE, **POSTS})
    return made_cell(fixturings={"up": fixturing}, home=HOME)


def blocked_pairs(cell, count, rng):
    """Return pairs of joints that the arm reaches and between which the straight move is blocked."""
    known = cell.with_part(block())
    reached = [one for one in known.reach(views(rng, 1500, SIZE), "up") if one.reached]
    arm = FixturedArm(known, "up")
    pairs = []
    while len(pairs) < count:
        chosen = rng.choice(len(reached), 2, replace=False)
        start, end = (reached[k].branches[0] for k in chosen)
        if not check_move(arm, start, end).free:
            pairs.append((start, end))
    return arm, pairs


def ways_around(cell, count, seed):
    """Print how many ways are found with the usual trials and thoroughly, and how much longer they take."""
    arm, pairs = blocked_pairs(cell, count, np.random.default_rng(seed))
    rates = JointRates(0.5 * cell.robot.speeds, cell.robot.accelerations)
    for thorough in (False, True):
        detours = Detours(arm, rates)
        started = time.process_time()
        ways = [
            detours.find(start, end, [seed, k], thorough=thorough)
            for k, (start, end) in enumerate(pairs)
        ]
        seconds = time.process_time() - started
        longer = [
            detours.seconds(way) / detours.seconds(np.array(pair))
            for way, pair in zip(ways, pairs, strict=True)
            if way is not None
        ]
        kind = "thoroughly" if thorough else "usually"
        print(
            f"ways {kind}, seed {seed}: {len(longer)} of {count} found, {seconds:.1f} s, "
            f"{np.mean(longer):.2f} times the straight move"
        )


def rounds(cell, count):
    """Print what a round of so many settings costs."""
    known = cell.with_part(block())
    poses = views(np.random.default_rng(8), 60 * count, SIZE)
    reach = known.reach(poses, "up")
    plan = plan_of(np.array([poses[k] for k, one in enumerate(reach) if one.reached][:count]))
    robot_program(plan, block(), cell)
    started = time.process_time()
    program = robot_program(plan, block(), cell)
    seconds = time.process_time() - started
    moves = [move for tour in program.tours for move in tour.moves]
    around = sum(move.is_detour for move in moves)
    print(
        f"{count} settings: {seconds:.2f} s; round {program.seconds:.1f} s, "
        f"{around} of {len(moves)} moves go around, {len(program.unreached)} unreached"
    )


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--settings", type=int, nargs="*", default=[10, 40])
    parser.add_argument("--pairs", type=int, default=30)
    parser.add_argument("--seeds", type=int, nargs="*", default=[2])
    options = parser.parse_args()
    cell = cluttered_cell()
    for count in options.settings:
        rounds(cell, count)
    for seed in options.seeds:
        ways_around(cell, options.pairs, seed)


if __name__ == "__main__":
    main()

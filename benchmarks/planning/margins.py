"""What the margin step does to the settings of plans: least share of room and P_all, before and after.

    aspectgraph plan part.step --all --give-up 0 --out plan
    python benchmarks/planning/margins.py plan/plan.json [more plans] [--give-up 0.001] [--poses 4000]

A plan that was made with ``--give-up 0`` has the poses at which the search ended. Its request is read from the file,
the visible regions are computed again, and each setting is moved as a plan would move it. Printed are the least share
and its condition, P_all of all targets of the setting together, and the processor time of the step.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from ground.shared import Shared
from planner import read_plan
from planner.app.job import read_job
from planner.app.parsing import parse
from planner.callbacks import Deadline
from planner.inspection import _problem
from planner.resolve_request import ResolvedRequest
from planner.search.columns import Judge
from planner.search.evolution import Centring, least_share
from planner.search.realise_column import centre_setting
from planner.verify.joint_counts import DisplacedChecks


def request_of(path):
    """Return the request of a plan file, with the regions of its targets."""
    job = read_job(parse(["plan", "--again", path]))
    asked = job.request
    resolved = ResolvedRequest(asked, job.wanted.entities)
    return _problem(job.solid, resolved, job.options, Deadline()), asked.effort


def main(argv=None):
    """Move the settings of plans and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plans", nargs="+")
    parser.add_argument("--give-up", type=float, default=0.001)
    parser.add_argument("--poses", type=int, default=4000)
    args = parser.parse_args(argv)
    all_before = []
    all_after = []
    print(
        f"{'plan':24} {'setting':>7} {'share':>7} {'P_all':>7}    {'share':>7} {'P_all':>7} {'s':>6}"
    )
    for path in args.plans:
        plan = read_plan(path)
        request, effort = request_of(path)
        centring = Centring.of(effort.giving_up(args.give_up))
        shared = Shared(Judge(request, effort))
        for k, setting in enumerate(plan.settings):
            own = request.at_pose(setting.cam2world, setting.entities)
            checks = DisplacedChecks(own, setting.entities)
            began = time.process_time()
            # few poses, as P_all is counted below
            pose = centre_setting(shared, setting, k, 1000, centring).cam2world
            seconds = time.process_time() - began
            row = []
            for at in (setting.cam2world, pose):
                least = least_share(own, at)
                counts = checks.count(at, args.poses, seed=1)
                share = np.nan if least is None else least.share
                row.append(
                    (share, counts.together / args.poses, "" if least is None else least.condition)
                )
            (before, p_before, _), (after, p_after, condition) = row
            all_before.append(before)
            all_after.append(after)
            print(
                f"{plan.part[:24]:24} {k + 1:7} {before:7.4f} {p_before:7.4f} -> {after:7.4f} {p_after:7.4f} "
                f"{seconds:6.2f}  {condition}"
            )
    for name, found in (("before", all_before), ("after", all_after)):
        values = np.array(found)
        tenth, twentieth = ((values >= limit).sum() for limit in (0.1, 0.05))
        print(f"{name}: {tenth} of {len(values)} settings have 10 % left, {twentieth} have 5 %")


if __name__ == "__main__":
    sys.exit(main())

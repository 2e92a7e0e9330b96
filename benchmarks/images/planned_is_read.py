"""Whether what a plan promises is read: readings made, against the sum of their P_all, on rendered matt parts.

Plans have lamps. For each pair of a plan and its part, parts are drawn whose surfaces deviate, and cameras are
displaced, as in `measured_parts`. One image is rendered for each that the plan takes, under its lamps, with the lens
distortion of its camera. A reading is planned if the plan lights a target in a setting. It is made if `planner.measure`
reads it in some image of this setting. Of readings with the promise P_all, at least this share should be made. A table
names the reasons of the rest.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections import Counter

# before numpy: threads of small matrices only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from measured_parts import Condition, Model, rendered

from planner import Localisation, MeasureOptions, Registration
from planner.rows import measured_rows

# names of entities and numbers, which reasons are counted without
_NAMES = re.compile(r"\b[era]\d+(\+[era]\d+)*(\[[^]]*\])?")
_PERCENT = re.compile(r"\d+ %")


@dataclass
class Planned:
    """One planned reading: its promise, and what became of it; errors are nan where none was made."""

    part: str
    seed: int
    setting: int
    name: str
    promise: float
    reason: str
    error: float = np.nan
    u: float = np.nan

    @property
    def is_made(self) -> bool:
        """Whether there is a value."""
        return not self.reason


def planned_readings(model: Model, seed: int, results) -> list[Planned]:
    """Return what became of all readings that a plan lights."""
    stated = measured_rows(model.plan)
    rows = {(row.setting - 1, row.name): row.promise for own in stated for row in own}
    readings = []
    for k, lit in enumerate(model.plan.light.images):
        for name in dict.fromkeys(name for image in lit for name in image.contrast):
            own = [one for one in results[name].readings if one.setting == k]
            made = [one for one in own if one.measured]
            reading = Planned(model.name, seed, k, name, rows[k, name], "no image")
            readings.append(reading)
            if not own:
                continue
            reading.reason = "" if made else own[0].reason
            if made and (k, name) in model.measured:
                best = min(made, key=lambda one: one.standard_uncertainty)
                truth = model.part.true_value(model.measured[k, name])
                reading.error = best.value - model.plan.dimensions[name].nominal - truth
                reading.u = best.standard_uncertainty
    return readings


def kind_of(reason: str) -> str:
    """Return a reason without names and numbers."""
    return _PERCENT.sub("n %", _NAMES.sub("it", reason))


def show(readings: list[Planned]) -> None:
    """Print a line for each part, and the reasons."""
    print(
        f"{'part':<26}{'planned':>8}{'promised':>9}{'made':>6}{'share':>7}"
        f"{'rms':>7}{'u':>7}{'in 2u':>7}{'worst':>7}   µm, mdeg; worst in u"
    )
    for part in dict.fromkeys(one.part for one in readings):
        own = [one for one in readings if one.part == part]
        made = [one for one in own if one.is_made]
        known = [one for one in made if np.isfinite(one.error)]
        text = f"{part:<26}{len(own):>8}{sum(one.promise for one in own):>9.1f}{len(made):>6}"
        text += f"{len(made) / len(own):>7.2f}"
        if known:
            error = np.array([one.error for one in known])
            u = np.array([one.u for one in known])
            text += f"{1000 * np.sqrt(np.mean(error**2)):>7.1f}{1000 * u.mean():>7.1f}"
            text += f"{np.mean(np.abs(error) <= 2 * u):>7.3f}{np.max(np.abs(error) / u):>7.2f}"
        print(text)
        reasons = Counter(kind_of(one.reason) for one in own if not one.is_made)
        for reason, n in reasons.most_common(8):
            print(f"    {n:3d}  {reason}")


def main() -> int:
    """Measure all parts, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--pair", nargs=2, action="append", required=True, metavar=("PLAN", "PART"), type=Path
    )
    parser.add_argument("--draws", type=int, default=2, help="parts of each model")
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    parser.add_argument("--surfaces-mm", type=float, default=0.03, help="stated deviation")
    parser.add_argument("--exposure", type=float, default=1.0)
    parser.add_argument("--gloss", type=float, default=0.0)
    parser.add_argument("--floor", type=float, default=0.01, help="of the localisation, px")
    parser.add_argument("--keep", type=Path, help="folder of images to use again")
    parser.add_argument("--verbose", action="store_true", help="print each reading")
    options = parser.parse_args()
    how = MeasureOptions(
        Registration.own_edges(options.surfaces_mm),
        Localisation.gaussian(0.1, floor_px=options.floor),
    )
    readings: list[Planned] = []
    for plan, part in options.pair:
        model = Model(plan.parent.name, plan, part)
        if model.plan.light is None or model.plan.light.area is not None:
            parser.error(f"{plan} must be a plan with small lamps")
        for seed in range(options.first, options.first + options.draws):
            images = rendered(model, seed, Condition(), options)
            drawn = planned_readings(model, seed, model.measurer.measure(images, how))
            readings += drawn
            if options.verbose:
                for one in drawn:
                    print(one, file=sys.stderr, flush=True)
    show(readings)
    return 0


if __name__ == "__main__":
    sys.exit(main())

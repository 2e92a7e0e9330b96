"""Tables III and IV of Yang and Ciarallo (2001) with our reconstruction of their objects.

``python benchmarks/planning/paper_tables.py --runs 5 --out notebooks/table_iii.csv``

That is all of Table III: 18 rows of 5 runs on 10 entities each. The notebook tables_iii_iv reads that file and repeats
a part of it.

The paper does not print its ε. A total over N individuals scatters with N, so ε is set per individual: a run ends when
the mean fitness of the population has changed by less than 0.003 in five generations running.
"""

from __future__ import annotations

import argparse
import csv
import time
from dataclasses import asdict, dataclass, fields

import numpy as np
from cases import PAPER_CAMERA, PAPER_UNCERTAINTY, TABLE_IV, regions

from planner import Search, SensorSetting, plan_setting

EPSILON_PER_INDIVIDUAL = 0.003
ENTITIES = [("slotted", f"e{k}") for k in range(1, 5)] + [("block", f"e{k}") for k in range(1, 7)]
"""The ten entities of Table III: four of Table I's object, six of Table II's."""

PAPER_TABLE_III = [
    (0.9, 0.1, 110, 0.95, 104, 135),
    (0.9, 0.1, 100, 0.95, 105, 136),
    (0.9, 0.1, 90, 0.95, 109, 141),
    (0.9, 0.1, 70, 0.95, 114, 148),
    (0.9, 0.1, 50, 0.95, 132, 168),
    (0.9, 0.1, 20, 0.95, 189, 242),
    (0.7, 0.3, 100, 0.93, 252, 328),
    (0.7, 0.3, 50, 0.92, 288, 373),
    (0.7, 0.3, 20, 0.92, 579, 754),
    (0.5, 0.5, 100, 0.92, 507, 660),
    (0.5, 0.5, 50, 0.90, 522, 677),
    (0.5, 0.5, 20, 0.89, 927, 1208),
    (0.3, 0.7, 100, 0.80, 738, 958),
    (0.3, 0.7, 50, 0.78, 492, 642),
    (0.3, 0.7, 20, 0.70, 366, 473),
    (0.1, 0.9, 100, 0.50, 431, 561),
    (0.1, 0.9, 50, 0.45, 298, 389),
    (0.1, 0.9, 20, 0.30, 135, 173),
]
"""P_c, P_m, N, probability, generations, seconds on their machine."""

PAPER_TABLE_IV = [
    (0.96, 0.96),
    (0.94, 0.94, 0.90),
    (0.92, 0.93, 0.89, 0.92, 0.92),
    (0.94, 0.93, 0.93, 0.94),
]
"""P per entity of the four sets `cases.TABLE_IV`."""


@dataclass(frozen=True)
class TableRun:
    """One run of Table III.

    Attributes
    ----------
    crossover, mutation, population : float, float, int
        P_c, P_m, N.
    part, entity, seed : str, str, int
        What was searched.
    best : float
        Best probability of the run.
    last_mean : float
        Mean probability of the last population.
    generations : int
        Generations until the end.
    seconds : float
        Processor time.
    """

    crossover: float
    mutation: float
    population: int
    part: str
    entity: str
    seed: int
    best: float
    last_mean: float
    generations: int
    seconds: float


def paper_setting(
    part: str, names, search: Search, seed: int, callback=None, inside_mm: float = 0.0
) -> SensorSetting:
    """Plan a setting on one of the two blocks with the paper's parameters, perhaps away from the domains' boundary."""
    return plan_setting(
        regions(part),
        names,
        PAPER_CAMERA,
        PAPER_UNCERTAINTY,
        accuracy=0.98,
        field_margin_px=0.0,
        search=search,
        rng=seed,
        callback=callback,
        visibility_radius_mm=inside_mm,
    )


def table_run(
    crossover: float, mutation: float, population: int, part: str, entity: str, seed: int
) -> TableRun:
    """Run the paper's plain algorithm once for one entity."""
    means = []
    search = Search.paper(
        population=population,
        crossover=crossover,
        mutation=mutation,
        epsilon=EPSILON_PER_INDIVIDUAL * population,
    )
    start = time.process_time()
    setting = paper_setting(
        part, [entity], search, seed, lambda generation: means.append(generation.fitness.mean())
    )
    seconds = time.process_time() - start
    how = (crossover, mutation, population, part, entity, seed)
    return TableRun(*how, setting.fitness, float(means[-1]), setting.generations, seconds)


def table_iv(seed: int, inside_mm: float = 0.0) -> list[SensorSetting]:
    """Return the setting of the default search for every set of Table IV."""
    return [
        paper_setting("block", names, Search(), seed, inside_mm=inside_mm) for names in TABLE_IV
    ]


def main() -> None:
    """Run Table III row by row and write every run to a file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--runs", type=int, default=1, help="runs per entity and row; the paper's table has 5"
    )
    parser.add_argument("--out", default="table_iii.csv")
    arguments = parser.parse_args()
    with open(arguments.out, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(
            file, [field.name for field in fields(TableRun)], lineterminator="\n"
        )
        writer.writeheader()
        for seed in range(arguments.runs):
            for row in PAPER_TABLE_III:
                runs = [table_run(*row[:3], *entity, seed) for entity in ENTITIES]
                writer.writerows(asdict(run) for run in runs)
                file.flush()
                best, mean, nit = (
                    np.mean([getattr(r, k) for r in runs])
                    for k in ("best", "last_mean", "generations")
                )
                print(
                    f"{row[:3]}: best {best:.4f}, last population {mean:.4f}, {nit:.0f} generations",
                    flush=True,
                )


if __name__ == "__main__":
    main()

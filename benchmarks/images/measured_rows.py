"""Readings of many parts, pooled: tables of bias, spread and coverage, with intervals that respect what they share.

Readings of one image share its pose and its surfaces, so they are not independent. A cluster is one view of a part:
the readings of one setting of one part that was drawn. Views of a setting share where light and perspective move their
edges; a wider cluster holds one setting of one part model, whatever was drawn. The interval of a coverage comes from
drawing clusters with replacement (bootstrap).
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

DRAWS = 4000
KINDS = {"centre_distance": "distance", "centre_to_edge": "distance"}


@dataclass
class Row:
    """One reading: truth and reading are deviations from nominal, mm or degrees; sources are standard deviations."""

    part: str
    draw: int
    condition: str
    image: str
    name: str
    kind: str
    truth: float
    read: float
    u: float
    pixel: float
    reason: str
    notes: str = ""
    pose: float = np.nan
    surfaces: float = np.nan
    random: float = np.nan
    floor: float = np.nan

    @property
    def is_read(self) -> bool:
        """Whether there is a value."""
        return not self.reason

    @property
    def error(self) -> float:
        """Reading less truth."""
        return self.read - self.truth

    @property
    def inside(self) -> bool:
        """Whether the truth is within 2 u."""
        return abs(self.error) <= 2 * self.u

    @property
    def false(self) -> bool:
        """Whether something else was found: off by more than a pixel and 3 u."""
        return abs(self.error) > max(self.pixel, 3 * self.u)

    @property
    def refused(self) -> bool:
        """Whether its image was not registered."""
        return "cannot be registered" in self.reason

    @property
    def view(self) -> tuple:
        """The view of a part that it is from."""
        return (self.part, self.draw, self.image)

    @property
    def setting(self) -> tuple:
        """The setting of a part model that it is from."""
        return (self.part, self.image)


def truth_of(result, truth) -> float | None:
    """Return the true deviation of a value, from those by number of the setting and name; None if it is not known.

    Settings may measure a dimension at other places of the part. A value from several such readings has no true value.
    """
    used = [one for one in result.readings if one.measured] or result.readings
    places = {truth.get((one.setting, result.name)) for one in used}
    return places.pop() if len(places) == 1 else None


def rows_of(results, plan, truth, part: str, draw: int, condition: str) -> list[Row]:
    """Return the rows of one measured part; ``truth`` has true deviations by number of the setting and name."""
    rows = []
    for one in results:
        reading = min(
            one.readings, key=lambda r: (not r.measured, r.standard_uncertainty), default=None
        )
        true = truth_of(one, truth)
        if true is None:
            # not planned, or its true value is not known
            continue
        target = plan.dimensions[one.name]
        pixel = np.inf
        if target.unit == "mm":
            pose = plan.settings[reading.setting].cam2world
            pixel = target.permitted_error / target.permitted_error_px(pose, plan.camera)
        budget = {name: np.sqrt(max(value, 0.0)) for name, value in one.budget.items()}
        rows.append(
            Row(
                *(part, draw, condition, reading.image, one.name, KINDS.get(one.kind, one.kind)),
                *(true, one.deviation, one.standard_uncertainty, pixel),
                one.reason,
                "; ".join(one.notes),
                *(budget.get(s, np.nan) for s in ("pose", "surfaces", "localisation")),
                budget.get("localisation floor", np.nan),
            )
        )
    return rows


def interval(rows: Sequence[Row], cluster: Callable[[Row], tuple]) -> tuple[int, float, float]:
    """Return the number of clusters, and the 95 % interval of the share within 2 u by drawing clusters."""
    keys = sorted({cluster(row) for row in rows})
    number = {key: k for k, key in enumerate(keys)}
    own = np.array([number[cluster(row)] for row in rows])
    total = np.bincount(own, minlength=len(keys))
    inside = np.bincount(own, [row.inside for row in rows], minlength=len(keys))
    drawn = np.random.default_rng(1).integers(0, len(keys), (DRAWS, len(keys)))
    shares = inside[drawn].sum(axis=1) / total[drawn].sum(axis=1)
    return len(keys), *np.quantile(shares, [0.025, 0.975])


HEAD = (
    f"{'n':>5}{'read':>6}{'bias':>8}{'rms':>8}{'u':>8}{'e/u':>6}{'in 2u':>7}"
    f"{'views':>7} {'interval':<13}{'settings':>9} {'interval':<13}{'false':>6}{'refused':>8}"
)


def line(rows: Sequence[Row]) -> str:
    """Return the numbers of some rows, as `HEAD` names them."""
    good = [row for row in rows if row.is_read]
    text = f"{len(rows):5d}{len(good):6d}"
    refused = sum(row.refused for row in rows)
    if not good:
        return f"{text}{'':>82}{refused:8d}"
    error = np.array([row.error for row in good]) * 1000
    u = np.array([row.u for row in good]) * 1000
    views = interval(good, lambda row: row.view)
    settings = interval(good, lambda row: row.setting)
    bounds = [f"{low:.3f}..{high:.3f}" for _, low, high in (views, settings)]
    return (
        f"{text}{error.mean():8.1f}{np.sqrt((error**2).mean()):8.1f}{u.mean():8.1f}"
        f"{np.sqrt(np.mean((error / u) ** 2)):6.2f}{np.mean([row.inside for row in good]):7.3f}"
        f"{views[0]:7d} {bounds[0]:<13}{settings[0]:9d} {bounds[1]:<13}"
        f"{sum(row.false for row in good):6d}{refused:8d}"
    )


def show(rows: Sequence[Row], by_part: bool = False) -> None:
    """Print a line for each condition and kind; µm and thousandths of a degree."""
    width = max(len(row.condition) for row in rows) + 2
    print(f"{'condition':<{width}}{'of':<12}{HEAD}   µm, mdeg")
    for condition in dict.fromkeys(row.condition for row in rows):
        own = [row for row in rows if row.condition == condition]
        groups = {"all": own}
        for kind in sorted({row.kind for row in own}):
            groups[kind] = [row for row in own if row.kind == kind]
        if by_part:
            for part in dict.fromkeys(row.part for row in own):
                groups[part] = [row for row in own if row.part == part]
        for name, some in groups.items():
            print(f"{condition:<{width}}{name[:11]:<12}{line(some)}")


def write(rows: Sequence[Row], path: Path) -> None:
    """Write rows to a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows(map(asdict, rows))


def read(path: Path) -> list[Row]:
    """Read rows of a CSV file."""
    types = {one.name: one.type for one in fields(Row)}
    to = {"int": int, "float": float, "str": str}
    with path.open(newline="", encoding="utf-8") as file:
        return [
            Row(**{name: to[types[name]](value) for name, value in own.items()})
            for own in csv.DictReader(file)
        ]


def main() -> int:
    """Print the table of CSV files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--by-part", action="store_true")
    options = parser.parse_args()
    show([row for path in options.files for row in read(path)], options.by_part)
    return 0


if __name__ == "__main__":
    sys.exit(main())

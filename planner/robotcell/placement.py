"""Where to put the part so that the robot reaches the settings of a plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.argument_kinds import check_count, shown, suggests_names
from planner.exceptions import RobotError
from planner.robotcell.bodies import SKIN_MM, Fixturing
from planner.robotcell.cell import Cell, reachability_of
from planner.robotcell.hand import axes_of
from planner.robotcell.reachability import Reachability
from planner.robotcell.urdf import carry
from planner.text_table import count

if TYPE_CHECKING:
    from aspectgraph import Solid


_KEPT = 10


@dataclass(frozen=True, eq=False, kw_only=True)
class Reached:
    """What a cell reaches of a plan, and how well.

    Attributes
    ----------
    reachability : Reachability
        What is reached.
    n_reached : int
        Settings that are reached in some fixturing.
    singular_value : float
        The smallest of the Jacobian, lengths divided by 500 mm: of each setting in its best joints, of these the worst.
    to_limit_rad : float
        Least distance of these joints from their limits, rad.
    """

    reachability: Reachability
    n_reached: int
    singular_value: float
    to_limit_rad: float

    @property
    def worth(self) -> tuple[float, ...]:
        """What places are ordered by, the best first; digits that noise decides are left out."""
        return -self.n_reached, -round(self.singular_value, 6), -round(self.to_limit_rad, 6)

    def numbers(self) -> dict[str, Any]:
        """Return what is reached, as plain values.

        Returns
        -------
        dict
            By attribute, without the joints.
        """
        return {
            "reached": self.n_reached,
            "singular_value": self.singular_value,
            "to_limit_rad": self.to_limit_rad,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement(Reached):
    """A position of the part before the robot, and what is reached there.

    Attributes
    ----------
    centre_mm : tuple of float
        Middle of the part's bounding box in the base, mm.
    turn_deg : float
        Turn about the vertical from the fixturings that were given.
    motion : array (4, 4)
        The motion from the fixturings that were given, in the base, mm: `Cell.moved` takes it.
    fixturings : mapping of str to Fixturing
        The part and its obstacles there. These were evaluated: tables and clamps move with the part.
    """

    centre_mm: tuple[float, float, float]
    turn_deg: float
    motion: np.ndarray
    fixturings: Mapping[str, Fixturing]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        middle = ", ".join(f"{number:.1f}" for number in self.centre_mm)
        reached = f"{self.n_reached} of {count(len(self.reachability.settings), 'setting')} reached"
        return f"<Placement at ({middle}) mm, turned by {self.turn_deg:g}°: {reached}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain values.

        Returns
        -------
        dict
            By attribute, ``moved_with_part``: the obstacles that moved by ``motion``, and
            ``part2base`` of each fixturing, with the ``axis`` of a turntable.
        """
        return {
            "centre_mm": list(self.centre_mm),
            "turn_deg": self.turn_deg,
            "motion": self.motion.tolist(),
            **self.numbers(),
            "moved_with_part": {
                name: [*fixturing.obstacles, *fixturing.turning]
                for name, fixturing in self.fixturings.items()
            },
            "part2base": {
                name: fixturing.part2base.tolist() for name, fixturing in self.fixturings.items()
            },
            **({"axis": axes} if (axes := axes_of(self.fixturings)) else {}),
        }


@suggests_names
def propose_placements(
    plan: Any,
    solid: Solid,
    cell: Cell,
    *,
    x: Sequence[float],
    y: Sequence[float],
    z: Sequence[float] | None = None,
    draws: int = 300,
    rng: int = 0,
) -> tuple[Placement, ...]:
    """Draw positions of the part, and rank them by how many settings of a plan the robot reaches.

    All fixturings move together with their obstacles, and turn about the vertical. These obstacles
    must stand clear of all others and of the robot's base. They may be 1 mm deep in them, or 1 mm
    deeper than in the cell that was given. The middle of the part in the first fixturing comes to the
    drawn position. Of equal numbers of settings, the position comes first whose worst setting is
    farthest from singular joints, then from limits.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    cell : Cell
        Robot and fixturings.
    x, y, z : sequence of float
        Ranges (2,) of the middle of the part's bounding box in the base, mm. Without `z`, its
        height stays.
    draws : int
        Positions to try.
    rng : int
        Seed.

    Returns
    -------
    tuple of Placement
        At most ten, the best first. Empty if every position puts the part through something.

    Raises
    ------
    RobotError
        If a range is none, or the part goes through something that moves with it.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, propose_placements, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> cell = Cell.from_toml("examples/cell.toml")
    >>> found = propose_placements(plan, block, cell, x=(500, 900), y=(0, 300), draws=5)
    >>> found[0].n_reached, len(plan.settings)
    (1, 1)
    """
    search = PlacementSearch(plan, solid, cell, (x, y, z))
    return search.run(draws, rng)


class PlacementSearch:
    """What `propose_placements` does, with its progress.

    Parameters
    ----------
    plan, solid, cell
        As `propose_placements` takes them.
    ranges : sequence of sequence of float
        Its `x`, `y` and `z`.
    """

    def __init__(
        self, plan: Any, solid: Solid, cell: Cell, ranges: Sequence[Sequence[float] | None]
    ) -> None:
        self._plan = plan
        lying = next(iter(cell.fixturings.values()))
        if not isinstance(lying, Fixturing):
            rule = "must hold the part on a fixturing to search for its position"
            raise RobotError.of_rule("cell", rule, "a part in the hand")
        first = lying.part2base
        corners = np.asarray(solid.bounds, dtype=np.float64)
        self._middle = carry(first, corners.mean(axis=0)[None])[0]
        height = (self._middle[2], self._middle[2])
        x, y, z = ranges
        self._ranges = np.array(
            [_range("x", x), _range("y", y), _range("z", height if z is None else z)]
        )
        self._inside = cell.with_part(solid, check=False)
        self._inside.check_fixturings()
        self._depths = dict(self._inside.fixture_depths())

    def run(
        self, draws: int, rng: int, progress: Callable[[int, int, str], object] | None = None
    ) -> tuple[Placement, ...]:
        """Return the best placements, and call ``progress(done, total, label)`` on the way."""
        check_count("draws", draws, 1)
        low, high = self._ranges.T
        placements: list[Placement] = []
        for done, shares in enumerate(np.random.default_rng(rng).random((draws, 4)), start=1):
            centre = low + shares[:3] * (high - low)
            motion = _motion(self._middle, centre, 2 * np.pi * float(shares[3]))
            turn_deg = 360.0 * float(shares[3])
            moved = self._inside.moved(motion)
            placement = None
            if self._stands_clear(moved):
                placement = self._placement(moved, centre, turn_deg, motion)
            if placement is not None:
                placements.append(placement)
                placements.sort(key=lambda place: place.worth)
                del placements[_KEPT:]
            if progress is not None:
                progress(done, draws, "positions of the part")
        return tuple(placements)

    def _placement(
        self, cell: Cell, centre: np.ndarray, turn_deg: float, motion: np.ndarray
    ) -> Placement | None:
        """Return what is reached at a position; None if the part or home does not stand free there."""
        reached = reached_in(cell, self._plan)
        if reached is None:
            return None
        x, y, z = centre.tolist()
        return Placement(
            centre_mm=(x, y, z),
            turn_deg=turn_deg,
            motion=motion,
            fixturings=cell.fixturings,
            **vars(reached),
        )

    def _stands_clear(self, cell: Cell) -> bool:
        """Return whether fixtures are no deeper in other objects than in the cell that was given."""
        enough = SKIN_MM + max(self._depths.values(), default=0.0)
        return all(mm <= SKIN_MM + self._depths[names] for names, mm in cell.fixture_depths(enough))


def _range(name: str, value: Any) -> tuple[float, float]:
    try:
        low, high = (float(number) for number in value)
    except (TypeError, ValueError):
        low = high = np.nan
    if not (np.isfinite([low, high]).all() and low <= high):
        raise RobotError.of_rule(name, "must be two finite numbers, the lower first", shown(value))
    return low, high


def _motion(middle: np.ndarray, centre: np.ndarray, turn: float) -> np.ndarray:
    """Return the pose (4, 4) that turns about the vertical through one point and carries it to another."""
    motion = np.eye(4)
    cosine = np.cos(turn)
    sine = np.sin(turn)
    motion[:2, :2] = [[cosine, -sine], [sine, cosine]]
    motion[:3, 3] = centre - motion[:3, :3] @ middle
    return motion


def reached_in(cell: Cell, plan: Any) -> Reached | None:
    """Return what a cell reaches with the part in it; None if the part or home does not stand free.

    Parameters
    ----------
    cell : Cell
        With the part, unchecked.
    plan : InspectionPlan
        The plan.
    """
    try:
        cell.check_place()
    except RobotError:
        return None
    reachability = reachability_of(cell, plan, all_branches=True)
    singular = []
    limits = []
    for poses in zip(*reachability.poses.values(), strict=True):
        q = np.concatenate([pose.joints for pose in poses])
        if len(q):
            values = cell.robot.singular_value(q)
            best = int(values.argmax())
            singular.append(float(values[best]))
            limits.append(float(cell.robot.to_limit_rad(q[best])))
    return Reached(
        reachability=reachability,
        n_reached=len(singular),
        singular_value=min(singular, default=0.0),
        to_limit_rad=min(limits, default=0.0),
    )

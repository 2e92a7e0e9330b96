"""How to lay the part on a table so that the robot reaches a plan: which side, turned how, where, on what post.

**Guarantee.** Each way that is proposed was evaluated as `Cell.reachability` does, with table and
post as obstacles. Table and post touch the part only where it lies on them. Whether a part stands
firmly there, and what clamps it, is not computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from aspectgraph.solid.solid import RayScene
from ground.short_repr import short_repr
from planner.argument_kinds import (
    NOT_NEGATIVE,
    POSITIVE,
    check_count,
    check_number,
    shown,
    suggests_names,
)
from planner.exceptions import RobotError
from planner.robotcell.bodies import (
    SKIN_MM,
    Body,
    Box,
    Fixturing,
    Standing,
    standing_bodies,
    sunk_mm,
)
from planner.robotcell.cell import Cell
from planner.robotcell.cell_light import LightBox
from planner.robotcell.placement import Reached, reached_in
from planner.robotcell.urdf import carry, invert

if TYPE_CHECKING:
    from aspectgraph import Solid

POST_HEIGHTS_MM = (0.0, 25.0, 50.0, 80.0, 100.0, 150.0, 200.0, 250.0, 300.0)
"""Heights of posts and parallel blocks that are tried, mm; 0: the part lies on the table."""

POST_WIDTH_MM = 20.0
"""Side of the square section of posts, mm."""

FLAT_RAD = 1e-3
"""Largest angle between facets of the part's convex hull that lie on a table together, rad."""

TOUCHING_MM = 0.1
"""Points of the part that are this near to the plane it lies on touch it, mm."""

FIRM_RAD = np.radians(15.0)
"""A part that tips over only at this tilt of the table or more is preferred, rad."""

UPRIGHT_RAD = 1e-6
"""Largest tilt of a table, rad."""

_MOST_SIDES = 6
_POST = "post"
# steps along the longer side of what the part lies on, at which posts may stand
_STEPS = 48
_TRIANGLES = 2000
# which of the drawn triangles are tried, the firmest first
_FIRMEST = (0.0, 0.01, 0.05, 0.15)
_KEPT = 10
# of the draws, those that vary the best ways
_VARIED = 0.5
_NEAR_MM = 60.0
_NEAR_RAD = 0.25
# ways that pairs are made of
_PAIRED = 150


class Side(NamedTuple):
    """A flat side of the part's convex hull above whose inside its centre of mass is.

    Attributes
    ----------
    rotation : array (3, 3)
        Turns the part onto this side: its outward normal points down.
    foot : array (3,)
        The part's point in the plane of the side that is below its centre of mass, in the part's frame, mm.
    area_mm2 : float
        Of the hull's side.
    stands : tuple of array (k, 2)
        Ways to put one or three posts below it, each wholly touched by the part: their middles from `foot`, turned by
        `rotation`, mm.
    outline : array (n, 2)
        Corners of what lies on the table, as `stands`.
    height_mm : float
        Of the centre of mass above the side.
    """

    rotation: np.ndarray
    foot: np.ndarray
    area_mm2: float
    stands: tuple[np.ndarray, ...]
    outline: np.ndarray
    height_mm: float

    def tips_at_rad(self, support: np.ndarray) -> float:
        """Return the least tilt of the table that tips the part over, on the hull of points (n, 2) as `stands`, rad."""
        if len(support) < 3:
            return 0.0
        inward = -ConvexHull(support).equations[:, 2]
        return max(0.0, float(np.arctan2(inward.min(), self.height_mm)))


@dataclass(frozen=True)
class Laying:
    """One way to lay the part.

    Attributes
    ----------
    side : int
        Number of the side on which it lies, the largest is 1.
    turn_deg : float
        Turn about the vertical.
    foot_mm : tuple of float
        Where the point below its centre of mass is in the base, x and y, mm.
    post_mm : float
        Height of its posts; 0: it lies on the table.
    stand : int
        Number of the way its posts stand, from 0.
    tips_at_deg : float
        Least tilt of the table that tips the part over, unless it is clamped; 0 on a single post.
    """

    side: int
    turn_deg: float
    foot_mm: tuple[float, float]
    post_mm: float
    stand: int = 0
    tips_at_deg: float = 0.0

    @property
    def name(self) -> str:
        """What the fixturing is called."""
        posts = f" on posts of {self.post_mm:g} mm" if self.post_mm else ""
        return f"side {self.side}{posts}"


@dataclass(frozen=True, eq=False, kw_only=True)
class LaidPart(Reached):
    """One or more ways to lay the part, and what the robot reaches in them.

    Attributes
    ----------
    layings : mapping of str to Laying
        By the name of the fixturing.
    fixturings : mapping of str to Fixturing
        The part there, with table and post: `Cell.with_fixturings` takes them.
    """

    layings: Mapping[str, Laying]
    fixturings: Mapping[str, Fixturing]

    __repr__ = short_repr

    @property
    def worth(self) -> tuple[float, ...]:
        """What proposals are ordered by: settings, fixturings, whether the part stands firmly, then as `Reached`."""
        loose = any(laying.tips_at_deg < np.degrees(FIRM_RAD) for laying in self.layings.values())
        reached, *quality = super().worth
        return reached, len(self.layings), float(loose), *quality

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain values.

        Returns
        -------
        dict
            By attribute, and ``part2base`` of each fixturing.
        """
        return {
            "layings": {
                name: {
                    "side": laying.side,
                    "turn_deg": laying.turn_deg,
                    "foot_mm": list(laying.foot_mm),
                    "post_mm": laying.post_mm,
                    "tips_at_deg": laying.tips_at_deg,
                    "part2base": self.fixturings[name].part2base.tolist(),
                }
                for name, laying in self.layings.items()
            },
            **self.numbers(),
        }


@suggests_names
def propose_layings(
    plan: Any,
    solid: Solid,
    cell: Cell,
    table: str,
    *,
    post_heights_mm: Sequence[float] = POST_HEIGHTS_MM,
    post_width_mm: float = POST_WIDTH_MM,
    most_fixturings: int = 2,
    draws: int = 2000,
    rng: int = 0,
) -> tuple[LaidPart, ...]:
    """Draw ways to lay the part on a table, and rank them by how many settings of a plan the robot reaches.

    The part lies on a flat side of its convex hull that its centre of mass is above, at most on the six largest. It is
    turned about the vertical, and lies on the table, on three square posts around its centre of mass, or on one below
    it. Half of the draws vary the best ways of the other half. Of equal numbers of settings, the fewest fixturings come
    first, then parts that tip over at 15° or more. Then those come whose worst setting is farthest from singular
    joints.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    cell : Cell
        The robot, and what stands around. Of its first fixturing, the table, a backlight and a turntable stay where
        they are, with what stands still below the turntable.
    table : str
        Name of a box with a level top, among the obstacles of the cell or the objects of its first fixturing. On a
        turntable, it must turn with the part. The backlight of a cell file is "light".
    post_heights_mm : sequence of float
        Heights of posts to try, mm; 0: none.
    post_width_mm : float
        Side of their square section, mm.
    most_fixturings : int
        1, or 2 to choose two ways together where one is not enough.
    draws : int
        Ways to try.
    rng : int
        Seed.

    Returns
    -------
    tuple of LaidPart
        At most ten, the best first. Empty if no way is free.

    Raises
    ------
    RequestError
        If a number breaks its rule.
    RobotError
        If there is no such table, the turntable is tilted, or the part is in the hand.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, propose_layings, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> cell = Cell.from_toml("examples/cell.toml")
    >>> found = propose_layings(plan, block, cell, "table", draws=20)
    >>> found[0].n_reached, len(plan.settings)
    (1, 1)
    """
    posts = Posts(tuple(post_heights_mm), post_width_mm)
    search = LayingSearch(plan, solid, cell, table, posts)
    return search.run(draws, rng, most_fixturings)


@dataclass(frozen=True)
class Posts:
    """Square posts that may stand below a part.

    Parameters
    ----------
    heights_mm : tuple of float
        At least one, mm; 0: no post.
    width_mm : float
        Side of the section, mm.

    Raises
    ------
    RequestError
        If a number breaks its rule.
    RobotError
        If there is no height.
    """

    heights_mm: tuple[float, ...] = POST_HEIGHTS_MM
    width_mm: float = POST_WIDTH_MM

    def __post_init__(self) -> None:
        if not self.heights_mm:
            raise RobotError.of_rule("post_heights_mm", "must have at least one height", "none")
        for height in self.heights_mm:
            check_number("post_heights_mm", height, NOT_NEGATIVE)
        check_number("post_width_mm", self.width_mm, POSITIVE)


class _Table(NamedTuple):
    """The level top of a box: its own frame (4, 4) in the base, corners of it there, and the height of the top."""

    frame: np.ndarray
    low: np.ndarray
    high: np.ndarray
    top_mm: float

    def holds(self, points: np.ndarray) -> bool:
        """Return whether points (n, 3) of the base are above the top."""
        placed = carry(invert(self.frame), points)[:, :2]
        return bool(((placed >= self.low[:2]) & (placed <= self.high[:2])).all())

    def carried(self, outline: np.ndarray) -> np.ndarray:
        """Return corners (m, 2) of what is above the top, of the inside of a convex outline (n, 2) of the base.

        The outline is cut along one side of the table after the other (Sutherland and Hodgman, 1974).
        """
        level = np.column_stack([outline, np.full(len(outline), self.top_mm)])
        corners = carry(invert(self.frame), level)[:, :2]
        for axis in (0, 1):
            for sign, border in ((1.0, self.high[axis]), (-1.0, -self.low[axis])):
                corners = _cut(corners, sign * corners[:, axis] - border)
        back = np.column_stack([corners, np.zeros(len(corners))])
        return carry(self.frame, back)[:, :2]


def _cut(corners: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Return the corners (m, 2) of a convex outline (n, 2) whose height over a line (n,) is not positive."""
    result = []
    for k, height in enumerate(beyond.tolist()):
        before = float(beyond[k - 1])
        if (height > 0) is not (before > 0):
            share = before / (before - height)
            result.append(corners[k - 1] + share * (corners[k] - corners[k - 1]))
        if height <= 0:
            result.append(corners[k])
    return np.array(result).reshape(-1, 2)


class _Tried(NamedTuple):
    """A way that was evaluated: its draw, and what it reaches."""

    laying: Laying
    fixturing: Fixturing
    reached: Reached


class LayingSearch:
    """What `propose_layings` does, with its progress.

    Parameters
    ----------
    plan, solid, cell, table
        As `propose_layings` takes them.
    posts : Posts
        What may stand below the part.

    Raises
    ------
    RobotError
        As `propose_layings` says.
    """

    def __init__(
        self, plan: Any, solid: Solid, cell: Cell, table: str, posts: Posts | None = None
    ) -> None:
        self._plan = plan
        self._posts = Posts() if posts is None else posts
        first = _lying(cell)
        self._stays = _what_stays(first, table)
        self._has_light = isinstance(cell.light, LightBox)
        around = {**cell.bodies_around, **first.obstacles, **first.turning}
        self._table = _level_top(table, around)
        taken = any(name.startswith(_POST) for name in around)
        self._post = f"{_POST} under part" if taken else _POST
        self._cell = cell.with_part(solid, check=False)
        self.sides = flat_sides(solid, self._posts.width_mm)
        if not self.sides:
            rule = "must have a flat side below its centre of mass"
            raise RobotError.of_rule("solid", rule, "none")
        self._heights = [0.0 if not height else float(height) for height in self._posts.heights_mm]

    @property
    def turns(self) -> bool:
        """Whether the part is laid on a turntable."""
        return self._stays.first.table is not None

    def run(
        self,
        draws: int,
        rng: int,
        most_fixturings: int = 2,
        progress: Callable[[int, int, str], object] | None = None,
    ) -> tuple[LaidPart, ...]:
        """Return the best ways, and call ``progress(done, total, label)`` on the way."""
        check_count("draws", draws, 1)
        if most_fixturings not in (1, 2):
            raise RobotError.of_rule("most_fixturings", "must be 1 or 2", shown(most_fixturings))
        generator = np.random.default_rng(rng)
        tried: list[_Tried] = []
        for done in range(1, draws + 1):
            best = tried[:_KEPT]
            varies = best and done > (1 - _VARIED) * draws
            laying = self._varied(best, generator) if varies else self._drawn(generator)
            outcome = None if laying is None else self._tried(laying)
            if outcome is not None:
                tried.append(outcome)
                tried.sort(key=lambda way: way.reached.worth)
            if progress is not None:
                progress(done, draws, "ways to lay the part")
        proposals = [self._proposal((way,)) for way in _best_of_sides(tried)]
        # a backlight must be at the same position under the part in every fixturing
        if most_fixturings == 2 and proposals and not self._has_light:
            proposals += [self._proposal(pair) for pair in _best_pairs(tried)]
        proposals.sort(key=lambda way: way.worth)
        return tuple(proposals[:_KEPT])

    def _drawn(self, generator: np.random.Generator) -> Laying | None:
        """Return a way anywhere on the table; None if the post would not carry the part."""
        number = int(generator.integers(len(self.sides)))
        height = self._heights[int(generator.integers(len(self._heights)))]
        turn, across, along = generator.random(3)
        stands = self.sides[number].stands
        if height and not stands:
            return None
        stand = int(generator.integers(len(stands))) if height else 0
        low = self._table.low[:2]
        place = low + np.array([across, along]) * (self._table.high[:2] - low)
        foot = carry(self._table.frame, np.array([[*place, 0.0]]))[0]
        x, y, _ = foot.tolist()
        return Laying(number + 1, 360.0 * float(turn), (x, y), height, stand)

    def _varied(self, best: Sequence[_Tried], generator: np.random.Generator) -> Laying | None:
        """Return a way near one of the best; None if it is beside the table."""
        laying = best[int(generator.integers(len(best)))].laying
        shift = _NEAR_MM * generator.standard_normal(2)
        turn = float(np.degrees(_NEAR_RAD) * generator.standard_normal())
        height = laying.post_mm
        if height and generator.random() < 0.3:
            raised = [mm for mm in self._heights if mm > 0]
            height = raised[int(generator.integers(len(raised)))]
        foot = (laying.foot_mm[0] + float(shift[0]), laying.foot_mm[1] + float(shift[1]))
        if not self._table.holds(np.array([[*foot, self._table.top_mm]])):
            return None
        return replace(
            laying, turn_deg=(laying.turn_deg + turn) % 360.0, foot_mm=foot, post_mm=height
        )

    def _tried(self, laying: Laying) -> _Tried | None:
        """Return what is reached of a way; None if part, post or home is not free there."""
        laying = replace(laying, tips_at_deg=float(np.degrees(self._tips_at_rad(laying))))
        posts = self._posts_of(laying)
        feet = [post.corners() for post in posts.values()]
        if feet and not self._table.holds(np.concatenate(feet)):
            return None
        if any(sunk_mm(*pair, SKIN_MM, SKIN_MM) > SKIN_MM for pair in self._beside(posts)):
            return None
        fixturing = self._fixturing(laying, posts)
        cell = self._cell.with_fixturings({laying.name: fixturing})
        if any(mm > SKIN_MM for names, mm in cell.fixture_depths(SKIN_MM) if names[1] in posts):
            return None
        try:
            cell.check_fixturings()
        except RobotError:
            return None
        reached = reached_in(cell, self._plan)
        return None if reached is None else _Tried(laying, fixturing, reached)

    def _tips_at_rad(self, laying: Laying) -> float:
        """Return at which tilt the part tips over: it may reach beyond the table, which then carries less of it."""
        side = self.sides[laying.side - 1]
        if laying.post_mm:
            return side.tips_at_rad(side.stands[laying.stand])
        turn = _turn_about_vertical(np.radians(laying.turn_deg))[:2, :2]
        outline = side.outline[ConvexHull(side.outline).vertices]
        carried = self._table.carried(outline @ turn.T + laying.foot_mm)
        return side.tips_at_rad((carried - laying.foot_mm) @ turn)

    def _beside(self, posts: Mapping[str, Body]) -> Iterator[tuple[Standing, Standing]]:
        """Yield posts with what stays of the first fixturing."""
        others = self._stays.standing
        for post in standing_bodies(posts, "obstacle") if others else ():
            for other in others:
                yield post, other

    def _fixturing(self, laying: Laying, posts: Mapping[str, Body]) -> Fixturing:
        """Return the part as it lies, with the table where it belongs to fixturings, and its posts."""
        side = self.sides[laying.side - 1]
        turn = _turn_about_vertical(np.radians(laying.turn_deg))
        x, y = laying.foot_mm
        top = self._table.top_mm
        part2base = np.eye(4)
        part2base[:3, :3] = turn @ side.rotation
        foot = np.array([x, y, top + laying.post_mm])
        part2base[:3, 3] = foot - part2base[:3, :3] @ side.foot
        stays = self._stays
        if not self.turns:
            return Fixturing(part2base, {**stays.still, **posts})
        turning = {**stays.turning, **posts}
        return replace(stays.first, part2base=part2base, obstacles=stays.still, turning=turning)

    def _posts_of(self, laying: Laying) -> dict[str, Box]:
        """Return the posts of a way by name; none if the part lies on the table."""
        if not laying.post_mm:
            return {}
        frame = np.eye(4)
        frame[:3, :3] = _turn_about_vertical(np.radians(laying.turn_deg))
        frame[:3, 3] = *laying.foot_mm, self._table.top_mm
        half = self._posts.width_mm / 2
        posts = {}
        stand = self.sides[laying.side - 1].stands[laying.stand]
        for number, (u, v) in enumerate(stand.tolist(), start=1):
            low = (u - half, v - half, 0.0)
            high = (u + half, v + half, laying.post_mm)
            posts[f"{self._post} {number}"] = Box(low, high, frame)
        return posts

    def _proposal(self, ways: Sequence[_Tried]) -> LaidPart:
        names: list[str] = []
        for way in ways:
            name = way.laying.name
            names.append(f"{name}, again" if name in names else name)
        reached = ways[0].reached
        fixturings = {name: way.fixturing for name, way in zip(names, ways, strict=True)}
        if len(ways) > 1:
            both = reached_in(self._cell.with_fixturings(fixturings), self._plan)
            reached = reached if both is None else both
        layings = {name: way.laying for name, way in zip(names, ways, strict=True)}
        return LaidPart(layings=layings, fixturings=fixturings, **vars(reached))


def _best_of_sides(tried: Sequence[_Tried]) -> list[_Tried]:
    """Return the best way on each side, on posts and without."""
    best: dict[tuple[int, bool], _Tried] = {}
    for way in tried:
        best.setdefault((way.laying.side, way.laying.post_mm > 0), way)
    return list(best.values())


def _best_pairs(tried: Sequence[_Tried]) -> list[tuple[_Tried, _Tried]]:
    """Return pairs that reach more settings together than any way alone, the most first."""
    single = tried[0].reached.n_reached
    masks = [way.reached.reachability.reached.any(axis=1) for way in tried[:_PAIRED]]
    # of equal sets of settings only the best way counts
    first = {mask.tobytes(): k for k, mask in reversed(list(enumerate(masks)))}
    # the ways of few settings may be what the best ones lack
    for k, way in enumerate(tried[_PAIRED:], _PAIRED):
        first.setdefault(way.reached.reachability.reached.any(axis=1).tobytes(), k)
    sets = {k: np.frombuffer(key, dtype=bool) for key, k in first.items()}
    counts = [(-int((sets[a] | sets[b]).sum()), a, b) for a, b in combinations(sorted(sets), 2)]
    better = sorted(row for row in counts if -row[0] > single)
    return [(tried[a], tried[b]) for _, a, b in better[:_KEPT]]


def _lying(cell: Cell) -> Fixturing:
    """Return the first fixturing, or raise if the part cannot be laid elsewhere."""
    first = next(iter(cell.fixturings.values()))
    if not isinstance(first, Fixturing):
        rule = "must hold the part on a fixturing to lay it elsewhere"
        raise RobotError.of_rule("cell", rule, "a part in the hand")
    table = first.table
    if table is not None and np.abs(table.direction[:2]).max() > UPRIGHT_RAD:
        rule = "must have an upright turntable to lay the part elsewhere"
        raise RobotError.of_rule("cell", rule, "an axis that is tilted")
    return first


class _Staying(NamedTuple):
    """What stays of the first fixturing when the part is laid elsewhere.

    Attributes
    ----------
    first : Fixturing
        The fixturing.
    still, turning : dict of str to body
        Its table and its backlight. What stands still below a turntable stays, too.
    standing : tuple of Standing
        Of both what is not the table.
    """

    first: Fixturing
    still: dict[str, Body]
    turning: dict[str, Body]
    standing: tuple[Standing, ...]


def _what_stays(first: Fixturing, table: str) -> _Staying:
    """Return what stays, or raise if the part is to be laid beside its turntable."""
    still: dict[str, Body] = dict(first.obstacles)
    if first.table is None:
        still = _table_and_light(first.obstacles, table)
    elif table not in first.turning:
        rule = "must turn with the part in the first fixturing, which is on a turntable"
        names = ", ".join(map(repr, first.turning)) or "nothing"
        raise RobotError.of_rule("table", rule, repr(table), hint=f"there turns {names}")
    turning = _table_and_light(first.turning, table)
    others = {name: body for name, body in {**still, **turning}.items() if name != table}
    return _Staying(first, still, turning, standing_bodies(others, "obstacle"))


def _table_and_light(bodies: Mapping[str, Body], table: str) -> dict[str, Body]:
    return {
        name: body for name, body in bodies.items() if name == table or isinstance(body, LightBox)
    }


def _level_top(name: str, obstacles: Mapping[str, Body]) -> _Table:
    """Return the top of a box, or raise if there is no such box or it is tilted."""
    if name not in obstacles:
        rule = "must be an obstacle of the cell or of its first fixturing"
        names = ", ".join(map(repr, obstacles)) or "none"
        raise RobotError.of_rule("table", rule, repr(name), hint=f"there are {names}")
    box = obstacles[name]
    if not isinstance(box, Box):
        raise RobotError.of_rule("table", "must be a box, with low and high", f"{name!r}, a mesh")
    if box.pose[2, 2] < 0 or np.abs(box.pose[2, :2]).max() > UPRIGHT_RAD:
        raise RobotError.of_rule("table", "must have a level top", f"{name!r}, which is tilted")
    return _Table(box.pose, np.array(box.low), np.array(box.high), float(box.corners()[:, 2].max()))


def flat_sides(solid: Solid, post_width_mm: float = POST_WIDTH_MM) -> tuple[Side, ...]:
    """Return the sides on which a part can lie, the largest first.

    Parameters
    ----------
    solid : Solid
        The part.
    post_width_mm : float
        Side of a square post below the centre of mass, mm.

    Returns
    -------
    tuple of Side
        At most six. Facets of the convex hull within 1 mrad are one side.
    """
    corners = np.asarray(solid.vertices, dtype=np.float64)
    centre = centre_of_mass(corners, np.asarray(solid.triangles))
    hull = ConvexHull(corners)
    facets = corners[hull.simplices]
    areas = (
        np.sqrt(
            (np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0]) ** 2).sum(axis=1)
        )
        / 2
    )
    scene = RayScene(corners, solid.triangles)
    sides: list[Side] = []
    free = np.ones(len(facets), dtype=bool)
    while free.any():
        largest = int(np.where(free, areas, -1.0).argmax())
        normal = hull.equations[largest, :3]
        height = -hull.equations[largest, 3]
        flat = hull.equations[:, :3] @ normal >= np.cos(FLAT_RAD)
        within = np.abs(facets @ normal - height).max(axis=1) <= TOUCHING_MM
        together = free & flat & within
        free[largest] = False
        free &= ~together
        rotation = _turned_down(normal)
        points = facets[together].reshape(-1, 3) @ rotation.T
        foot = centre - (normal @ centre - height) * normal
        if not _is_inside(points[:, :2], (rotation @ foot)[:2]):
            continue
        offsets = points[:, :2] - (rotation @ foot)[:2]
        spots = _spots(scene, rotation, foot, offsets, post_width_mm)
        area = float(areas[together].sum())
        above = float(height - normal @ centre)
        sides.append(Side(rotation, foot, area, _stands(spots), offsets, above))
    sides.sort(key=lambda side: -round(side.area_mm2, 6))
    return tuple(sides[:_MOST_SIDES])


def centre_of_mass(corners: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the centre of mass (3,) of a closed surface's inside, by tetrahedra about its middle.

    Parameters
    ----------
    corners : array, shape (v, 3)
        Corners, mm.
    triangles : array of int, shape (t, 3)
        Outward counter-clockwise.
    """
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    a, b, c = np.moveaxis(corners[triangles] - middle, 1, 0)
    volumes = np.einsum("tj,tj->t", a, np.cross(b, c))
    result = middle + (volumes[:, None] * (a + b + c)).sum(axis=0) / (4.0 * volumes.sum())
    return np.asarray(result)


def _turned_down(normal: np.ndarray) -> np.ndarray:
    """Return a rotation (3, 3) that turns a unit vector to (0, 0, -1), by rows."""
    helper = np.eye(3)[int(np.abs(normal).argmin())]
    across = np.cross(normal, helper)
    across /= np.sqrt((across**2).sum())
    return np.array([across, np.cross(across, normal), -normal])


def _turn_about_vertical(angle: float) -> np.ndarray:
    cosine = np.cos(angle)
    sine = np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _is_inside(points: np.ndarray, point: np.ndarray) -> bool:
    """Return whether a point (2,) is inside the convex hull of points (n, 2)."""
    planes = ConvexHull(points).equations
    return bool((planes[:, :2] @ point + planes[:, 2] < 0).all())


def _spots(
    scene: RayScene, rotation: np.ndarray, foot: np.ndarray, outline: np.ndarray, width_mm: float
) -> np.ndarray:
    """Return where a post wholly touches the part (m, 2), from the foot, within an outline (n, 2); the foot first."""
    low = outline.min(axis=0) + width_mm / 2
    high = outline.max(axis=0) - width_mm / 2
    if (low > high).any():
        return np.empty((0, 2))
    step = (outline.max(axis=0) - outline.min(axis=0)).max() / _STEPS
    axes = [np.arange(start, end + step / 2, step) for start, end in zip(low, high, strict=True)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    middles = np.concatenate([np.zeros((1, 2)), middles])
    parts = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)]) * width_mm / 2
    tops = middles[:, None] + parts
    starts = foot + tops @ rotation[:2] - width_mm * rotation[2]
    hits = scene.cast(starts, np.broadcast_to(rotation[2], starts.shape))["t_hit"]
    return middles[(np.abs(hits - width_mm) <= TOUCHING_MM).all(axis=1)]


def _stands(spots: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return ways to put posts at spots (m, 2): one below the centre of mass, and three around it."""
    single = [spots[:1]] if len(spots) and not spots[0].any() else []
    if len(spots) < 3:
        return tuple(single)
    corners = np.random.default_rng(0).integers(len(spots), size=(_TRIANGLES, 3))
    triangles = spots[corners]
    a, b, c = np.moveaxis(triangles, 1, 0)
    crosses = np.stack([_across(a, b), _across(b, c), _across(c, a)], axis=1)
    turned = np.sign(crosses.sum(axis=1))[:, None]
    sides = np.sqrt(((np.roll(triangles, -1, axis=1) - triangles) ** 2).sum(axis=2))
    # distances of the foot from the sides, negative outside
    inward = (turned * crosses / np.maximum(sides, TOUCHING_MM)).min(axis=1)
    order = np.argsort(-inward, kind="stable")
    chosen = [order[int(share * (_TRIANGLES - 1))] for share in _FIRMEST]
    return (*single, *(triangles[row] for row in chosen if inward[row] > 0))


def _across(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the third components (n,) of the products of vectors (n, 2)."""
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]

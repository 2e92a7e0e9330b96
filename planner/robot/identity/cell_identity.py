"""The digest of a cell, what a plan file says of it, and in what another cell differs."""

from __future__ import annotations

import hashlib
from abc import ABC
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from planner.robot.arm import Robot
from planner.robot.bodies import Body, Box, mesh_of
from planner.robot.collisions import Arm
from planner.robot.standing import Fixturing, Standing

_SHORT = 16
_FIXTURING = "fixturing "


class CellIdentity(ABC):
    """What a `Cell` says of itself."""

    robot: Robot
    cam2flange: np.ndarray
    clearance_mm: float
    home: np.ndarray | None
    fixturings: dict[str, Fixturing]
    _arm: Arm
    _camera_body: tuple[Body, ...]
    _standing: tuple[Standing, ...]
    _with_it: dict[str, tuple[Standing, ...]]
    _turning: dict[str, tuple[Standing, ...]]

    @property
    def state_name(self) -> str:
        """Digest of everything that decides what is reached."""
        own = (self.robot.state_name, self.clearance_mm, self.cam2flange.tolist())
        places: list[tuple[str, np.ndarray, Sequence[Standing]]]
        places = [("", np.eye(4), self._standing)]
        places += [
            (name, one.part2base, self._with_it[name]) for name, one in self.fixturings.items()
        ]
        places += [place for name in self.fixturings for place in self._table_of(name)]
        return f"cell {digest_of((*own, self._home_values), self._arm, places)}"

    @property
    def _home_values(self) -> list[float] | None:
        return None if self.home is None else self.home.tolist()

    def _table_of(self, name: str) -> list[tuple[str, np.ndarray, Sequence[Standing]]]:
        """Return what turns in a fixturing, as a place of the digest; nothing without a turntable."""
        table = self.fixturings[name].table
        if table is None:
            return []
        return [(repr((name, table.numbers)), np.eye(4), self._turning[name])]

    @property
    def parts(self) -> dict[str, str]:
        """Short digests of what the cell consists of, by name."""
        camera = [
            one.corners() if isinstance(one, Box) else mesh_of(one, "camera_body")[0]
            for one in self._camera_body
        ]
        found = {
            "robot": short_digest(self.robot.state_name),
            "cam2flange": short_digest(self.cam2flange.tolist()),
            "camera_body": short_digest([corners.tolist() for corners in camera]),
            "clearance_mm": short_digest(self.clearance_mm),
            "home": short_digest(self._home_values),
            "obstacles": short_digest(digest_of((), None, [("", np.eye(4), self._standing)])),
        }
        for name, one in self.fixturings.items():
            place = [(name, one.part2base, self._with_it[name]), *self._table_of(name)]
            found[_FIXTURING + name] = short_digest(digest_of((), None, place))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell.

        Returns
        -------
        dict
            Name of the robot, digest of the cell, and ``part2base`` of each fixturing; with the
            axes of turntables. ``parts`` are short digests, which show what was changed.
            ``bodiless_links`` are those whose collisions were not checked.
        """
        tables = {name: one.table for name, one in self.fixturings.items() if one.table}
        axes = {
            name: {"point": table.point.tolist(), "direction": table.direction.tolist()}
            for name, table in tables.items()
        }
        return {
            "robot": self.robot.name,
            "digest": self.state_name.split()[-1],
            "fixturings": {name: one.part2base.tolist() for name, one in self.fixturings.items()},
            "parts": self.parts,
            **({"turntables": axes} if axes else {}),
            **bodiless(self.robot),
        }

    def difference(self, stated: Mapping[str, Any]) -> str:
        """Return in what this cell differs from the one of a plan.

        Parameters
        ----------
        stated : mapping
            What the plan says of its cell, ``plan.cell``; empty without one.

        Returns
        -------
        str
            Such as "cam2flange and fixturing 'up'"; empty if nothing differs.
        """
        now = self.to_dict()
        if not stated or stated["digest"] == now["digest"]:
            return ""
        # plans of earlier versions name no parts
        before = stated.get("parts", {})
        names = [name for name in {**before, **now["parts"]} if name in before or before]
        changed = [name for name in names if before.get(name) != now["parts"].get(name)]
        words = [_named(name, before, now["parts"]) for name in changed]
        if not words:
            return "something that the plan does not name"
        return " and ".join([", ".join(words[:-1]), words[-1]] if words[:-1] else words)


def bodiless(robot: Robot) -> dict[str, list[str]]:
    """Return what a plan file says of links without geometry; empty if each has some."""
    return {"bodiless_links": list(robot.bodiless_links)} if robot.bodiless_links else {}


def _named(name: str, before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return the name of a part of the cell as its file has it, and whether it is new or gone."""
    word = name
    if name.startswith(_FIXTURING):
        word = f"fixturing {name.removeprefix(_FIXTURING)!r}"
    if name not in before:
        return f"{word} (new)"
    return word if name in now else f"{word} (gone)"


def short_digest(value: Any, digits: int = _SHORT) -> str:
    """Return the first hexadecimal digits of the SHA-256 of a plain value."""
    return hashlib.sha256(repr(value).encode()).hexdigest()[:digits]


def digest_of(
    numbers: tuple[Any, ...],
    arm: Arm | None,
    places: Iterable[tuple[str, np.ndarray, Sequence[Standing]]],
) -> str:
    """Return the SHA-256 of an arm, of numbers, and of what stands still by name and pose."""
    digest = hashlib.sha256(repr(numbers).encode())
    for body in () if arm is None else arm.bodies:
        digest.update(body.hull.corners.tobytes())
    for name, pose, standing in places:
        digest.update(repr((name, pose.tolist())).encode())
        for one in standing:
            digest.update(repr((one.name, one.pose.tolist())).encode())
            digest.update(one.shape.corners.tobytes())
            digest.update(one.shape.triangles.astype("<i8").tobytes())
    return digest.hexdigest()

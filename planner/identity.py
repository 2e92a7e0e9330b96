"""What is asked of a plan, as one value: what tells it from other requests, and in which words."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands.geometry import Localisation
from ground.convert import STATED, Meta, Plain, Shape, from_plain, to_plain
from ground.faces import program_name
from ground.short_repr import short_repr
from planner.camera.camera import Camera
from planner.camera.pose import GivenPose, PoseUncertainty
from planner.effort import Effort
from planner.exceptions import PlanFileError, RequestError
from planner.files import encoded, program_digest, timestamp
from planner.light.lighting import Lighting
from planner.plan_file import Amount, Coordinates, Count, Fraction
from planner.request.constraints import Requirements
from planner.request.edge_state import Break, EdgeState, checked_break
from planner.request.models import Means
from planner.request.registration import RegistrationRecord
from planner.request.target_records import plain_target, target_from
from planner.request.targets import Target

# In what two requests differ, in the words of the caller.


# fields of a request that a call in Python knows under another name
_KEYWORDS = {
    "seed": "rng",
    "lighting": "lamps",
    "ring": "space",
    # the default of the margin is a reserve for each point
    "focus_reserve": "focus_margin_mm",
}
# fields whose own fields are the words of the caller
_GROUPS = ("requirements", "showing", "lighting")
_UNNAMED = "unnamed"
# what a user calls the entities of a target
_IN_WORDS = "entities in words"


def keyword(field: str) -> str:
    """Return the name under which `plan_inspection` takes a field of a request."""
    return _KEYWORDS.get(field, field)


def first_difference(
    now: Mapping[str, Any],
    before: Mapping[str, Any],
    words: Callable[[str], str] = str,
    tolerance: float = 0.0,
) -> str | None:
    """Return the first difference of two identities, or None if they are of the same request.

    Parameters
    ----------
    now, before : mapping
        Identities of two requests.
    words : callable
        Returns what the caller calls a keyword of `plan_inspection`. Default: its name.
    tolerance : float
        Relative difference up to which two numbers are the same.

    Returns
    -------
    str or None
        Such as ``seed was 5 and is now 6``.
    """
    orders = [[target["name"] for target in one.get("targets") or ()] for one in (now, before)]
    change = None
    if set(orders[0]) == set(orders[1]):
        # what is measured of an edge follows from it, so it is named before what changed in the targets
        edges_now = {_EDGES: now.get(_EDGES)}
        change = _first_change((), edges_now, {_EDGES: before.get(_EDGES)}, tolerance)
    elif now.get("part") == before.get("part"):
        targets = {"targets": _by_name(now).get("targets")}
        change = _first_change((), targets, {"targets": _by_name(before).get("targets")}, tolerance)
    if change is None:
        change = _first_change((), _by_name(now), _by_name(before), tolerance)
    if change is not None:
        return _described(change, words)
    return None if orders[0] == orders[1] else "the order of the targets changed"


_EDGES = "edge_break_mm"


class _Change(NamedTuple):
    """The names of the fields that lead to a difference, and both values."""

    path: tuple[str, ...]
    now: Any
    before: Any


def _by_name(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return an identity with its targets by name, each with its entities in words."""
    targets = identity.get("targets")
    if targets is None:
        return dict(identity)
    named = {target["name"]: {_IN_WORDS: _entities_of(target), **target} for target in targets}
    return {**identity, "targets": named}


def _first_change(path: tuple[str, ...], now: Any, before: Any, tolerance: float) -> _Change | None:
    """Return the first thing that differs in two plain values; what is not there is None."""
    if isinstance(now, Mapping) and isinstance(before, Mapping):
        if _UNNAMED in now or _UNNAMED in before:
            # nobody can know whether these are the same
            return _Change(path, None, None)
        keys = list(dict.fromkeys([*before, *now]))
        if path:
            # a number of its own says more than one inside a record
            keys.sort(key=lambda key: isinstance(before.get(key, now.get(key)), Mapping))
        changes = (
            _first_change((*path, key), now.get(key), before.get(key), tolerance) for key in keys
        )
        return next((change for change in changes if change is not None), None)
    return None if _is_same(now, before, tolerance) else _Change(path, now, before)


def _is_same(now: Any, before: Any, tolerance: float) -> bool:
    if isinstance(now, list | tuple) and isinstance(before, list | tuple):
        return len(now) == len(before) and all(
            _first_change((), *pair, tolerance) is None for pair in zip(now, before, strict=True)
        )
    if isinstance(now, int | float) and isinstance(before, int | float):
        return now == before or math.isclose(now, before, rel_tol=tolerance, abs_tol=0.0)
    return bool(now == before)


def _described(change: _Change, words: Callable[[str], str]) -> str:
    """Say what changed: a keyword of the caller's, a target, or something inside one."""
    if change.path == ("part", "digest"):
        return "the shape of the part changed"
    field, *inside = [name for name in change.path if name not in _GROUPS] or change.path[-1:]
    values = _values(change)
    if field == "part":
        return f"the part {values or 'changed'}"
    if field == "targets" and inside:
        subject = f"target {inside.pop(0)!r}"
        if not inside:
            return f"{subject} is {'new' if change.before is None else 'no longer wanted'}"
        if inside == [_IN_WORDS]:
            return f"{subject} was {change.before} and is now {change.now}"
    else:
        subject = "the targets" if field == "targets" else words(keyword(field))
        if field == _EDGES and subject.startswith("--"):
            return f"{subject} was {_typed(change.before)} and is now {_typed(change.now)}"
    if inside and values:
        what = " of ".join(reversed(inside)).replace("_", " ")
        return f"{subject} changed: {what} {values}"
    return f"{subject} {values or 'changed'}" if not inside else f"{subject} changed"


def _typed(limits: Any) -> str:
    """Return the limits of breaks as the command line takes them."""
    if limits is None:
        return _text(None)
    low, high = limits
    return f"{low:g}..{high:g}" if high else "sharp"


def _values(change: _Change) -> str:
    """Return a sentence with both values, if they are short."""
    if change.before == change.now or not (_is_short(change.before) and _is_short(change.now)):
        return ""
    return f"was {_text(change.before)} and is now {_text(change.now)}"


def _is_short(value: object) -> bool:
    if isinstance(value, list | tuple):
        return len(value) <= 3 and all(isinstance(item, int | float) for item in value)
    return value is None or isinstance(value, str | int | float)


def _text(value: object) -> str:
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return f"{value:.9g}" if isinstance(value, float) else repr(value)


def _entities_of(target: Mapping[str, Any]) -> str:
    """Return the ids of a target's entities as a user gives them."""
    return ", ".join(
        f"{entity['kind']} of edges {entity['edges']}"
        if len(entity["edges"]) > 1
        else f"{entity['kind']} {''.join(map(str, entity['edges']))}"
        for witness in target.get("witnesses", ())[:1]
        for entity in witness["entities"]
    )


# The request of a plan as one frozen value, which resume, ``--out``, batch, kept regions and plan
# files compare.
#
# **Guarantee.** Every field distinguishes requests: `Request.identity` goes through all
# fields there are, so an option that is added to the request cannot be forgotten.


@dataclass(frozen=True)
class PartRecord:
    """The part of a request.

    Attributes
    ----------
    name : str
        Its name.
    digest : str
        Of its vertices, to 1e-6 mm, and its triangles.
    """

    name: str
    digest: str

    @classmethod
    def of(cls, solid: Any) -> PartRecord:
        """Return the record of a part."""
        # other machines compute the last digits otherwise, and a zero may be negative
        vertices = np.round(np.asarray(solid.vertices, dtype=np.float64), 6) + 0.0
        triangles = np.asarray(solid.triangles, dtype="<i8")
        digest = hashlib.sha256(vertices.astype("<f8").tobytes())
        digest.update(triangles.tobytes())
        return cls(solid.name, digest.hexdigest())


_Digest = Annotated[str, Meta(pattern="^([0-9a-f]{64})?$", title="must be a SHA-256, or empty")]


@dataclass(frozen=True)
class Made:
    """When, by whom and by which program a plan was made, and of what.

    It is no part of a request, and plans that differ in nothing else are equal. Anybody can compute the digests again
    from the part's file and from the plan's.

    Attributes
    ----------
    date : str
        When the plan was written, in the form of ISO 8601 (UTC).
    program : str
        Name and version of the program; files of older releases have the version alone.
    operator : str
        Who planned; empty if not stated.
    part_file_sha256 : str
        Of the part's file; empty if it can be read only once.
    camera_sha256, request_sha256 : str
        Of the camera, and of request and targets, as JSON with sorted keys.
    """

    date: Annotated[
        str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$", title="must be a date in UTC")
    ]
    program: Annotated[str, Meta(title="must be name and version of the program")]
    operator: Annotated[str, Meta(title="must be the name of who planned")] = ""
    part_file_sha256: _Digest = ""
    camera_sha256: _Digest = ""
    request_sha256: _Digest = ""

    @classmethod
    def now(cls, request: Request, part_file_sha256: str = "", operator: str = "") -> Made:
        """Return the record of a plan that is written now.

        Parameters
        ----------
        request : Request
            What was planned.
        part_file_sha256 : str
            Digest of the part's file.
        operator : str
            Who planned.
        """
        stored = encoded(stored_request(request))
        return cls(
            timestamp(),
            program_name(),
            operator,
            part_file_sha256,
            digest_of(stored["request"]["camera"]),
            digest_of(stored["request"], stored["targets"]),
        )


@dataclass(frozen=True)
class RingRecord:
    """A space in which the lamp is on the camera.

    Attributes
    ----------
    contrast : float
        Least contrast of an edge.
    step : float or None
        Least step of grey values.
    """

    contrast: float
    step: float | None


@dataclass(frozen=True, eq=False)
class Request:
    """All that a plan depends on, except the program.

    A new field needs nothing else to distinguish requests. If `plan_inspection` takes it under another name,
    `planner.identity` holds that name, and `planner.app.checks` the option of the command line.

    Attributes
    ----------
    part : PartRecord or None
        The part; None where the request is for any part, as in a batch.
    targets : tuple of Target
        Edges and dimensions, in order; none as for the part.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    localisation : Localisation
        How well points are found in the image.
    accuracy, probability : float
        What is required.
    requirements : Requirements
        What every setting must satisfy: limits, detection conditions and reach.
    workspace : array (2, 3) or None
        The box the camera may be in, mm; None where it follows from the part.
    lighting : Lighting or None
        What is asked of lamps.
    ring : RingRecord or None
        Contrast and step, where the space is one with the lamp on the camera.
    seed : int
        Repeats the plan.
    effort : Effort
        How long to search.
    gap : float
        Share of the settings that the bound may miss.
    surfaces_mm : float
        Standard deviation of the position of faces along their normals, mm.
    registration : RegistrationRecord or None
        How poses are known when values are read; None if it is not stated: no better than planned.
    edge_break_mm : (float, float) or None
        By how much the part's edges are broken along their faces, least and most, mm; None if it is not stated.
    poses : tuple of GivenPose or None
        The poses that the settings are chosen from; None where poses are searched.
    split : {"auto", "never"}
        Whether different settings may measure the entities of a target.
    """

    part: PartRecord | None
    targets: tuple[Annotated[Target, Plain(plain_target, target_from)], ...]
    camera: Camera
    pose_uncertainty: PoseUncertainty
    localisation: Localisation
    accuracy: Fraction
    probability: Fraction
    requirements: Requirements
    workspace: Annotated[NDArray[np.float64] | None, Shape(2, 3), Coordinates]
    lighting: Lighting | None
    ring: RingRecord | None
    seed: Count
    effort: Effort
    gap: Annotated[float, STATED, Meta(ge=0, lt=1, title="must be in [0, 1)")] = 0.0
    surfaces_mm: Annotated[Amount, STATED] = 0.0
    registration: Annotated[RegistrationRecord | None, STATED] = None
    edge_break_mm: Break | None = None
    poses: tuple[GivenPose, ...] | None = None
    split: Literal["auto", "never"] = "never"

    def __post_init__(self) -> None:
        if self.edge_break_mm is not None:
            checked_break(self.edge_break_mm)
        if self.split not in ("auto", "never"):
            raise RequestError.of_rule("split", "must be 'auto' or 'never'", repr(self.split))

    __repr__ = short_repr

    def identity(self) -> dict[str, Any]:
        """Return all fields as plain values, the same in every process.

        Returns
        -------
        dict of str to value
            By field, in their order.
        """
        return to_plain(self, defaults=True)

    def fingerprint(self) -> str:
        """Return a digest of the identity and of the code that decides about plans, 64 hexadecimal digits."""
        return digest_of(self.identity(), program_digest())

    def difference(
        self,
        before: Request | Mapping[str, Any],
        words: Callable[[str], str] = str,
        tolerance: float = 0.0,
    ) -> str | None:
        """Return in what an earlier request differs from this one.

        Parameters
        ----------
        before : Request or mapping
            The earlier request, or its identity.
        words, tolerance
            See `planner.identity.first_difference`.

        Returns
        -------
        str or None
            The first difference, such as ``seed was 5 and is now 6``; None if it is the same request.
        """
        known = before.identity() if isinstance(before, Request) else before
        return first_difference(self.identity(), known, words, tolerance)

    def other_part(self, solid: Any) -> str:
        """Return why a part is not the one of the request, in words that follow its name; empty if it is."""
        if self.part is not None and self.part.digest == PartRecord.of(solid).digest:
            return ""
        return "which has another shape"

    @property
    def means(self) -> Means:
        """What the targets are measured with, and how accurately."""
        return Means(
            self.camera,
            self.pose_uncertainty,
            self.accuracy,
            self.localisation,
            surfaces_mm=self.surfaces_mm,
            edges=self.edges,
        )

    @property
    def edges(self) -> EdgeState:
        """By how much the part's edges are broken, as plans count it."""
        return EdgeState.planned(self.edge_break_mm)

    def check_lasting(self) -> None:
        """Refuse a request that another process could not recognise.

        Raises
        ------
        RequestError
            If a reach has no lasting name; says how to give it one.
        """
        for owner, reach in _unnamed(self.identity(), ""):
            raise RequestError(
                f"{owner} must have a name that lasts where a state is kept: give it an attribute state_name, a text "
                f"that says what it permits, or plan without state. Got {reach}."
            )


def digest_of(*values: Any) -> str:
    """Return the SHA-256 of plain values."""
    text = json.dumps(values, sort_keys=True, allow_nan=True)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _unnamed(value: Any, owner: str) -> list[tuple[str, str]]:
    """Return what nobody can recognise again in plain values, with the field that holds it."""
    if not isinstance(value, Mapping):
        return []
    if "unnamed" in value:
        return [(owner, str(value["unnamed"]))]
    return [pair for key, item in value.items() for pair in _unnamed(item, str(key))]


# A request from its identity, as plan files store it: so a plan can be made again.


# fields that earlier plan files do not have: nothing was stated
_LATER = ("edge_break_mm", "poses", "split")


def restored_request(identity: Mapping[str, Any]) -> Request:
    """Return the request whose identity this is.

    Parameters
    ----------
    identity : mapping
        As `Request.identity` returns it, and as plan files hold it under ``request``.

    Raises
    ------
    PlanFileError
        If a field is missing, wrong or unknown; names it.
    """
    for item in fields(Request):
        if item.name not in identity and item.name not in _LATER:
            raise PlanFileError(f"request.{item.name} must be given. Got none.")
    try:
        return from_plain(Request, identity, PlanFileError)
    except PlanFileError as error:
        raise PlanFileError(f"request.{error}") from None


def stored_request(request: Request) -> dict[str, Any]:
    """Return ``request`` and ``targets`` of a plan file: the request names its targets, which are stated once."""
    identity = request.identity()
    targets = {target.pop("name"): target for target in identity["targets"]}
    return {"request": {**identity, "targets": list(targets)}, "targets": targets}

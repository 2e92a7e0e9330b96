"""What is asked of a plan, as one value: what tells it from other requests, and in which words."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from errors.exceptions import InvalidParameterError, MeasurandError
from errors.measurands.geometry import Geometry, Line, Localisation, MeasuredCircle
from errors.measurands.measurand import measurand
from ground.convert import from_plain, to_plain
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.effort import Effort
from planner.exceptions import PlanFileError, PlannerError, RequestError
from planner.files import program_digest
from planner.light.lighting import LampBox, LampDome, Lighting
from planner.plan_file import field_name, shown
from planner.request.constraints import Requirements
from planner.request.dimension import checked_tolerance, plain_tolerance
from planner.request.models import Means
from planner.request.reach import (
    BoxRegion,
    PoseRegion,
    SphereRegion,
    StatedRegion,
    reach_identity,
)
from planner.request.registration import RegistrationRecord
from planner.request.targets import (
    EDGE,
    EdgeTarget,
    EntityRecord,
    PlannedDimension,
    Target,
    Witness,
)

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
    change = _first_change((), _by_name(now), _by_name(before), tolerance)
    if change is not None:
        return _described(change, words)
    orders = [[target["name"] for target in one.get("targets") or ()] for one in (now, before)]
    return None if orders[0] == orders[1] else "the order of the targets changed"


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
    if inside and values:
        what = " of ".join(reversed(inside)).replace("_", " ")
        return f"{subject} changed: {what} {values}"
    return f"{subject} {values or 'changed'}" if not inside else f"{subject} changed"


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


# Values of a request as plain values: texts, numbers, lists and mappings, the same in every
# process; and back.


# relative difference of a nominal value and that of its geometry: both are computed
_SAME_NOMINAL = 1e-6
# fields that hold values of several kinds: the kind belongs to the value
_OF_SEVERAL_KINDS = ("lamps",)
_KINDS = {kind.__name__: kind for kind in (BoxRegion, SphereRegion, LampBox, LampDome)}


def plain_value(value: Any, name: str = "") -> Any:
    """Return a value as plain values that JSON can hold.

    Parameters
    ----------
    value
        A number, text, array, mapping, sequence, dataclass, or anything with ``to_dict`` and ``from_dict``.
    name : str
        Name of the field that holds it.

    Raises
    ------
    TypeError
        If it is none of these: then it cannot tell requests apart.
    """
    if name in ("reach", "cell"):
        return reach_identity(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and math.isinf(value):
        # JSON has no such number; float() reads the text
        return str(value)
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if hasattr(value, "_asdict"):
        return plain_value(value._asdict())
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain_value(item, str(key)) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(item) for item in value]
    # what comes back from its values with nothing lost
    if hasattr(value, "to_dict") and hasattr(value, "from_dict"):
        return plain_value(value.to_dict())
    if isinstance(value, Target):
        return _target_values(value)
    if is_dataclass(value):
        kind = {"kind": type(value).__name__} if name in _OF_SEVERAL_KINDS else {}
        return kind | plain_fields(value)
    raise TypeError(
        f"{name or 'a value'} of a request must have to_dict and from_dict. Got {value!r}."
    )


def plain_fields(record: Any) -> dict[str, Any]:
    """Return all fields of a dataclass as plain values, by name; a whole number in a field of floats is a float."""
    values = {}
    for field in fields(record):
        value = plain_value(getattr(record, field.name), field.name)
        whole = isinstance(value, int) and not isinstance(value, bool)
        values[field.name] = float(value) if whole and "float" in str(field.type) else value
    return values


def restored_value(kind: Any, value: Any) -> Any:
    """Return the value that `plain_value` made plain.

    Parameters
    ----------
    kind : type
        What the field that holds it is declared as.
    value
        Plain values.

    Raises
    ------
    PlanFileError
        If it is of a reach that no file can hold.
    KeyError, TypeError, ValueError, AttributeError
        If it is not as `plain_value` writes it.
    """
    if value is None and get_origin(kind) in (Union, UnionType):
        return None
    kind = _without_none(kind)
    if kind is Any:
        if not isinstance(value, Mapping):
            return value
        known = _KINDS.get(value.get("kind", ""))
        if known is None:
            return StatedRegion(value)
        value = {key: item for key, item in value.items() if key != "kind"}
        kind = known
    if kind is Target:
        return _target_of(value)
    if kind is PoseRegion:
        return StatedRegion(value)
    if hasattr(kind, "from_dict"):
        return kind.from_dict(value)
    if _is_record(kind):
        kinds = get_type_hints(kind)
        return kind(**{name: restored_value(kinds[name], own) for name, own in value.items()})
    if get_origin(kind) is tuple:
        return tuple(restored_value(get_args(kind)[0], item) for item in value)
    if kind is np.ndarray:
        return np.array(value, dtype=np.float64)
    return float(value) if kind is float and isinstance(value, str) else value


def _is_record(kind: Any) -> bool:
    return is_dataclass(kind) or hasattr(kind, "_asdict")


def _without_none(kind: Any) -> Any:
    """Return the type that a field has where it is given; Any if there are several."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    others = [other for other in get_args(kind) if other is not NoneType]
    return others[0] if len(others) == 1 else Any


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
        How poses are known when values are read; None for no better than planned.
    """

    part: PartRecord | None
    targets: tuple[Target, ...]
    camera: Camera
    pose_uncertainty: PoseUncertainty
    localisation: Localisation
    accuracy: float
    probability: float
    requirements: Requirements
    workspace: np.ndarray | None
    lighting: Lighting | None
    ring: RingRecord | None
    seed: int
    effort: Effort
    gap: float = 0.0
    surfaces_mm: float = 0.0
    registration: RegistrationRecord | None = None

    def identity(self) -> dict[str, Any]:
        """Return all fields as plain values, the same in every process.

        Returns
        -------
        dict of str to value
            By field, in their order.
        """
        return plain_fields(self)

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
        )

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
    known = {field.name: field for field in fields(Request)}
    kinds = get_type_hints(Request)
    for name in identity:
        if name not in known:
            raise PlanFileError(
                f"{field_name('request', name)} must be known to this program. Got an unknown field."
            )
    values = {}
    for name in known:
        if name not in identity:
            raise PlanFileError(f"request.{name} must be given. Got none.")
        value = identity[name]
        try:
            values[name] = restored_value(kinds[name], value)
        except PlanFileError:
            # names its field
            raise
        except PlannerError as error:
            raise PlanFileError(f"request.{name}.{error}") from None
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise PlanFileError(
                f"request.{name} must be as this program writes it. Got {shown(value)}."
            ) from error
    return Request(**values)


def stored_request(request: Request) -> dict[str, Any]:
    """Return ``request`` and ``targets`` of a plan file: the request names its targets, which are stated once."""
    identity = request.identity()
    targets = {target.pop("name"): target for target in identity["targets"]}
    return {"request": {**identity, "targets": list(targets)}, "targets": targets}


def request_from(request: Mapping[str, Any], targets: Mapping[str, Any]) -> Request:
    """Return the request of a plan file.

    Parameters
    ----------
    request, targets : mapping
        As `stored_request` returns them.

    Raises
    ------
    PlanFileError
        If a target is missing, or as `restored_request`.
    """
    names = request["targets"]
    if sorted(names) != sorted(targets):
        got = next(
            (name for name in (*targets, *names) if (name in names) != (name in targets)),
            "one twice",
        )
        raise PlanFileError(f"request.targets must name every target once. Got {shown(got)}.")
    known = [{"name": name, **targets[name]} for name in names]
    return restored_request({**request, "targets": known})


# Targets as files hold them: what they have from the request is stated there.


def _target_values(target: Target) -> dict[str, Any]:
    """Return a target as plain values."""
    witnesses = [
        {
            "entities": [plain_fields(record) for record in witness.records],
            "geometry": [to_plain(item) for item in witness.geometry],
        }
        for witness in target.witnesses
    ]
    values: dict[str, Any] = {"name": target.name, "kind": EDGE, "witnesses": witnesses}
    if not isinstance(target, PlannedDimension):
        return values
    return values | {
        "kind": target.kind,
        "nominal": target.nominal,
        "unit": target.unit,
        "tolerance": plain_tolerance(target.tolerance),
        "permitted_error": target.permitted_error,
        "share": target.share,
        "direction": None if target.direction is None else list(target.direction),
        "n_features": target.n_features,
        "surfaces_mm": target.stated_surfaces_mm,
        "surfaces_from": target.surfaces_from,
    }


def _geometry_of(witness: Mapping[str, Any]) -> tuple[Geometry, ...]:
    """Return the lines and circles that plain values hold."""
    shapes: list[Geometry] = []
    for item in witness["geometry"]:
        kind: type[Line] | type[MeasuredCircle] = Line if "p" in item else MeasuredCircle
        shapes.append(from_plain(kind, item, InvalidParameterError))
    return tuple(shapes)


def _target_of(values: Mapping[str, Any]) -> Target:
    """Return the target of plain values."""
    name = values["name"]
    kind = values["kind"]
    direction = values.get("direction")
    if direction is not None:
        direction = tuple(direction)
    try:
        witnesses = tuple(
            Witness(
                tuple(
                    EntityRecord(**{**record, "edges": tuple(record["edges"])})
                    for record in witness["entities"]
                ),
                measurand(
                    "length" if kind == EDGE else kind,
                    _geometry_of(witness),
                    direction,
                ),
            )
            for witness in values["witnesses"]
        )
    except (MeasurandError, InvalidParameterError, PlanFileError) as error:
        raise PlanFileError(
            f"{field_name('targets', name)} must be one that can be measured. Got: {error}"
        ) from None
    if kind == EDGE:
        return EdgeTarget(name, witnesses)
    tolerance = values["tolerance"]
    target = PlannedDimension(
        name,
        witnesses,
        kind,
        values["permitted_error"],
        None if tolerance is None else checked_tolerance(tolerance),
        values["share"],
        direction,
        values["n_features"],
        values["surfaces_mm"],
        values["surfaces_from"],
    )
    if abs(target.nominal - values["nominal"]) > _SAME_NOMINAL * max(1.0, abs(target.nominal)):
        raise PlanFileError(
            f"{field_name('targets', name, 'nominal')} must be that of the geometry, {target.nominal:.9g}. "
            f"Got {values['nominal']!r}."
        )
    return target

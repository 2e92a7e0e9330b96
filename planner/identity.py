"""What is asked of a plan, as one value: what tells it from other requests, and in which words."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from errors.measurands.geometry import Circle, Geometry, Line, Localisation
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.effort import Effort
from planner.exceptions import PlanFileError, PlannerError, RequestError
from planner.light.lighting import RING, LampBox, LampDome, Lighting
from planner.options import InspectionOptions
from planner.plan_file import field_name, shown
from planner.request.constraints import Requirements
from planner.request.defaults import default_workspace
from planner.request.dimension import Dimension, is_one_sided
from planner.request.reach import BoxRegion, SphereRegion, reach_identity
from planner.request.targets import DimensionTarget, RegistrationRecord, Target
from planner.version import program_digest

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid
    from planner.plan import InspectionPlan


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
        for entity in target.get("entities", ())
    )


# Requests as earlier programs stored them, in the words of this one.


# a place of lamps that was all of them at once, before `Lighting` had a field for it
_TOGETHER = "LampsTogether"


def in_words_of_now(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stored identity of a request as this program stores it.

    Parameters
    ----------
    identity : mapping
        Of this program, or of an earlier one. What cannot be understood stays as it is.

    Returns
    -------
    dict of str to value
        A new mapping.
    """
    lighting = identity.get("lighting")
    if not isinstance(lighting, Mapping) or "lamps" not in lighting:
        return dict(identity)
    return {**identity, "lighting": {**lighting, **_lamps_of_now(lighting["lamps"])}}


def _lamps_of_now(lamps: Any) -> dict[str, Any]:
    if lamps is None:
        return {"lamps": RING}
    if isinstance(lamps, Mapping) and lamps.get("kind") == _TOGETHER:
        return {"lamps": lamps.get("lamps"), "together": True}
    return {"lamps": lamps}


# Values of a request as plain values: texts, numbers, lists and mappings, the same in every
# process; and back.


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


def completed_value(kind: Any, value: Any) -> Any:
    """Return plain values of a record with the fields they lack, which have their defaults.

    Parameters
    ----------
    kind : type
        What the field that holds them is declared as.
    value
        Plain values, such as an earlier program wrote: it did not know all fields.
    """
    kind = _without_none(kind)
    if not (_is_record(kind) and isinstance(value, Mapping)):
        return value
    kinds = get_type_hints(kind)
    known = {name: completed_value(kinds.get(name), item) for name, item in value.items()}
    defaults = {name: plain_value(item, name) for name, item in _defaults(kind).items()}
    return {**defaults, **known}


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
        value = dict(value)
        name = value.pop("kind", None)
        if name not in _KINDS:
            got = name or next(iter(value.values()), "nothing")
            raise PlanFileError(f"reach must be a box or a ball to be in a file. Got {got}.")
        kind = _KINDS[name]
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


def _defaults(kind: Any) -> dict[str, Any]:
    """Return the defaults of a dataclass or a named tuple, by field."""
    if not is_dataclass(kind):
        return dict(kind._field_defaults)
    made = {
        field.name: field.default_factory()
        for field in fields(kind)
        if field.default_factory is not MISSING
    }
    given = {field.name: field.default for field in fields(kind) if field.default is not MISSING}
    return {**made, **given}


def _without_none(kind: Any) -> Any:
    """Return the type that a field has where it is given; Any if there are several."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    others = [other for other in get_args(kind) if other is not NoneType]
    return others[0] if len(others) == 1 else Any


# Targets as a request keeps them: which entities of the part, and which error is permitted.


EDGE = "edge"


@dataclass(frozen=True)
class EntityRecord:
    """An entity of the part.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        "edge", "rim" or "arc".
    edges : tuple of int
        Ids of its edges in the part.
    part : str
        What it is a part of an edge, rim or arc, such as ``17[0:1/4]``; empty if it is a whole one.
    """

    name: str
    kind: str
    edges: tuple[int, ...]
    part: str = ""

    @classmethod
    def of(cls, name: str, entity: Any) -> EntityRecord:
        """Return the record of an entity of a space."""
        edges = tuple(int(edge) for edge in getattr(entity, "edge_ids", ()))
        part = getattr(entity, "part", None)
        return cls(name, getattr(entity, "kind", EDGE), edges, "" if part is None else str(part))

    def entity_of(self, solid: Solid) -> Entity:
        """Return the entity of the part under its name."""
        from aspectgraph import resolve_entities

        return resolve_entities(solid, {self.name: self._given(solid)})[self.name]

    def _given(self, solid: Solid) -> Any:
        from aspectgraph import Entity, parse_part

        if self.part:
            return parse_part(self.part)
        if self.kind != EDGE:
            curves = {curve.edge_ids: curve for curve in (*solid.rims(), *solid.arcs())}
            return curves[self.edges]
        if len(self.edges) == 1:
            return self.edges[0]
        first = solid.edge_points(self.edges[0])
        last = solid.edge_points(self.edges[-1])
        # of a chain of collinear edges the ends are farthest apart
        apart = np.linalg.norm(first[:, None] - last, axis=-1)
        begin, end = np.unravel_index(np.argmax(apart), apart.shape)
        return Entity(self.name, np.array([first[begin], last[end]]), self.edges)


@dataclass(frozen=True, eq=False)
class TargetRecord:
    """An edge or a dimension that is wanted.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        "edge", whose length is measured as in the paper, or the kind of dimension.
    ends : array (2, 3)
        Two points of it, mm.
    entities : tuple of EntityRecord
        What must be seen.
    permitted_error : float or None
        Of a dimension, mm (angles: degrees).
    tolerance : tuple of float or None
        Lower and upper deviation that the drawing allows; one may be infinite.
    share : float or None
        Part of the tolerance's half width that is permitted as error.
    direction : tuple of float or None
        Of a distance.
    alternatives : tuple of tuple of EntityRecord
        Other sets of entities that give the value.
    surfaces_mm : float or None
        Standard deviation of the position of its faces, mm; None if it is that of the request.
    surfaces_from : str
        The tolerance of the model that this follows from.
    """

    name: str
    kind: str
    ends: np.ndarray
    entities: tuple[EntityRecord, ...]
    permitted_error: float | None = None
    tolerance: tuple[float, float] | None = None
    share: float | None = None
    direction: tuple[float, float, float] | None = None
    alternatives: tuple[tuple[EntityRecord, ...], ...] = ()
    surfaces_mm: float | None = None
    surfaces_from: str = ""

    @classmethod
    def of(cls, target: Target, entities: Mapping[str, Any]) -> TargetRecord:
        """Return the record of a target whose entities are known by name."""
        witness = target.witnesses[0]
        seen, *others = (
            tuple(EntityRecord.of(name, entities[name]) for name in one.entities)
            for one in target.witnesses
        )
        if not isinstance(target, DimensionTarget):
            return cls(target.name, EDGE, witness.ends, seen)
        dimension = target.dimension
        has_width = dimension.tolerance is not None and not is_one_sided(dimension.tolerance)
        return cls(
            target.name,
            dimension.kind,
            witness.ends,
            seen,
            float(target.max_error),
            dimension.tolerance,
            dimension.share if has_width else None,
            dimension.direction,
            tuple(others),
            dimension.surfaces_mm,
            dimension.surfaces_from,
        )

    def item_of(self, solid: Solid) -> Any:
        """Return the target as `plan_inspection` takes it."""
        entities, *others = (
            tuple(record.entity_of(solid) for record in way)
            for way in (self.entities, *self.alternatives)
        )
        if self.kind == EDGE:
            return entities[0]
        error: dict[str, Any] = {"tolerance": self.tolerance}
        # what has no width has an error of its own
        error |= (
            {"max_error": self.permitted_error} if self.share is None else {"share": self.share}
        )
        return Dimension(
            self.kind,
            entities,
            direction=self.direction,
            alternatives=tuple(others),
            surfaces_mm=self.surfaces_mm,
            surfaces_from=self.surfaces_from,
            **error,
        )


def target_records(
    entities: Mapping[str, Any], targets: Sequence[Target]
) -> tuple[TargetRecord, ...]:
    """Return the records of targets whose entities are known by name."""
    return tuple(TargetRecord.of(target, entities) for target in targets)


# The request of a plan as one frozen value, which resume, ``--out``, batch, kept regions and plan
# files compare.
#
# **Guarantee.** Every field distinguishes requests: `InspectionRequest.identity` goes through all
# fields there are, so an option that is added to the request cannot be forgotten.


# beside the request in a plan file: how the part's file was read
SOURCE = "source"


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
class InspectionRequest:
    """All that a plan depends on, except the program.

    A new field needs nothing else to distinguish requests. If `plan_inspection` takes it under another name,
    `planner.identity` holds that name, and `planner.app.parsing` the option of the command line.

    Attributes
    ----------
    part : PartRecord or None
        The part; None where the request is for any part, as in a batch.
    targets : tuple of TargetRecord or None
        Edges and dimensions, in order; None as for the part.
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
    targets: tuple[TargetRecord, ...] | None
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
        before: InspectionRequest | Mapping[str, Any],
        words: Callable[[str], str] = str,
        tolerance: float = 0.0,
    ) -> str | None:
        """Return in what an earlier request differs from this one.

        Parameters
        ----------
        before : InspectionRequest or mapping
            The earlier request, or its identity.
        words, tolerance
            See `planner.identity.first_difference`.

        Returns
        -------
        str or None
            The first difference, such as ``seed was 5 and is now 6``; None if it is the same request.
        """
        known = before.identity() if isinstance(before, InspectionRequest) else before
        return request_difference(self.identity(), known, words, tolerance)

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


def request_difference(
    now: Mapping[str, Any],
    before: Mapping[str, Any],
    words: Callable[[str], str] = str,
    tolerance: float = 0.0,
) -> str | None:
    """Return the first difference of two identities; a field that is missing has its default.

    Parameters
    ----------
    now, before, words, tolerance
        See `planner.identity.first_difference`.

    Returns
    -------
    str or None
        None if they are of the same request.
    """
    return first_difference(_completed(now), _completed(before), words, tolerance)


def _completed(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return an identity in this program's words: with all its fields, and without the source."""
    known = {name: value for name, value in in_words_of_now(identity).items() if name != SOURCE}
    return completed_value(InspectionRequest, known)


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


def restored_request(identity: Mapping[str, Any]) -> InspectionRequest:
    """Return the request whose identity this is.

    Parameters
    ----------
    identity : mapping
        As `InspectionRequest.identity` returns it, and as plan files hold it under ``request``.

    Raises
    ------
    PlanFileError
        If a field is missing, wrong or unknown, or cannot be in a file; names it.
    """
    identity = in_words_of_now(identity)
    known = {field.name: field for field in fields(InspectionRequest)}
    kinds = get_type_hints(InspectionRequest)
    for name in identity:
        if name not in known and name != SOURCE:
            raise PlanFileError(
                f"{field_name('request', name)} must be known to this program. Got an unknown field."
            )
    values = {}
    for name, field in known.items():
        if name not in identity and field.default is MISSING:
            raise PlanFileError(f"request.{name} must be given. Got none.")
        value = identity.get(name, field.default)
        try:
            values[name] = restored_value(kinds[name], value)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            if isinstance(error, PlannerError):
                raise PlanFileError(f"request.{name}: {error}") from None
            raise PlanFileError(
                f"request.{name} must be as this program writes it. Got {shown(value)}."
            ) from None
    return InspectionRequest(**values)


def restored_options(request: InspectionRequest) -> InspectionOptions:
    """Return the options of `plan_inspection` that make a request again."""
    need = request.requirements
    values: dict[str, Any] = {
        field.name: getattr(record, field.name)
        for record in (need, request)
        for field in fields(InspectionOptions)
        if hasattr(record, field.name)
    }
    if need.focus_reserve.sigmas > 0:
        # the reserve of each point stands for a margin that was not given
        values["focus_margin_mm"] = None
    if any(target.surfaces_from for target in request.targets or ()):
        # tolerances of the model count only where no value was given
        values["surfaces_mm"] = None
    return InspectionOptions(**{**values, "lamps": request.lighting})


# Whether a part is the one of a plan: by its digest, or by what a plan without one holds of its
# part.


_SAME_MM = 1e-3
# of the longest chords, as a share of the radius: those of a circle in 6 pieces
_SAG = 0.134
# points of a planned edge or circle that must lie on edges of the part
_SHARES = np.linspace(0.0, 1.0, 8)


def other_part(plan: InspectionPlan, solid: Solid) -> str:
    """Return why a part is not the plan's, in words that follow its name.

    A plan of an early version has no digest of its part. Then its edges and
    circles must lie on edges of the part.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        The part.

    Returns
    -------
    str
        Such as "which has another shape"; empty if it is the plan's.

    Raises
    ------
    RequestError
        If the plan holds nothing that could be compared.
    """
    planned = plan.request.get("part")
    if planned is not None:
        same = planned["digest"] == PartRecord.of(solid).digest
        return "" if same else "which has another shape"
    targets = plan.targets
    if not targets:
        rule = "must hold the digest of its part, or an edge to compare"
        hint = "it is of an early version: plan the part again"
        raise RequestError.of_rule("plan", rule, "neither", hint=hint)
    starts, ends = _edges(solid)
    for name, target in targets.items():
        for one in target.geometry:
            if not _is_on(one, starts, ends):
                return f"which has no edge at {name!r}"
    return ""


def part_note(plan: InspectionPlan, solid: Solid) -> str:
    """Return what remains open about a part that `other_part` finds no fault with; empty if nothing does."""
    if plan.request.get("part") is not None or _has_default_workspace(plan, solid):
        return ""
    return "the plan has no digest of its part, so only its edges were compared: plan it again."


def _has_default_workspace(plan: InspectionPlan, solid: Solid) -> bool:
    """Return whether the plan's workspace is the one about this part, which tells the size of its box."""
    default = default_workspace(solid, plan.camera)
    return bool(np.allclose(plan.workspace, default, rtol=0.0, atol=_SAME_MM))


def _is_on(one: Geometry, starts: np.ndarray, ends: np.ndarray) -> bool:
    """Return whether a line or circle lies on edges (n, 3) of a part; of circles these are the chords."""
    if isinstance(one, Line):
        points = one.p + _SHARES[:, None] * (one.q - one.p)
        return bool((_distances(points, starts, ends) <= _SAME_MM).all())
    chords = _is_near(one, starts) & _is_near(one, ends)
    points = one.points(one.span_rad * _SHARES)
    off = _distances(points, starts[chords], ends[chords])
    return bool((off <= _SAME_MM + _SAG * one.radius_mm).all())


def _is_near(circle: Circle, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) lie on a whole circle (n,)."""
    apart = points - circle.centre
    heights = apart @ circle.axis
    across = apart - heights[:, None] * circle.axis
    radial = np.sqrt((across**2).sum(axis=1)) - circle.radius_mm
    return np.asarray(np.hypot(heights, radial) <= _SAME_MM)


def _edges(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of all edges of a part, (n, 3) each."""
    pairs = np.array([edge.vertices for edge in solid.edges], dtype=np.int64).reshape(-1, 2)
    return solid.vertices[pairs[:, 0]], solid.vertices[pairs[:, 1]]


def _distances(points: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return how far points (m, 3) are from the nearest of segments (n, 3), (m,)."""
    ways = ends - starts
    squares = np.maximum((ways**2).sum(axis=1), np.finfo(float).tiny)
    found = []
    for point in points:
        shares = np.clip(((point - starts) * ways).sum(axis=1) / squares, 0.0, 1.0)
        apart = starts + shares[:, None] * ways - point
        found.append(np.sqrt((apart**2).sum(axis=1)).min(initial=np.inf))
    return np.array(found)

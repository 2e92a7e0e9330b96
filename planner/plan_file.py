"""What the records of plan and state files cannot say of themselves: what contradicts itself is refused by its path."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ground.convert import Meta, Shape, field_name, shown
from planner.exceptions import PlanFileError

# Rules of fields that several records of a plan file have.


Count = Annotated[int, Meta(ge=0, title="must be a non-negative integer")]
Amount = Annotated[float, Meta(ge=0, title="must not be negative")]
Share = Annotated[float, Meta(ge=0, le=1, title="must be a number in [0, 1]")]
Fraction = Annotated[float, Meta(gt=0, lt=1, title="must be in (0, 1)")]
Draws = Annotated[int, Meta(ge=1, le=2**53, title="must be an integer from 1 to 2^53")]
Coordinates = Meta(ge=-1e9, le=1e9)
"""Limits of coordinates, mm: products of what is larger overflow."""
Pose = Annotated[NDArray[np.float64], Shape(4, 4), Coordinates]
Names = Annotated[
    tuple[str, ...],
    Meta(
        min_length=1,
        title="must be an array of at least one name, all different",
        extra_json_schema={"uniqueItems": True},
    ),
]
Texts = Annotated[Mapping[str, str], Meta(title="must map names to texts")]
Reasons = Annotated[Mapping[str, str], Meta(title="must map names to reasons")]
Probabilities = Annotated[Mapping[str, Share], Meta(title="must map names to probabilities")]
Pixels = Annotated[Mapping[str, Amount], Meta(title="must map names to pixels")]


# Format and version of plan files.


FORMAT = "aspectgraph inspection plan"
VERSION = 1


def check_format(data: Any) -> None:
    """Refuse data that is no plan, or one of a version that this program does not read.

    Parameters
    ----------
    data : Any
        What a plan file holds.

    Raises
    ------
    PlanFileError
        Names the field.
    """
    if not isinstance(data, Mapping) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, Mapping) else type(data).__name__
        raise PlanFileError(f"format must be {FORMAT!r}. Got {repr(found)[:60]}.")
    version = data.get("version")
    if version != VERSION or isinstance(version, bool):
        raise PlanFileError(f"version must be {VERSION}. Got {shown(version)}.")


# What the type of a field cannot say: names that agree, rigid poses, promises that make sense.
#
# Every function takes plain values that `planner.plan_record` has read, and raises `PlanFileError` with
# the path of the field.


# rotations are stored with all digits; a matrix farther from one was changed
_RIGID = 1e-6
# a number computed twice may differ in its last digits
# no number of displaced poses that is drawn shows more
_SHOWN_BY_COUNTING = 0.9999
_SAME = 1e-6


# arrays of a checkpoint by what holds them: the kind of their numbers, then lengths.
# a name stands for one length in what holds the arrays; in capitals for one in the whole checkpoint
_POOL = {"membership": "b n TARGETS", "poses": "f n 4 4", "quality": "f n"}
_ARRAYS = {
    "checkpoint": {"inspected": "b TARGETS", "bound_of": "b TARGETS", "bound_weights": "f TARGETS"},
    "realised": _POOL,
    "near": _POOL,
    "pricing": {"breed": "f n 4 4", "prices": "f TARGETS", "covered": "b TARGETS"},
    "covers": {"conflict": "b SINGLE SINGLE", "weights": "f w"},
    "growing": {"conflict": "b SINGLE SINGLE", "rows": "b r s"},
    "tree": {
        **{"centre": "f n 3", "half": "f n 3", "extents": "f n 3", "patch": "f n 4"},
        **{"face": "i n", "roll": "f n 2", "sets": "b n SINGLE"},
    },
    "linear": {"found": "b n WEIGHED", "poses": "f p 4 4"},
    "course": {"y": "f WEIGHED"},
    "viewpoints": {"y": "f WEIGHED"},
    "parts": {"proven": "b n", "waits": "b n", "worth": "i n"},
    "swept": {
        **{"outcome": "i n", "made": "i n", "doubt": "b n WEIGHED", "n_poses": "i n"},
        **{"poses": "f p 4 4", "sets": "b p WEIGHED"},
    },
}
# values are from 0 to below this
_BELOW = {"face": 6}


def check_plan(data: Mapping[str, Any]) -> None:
    """Refuse a plan that contradicts itself.

    Raises
    ------
    PlanFileError
        Names the first wrong field by its path, the rule and the value.
    """
    request = data["request"]
    targets = data["targets"]
    dimensions = [name for name, target in targets.items() if target["kind"] != "edge"]
    _check_workspace(request)
    if "source" in data and not isinstance(data["source"].get("file"), str):
        _refuse("source.file", "must be text", data["source"].get("file"))
    for k, setting in enumerate(data["settings"]):
        check_setting(setting, "settings", k)
        if "measurements" in setting:
            names = [name for name in setting["entities"] if name in dimensions]
            _check_keys(setting["measurements"], names, "settings", k, "measurements")
        _check_windows(setting, k)
        _check_witnesses(setting, targets, k)
        _check_promises(setting, request, targets, k)
    _check_everyone_once(data, targets)
    _check_split(data, targets)
    _check_foreseen(data, dimensions)
    _check_bound(data)
    if data.get("simulation") is not None:
        _check_simulation(data["simulation"], data["settings"])
        _check_split_rates(data["simulation"], data.get("split", {}))
    if data.get("light") is not None:
        _check_light(data["light"], data["settings"])


def check_state(data: Mapping[str, Any]) -> None:
    """Refuse a planning state that contradicts itself.

    Raises
    ------
    PlanFileError
        Names the first wrong field by its path, the rule and the value.
    """
    for key, outcome in data["outcomes"].items():
        names = _names_of(key)
        if "setting" in outcome:
            check_setting(outcome["setting"], "outcomes", key, "setting")
            if sorted(outcome["setting"]["entities"]) != names:
                where = field_name("outcomes", key, "setting", "entities")
                _refuse(where, "must be those of the key", outcome["setting"]["entities"])
    if data["plan"] is not None:
        try:
            check_plan(data["plan"])
        except PlanFileError as error:
            raise PlanFileError(f"plan.{error}") from None


def check_checkpoint(data: object, n_targets: int = 0) -> None:
    """Refuse a checkpoint whose arrays do not fit together: compiled loops would read beyond them.

    Parameters
    ----------
    data : object
        The checkpoint, with its arrays unpacked; None if there is none.
    n_targets : int
        Number of the request's targets; 0 if that is not known.

    Raises
    ------
    PlanFileError
        Names the first wrong array by its path.
    """
    if data is not None:
        _check_arrays(data, ("checkpoint",), {"TARGETS": n_targets} if n_targets else {})


def _check_arrays(data: object, path: tuple[object, ...], common: dict[str, int]) -> None:
    """Check the arrays in a value and in all that it holds; common lengths are added to those known."""
    if isinstance(data, list | tuple):
        for k, item in enumerate(data):
            _check_arrays(item, (*path, k), common)
    if isinstance(data, np.ndarray) and not np.isfinite(data).all():
        raise PlanFileError(f"{field_name(*path)} must be finite. Got NaN or infinity.")
    if not isinstance(data, dict):
        return
    lengths = common
    for name, form in _ARRAYS.get(str(path[-1]), {}).items():
        if data.get(name) is not None:
            lengths = _check_array(data[name], form, field_name(*path, name), lengths)
    common.update({name: n for name, n in lengths.items() if name.isupper()})
    counts = data.get("n_poses")
    if isinstance(counts, np.ndarray):
        n = len(data["poses"])
        if (counts < 0).any() or counts.sum() != n:
            _refuse(field_name(*path, "n_poses"), f"must add up to {n}, the poses", counts.tolist())
    for name, item in data.items():
        _check_arrays(item, (*path, name), common)


def _check_array(array: object, form: str, where: str, lengths: dict[str, int]) -> dict[str, int]:
    """Check the kind, the lengths and the range of an array; return the lengths that are known then."""
    kind, *names = form.split()
    shape = array.shape if isinstance(array, np.ndarray) else None
    known = dict(lengths)
    fits = shape is not None and len(shape) == len(names)
    if shape is not None and fits:
        for name, n in zip(names, shape, strict=True):
            fits = fits and known.setdefault(name, int(name) if name.isdigit() else n) == n
    if not fits or not isinstance(array, np.ndarray) or array.dtype.kind != kind:
        text = " x ".join(str(known.get(name, name)) for name in names).lower()
        got = "no array" if not isinstance(array, np.ndarray) else f"{array.dtype} {array.shape}"
        raise PlanFileError(f"{where} must be an array of {text}, of the kind {kind}. Got {got}.")
    if not np.isfinite(array).all():
        raise PlanFileError(f"{where} must be finite. Got NaN or infinity.")
    if names[-2:] == ["4", "4"]:
        _check_rigid(array, where)
    most = _BELOW.get(where.rpartition(".")[2])
    if most is not None and not ((array >= 0) & (array < most)).all():
        _refuse(
            where, f"must be from 0 to {most - 1}", array[(array < 0) | (array >= most)][0].item()
        )
    return known


def check_setting(setting: Mapping[str, Any], *where: object) -> None:
    """Refuse a setting whose pose is not rigid or whose probabilities are not those of its entities."""
    _check_rigid(np.array(setting["cam2world"], dtype=float)[None], field_name(*where, "cam2world"))
    _check_keys(setting["probability"], setting["entities"], *where, "probability")


def _check_rigid(poses: np.ndarray, name: str) -> None:
    turns = poses[:, :3, :3]
    # beyond this, products overflow before they can be compared
    off = np.inf if np.abs(turns).max(initial=0.0) > 2.0 else _off_rotation(turns)
    if off > _RIGID:
        raise PlanFileError(
            f"{name} must hold a rotation: orthonormal, determinant +1. Got one off by {off:.3g}."
        )
    if np.abs(poses[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(initial=0.0) > 0.0:
        wrong = poses[(poses[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1), 3][0]
        raise PlanFileError(
            f"{name} must have the last row [0, 0, 0, 1]. Got {shown(wrong.tolist())}."
        )


def _off_rotation(turns: np.ndarray) -> float:
    """Return by how much matrices (n, 3, 3) are no rotations, at most."""
    gram = np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3)).max(initial=0.0)
    return float(max(gram, np.abs(np.linalg.det(turns) - 1.0).max(initial=0.0)))


def _check_workspace(request: Mapping[str, Any]) -> None:
    """Check that the workspace is a box, and that there is a part."""
    for name in ("part", "workspace"):
        if request[name] is None:
            _refuse(f"request.{name}", "must be given", None)
    low, high = np.array(request["workspace"], dtype=float)
    if not (low < high).all():
        rule = "must hold the lower corner, then the upper one"
        _refuse("request.workspace", rule, request["workspace"])


def _check_witnesses(setting: Mapping[str, Any], targets: Mapping[str, Any], k: int) -> None:
    """Check that a setting uses witnesses that its targets have."""
    for name, number in setting.get("witness", {}).items():
        where = field_name("settings", k, "witness", name)
        if name not in setting["entities"]:
            _refuse(where, "must be of an item of the setting", name)
        n = len(targets[name]["witnesses"]) if name in targets else 0
        if number >= n:
            _refuse(where, f"must be below {n}, the number of its witnesses", number)


def _check_promises(
    setting: Mapping[str, Any], request: Mapping[str, Any], targets: Mapping[str, Any], k: int
) -> None:
    """Check what the plan says of one setting: inside the workspace, all constraints met, probable enough."""
    position = np.array(setting["cam2world"], dtype=float)[:3, 3]
    low, high = np.array(request["workspace"], dtype=float)
    if not ((position >= low - _SAME) & (position <= high + _SAME)).all():
        _refuse(
            field_name("settings", k, "cam2world"), "must be in the workspace", position.tolist()
        )
    for i, name in enumerate(setting["entities"]):
        if name not in targets:
            where = field_name("settings", k, "entities", i)
            _refuse(where, "must be one of the plan's targets", name)
    required = request["probability"]
    for name, value in setting["probability"].items():
        if value < required - _SAME:
            rule = f"must be at least the required probability, {required:g}"
            _refuse(field_name("settings", k, "probability", name), rule, value)
    _check_p_all(setting, required, k)
    for name, value in setting["margins"].items():
        if not isinstance(value, Mapping) and value < -_SAME:
            _refuse(
                field_name("settings", k, "margins", name),
                "must not be negative: the constraint is met",
                value,
            )


def _check_p_all(setting: Mapping[str, Any], required: float, k: int) -> None:
    """Check that what is stated of everything together is of the setting's entities, and enough."""
    given = [name for name in ("p_all", "p_all_together", "p_all_poses") if name in setting]
    if not given:
        return
    if len(given) < 3:
        _refuse(field_name("settings", k, given[0]), "must come with all fields of P_all", given)
    _check_keys(setting["p_all"], setting["entities"], "settings", k, "p_all")
    for name, value in setting["p_all"].items():
        where = field_name("settings", k, "p_all", name)
        if value > setting["probability"].get(name, 1.0) + _SAME:
            rule = f"must be at most the entity's probability, {setting['probability'][name]:g}"
            _refuse(where, rule, value)
        if value < min(required, _SHOWN_BY_COUNTING) - _SAME:
            _refuse(where, f"must be at least the required probability, {required:g}", value)


def _check_windows(setting: Mapping[str, Any], k: int) -> None:
    """Check that every item has a search window, and that the lines that are told of lie in them."""
    windows = setting.get("search_window_px", {})
    if "search_window_px" in setting:
        _check_keys(windows, setting["entities"], "settings", k, "search_window_px")
    for name, value in setting.get("lines_in_window_px", {}).items():
        where = field_name("settings", k, "lines_in_window_px", name)
        if name not in windows:
            _refuse(where, "must be of an entity with a search window", name)
        if value > windows[name] + _SAME:
            _refuse(where, f"must be at most the search window, {windows[name]:g}", value)


def _check_everyone_once(data: Mapping[str, Any], targets: Mapping[str, Any]) -> None:
    inspected = {name for setting in data["settings"] for name in setting["entities"]}
    for name in data["uninspectable"]:
        if name not in targets:
            _refuse(field_name("uninspectable", name), "must be one of the plan's targets", name)
    for name in data.get("uninspectable_kinds", {}):
        if name not in data["uninspectable"]:
            path = field_name("uninspectable_kinds", name)
            _refuse(path, "must be a name that has a reason", name)
    for name in data.get("not_planned_frames", {}):
        if name not in data.get("not_planned", {}):
            path = field_name("not_planned_frames", name)
            _refuse(path, "must be a name that has a reason", name)
    for name in targets:
        if (name in inspected) == (name in data["uninspectable"]):
            place = "both" if name in inspected else "neither"
            where = field_name("targets", name)
            raise PlanFileError(f"{where} must be in a setting or uninspectable. Got {place}.")


def _check_foreseen(data: Mapping[str, Any], dimensions: Sequence[str]) -> None:
    """Check that what is foreseen is of dimensions that its settings measure, once each, and grows with breaks."""
    seen = set()
    for k, row in enumerate(data.get("foreseen", ())):
        name = row["name"]
        number = row["setting"]
        if number >= len(data["settings"]):
            rule = f"must be the number of a setting, from 0 to {len(data['settings']) - 1}"
            _refuse(field_name("foreseen", k, "setting"), rule, number)
        path = field_name("foreseen", k, "name")
        if name not in dimensions or name not in data["settings"][number]["entities"]:
            _refuse(path, f"must be a dimension that setting {number} measures", name)
        if (name, number) in seen:
            _refuse(path, f"must stand once for setting {number}", name)
        seen.add((name, number))
        if row["unseen_uncertainty"] < row["expanded_uncertainty"]:
            rule = "must be at least expanded_uncertainty"
            _refuse(
                field_name("foreseen", k, "unseen_uncertainty"), rule, row["unseen_uncertainty"]
            )


def _check_split(data: Mapping[str, Any], targets: Mapping[str, Any]) -> None:
    """Check that what two settings measure has both of its ends in settings, each once, and is probable enough."""
    entities: dict[str, list[int]] = {}
    split = data.get("split", {})
    required = data["request"]["probability"]
    for k, setting in enumerate(data["settings"]):
        for name, entity in setting.get("ends", {}).items():
            path = field_name("settings", k, "ends", name)
            if name not in setting["entities"]:
                _refuse(path, "must be of an item of the setting", name)
            if len(targets[name]["witnesses"][0]["entities"]) < 2:
                _refuse(path, "must be of a dimension of several entities", name)
            entities.setdefault(name, []).append(entity)
    for name in (*split, *entities):
        path = field_name("split", name)
        if name not in split:
            raise PlanFileError(f"{path} must be given. Got none.")
        if sorted(entities.get(name, [])) != [0, 1]:
            rule = "must have each of its two ends in one setting, as ends of settings say"
            _refuse(path, rule, entities.get(name, []))
        value = split[name]["p_all"]
        if value < min(required, _SHOWN_BY_COUNTING) - _SAME:
            rule = f"must be at least the required probability, {required:g}"
            _refuse(field_name("split", name, "p_all"), rule, value)


def _check_split_rates(simulation: Mapping[str, Any], split: Mapping[str, Any]) -> None:
    """Check that what two settings measure was simulated, with the probability that the plan states."""
    rates = simulation.get("split", {})
    _check_keys(rates, list(split), "simulation", "split")
    for name, rate in rates.items():
        path = ("simulation", "split", name)
        _check_rate(rate, simulation, *path)
        if abs(rate["predicted"] - split[name]["probability"]) > _SAME:
            rule = f"must be the probability in split, {split[name]['probability']:g}"
            _refuse(field_name(*path, "predicted"), rule, rate["predicted"])


def _check_bound(data: Mapping[str, Any]) -> None:
    n = len(data["settings"])
    bound = data["bound"]
    if not min(n, 1) <= bound <= n:
        rule = (
            f"must be 1 to {n}, the number of settings"
            if n
            else "must be 0, as there are no settings"
        )
        _refuse("bound", rule, bound)
    of_whole = data.get("whole_bound", 0)
    if of_whole and not bound < of_whole <= n:
        _refuse("whole_bound", f"must be 0, or {bound + 1} to {n}", of_whole)


def _check_simulation(simulation: Mapping[str, Any], settings: Sequence[Any]) -> None:
    _check_one_each("simulation.rates", simulation["rates"], settings)
    for k, (rates, setting) in enumerate(zip(simulation["rates"], settings, strict=True)):
        _check_keys(rates, setting["entities"], "simulation", "rates", k)
        for name, rate in rates.items():
            where = ("simulation", "rates", k, name)
            _check_rate(rate, simulation, *where)
            if abs(rate["predicted"] - setting["probability"][name]) > _SAME:
                rule = f"must be the setting's probability, {setting['probability'][name]:g}"
                _refuse(field_name(*where, "predicted"), rule, rate["predicted"])
    if simulation.get("shown") is not None:
        _check_images(simulation["shown"], settings)


def _check_images(images: Mapping[str, Any], settings: Sequence[Any]) -> None:
    """Check that the counts of images are those of each setting's names, and no more than there are."""
    counts = images["counts"]
    n = images["n"]
    _check_one_each("simulation.shown.counts", counts, settings)
    for k, (shown_counts, setting) in enumerate(zip(counts, settings, strict=True)):
        for name, n_shown in shown_counts.items():
            where = field_name("simulation", "shown", "counts", k, name)
            if name not in setting["entities"]:
                _refuse(where, "must be of a name that the setting measures", name)
            if n_shown > n:
                _refuse(where, f"must be at most {n}, the number of images", n_shown)


def _check_light(light: Mapping[str, Any], settings: Sequence[Any]) -> None:
    """Check that every setting tells of each name once how it is lit, and that lamps and bound are possible."""
    n = len(light["lamps"])
    if light["lower_bound"] > n:
        _refuse(
            "light.lower_bound", f"must be at most {n}, the number of lamps", light["lower_bound"]
        )
    has_area = light.get("area") is not None
    if has_area != (light["kind"] not in ("fixed", "ring", "placed")):
        _refuse(
            "light.area", "must be given of a light with an area, and of no other", light["kind"]
        )
    _check_one_each("light.settings", light["settings"], settings)
    for k, (lit, setting) in enumerate(zip(light["settings"], settings, strict=True)):
        where = ("light", "settings", k)
        reported = list(lit["unlit"])
        for i, image in enumerate(lit["images"]):
            reported += image["contrast"]
            path = (*where, "images", i)
            on = image["lamps"]
            if light.get("area"):
                if on:
                    _refuse(field_name(*path, "lamps"), "must be empty with light.area", on)
            elif (
                not on or on != sorted(set(on)) or on[-1] >= n or (len(on) > 1) > light["together"]
            ):
                rule = f"must be numbers of lamps below {n} in rising order, more than one only if they are on together"
                _refuse(field_name(*path, "lamps"), rule, on)
            for name, value in image["contrast"].items():
                if value < light["contrast"] - _SAME:
                    rule = f"must be at least light.contrast, {light['contrast']:g}"
                    _refuse(field_name(*path, "contrast", name), rule, value)
            exposed = image.get("expose_for", {})
            named = [("silhouettes", name) for name in image["silhouettes"]]
            named += [("expose_for", exposed[field]) for field in ("target", "dimmest") if exposed]
            for field, name in named:
                if name not in image["contrast"]:
                    _refuse(field_name(*path, field), "must be names that the image shows", name)
        if sorted(reported) != sorted(setting["entities"]):
            _refuse(
                field_name(*where),
                "must tell of each of the setting's entities once",
                sorted(reported),
            )


def _check_rate(rate: Mapping[str, Any], simulation: Mapping[str, Any], *where: object) -> None:
    n = simulation["n"]
    together = simulation["confidence"]
    if rate["confidence"] < together:
        rule = f"must be at least simulation.confidence, {together:g}"
        _refuse(field_name(*where, "confidence"), rule, rate["confidence"])
    if rate["n"] != n:
        _refuse(field_name(*where, "n"), f"must be simulation.n, {n}", rate["n"])
    for field in ("successes", "outside"):
        if rate[field] > n:
            _refuse(field_name(*where, field), f"must be at most n, {n}", rate[field])
    if not rate["low"] <= rate["successes"] / n <= rate["high"]:
        interval = f"{rate['low']:g} to {rate['high']:g}"
        rule = f"must be an interval, low to high, that contains successes / n, {rate['successes'] / n:g}"
        raise PlanFileError(f"{field_name(*where)} {rule}. Got {interval}.")


def _check_one_each(name: str, values: Sequence[Any], settings: Sequence[Any]) -> None:
    if len(values) != len(settings):
        _refuse(name, f"must hold one object per setting, {len(settings)}", len(values))


def _check_keys(values: Mapping[str, Any], names: Sequence[str], *where: object) -> None:
    """Refuse an object that does not have exactly one field per entity of the setting."""
    for name in names:
        if name not in values:
            raise PlanFileError(f"{field_name(*where, name)} must be given. Got none.")
    for name in values:
        if name not in names:
            _refuse(field_name(*where, name), "must be of an entity of the setting", name)


def _names_of(key: str) -> list[str]:
    """Return the names a key of the outcomes stands for."""
    try:
        names = json.loads(key)
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        _refuse("outcomes", "must have sorted JSON arrays of names as keys", key)
    if names != sorted(set(names)):
        _refuse("outcomes", "must have sorted JSON arrays of names as keys", key)
    return names


def _refuse(name: str, rule: str, value: object) -> None:
    raise PlanFileError(f"{name} {rule}. Got {shown(value)}.")


# Arrays, and what holds them, as values that JSON can hold, bit for bit and shorter than as lists
# of numbers.
#
# An array becomes ``{"array": type, "shape": [...], "base64": bytes}``: little-endian, row by
# row; Booleans as bits.


_TYPES = ("<f8", "<i8", "bits")


def packed(value: object) -> Any:
    """Return a value with all arrays in it packed.

    Parameters
    ----------
    value : object
        Plain values, arrays of numbers or Booleans, and dicts, lists and tuples of them; what can be called is called
        and what it returns is taken.
    """
    if callable(value):
        return packed(value())
    if isinstance(value, np.ndarray):
        return _packed_array(value)
    if isinstance(value, Mapping):
        return {key: packed(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [packed(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def unpacked(value: object) -> Any:
    """Return what `packed` was given; tuples come back as lists.

    Raises
    ------
    ValueError
        If something looks like a packed array and is none.
    """
    if isinstance(value, dict):
        return (
            _unpacked_array(value)
            if "base64" in value
            else {key: unpacked(item) for key, item in value.items()}
        )
    return [unpacked(item) for item in value] if isinstance(value, list) else value


def _packed_array(array: np.ndarray) -> dict[str, Any]:
    if array.dtype == bool:
        kind = "bits"
        content = np.packbits(array.ravel()).tobytes()
    else:
        kind = "<i8" if np.issubdtype(array.dtype, np.integer) else "<f8"
        content = np.ascontiguousarray(array, dtype=kind).tobytes()
    return {
        "array": kind,
        "shape": list(array.shape),
        "base64": base64.b64encode(content).decode("ascii"),
    }


def _unpacked_array(data: dict[str, Any]) -> np.ndarray:
    kind = data.get("array")
    shape = data.get("shape")
    if kind not in _TYPES or not isinstance(shape, list):
        raise ValueError(
            f"array must be one of {', '.join(_TYPES)}, with a shape. Got {kind!r} and {shape!r}"
        )
    content = base64.b64decode(data["base64"], validate=True)
    if kind == "bits":
        bits = np.unpackbits(np.frombuffer(content, dtype=np.uint8))
        n = int(np.prod(shape, dtype=np.int64))
        if not 0 <= len(bits) - n < 8:
            raise ValueError(f"array of the shape {shape} must have {n} bits. Got {len(bits)}")
        return bits[:n].astype(bool).reshape(shape)
    return np.frombuffer(content, dtype=kind).reshape(shape).copy()

"""How a plan is searched for is one value: each number in it is checked, tells requests apart, and comes back."""

import json
from dataclasses import is_dataclass, replace

import pytest

from planner import Effort, RequestError
from planner.effort.bound import BoundEffort, BoxEffort, Division, Halving, Subdivision
from planner.effort.effort import NORMAL, QUICK, THOROUGH, Improving, Pricing, StageEffort
from planner.effort.poses import Repair, Search
from planner.identity import plain_fields, restored_value

OTHER_WORDS = {"selection": "sus", "scaling": "rank", "sampling": "workspace"}


def with_field(record, name, value):
    return (
        replace(record, **{name: value})
        if is_dataclass(record)
        else record._replace(**{name: value})
    )


def other(name, value):
    """Another legal value."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, tuple):
        return (*value, 7)
    if value is None:
        return 1000
    return OTHER_WORDS[name] if isinstance(value, str) else value + 1


def changed_by_one_value(record):
    """Yield where a value is, and a record in which only that differs, for every value of a record."""
    names = list(record.__dataclass_fields__ if is_dataclass(record) else record._fields)
    for name in names:
        value = getattr(record, name)
        if is_dataclass(value) or hasattr(value, "_asdict"):
            for path, inner in changed_by_one_value(value):
                yield (name, *path), with_field(record, name, inner)
        else:
            yield (name,), with_field(record, name, other(name, value))


CHANGED = dict(changed_by_one_value(NORMAL))


def test_every_value_tells_requests_apart_and_comes_back_from_a_file():
    assert len(CHANGED) > 120
    stored = {json.dumps(plain_fields(effort)) for effort in (NORMAL, *CHANGED.values())}
    assert len(stored) == 1 + len(CHANGED)
    for effort in CHANGED.values():
        assert restored_value(Effort, json.loads(json.dumps(plain_fields(effort)))) == effort


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Effort(pricing=Pricing(parents=0)),
            r"pricing\.parents must be an integer of at least 1\. Got 0",
        ),
        (
            lambda: Effort(pricing=Pricing(least_gain=-1.0)),
            r"pricing\.least_gain must be a finite number, 0 or more\. Got -1\.0",
        ),
        (
            lambda: BoundEffort(boxes=BoxEffort(Halving(finest=float("nan")))),
            r"bound\.boxes\.halving\.finest must be a finite number",
        ),
        (
            lambda: BoundEffort(subdivision=Subdivision(boxes=1.5)),
            r"bound\.subdivision\.boxes must be an integer",
        ),
        (
            lambda: Effort(bound=BoundEffort(division=Division(tick_s="soon"))),
            r"bound\.division\.tick_s must be a finite number",
        ),
        (
            lambda: Effort(stages=StageEffort(improving=Improving(directions=(4, 0)))),
            r"stages\.improving\.directions must be an integer of at least 1\. Got 0",
        ),
        (lambda: Search(repair=Repair(rounds=0)), r"repair\.rounds must be an integer"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_name(make, message):
    with pytest.raises(RequestError, match=message):
        make()


def test_compiled_loops_get_the_numbers_they_are_made_for():
    boxes = BoundEffort(boxes=BoxEffort(Halving(look_share=1))).boxes
    assert boxes == BoxEffort(Halving(look_share=1.0))
    assert isinstance(boxes.halving.look_share, float)
    assert NORMAL.bound.boxes == BoxEffort()
    assert NORMAL.bound.subdivision == Subdivision()


def test_presets_are_named():
    named = [Effort.named(name) for name in ("quick", "standard", "thorough")]
    assert named == [QUICK, NORMAL, THOROUGH]
    assert Effort() == NORMAL

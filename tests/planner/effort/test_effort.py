"""How a plan is searched for is one value: each number in it is checked, tells requests apart, and comes back."""

import json
from dataclasses import fields, is_dataclass, replace

import pytest

from ground.convert import from_plain, to_plain
from planner import Effort, RequestError, Search
from planner.effort import NORMAL, QUICK, THOROUGH

OTHER_WORDS = {"selection": "sus", "scaling": "rank", "sampling": "workspace"}


def other(name, value):
    """Another legal value."""
    if isinstance(value, bool):
        return not value
    if value is None:
        return 1000
    return OTHER_WORDS[name] if isinstance(value, str) else value + 1


def changed_by_one_value(record):
    """Yield records in which only one value differs, for every value of a record."""
    for field in fields(record):
        value = getattr(record, field.name)
        if is_dataclass(value):
            for inner in changed_by_one_value(value):
                yield replace(record, **{field.name: inner})
        else:
            yield replace(record, **{field.name: other(field.name, value)})


CHANGED = list(changed_by_one_value(NORMAL))


def test_every_value_tells_requests_apart_and_comes_back_from_a_file():
    assert len(CHANGED) == len(fields(Effort)) - 1 + len(fields(Search))
    stored = {json.dumps(to_plain(effort)) for effort in (NORMAL, *CHANGED)}
    assert len(stored) == 1 + len(CHANGED)
    for effort in CHANGED:
        plain = json.loads(json.dumps(to_plain(effort, defaults=True)))
        assert from_plain(Effort, plain, RequestError) == effort


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"viewpoints": 0}, r"viewpoints must be an integer of at least 1\. Got 0"),
        ({"bound_nodes": -1}, r"bound_nodes must be an integer of at least 0\. Got -1"),
        ({"bound_targets": 1.5}, r"bound_targets must be an integer"),
        ({"give_up": -1.0}, r"give_up must be finite and not negative\. Got -1\.0"),
        ({"good_enough": float("nan")}, r"good_enough must be finite and not negative"),
        ({"margin_generations": "long"}, r"margin_generations must be an integer"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_name(values, message):
    with pytest.raises(RequestError, match=message):
        Effort(**values)


def test_presets_are_named():
    named = [Effort.named(name) for name in ("quick", "standard", "thorough")]
    assert named == [QUICK, NORMAL, THOROUGH]
    assert Effort() == NORMAL

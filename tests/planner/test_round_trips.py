"""Whatever a plan, a state or a file of dimensions holds comes back as it was, bit for bit."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from plan_examples import plan, setting

from errors.measurands.measurand import kinds
from planner import Dimension
from planner.plan import read_plan
from planner.plan_file import packed, unpacked
from planner.request.dimension_files import read_wanted
from planner.resume import PlanningState
from planner.sensor_setting import Outcome

QUICK = settings(max_examples=20, deadline=None, derandomize=True)
NAMES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12).filter(str.strip)
LENGTHS = st.floats(1e-9, 1e9)
NUMBERS = st.floats(-1e6, 1e6)


@QUICK
@given(
    names=st.lists(NAMES, min_size=3, max_size=3, unique=True),
    ends=st.lists(NUMBERS, min_size=6, max_size=6),
    reason=NAMES,
    probability=st.floats(0.5, 1.0),
    accuracy=st.floats(0.01, 0.999999),
    seed=st.integers(0, 2**63 - 1),
)
def test_plans(tmp_path_factory, names, ends, reason, probability, accuracy, seed):
    first, second, third = names
    segment = np.reshape(ends, (2, 3))
    segment[1] += 1.0 + np.abs(segment).max()
    made = plan(
        settings=(setting((40.0, -180.0, 620.0), [first, second], probability=probability),),
        entities=dict.fromkeys(names, segment.tolist()),
        uninspectable={third: reason},
        accuracy=accuracy,
        probability=0.5 * probability,
        seed=seed,
        part=reason,
    )
    path = tmp_path_factory.mktemp("plan") / "plan.json"
    made.write(path)
    again = read_plan(path)
    assert again.to_dict() == made.to_dict()
    assert np.array_equal(again.entities[first], segment)
    assert (again.seed, again.accuracy, again.uninspectable) == (seed, accuracy, {third: reason})
    again.write(path.with_name("again.json"))
    assert path.read_bytes() == path.with_name("again.json").read_bytes()


@QUICK
@given(
    st.lists(NAMES, min_size=1, max_size=4, unique=True).filter(lambda n: n != ["one more"]), NAMES
)
def test_states(tmp_path_factory, names, reason):
    path = tmp_path_factory.mktemp("state") / "state.json"
    state = PlanningState({"part": "block"}, path)
    state.put(names, Outcome(reason=reason))
    several = sorted({*names, "one more"})
    found = setting((40.0, -180.0, 620.0), several)
    state.put(several, Outcome(found))
    state.save()
    again = PlanningState({"part": "block"}, path)
    assert len(again) == 2
    assert again.get(reversed(names)).reason == reason
    assert again.get(several).setting.to_dict() == found.to_dict()


SHAPES = arrays.array_shapes(min_dims=1, max_dims=3, max_side=4)


@QUICK
@given(
    arrays.arrays(st.sampled_from([np.float64, np.int64, np.bool_]), SHAPES),
    st.recursive(
        st.none() | st.booleans() | st.integers() | NAMES, lambda inner: st.lists(inner, max_size=3)
    ),
)
def test_values_of_checkpoints(table, plain):
    last = unpacked(json.loads(json.dumps(packed({"table": table, "plain": plain}))))
    assert last["plain"] == plain
    assert (last["table"].dtype, last["table"].shape) == (table.dtype, table.shape)
    assert last["table"].tobytes() == table.tobytes()


ENTITIES = st.one_of(st.integers(0, 999), st.integers(0, 99).map("r{}".format))
ASKED = st.one_of(
    st.fixed_dictionaries({"max_error": LENGTHS}),
    st.fixed_dictionaries({"accuracy": st.floats(0.01, 0.99)}),
    st.tuples(LENGTHS, LENGTHS, st.floats(0.01, 1.0)).map(
        lambda t: {"tolerance": [-t[0], t[1]], "share": t[2]}
    ),
    st.just({}),
)


@QUICK
@given(
    st.dictionaries(
        NAMES,
        st.tuples(st.sampled_from(["length", "diameter", "distance"]), ENTITIES, ENTITIES, ASKED),
        min_size=1,
    )
)
def test_files_of_dimensions(tmp_path_factory, wanted):
    path = tmp_path_factory.mktemp("wanted") / "dimensions.json"
    content = {
        name: {kind: [one, other] if kind == "distance" else one, **asked}
        for name, (kind, one, other, asked) in wanted.items()
    }
    path.write_text(json.dumps({"dimensions": content}))
    expected = {
        name: Dimension(kind, (one, other) if kind == "distance" else (one,), **asked)
        for name, (kind, one, other, asked) in wanted.items()
    }
    assert read_wanted(path, kinds()) == expected

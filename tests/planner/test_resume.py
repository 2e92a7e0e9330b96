"""A planning that is interrupted, wherever that is, comes to the same plan, and little is done again."""

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from plan_examples import plan as plan_by_hand

from planner import BoxRegion, Camera, MeshRegion, PoseUncertainty, SphereRegion, resume
from planner import cover as few_columns
from planner.bound import lower_bound, pose_space
from planner.effort import Effort
from planner.exceptions import OutputError, PlanFileError
from planner.inspection import plan_inspection
from planner.plan_file import check_checkpoint, packed, unpacked
from planner.request.reach import reach_identity
from planner.resume import PlanningState, holds_plan
from planner.sensor_setting import Outcome

# a narrow field of view, so that column generation, sweeps of the proof and refutations all have something to do
CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = list(EDGES)[:6]
EFFORT = Effort(
    viewpoints=2,
    pricing_rounds=3,
    refutations=2,
    bound_nodes=3000,
    margin_generations=3,
)


class Stop(Exception):
    pass


@pytest.fixture(scope="module", autouse=True)
def few_steps():
    with pytest.MonkeyPatch.context() as patch:
        # the space of poses has few parts, and soon: otherwise a small part has no sweeps, or long ones
        patch.setattr(pose_space, "_PARTS", 16)
        patch.setattr(lower_bound, "_TREE_NODES", 300)
        # a step of this search leaves nothing in the state, so a tenth of them shows as much
        patch.setattr(few_columns, "_EXCHANGES", 100)
        yield


@pytest.fixture(scope="module")
def space():
    return BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES)


@pytest.fixture
def at_once(monkeypatch):
    """Save whenever that is possible."""
    monkeypatch.setattr(resume, "_SECONDS", -1.0)
    monkeypatch.setattr(resume, "_TIMES", 0.0)


def plan_box(space, path=None, progress=None, **options):
    options = {"effort": EFFORT, "rng": 3, **options}
    return plan_inspection(
        space.solid,
        space.entities,
        CAMERA,
        UNCERTAINTY,
        space=space,
        state=path,
        progress=progress,
        **options,
    )


def stop_at(k):
    calls = iter(range(1, k + 1))

    def progress(done, total, label):
        if next(calls) == k:
            raise Stop

    return progress


def exact(plan):
    return json.dumps(plan.to_dict())


@pytest.fixture(scope="module")
def whole(space):
    """The plan, and the labels under which it told of its progress."""
    labels = []
    return plan_box(space, progress=lambda done, total, label: labels.append(label)), labels


def points_of_interruption(labels):
    """Return first and last calls of every label, and some in between."""
    some = set(np.linspace(1, len(labels), 6).astype(int).tolist())
    for label in set(labels):
        some |= {labels.index(label) + 1, len(labels) - labels[::-1].index(label)}
    return sorted(some)


def test_whatever_is_interrupted_the_plan_is_the_same_bit_for_bit(space, whole, tmp_path):
    plan, labels = whole
    assert labels.count("lower bound") > 60
    points = points_of_interruption(labels)
    steps = set()
    assert len(points) > 8
    for k in points:
        path = tmp_path / f"{k}.json"
        with pytest.raises(Stop):
            plan_box(space, path, stop_at(k))
        if path.exists():
            steps.add(json.loads(path.read_text())["checkpoint"]["stage"])
        assert exact(plan_box(space, path)) == exact(plan)
    assert steps >= {"candidate poses", "first columns", "column generation", "lower bound"}
    # what follows the proof is not done again from there
    assert steps & {"refutation", "counted columns", "settings"}


def test_candidate_poses_are_not_drawn_again(space, whole, tmp_path, monkeypatch):
    def stop(*arguments, **options):
        raise Stop

    path = tmp_path / "state.json"
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.stages.price_poses", stop)
        with pytest.raises(Stop):
            plan_box(space, path)
    assert json.loads(path.read_text())["checkpoint"]["stage"] == "first columns"
    monkeypatch.setattr("planner.search.stages.judged_poses", stop)
    assert exact(plan_box(space, path)) == exact(whole[0])


def test_pairs_that_exclude_each_other_and_the_tree_of_poses_are_kept(
    space, whole, tmp_path, monkeypatch
):
    """Neither tells of its progress for long."""

    def stop(*arguments, **options):
        raise Stop

    path = tmp_path / "state.json"
    bound = import_module("planner.bound.lower_bound")
    asked = []
    find = bound.find_conflicts
    with monkeypatch.context() as patch:
        # those of the first columns are found long before the proof
        patch.setattr(
            bound,
            "find_conflicts",
            lambda *given: asked.append(1) or (stop if asked[1:] else find)(*given),
        )
        with pytest.raises(Stop):
            plan_box(space, path)
    assert json.loads(path.read_text())["checkpoint"]["stage"] == "lower bound"
    splits = []
    split = bound.PoseTree.split
    with monkeypatch.context() as patch:
        patch.setattr(
            bound.PoseTree,
            "split",
            lambda *given: splits.append(1) or (stop if len(splits) > 2 else split)(*given),
        )
        with pytest.raises(Stop):
            plan_box(space, path)
    kept = json.loads(path.read_text())["checkpoint"]["entries"]["growing"]
    assert kept["tree"]["made"] > 0
    monkeypatch.setattr(bound, "find_conflicts", stop)
    splits.clear()
    monkeypatch.setattr(
        bound.PoseTree, "split", lambda *given: splits.append(given[0].made) or split(*given)
    )
    assert exact(plan_box(space, path)) == exact(whole[0])
    assert splits[0] == kept["tree"]["made"]


def test_interrupted_again_and_again_it_still_gets_there(space, whole, tmp_path):
    plan, labels = whole
    path = tmp_path / "state.json"
    goes = 0
    again = None
    while again is None and goes < 20:
        goes += 1
        with suppress(Stop):
            again = plan_box(space, path, stop_at(25))
    assert exact(again) == exact(plan)
    assert len(labels) / 25 < goes < 2 * len(labels) / 25


def test_interrupted_with_an_executor_and_resumed_without(space, whole, tmp_path):
    plan, labels = whole
    for k in (len(NAMES) + 2, len(labels) // 2, len(labels) - 2):
        with ThreadPoolExecutor(2) as executor, pytest.raises(Stop):
            plan_box(space, tmp_path / f"{k}.json", stop_at(k), executor=executor)
        assert exact(plan_box(space, tmp_path / f"{k}.json")) == exact(plan)


def test_what_a_killed_process_leaves_is_as_good(space, whole, tmp_path, at_once):
    """No exception, no time to save: only what was saved before is there."""
    plan, labels = whole
    copies = {}
    path = tmp_path / "state.json"

    def copy(done, total, label):
        if path.exists():
            copies[len(copies)] = path.read_text()

    plan_box(space, path, copy)
    for k in np.linspace(0, len(copies) - 1, 6).astype(int):
        path.write_text(copies[k])
        left = []
        assert exact(plan_box(space, path, lambda *call, left=left: left.append(call))) == exact(
            plan
        )
        # what was done is not done again, but for a few parts in the work
        assert len(left) <= len(labels) - k + len(NAMES) + 5


def test_a_finished_state_gives_the_plan_without_planning(space, whole, tmp_path):
    path = tmp_path / "state.json"
    assert plan_box(space, path) == whole[0]
    assert holds_plan(path)
    assert exact(plan_box(space, path, stop_at(1))) == exact(whole[0])


def test_nothing_found_out_leaves_no_state(space, tmp_path, monkeypatch):
    def stop(*arguments, **options):
        raise Stop

    monkeypatch.setattr("planner.search.stages.judged_poses", stop)
    with pytest.raises(Stop):
        plan_box(space, tmp_path / "state.json")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "change",
    [
        {"rng": 4},
        {"accuracy": 0.97},
        {"reach": BoxRegion((0, 0, 0), (1, 1, 1))},
        {"effort": Effort(viewpoints=11)},
    ],
)
def test_state_of_another_request_is_refused(space, whole, tmp_path, change):
    path = tmp_path / "state.json"
    with pytest.raises(Stop):
        plan_box(space, path, stop_at(10))
    before = path.read_bytes()
    with pytest.raises(
        PlanFileError, match="state file must belong to the same request and version of the program"
    ):
        plan_box(space, path, **change)
    assert path.read_bytes() == before


def test_state_of_another_version_of_the_program_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "state.json"
    monkeypatch.setattr(resume, "program_digest", lambda: "1" * 64)
    first = PlanningState({}, path)
    first.put(["a"], Outcome(reason="no view"))
    first.save()
    monkeypatch.setattr(resume, "program_digest", lambda: "2" * 64)
    with pytest.raises(PlanFileError, match=r"Got another one: the version of the program changed"):
        PlanningState({}, path)


@pytest.mark.parametrize("version", [1, 2, 3])
def test_state_of_an_earlier_format_is_refused_clearly(tmp_path, version):
    path = tmp_path / "state.json"
    path.write_text(
        json.dumps({"format": resume.FORMAT, "version": version, "request": "0", "outcomes": {}})
    )
    with pytest.raises(
        PlanFileError,
        match=rf"must be a planning state of version 4\. Got version {version}, which another",
    ):
        PlanningState({}, path)
    assert not holds_plan(path)


def test_state_without_a_field_is_refused(tmp_path):
    path = tmp_path / "state.json"
    PlanningState({}, path).finish(plan_by_hand())
    data = json.loads(path.read_text())
    del data["checkpoint"]
    path.write_text(json.dumps(data))
    with pytest.raises(PlanFileError, match=r"checkpoint must be given\. Got none\."):
        PlanningState({}, path)


def wrong_arrays(array):
    """Arrays in place of another one that compiled loops must not see."""
    if array.dtype.kind == "f":
        for value in (np.nan, np.inf):
            wrong = array.copy()
            wrong.flat[-1] = value
            yield wrong
    yield array[:-1]
    yield array[..., None]
    yield array.astype(np.int64 if array.dtype.kind != "i" else np.float64)


@pytest.mark.parametrize(
    ("label", "path"),
    [
        ("candidate poses", "pools.near.poses"),
        ("candidate poses", "pools.realised.membership"),
        ("candidate poses", "pools.realised.quality"),
        ("combining targets", "entries.pricing.prices"),
        ("combining targets", "entries.pricing.covered"),
        ("lower bound", "inspected"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_whatever_the_digest_says(
    space, whole, tmp_path, at_once, label, path
):
    """Poses with NaN crashed a compiled loop; the digest is one that anybody can compute."""
    state = tmp_path / "state.json"
    labels = whole[1]
    with pytest.raises(Stop):
        plan_box(space, state, stop_at(len(labels) - labels[::-1].index(label)))
    data = json.loads(state.read_text())
    del data["digest"]
    *parents, name = path.split(".")
    holder = data["checkpoint"]
    for parent in parents:
        holder = holder[parent]
    for wrong in wrong_arrays(unpacked(holder[name])):
        holder[name] = packed(wrong)
        state.write_text(json.dumps({**data, "digest": resume._digest(data)}))
        with pytest.raises(PlanFileError, match=r"must be .*; plan again without it\.$") as refused:
            PlanningState(data["request"], state)
        assert "checkpoint." in str(refused.value)


def test_poses_that_are_not_rigid_and_faces_out_of_range_are_refused():
    poses = np.tile(np.eye(4), (2, 1, 1))
    check_checkpoint({"linear": {"poses": poses}})
    with pytest.raises(PlanFileError, match=r"checkpoint\.linear\.poses must hold a rotation"):
        check_checkpoint({"linear": {"poses": 2 * poses}})
    check_checkpoint({"tree": {"face": np.arange(6)}})
    with pytest.raises(PlanFileError, match=r"tree\.face must be from 0 to 5\. Got 6"):
        check_checkpoint({"tree": {"face": np.arange(7)}})
    with pytest.raises(PlanFileError, match=r"swept\.n_poses must add up to 2"):
        check_checkpoint({"swept": {"poses": poses, "n_poses": np.array([1, 2])}})


def test_state_that_cannot_be_written_is_told_before_the_work(space, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"state\.json must be in a folder that can be made"):
        plan_box(space, tmp_path / "file" / "state.json", stop_at(1))


def test_state_that_can_no_longer_be_written_ends_no_planning(space, whole, tmp_path, monkeypatch):
    first = []

    def full(path, text):
        first.append(path)
        if len(first) > 1:
            raise OutputError("disk full")

    monkeypatch.setattr(resume, "write_text", full)
    with pytest.warns(RuntimeWarning, match="state is no longer saved: disk full") as told:
        assert plan_box(space, tmp_path / "state.json") == whole[0]
    assert len(told) == 1


def test_saving_takes_a_small_share_of_the_time(tmp_path, monkeypatch):
    """One hundredth at most, however long it takes: with a clock that only saving moves, and the work between."""
    clock = [0.0]
    saved = [0]

    def write(path, text):
        clock[0] += 0.3
        saved[0] += 1

    monkeypatch.setattr(resume, "write_text", write)
    monkeypatch.setattr(resume.time, "monotonic", lambda: clock[0])
    memo = PlanningState({}, tmp_path / "state.json")
    for _ in range(100_000):
        clock[0] += 0.01
        memo.keep({})
    assert saved[0] * 0.3 < 0.02 * clock[0]
    assert saved[0] > 10


def test_a_large_state_is_saved_often_enough(tmp_path, monkeypatch):
    """Saving takes a second: what is lost is still less than the twenty seconds that are promised."""
    clock = [0.0]
    saved = []

    def write(path, text):
        clock[0] += 1.0
        saved.append(clock[0])

    monkeypatch.setattr(resume, "write_text", write)
    monkeypatch.setattr(resume.time, "monotonic", lambda: clock[0])
    memo = PlanningState({}, tmp_path / "state.json")
    for _ in range(10_000):
        clock[0] += 0.01
        memo.keep({})
    assert max(np.diff(saved)) < 20.0


def test_arrays_survive_being_packed_bit_for_bit():
    rng = np.random.default_rng(0)
    values = {
        "numbers": rng.normal(size=(3, 4, 4)) * 10.0 ** rng.integers(-300, 300, (3, 4, 4)),
        "special": np.array([np.nan, np.inf, -0.0]),
        "bits": rng.random((5, 13)) < 0.5,
        "none": np.zeros((0, 7), dtype=bool),
        "integers": [np.arange(5), {"n": np.int64(3)}],
        "later": lambda: (1.5, np.ones(2)),
    }
    again = unpacked(json.loads(json.dumps(packed(values))))
    for name in ("numbers", "special", "bits", "none"):
        assert again[name].shape == values[name].shape
        assert again[name].dtype == values[name].dtype
        assert again[name].tobytes() == values[name].tobytes()
    assert again["integers"][0].tolist() == [0, 1, 2, 3, 4]
    assert again["integers"][1] == {"n": 3}
    assert again["later"][1].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    "change", [{"array": "<f4"}, {"shape": [3]}, {"shape": None}, {"base64": "!"}]
)
def test_damaged_arrays_are_refused(change):
    for array in (np.ones(2), np.ones(20, dtype=bool)):
        with pytest.raises(ValueError, match=r"array|shape|base64|buffer|padding"):
            unpacked({**packed(array), **change})


# --- regions a robot can reach --------------------------------------------------------------------------------------

REGIONS = """
import functools, json, numpy as np
from planner import BoxRegion, MeshRegion, SphereRegion

class Robot:
    def __init__(self, arm): self.arm = arm
    def margin(self, positions): return self.arm - abs(positions).max(axis=-1)

class Named(Robot):
    state_name = "robot of cell 7"

def above(positions): return positions[:, 2] > 0

def near(positions, far): return (positions < far).all(axis=-1)

corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
regions = [
    None, BoxRegion((0, 0, 0), (1, 1, 1)), SphereRegion((0, 0, 0), 5.0), Robot(3.0), Robot(4.0), Named(3.0), above,
    functools.partial(near, far=3), functools.partial(near, far=4),
    MeshRegion(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    MeshRegion(2 * corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    lambda positions: positions[:, 0] > 0,
]
"""


def test_a_region_has_the_same_name_in_every_process_and_another_than_others():
    script = (
        REGIONS
        + "import json\nfrom planner.request.reach import reach_identity\n"
        + "print(json.dumps([*map(reach_identity, regions)]))"
    )
    runs = [
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    names = json.loads(runs[0].stdout)
    assert json.loads(runs[1].stdout) == names
    assert len({json.dumps(name) for name in names}) == len(names)
    assert not any("0x" in json.dumps(name) for name in names)
    assert names[0] is None
    assert names[1] == {"kind": "BoxRegion", "low": [0, 0, 0], "high": [1, 1, 1]}
    assert names[5] == {"state_name": "robot of cell 7"}
    assert names[6]["kind"] == "__main__.above"
    # nobody can know another lambda from this one
    assert names[-1] == {"unnamed": "__main__.<lambda>"}


def test_a_mesh_is_known_by_its_content():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    used = MeshRegion(corners.astype(float), np.array(triangles, dtype=np.int32))
    used.margin(np.zeros((1, 3)))
    assert reach_identity(used) == reach_identity(MeshRegion(np.asfortranarray(corners), triangles))
    assert reach_identity(used) != reach_identity(MeshRegion(corners, triangles[::-1]))
    assert reach_identity(SphereRegion((0, 0, 0), 1.0)) != reach_identity(
        SphereRegion((0, 0, 0), 2.0)
    )


def test_a_plan_with_a_mesh_to_reach_is_resumed_by_another_region_object(space, tmp_path):
    low = -900.0
    high = 1100.0
    corners = np.array([[x, y, z] for x in (low, high) for y in (low, high) for z in (low, high)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    one = {"reach": MeshRegion(corners, triangles), "effort": Effort(1, 0, 0, 0)}
    with pytest.raises(Stop):
        plan_box(space, tmp_path / "state.json", stop_at(len(NAMES) + 1), **one)
    again = plan_box(
        space, tmp_path / "state.json", **{**one, "reach": MeshRegion(corners, triangles)}
    )
    assert again == plan_box(space, **one)

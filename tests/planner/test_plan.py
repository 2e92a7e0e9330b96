import hashlib
import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest
from plan_examples import ENTITIES, LIGHT, plan, planned_dimension, setting

from errors.measurands.geometry import Circle
from planner.exceptions import OutputError, PlanFileError
from planner.files import staged_folder, write_text
from planner.identity import Made
from planner.plan import InspectionPlan, read_plan
from planner.request.registration import OWN_EDGES, RegistrationRecord


def test_round_trip_loses_nothing(tmp_path):
    original = plan()
    original.write(tmp_path / "plan.json")
    again = read_plan(tmp_path / "plan.json")
    assert again == original
    assert np.array_equal(again.settings[0].cam2world, original.settings[0].cam2world)
    assert again.settings[0].margins["reach"] == float("inf")
    assert list(again.entities) == list(ENTITIES)
    again.write(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "plan.json").read_bytes()


def plan_of_arcs():
    """A plan of arcs about axes in any direction, whose unit vectors are rounded."""
    rng = np.random.default_rng(8)
    radii = {}
    for k in range(20):
        axis, start = rng.normal(size=(2, 3))
        arc = Circle(rng.uniform(0, 50, 3), axis, 5.0, start, 1.5)
        radii[f"r{k}"] = planned_dimension("radius", ["a0"], [arc], 0.1)
    return plan(dimensions=radii, uninspectable=dict.fromkeys(["bottom", *radii], "no view"))


CELL = {"robot": "arm", "digest": "0" * 64, "fixturings": {"flat": np.eye(4).tolist()}}
OF_EDGES = RegistrationRecord(OWN_EDGES, 0.02)
PLANS = {
    "plain": plan,
    "with light": lambda: plan(light=LIGHT),
    "in a cell": lambda: plan(cell=CELL),
    "registered": lambda: plan(registration=OF_EDGES),
    "unfinished": lambda: plan(unfinished=True),
    "arcs": plan_of_arcs,
}


@pytest.mark.parametrize("make", PLANS.values(), ids=list(PLANS))
def test_reading_and_writing_changes_no_byte_of_a_file(tmp_path, make):
    """So the digest of a plan is what ``sha256sum`` prints of its file."""
    path = make().write(tmp_path / "plan.json")
    again = read_plan(path)
    assert again.file_text() == path.read_text()
    assert again.digest == make().digest == hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_digest_is_that_of_the_file_however_it_was_written(tmp_path):
    """A person may lay it out anew, and an older release knows less; a changed plan is not in the file."""
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(json.loads(plan().file_text())))
    again = read_plan(path)
    assert again.digest == hashlib.sha256(path.read_bytes()).hexdigest() != plan().digest
    assert replace(again).digest == plan().digest


def test_a_plan_says_when_and_of_what_it_was_made(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    original = plan()
    made = replace(original, made=Made.now(original.request, "0" * 64, "A. Meyer"))
    assert made.made.date == "1970-01-02T00:00:00Z"
    assert re.fullmatch(r"aspectgraph \S+", made.made.program)
    made.write(tmp_path / "plan.json")
    again = read_plan(tmp_path / "plan.json")
    assert again.made == made.made
    assert again.file_text() == made.file_text()
    # it is no part of what was planned
    assert again == original
    # as anybody computes the digests from the file
    data = json.loads((tmp_path / "plan.json").read_text())
    for name, values in (
        ("camera", [data["request"]["camera"]]),
        ("request", [data["request"], data["targets"]]),
    ):
        text = json.dumps(values, sort_keys=True)
        digest = hashlib.sha256(text.encode()).hexdigest()
        assert data["made"][f"{name}_sha256"] == digest
    other = Made.now(replace(original.request, seed=original.request.seed + 1))
    assert other.request_sha256 != made.made.request_sha256
    assert other.camera_sha256 == made.made.camera_sha256


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("date", "yesterday", 'made.date must be a date in UTC. Got "yesterday".'),
        ("camera_sha256", "12", 'made.camera_sha256 must be a SHA-256, or empty. Got "12".'),
        ("place", "here", "made.place"),
    ],
)
def test_a_wrong_account_of_the_making_is_refused(field, value, message):
    data = plan().to_dict()
    data["made"] = {"date": "1970-01-02T00:00:00Z", "program": "0.1.0", field: value}
    with pytest.raises(PlanFileError, match=re.escape(message)):
        InspectionPlan.from_dict(data)


def test_an_entity_may_be_called_like_the_notation_of_numbers(tmp_path):
    name = "not finite"
    original = plan(
        settings=[setting((40.0, -180.0, 620.0), [name])],
        entities={name: ENTITIES["bottom"]},
        uninspectable={},
    )
    original.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == original


REQUEST = plan().to_dict()["request"]


def test_file_is_strict_json_with_a_version(tmp_path):
    plan().write(tmp_path / "plan.json")
    data = json.loads((tmp_path / "plan.json").read_text(), parse_constant=pytest.fail)
    assert data["version"] == 1
    assert data["units"]["length"] == "mm"
    assert data["bound"] == 1


def test_plan_knows_whether_it_is_complete_and_minimal():
    assert not plan().complete
    assert not plan().minimal
    assert plan(lower_bound=2).minimal
    assert plan().inspected == {"top front": 0.95, "top right": 0.99}


def test_forgotten_entity_is_refused():
    with pytest.raises(
        PlanFileError, match=r"entity 'bottom' must be in a setting or uninspectable. Got neither"
    ):
        plan(uninspectable={})


def test_entity_cannot_be_inspected_and_uninspectable():
    with pytest.raises(
        PlanFileError, match=r"'top right' must be in a setting or uninspectable. Got both"
    ):
        plan(uninspectable={"top right": "?", "bottom": "?"})


def test_unknown_name_is_refused():
    with pytest.raises(PlanFileError, match="Got no 'nowhere'"):
        plan(settings=(setting((0.0, 0.0, 600.0), ["nowhere"]),))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 4}, "version must be 1. Got 4"),
        (
            {"format": "a shopping list"},
            "format must be 'aspectgraph inspection plan'. Got 'a shopping list'",
        ),
        ({"request": {**REQUEST, "camera": {}}}, "focal_length_mm must be given"),
        (
            {"request": {**REQUEST, "pose_uncertainty": {"covariance": [[1.0]]}}},
            r"covariance must have the shape \(6, 6\)",
        ),
        ({"settings": [{"entities": []}]}, r"settings\[0\].cam2world must be given\. Got none"),
        ({"targets": {"top front": [1, 2, 3]}}, r'targets\["top front"\] must be a target'),
    ],
)
def test_wrong_content_is_named_with_the_file(tmp_path, change, message):
    path = tmp_path / "plan.json"
    path.write_text(
        json.dumps({**json.loads(json.dumps(plan().to_dict()).replace("Infinity", "1")), **change})
    )
    with pytest.raises(PlanFileError, match=f"plan.json: .*{message}"):
        read_plan(path)


def test_missing_field_is_named(tmp_path):
    data = plan().to_dict()
    del data["bound"]
    (tmp_path / "plan.json").write_text(json.dumps(data))
    with pytest.raises(PlanFileError, match="bound must be given"):
        read_plan(tmp_path / "plan.json")


def test_malformed_json_is_named_with_line_and_column(tmp_path):
    (tmp_path / "plan.json").write_text('{\n "format": oops\n}')
    with pytest.raises(PlanFileError, match=r"plan.json:2:12: plan file must be JSON"):
        read_plan(tmp_path / "plan.json")


def test_missing_and_binary_files_are_named(tmp_path):
    with pytest.raises(PlanFileError, match=r"nothing\.json: plan file must be readable"):
        read_plan(tmp_path / "nothing.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlanFileError, match="must be UTF-8"):
        read_plan(tmp_path / "binary.json")


def test_writing_replaces_the_old_file_whole(tmp_path):
    target = tmp_path / "plan.json"
    target.write_text("old")
    plan().write(target)
    assert read_plan(target) == plan()
    assert os.listdir(tmp_path) == ["plan.json"]


def test_writing_into_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(OutputError, match="must be in a folder that can be written"):
        write_text(tmp_path / "no" / "plan.json", "x")


def test_failed_block_leaves_the_folder_as_it_was(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "kept.txt").write_text("kept")

    class Stop(Exception):
        pass

    def stop_half_way():
        with staged_folder(out) as staging:
            (staging / "half.txt").write_text("half")
            raise Stop

    with pytest.raises(Stop):
        stop_half_way()
    assert os.listdir(out) == ["kept.txt"]
    assert os.listdir(tmp_path) == ["out"]


def test_staged_files_arrive_together_and_others_stay(tmp_path):
    out = tmp_path / "deep" / "out"
    for text in ("one", "two"):
        with staged_folder(out) as staging:
            (staging / "sub").mkdir()
            (staging / "sub" / "a.txt").write_text(text)
            (staging / f"{text}.txt").write_text(text)
    assert (out / "sub" / "a.txt").read_text() == "two"
    assert sorted(os.listdir(out)) == ["one.txt", "sub", "two.txt"]
    assert os.listdir(out.parent) == ["out"]


def test_output_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(OutputError, match="file is a file"),
        staged_folder(tmp_path / "file" / "out"),
    ):
        pass

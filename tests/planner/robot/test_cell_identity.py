"""A cell names in what it differs from the cell of a plan."""

import numpy as np
import pytest
from robot_cells import CAMERA_BODY, TABLE, made_cell, pose

from planner import Box, Cell, Fixturing

POST = Box((500.0, 200.0, 0.0), (510.0, 210.0, 10.0))
HOME = [0.0, -1.5, 1.5, 0.0, 0.0, 0.0]
UP = pose((700.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"clearance_mm": 11.0}, "clearance_mm"),
        ({"camera_body": ()}, "camera_body"),
        ({"obstacles": {"post": POST}}, "obstacles"),
        ({"home": HOME}, "home"),
        ({"fixturings": {"up": Fixturing(UP)}}, "fixturing 'up'"),
        (
            {"fixturings": {"up": Fixturing(pose((701.0, 0, 0)), {"table": TABLE})}},
            "fixturing 'up'",
        ),
        (
            {"fixturings": {"over": Fixturing(UP, {"table": TABLE})}, "clearance_mm": 9.0},
            "clearance_mm, fixturing 'up' (gone) and fixturing 'over' (new)",
        ),
        (
            {"fixturings": {"up": Fixturing(UP, {"table": TABLE}, axis=((0, 0, 0), (0, 0, 1)))}},
            "fixturing 'up'",
        ),
    ],
)
def test_a_cell_names_what_differs(changes, words):
    assert made_cell(**changes).difference(made_cell().to_dict()) == words


def test_another_robot_or_another_calibration_is_named():
    before = made_cell().to_dict()
    assert made_cell("made_wrist").difference(before).startswith("robot")
    cell = made_cell()
    other = Cell(
        cell.robot,
        pose((0.0, 0.0, 91.0)),
        camera_body=CAMERA_BODY,
        fixturings=cell.fixturings,
    )
    assert other.difference(before) == "cam2flange"


def test_plans_that_name_no_parts():
    before = made_cell().to_dict()
    assert made_cell(clearance_mm=9.0).difference({}) == ""
    del before["parts"]
    assert made_cell().difference(before) == ""
    assert made_cell(clearance_mm=9.0).difference(before) == (
        "something that the plan does not name"
    )


def test_the_record_is_as_the_schema_says():
    record = made_cell().to_dict()
    assert set(record) == {"robot", "digest", "fixturings", "parts"}
    assert np.array(record["fixturings"]["up"]).shape == (4, 4)
    assert all(len(value) == 16 for value in record["parts"].values())

"""An output folder belongs to one plan."""

from __future__ import annotations

import json

import pytest
from plan_examples import ENTITIES, plan

from planner.cli.folder_owner import check_owner, request_of
from planner.exceptions import OutputError

LIMITS = dict.fromkeys(
    ("min_length_px", "field_margin_px", "focus_margin_mm", "stand_off_mm", "visibility_radius_mm"),
    1.0,
)
OTHERS = {
    "part": ({"part": "bracket"}, "another part, 'block' and not 'bracket'"),
    "seed": ({"seed": 6}, "another seed, 5 and not 6"),
    "accuracy": ({"accuracy": 0.97}, "another accuracy, 0.98 and not 0.97"),
    "workspace": ({"workspace": [[-1, -1, -1], [900, 900, 900]]}, "another workspace."),
    "limits": ({"requirements": {**LIMITS, "stand_off_mm": 60.0}}, "another limits."),
    "entities": (
        {
            "entities": {**ENTITIES, "more": [[0, 0, 0], [0, 50, 0]]},
            "uninspectable": {"bottom": "", "more": ""},
        },
        "another set of entities.",
    ),
}


@pytest.fixture
def folder(tmp_path):
    plan(requirements=LIMITS).write(tmp_path / "plan.json")
    return tmp_path


def test_the_same_request_and_an_empty_folder_are_welcome(folder, tmp_path):
    asked, before = (
        request_of(plan(requirements=LIMITS, lower_bound=2)),
        (folder / "plan.json").read_bytes(),
    )
    check_owner(folder, asked, force=False)
    check_owner(tmp_path / "new", asked, force=False)
    # asking replaces and makes nothing
    assert (folder / "plan.json").read_bytes() == before
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("case", OTHERS)
def test_another_request_needs_force(folder, case):
    changes, message = OTHERS[case]
    asked = request_of(plan(**{"requirements": LIMITS, **changes}))
    with pytest.raises(
        OutputError, match="--out must be a folder without another plan; --force replaces it"
    ) as caught:
        check_owner(folder, asked, force=False)
    assert message in str(caught.value)
    check_owner(folder, asked, force=True)


def test_a_plan_without_limits_is_replaced_by_one_with_limits(tmp_path):
    plan().write(tmp_path / "plan.json")
    limited, other = (
        request_of(plan(requirements=LIMITS, **changes)) for changes in ({}, {"seed": 6})
    )
    check_owner(tmp_path, limited, force=False)
    # what it does not tell is not held against it; what it tells is
    with pytest.raises(OutputError, match="another seed, 5 and not 6"):
        check_owner(tmp_path, other, force=False)


def test_a_file_that_is_no_plan_is_not_replaced_either(folder):
    (folder / "plan.json").write_text(json.dumps({"mine": 1}))
    with pytest.raises(OutputError, match=r"Got .*plan\.json: format must be"):
        check_owner(folder, request_of(plan()), force=False)

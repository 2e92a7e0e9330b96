"""What simulation contradicts: suspected with few displaced poses, decided with many."""

from types import SimpleNamespace

import numpy as np
import pytest

from planner.search import realise_column
from planner.search.realise_column import PosedOnly, promised_too_much
from planner.verify.simulate_setting import MODEL_TOLERANCE


@pytest.mark.parametrize(
    ("first", "sure", "contradicted"),
    [
        # as much as the plan's own simulation would call contradicted
        (0.02, 0.021, True),
        # luck of the first draws
        (0.02, 0.9 * MODEL_TOLERANCE, False),
        # nothing suspected: not looked at again
        (0.9 * MODEL_TOLERANCE, 0.5, False),
    ],
)
def test_a_promise_is_contradicted_by_more_than_the_models_tolerance(
    monkeypatch, first, sure, contradicted
):
    frequencies = {
        realise_column._TRIAL_POSES: 0.95 - first,
        realise_column._SURE_POSES: 0.95 - sure,
    }

    def simulated(setting, *_, n, **__):
        # what is not suspected is not simulated again
        assert set(setting.entities) == (
            {"edge", "sound"} if n == realise_column._TRIAL_POSES else {"edge"}
        )
        found = {
            "edge": SimpleNamespace(predicted=0.95, frequency=frequencies[n]),
            "sound": SimpleNamespace(predicted=0.95, frequency=0.95),
        }
        return {name: found[name] for name in setting.entities}

    monkeypatch.setattr(realise_column, "simulate_setting", simulated)
    judge = SimpleNamespace(
        problem=SimpleNamespace(
            pose_uncertainty=None,
            at_pose=lambda *_: SimpleNamespace(measured=None),
            known_at=lambda *_: None,
        ),
        camera=None,
        accuracy=0.98,
    )
    posed = PosedOnly(np.eye(4), ("edge", "sound"), {"edge": 0.95, "sound": 0.95})
    assert list(promised_too_much(judge, posed, 0)) == ["edge"] * contradicted

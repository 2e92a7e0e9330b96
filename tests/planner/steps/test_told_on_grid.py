"""What is stated of edges that simulation contradicts in chosen settings."""

from types import SimpleNamespace

import numpy as np
import pytest
from plan_examples import setting

from planner.request.pixel_grid import lowered
from planner.steps import told_on_grid as module

RUN = SimpleNamespace(names=["a", "b"], request=SimpleNamespace(probability=0.9))


def told(monkeypatch, frequencies):
    """Settings for a and b, and for a alone; a is contradicted, and counted so often on the grid."""
    settings = [setting((0.0, 0.0, 300.0), ["a", "b"]), setting((50.0, 0.0, 300.0), ["a"])]
    monkeypatch.setattr(module, "contradicted", lambda run, settings: ["a"])
    monkeypatch.setattr(
        module, "frequencies", lambda run, i, poses: np.array(frequencies)[: len(poses)]
    )

    def setting_at(request, pose, names, message, **_):
        return setting(tuple(pose[:3, 3]), list(names))

    monkeypatch.setattr(module, "setting_at", setting_at)
    return settings, module.told_on_grid(RUN, settings)


def test_what_was_counted_is_stated_if_it_is_enough(monkeypatch):
    before, found = told(monkeypatch, [0.95, 0.97])
    assert found.counted == ("a",)
    assert found.wrong == []
    assert [one.probability["a"] for one in found.settings] == pytest.approx(
        lowered(np.array([0.95, 0.97]))
    )
    assert found.settings[0].probability["b"] == before[0].probability["b"]
    assert all(
        (one.cam2world == old.cam2world).all()
        for one, old in zip(found.settings, before, strict=True)
    )


def test_an_edge_is_left_to_the_setting_that_is_sure_enough_of_it(monkeypatch):
    _, found = told(monkeypatch, [0.5, 0.97])
    assert [one.entities for one in found.settings] == [("b",), ("a",)]
    _, found = told(monkeypatch, [0.97, 0.5])
    assert [one.entities for one in found.settings] == [("a", "b")]
    assert found.counted == ("a",)


def test_an_edge_that_is_sure_enough_nowhere_needs_another_pose(monkeypatch):
    before, found = told(monkeypatch, [0.5, 0.89])
    assert (found.counted, found.wrong) == ((), ["a"])
    assert [one.probability for one in found.settings] == [one.probability for one in before]

"""The space of a ring light: as `plan_light` says it of single poses, and known answers."""

import pickle

import numpy as np
import pytest
from lit_parts import RIM, block, step
from plan_examples import CAMERA, plan, setting

from aspectgraph import compute_light, read_solid, resolve_entities
from planner import RequestError, RingSpace, plan_light

WORKSPACE = np.array([[-900.0] * 3, [900.0] * 3])


def space_of(solid, entities, contrast=0.1, least_step=0.1):
    return RingSpace(compute_light(solid, entities, contrast, WORKSPACE), CAMERA, least_step)


def test_both_floors_of_a_step_are_as_bright_from_above():
    """The rim of the upper floor is a silhouette for x < 30: 10 mm in 390 make no contrast."""
    space = space_of(step(), RIM)
    above = np.array([[10.0, 20, 400]])
    in_front = np.array([[200.0, 20, 400]])
    assert space.light.observable(above).all()
    assert not space.observable(above).any()
    # from x = 200 both faces are seen, at heights of 170 and 390 mm over them
    assert space.observable(in_front).all()
    assert not space_of(step(), RIM, contrast=0.4).observable(in_front).any()
    assert not space_of(step(), RIM, least_step=0.6).observable(in_front).any()


@pytest.mark.parametrize("part", ["block", "step", "pockets"])
def test_the_space_agrees_with_lamps_planned_for_single_poses(part):
    solid = {"block": block, "step": step}.get(
        part, lambda: read_solid("examples/two_pocket_block.off")
    )()
    edges = {f"e{edge.id}": solid.edge_points(edge.id) for edge in solid.straight_edges()}
    space = space_of(solid, resolve_entities(solid, edges))
    middle = solid.bounds.mean(axis=0)
    ways = np.random.default_rng(4).normal(size=(12, 3))
    eyes = middle + 300.0 * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    shown = space.observable(eyes)
    exact = space.light.observable(eyes)
    settings = []
    names = []
    for k, eye in enumerate(eyes):
        seen = [name for i, name in enumerate(edges) if exact[k, i]]
        settings.append(setting(tuple(eye), seen, tuple(middle), probability=1.0))
        names.append(seen)
    asked = plan(
        settings=tuple(settings),
        entities=edges,
        uninspectable=dict.fromkeys(set(edges) - set().union(*names), ""),
    )
    light = plan_light(asked, solid, "ring")
    told = {
        (k, name)
        for k, images in enumerate(light.images)
        for image in images
        for name in image.contrast
    }
    found = {(k, name) for k in range(len(eyes)) for i, name in enumerate(edges) if shown[k, i]}
    assert found == told
    assert 0.3 * exact.sum() < len(found) < exact.sum()


def test_it_passes_to_other_processes_and_knows_its_parts():
    space = space_of(step(), RIM)
    eyes = np.array([[10.0, 20, 400], [200.0, 20, 400]])
    before = space.observable(eyes)
    again = pickle.loads(pickle.dumps(space))
    assert (again.observable(eyes) == before).all()
    assert (space.subset(["rim"]).observable(eyes) == before).all()
    assert space.covering_cells(["rim"]).volume == space.light.covering_cells(["rim"]).volume
    assert repr(space) == "<RingSpace of 'step': 1 entities, contrast 0.1>"
    with pytest.raises(RequestError, match=r"step must be in \[0, 1\). Got 1"):
        RingSpace(space.light, CAMERA, 1)

"""Rims and arcs that are asked for as entities: their diameter or radius is measured, at the call's accuracy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from holed_plate import CAMERA, FRONT, HOLES, QUICK, UNCERTAINTY, holed_plate, upper_rims

from aspectgraph import Solid, compute_regions, read_solid, resolve_entities, select_entities
from errors.measurands import Localisation
from planner import Dimension, RequestError, plan_inspection, plan_setting, predict
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE
from planner.plan import read_plan
from planner.request.dimension_files import read_wanted
from planner.request.resolve import is_circle, resolve_wanted
from planner.request.targets import EdgeTarget

# 24 chords are up to 0.07 mm off these circles of 16 and 12 mm, and 5 % of these are 0.8 and 0.6 mm
ACCURACY = 0.95
PLATE = holed_plate()
LEFT_RIM, RIGHT_RIM = upper_rims(PLATE)
CLI = ["--camera", "basler-acA2440-20gm-8mm", "--sigma-mm", "0.05", "--sigma-rad", "0.001"]
CLI += ["--accuracy", "0.95", "--effort", "quick", "--jobs", "1", "--simulate", "500"]


def planned(wanted, **options):
    return plan_inspection(
        PLATE, wanted, CAMERA, UNCERTAINTY, accuracy=ACCURACY, effort=QUICK, **options
    )


def plate_file(path):
    """Write the plate as an OFF file, its upper side towards +z."""
    lines = ["OFF", f"{len(PLATE.vertices)} {len(PLATE.triangles)} 0"]
    lines += [" ".join(map(repr, row)) for row in PLATE.vertices.tolist()]
    lines += ["3 " + " ".join(map(str, row)) for row in PLATE.triangles.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def rounded_corner(n=12, radius=20.0):
    """A block with one rounded upright corner: its upper arc is a quarter of a circle."""
    turns = np.linspace(0.0, math.pi / 2, n + 1)
    corner = [(40.0 + radius * math.cos(t), 20.0 + radius * math.sin(t)) for t in turns]
    outline = [(0.0, 0.0), (60.0, 0.0), *corner, (0.0, 40.0)]
    size = len(outline)
    vertices = [(x, y, z) for z in (0.0, 15.0) for x, y in outline]
    faces = [list(range(size))[::-1], list(range(size, 2 * size))]
    faces += [[k, (k + 1) % size, size + (k + 1) % size, size + k] for k in range(size)]
    return Solid(vertices, faces)


def test_a_rim_is_its_diameter_and_an_edge_is_as_before():
    wanted = {"bore": LEFT_RIM, "front": FRONT}
    entities, (bore, front) = resolve_wanted(PLATE, wanted, ACCURACY)
    assert list(entities) == ["bore", "front"]
    assert (bore.kind, bore.permitted_error) == ("diameter", (1 - ACCURACY) * bore.nominal)
    diameter = 2 * HOLES["left"][1]
    assert bore.measurand.nominal == pytest.approx(diameter)
    assert bore.error_at(ACCURACY) == pytest.approx(0.05 * diameter)
    assert isinstance(front, EdgeTarget)
    assert front.measurand.nominal == pytest.approx(80.0)
    assert front.error_at(ACCURACY) == pytest.approx(0.05 * 80.0)


@pytest.mark.parametrize("stands_for", ["id", "rim", "entity"])
def test_everything_that_stands_for_a_rim_is_one(stands_for):
    rim = next(rim for rim in PLATE.rims() if rim.id == LEFT_RIM)
    entity = resolve_entities(PLATE, {"x": LEFT_RIM})["x"]
    item = {"id": LEFT_RIM, "rim": rim, "entity": entity}[stands_for]
    assert is_circle(item)
    _, (target,) = resolve_wanted(PLATE, {"bore": item}, ACCURACY)
    assert target.measurand.nominal == pytest.approx(2 * HOLES["left"][1])


def test_an_arc_is_its_radius():
    solid = rounded_corner()
    arc = next(arc for arc in solid.arcs() if arc.centre[2] == pytest.approx(15.0))
    _, (target,) = resolve_wanted(solid, {"corner": arc.id}, 0.9)
    assert target.measurand.kind == "radius"
    assert target.measurand.nominal == pytest.approx(20.0)
    assert target.error_at(0.9) == pytest.approx(2.0)
    assert not is_circle(17)
    assert not is_circle(FRONT)
    assert not is_circle(Dimension.radius(arc.id))


def test_a_plan_of_rims_is_that_of_their_diameters():
    """As dimensions of the same permitted errors, beside an edge, whose density stays the paper's."""
    bore = Dimension.diameter(LEFT_RIM, accuracy=ACCURACY)
    # what is assumed of dimensions, where nothing is said, is not assumed of rims
    how = {"localisation": Localisation.rounding()}
    found = planned({LEFT_RIM: LEFT_RIM, "front": FRONT}, **how)
    assert found == planned({LEFT_RIM: bore, "front": FRONT}, **how)
    assert found.complete
    assert list(found.dimensions) == [LEFT_RIM]
    assert found.simulate(2000, rng=1).confirmed
    # with regions of its own names, too
    named = {"left": LEFT_RIM}
    space = compute_regions(PLATE, named, workspace=found.workspace)
    assert planned(named, space=space, workspace=found.workspace).complete


def test_what_is_selected_may_hold_rims():
    ids = select_entities(PLATE, "kind = rim and face = top")
    assert ids == [LEFT_RIM, RIGHT_RIM]
    found = planned(ids)
    assert set(found.inspected) == set(ids)


def test_a_rim_in_a_file_and_in_a_prediction(tmp_path):
    path = tmp_path / "wanted.toml"
    path.write_text(f'bore = "{LEFT_RIM}"\n')
    wanted = read_wanted(path, ("diameter",))
    assert wanted == {"bore": LEFT_RIM}
    plan = planned(wanted)
    pose = plan.settings[0].cam2world
    prediction = predict(PLATE, wanted, pose, CAMERA, UNCERTAINTY, accuracy=ACCURACY)["bore"]
    assert prediction.probability == pytest.approx(plan.settings[0].probability["bore"], abs=1e-3)


def test_a_rim_of_too_few_chords_is_refused_before_the_regions(monkeypatch):
    monkeypatch.setattr(
        "planner.inspection.visible_regions", lambda *_, **__: pytest.fail("work has begun")
    )
    with pytest.raises(
        RequestError, match=r"^dimension 'bore': rim r0 must have at least \d+ chords"
    ):
        plan_inspection(PLATE, {"bore": "r0"}, CAMERA, UNCERTAINTY, accuracy=0.998)


def test_one_setting_measures_edges_only():
    space = compute_regions(PLATE, {"bore": LEFT_RIM})
    with pytest.raises(RequestError, match=r"must be edges, .* Got 'bore', which is a rim"):
        plan_setting(space, ["bore"], CAMERA, UNCERTAINTY)


def test_the_command_line_plans_rims(tmp_path, capsys):
    part = plate_file(tmp_path / "plate.off")
    out = tmp_path / "rims"
    rule = "kind = rim and face = top and radius > 7"
    assert main(["plan", part, "--select", rule, *CLI, "--out", str(out)]) == DONE
    assert "1 of 1 dimension inspected" in capsys.readouterr().out
    wanted = tmp_path / "wanted.toml"
    (rim,) = select_entities(read_solid(part), rule)
    wanted.write_text(f'{rim} = {{ diameter = "{rim}", accuracy = 0.95 }}\n')
    same = tmp_path / "same"
    command = ["plan", part, "--dimensions", str(wanted), "--localisation", "rounding", *CLI]
    assert main([*command, "--out", str(same)]) == DONE
    assert read_plan(out / "plan.json") == read_plan(same / "plan.json")


def test_the_command_line_refuses_at_once_and_leaves_nothing(tmp_path, capsys):
    part = plate_file(tmp_path / "plate.off")
    out = tmp_path / "out"
    command = ["plan", part, "--select", "kind = rim", *CLI, "--accuracy", "0.998"]
    assert main([*command, "--out", str(out)]) == BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("aspectgraph: --select: dimension 'r0': rim r0 must have ")
    assert error.count("\n") == 1
    assert not out.exists()
    batch = ["batch", str(tmp_path), "--select", "kind = rim", *CLI[:-2], "--accuracy", "0.998"]
    main([*batch, "--out", str(out), "--quiet"])
    assert "plate.off is refused: dimension 'r0': rim r0 must have" in capsys.readouterr().out
    assert not list(out.rglob("planning-*"))

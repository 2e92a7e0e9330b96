"""One style for all packages: version, clean dir(), read and write, plot, and arguments that are checked."""

from __future__ import annotations

import ast
import builtins
import inspect
import sys
import types
from importlib.metadata import version
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import aspectgraph
import errors
import ga
import planner
from aspectgraph import (
    ReadError,
    Solid,
    SolidError,
    build_aspect_graph,
    compute_regions,
    read_dimensions,
    read_entities,
    read_graphml,
    read_solid,
    resolve_entities,
    select_entities,
)
from planner import (
    Camera,
    Detectability,
    Distortion,
    Effort,
    InspectionOptions,
    InspectionPlan,
    MeasureOptions,
    Measurer,
    PartRequest,
    PlanFileError,
    PoseUncertainty,
    Registration,
    RequestError,
    measure,
    measured_html,
    plan_folder,
    plan_inspection,
    plan_light,
    plan_setting,
    predict,
    predict_poses,
    propose_optics,
    read_plan,
    read_poses,
    report_html,
    write_poses,
)

ROOT = Path(__file__).parents[1]
PART = ROOT / "examples/two_pocket_block.off"
PLAN = ROOT / "examples/two_pocket_block_plan.json"
BLOCK = read_solid(PART)
CAMERA = Camera.named("basler-acA2440-20gm-8mm")
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
RIM = {"rim": [[60, 20, 10], [60, 40, 10]]}
EDGES = Registration.own_edges()
REQUEST = PartRequest(CAMERA, SIGMA, 0.95)


@pytest.mark.parametrize("package", [aspectgraph, errors, ga, planner])
def test_every_package_has_its_version_and_a_clean_dir(package):
    assert package.__version__ == version("aspectgraph")
    names = [name for name in dir(package) if not name.startswith("__")]
    assert sorted(package.__all__) == names
    assert all(hasattr(package, name) for name in dir(package))
    with pytest.raises(AttributeError, match="has no attribute 'colour'"):
        package.colour  # noqa: B018


@pytest.mark.parametrize("package", [aspectgraph, errors, ga, planner])
def test_the_stub_states_every_public_name_where_it_is_defined_or_handed_on(package):
    stub = Path(package.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    statements = [node for node in ast.parse(stub).body if isinstance(node, ast.ImportFrom)]
    names = [alias.asname for node in statements for alias in node.names]
    assert sorted(names) == sorted(package.__all__)
    assert len(set(names)) == len(names)


def test_a_plan_is_written_to_a_folder_or_a_file_and_read_from_both(tmp_path):
    plan = InspectionPlan.read(PLAN)
    assert plan == read_plan(PLAN)
    assert plan.write(tmp_path) == tmp_path / "plan.json"
    assert plan.write(tmp_path / "other.json") == tmp_path / "other.json"
    for path in (tmp_path, tmp_path / "plan.json", tmp_path / "other.json", str(tmp_path)):
        assert InspectionPlan.read(path) == plan
    (tmp_path / "empty").mkdir()
    with pytest.raises(planner.PlanFileError, match=r"plan\.json: plan file must be readable"):
        InspectionPlan.read(tmp_path / "empty")


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        Camera(
            25.0, (0.00345, 0.0035), (2448, 2048), 8.0, 250.0, name='a "b" \\ ü\x7f',
            principal_point_px=(1200.5, 1010.25), distortion=Distortion(k1=-0.1, p2=1e-05),
        ),
    ],
)  # fmt: skip
def test_a_camera_comes_back_from_its_file_without_loss(tmp_path, camera):
    path = camera.write(tmp_path / "camera.toml")
    assert Camera.read(path) == camera == Camera.from_toml(path)
    assert Camera.read(path).to_dict() == camera.to_dict()


def test_a_graph_and_a_solid_have_the_same_names(tmp_path):
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces)
    eag = build_aspect_graph(box, {"top": 1})
    eag.write(tmp_path / "graph.graphml")
    assert len(read_graphml(tmp_path / "graph.graphml")) == len(eag.graph)
    assert len(Solid.read(PART, units="inch").faces) == len(BLOCK.faces)


def test_plots_show_part_entities_and_cameras():
    plan = read_plan(PLAN)
    assert "rim" in str(BLOCK.plot(RIM).to_dict()["data"])
    assert "rim" not in str(BLOCK.plot().to_dict()["data"])
    meshes = [trace for trace in plan.plot(BLOCK).data if trace.type == "mesh3d"]
    assert meshes
    alone = plan.plot()
    assert [trace for trace in alone.data if trace.type == "mesh3d"] == []
    assert {"setting 1", "camera 1"} <= {trace.name for trace in alone.data}


def test_a_data_frame_holds_the_rows(monkeypatch):
    """pandas is no dependency, so a stand-in takes what its constructor would."""
    stand_in = types.ModuleType("pandas")
    stand_in.DataFrame = lambda rows: ("frame", rows)
    monkeypatch.setitem(sys.modules, "pandas", stand_in)
    plan = read_plan(PLAN)
    assert plan.to_dataframe() == ("frame", plan.rows())
    width, height = plan.camera.resolution
    results = measure(plan, BLOCK, {1: np.zeros((height, width), np.uint8)})
    assert results.to_dataframe() == ("frame", results.rows())
    assert len(results.rows()) == len(plan.targets)


def test_without_pandas_one_sentence_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without(name, *more):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"needs pandas\. Install it with: pip install pandas"):
        read_plan(PLAN).to_dataframe()


ORDER = "the order of the arguments is"
POSE_FILE = read_poses(ROOT / "examples/two_pocket_block_poses.yaml")
MEASURER = Measurer(read_plan(PLAN), BLOCK)
WRONG = [
    (lambda: plan_inspection(CAMERA, BLOCK, RIM, SIGMA), "solid must be a Solid", ORDER),
    (lambda: plan_inspection(BLOCK, CAMERA, RIM, SIGMA), "entities must be a mapping", ORDER),
    (lambda: plan_inspection(BLOCK, RIM, SIGMA, CAMERA), "camera must be a Camera", ORDER),
    (lambda: plan_inspection("part.stp", RIM, CAMERA, SIGMA), "Got 'part.stp'", "read_solid"),
    (lambda: plan_inspection(BLOCK, "8,9", CAMERA, SIGMA), "Got '8,9'", "read_entities"),
    (lambda: plan_inspection(BLOCK, RIM, "basler", SIGMA), "Got 'basler'", "Camera.named"),
    (lambda: plan_inspection(BLOCK, RIM, CAMERA, 0.05), "Got 0.05", "PoseUncertainty.isotropic"),
    (lambda: plan_inspection(BLOCK, RIM, CAMERA, None), "Got None", "PoseUncertainty.isotropic"),
    (lambda: plan_setting(None, "rim", CAMERA, SIGMA), "names must be a mapping", "Got 'rim'"),
    (lambda: plan_setting(None, ["rim"], SIGMA, CAMERA), "camera must be a Camera", ORDER),
    (lambda: predict(BLOCK, ["rim"], None, CAMERA, SIGMA), "wanted must be a mapping", "a list"),
    (lambda: predict(BLOCK, np.eye(4), RIM, CAMERA, SIGMA), "wanted must be a mapping", ORDER),
    (lambda: predict(BLOCK, RIM, CAMERA, np.eye(4), SIGMA), "cam2world must be a pose", ORDER),
    (lambda: predict(BLOCK, RIM, np.eye(4), SIGMA, CAMERA), "camera must be a Camera", ORDER),
    (lambda: predict(BLOCK, RIM, None, CAMERA, SIGMA), "must have the shape", "Got ()"),
    (lambda: predict(BLOCK, RIM, POSE_FILE, CAMERA, SIGMA), "cam2world must be", "predict_poses"),
    (lambda: predict_poses(BLOCK, POSE_FILE, RIM, CAMERA, SIGMA), "wanted must be", ORDER),
    (
        lambda: plan_inspection(BLOCK, RIM, CAMERA, SIGMA, registration="edges"),
        "Registration.own_edges()",
        "Registration.none()",
    ),
    (lambda: propose_optics(BLOCK, SIGMA, RIM), "wanted must be a mapping", ORDER),
    (lambda: plan_light(BLOCK, read_plan(PLAN), "ring"), "plan must be an InspectionPlan", ORDER),
    (lambda: write_poses("poses", read_plan(PLAN)), "Got 'poses'", "read_plan"),
    (lambda: read_plan(PLAN).plot("x"), "solid must be a Solid. Got 'x'", "read_solid"),
    (lambda: report_html(BLOCK, BLOCK), "plan must be an InspectionPlan", "read_plan reads one"),
    (lambda: report_html(read_plan(PLAN), CAMERA), "space must be a Solid, Visib", "regions"),
    (lambda: plan_setting(BLOCK, ["rim"], CAMERA, SIGMA), "space must be Visibility", "regions"),
    (lambda: measured_html(read_plan(PLAN)), "results must be a MeasurementResults", "measure"),
    (lambda: MeasureOptions("edges"), "registration must be a Registration", "own_edges"),
    (lambda: MeasureOptions(EDGES, rule="iso"), "rule must be a DecisionRule", "iso14253"),
    (lambda: MeasureOptions(EDGES, "gaussian"), "localisation must be a Localisation", "gaussian"),
    (lambda: MEASURER.measure("images", {"coverage": 0.7}), "options must be a MeasureOpt", "Got"),
    (lambda: Registration.given("poses.json"), "poses must be a mapping", "Got 'poses.json'"),
    (lambda: read_plan(PLAN).simulated("many"), "n must be an integer", "Got 'many'"),
    (lambda: plan_folder("parts", CAMERA, "out"), "request must be a PartRequest", "Got 'out'"),
    (lambda: plan_folder("parts", BLOCK, REQUEST), "out must be a path", "Got a Solid"),
]


@pytest.mark.parametrize(
    ("kind", "word", "meant"),
    [
        (InspectionOptions, "acuracy", "accuracy"),
        (Effort, "viewpoint", "viewpoints"),
        (Detectability, "seperation_px", "separation_px"),
    ],
)
def test_a_field_that_there_is_not_names_the_one_that_is_meant(kind, word, meant):
    text = rf"^{kind.__name__}\(\) has no argument '{word}'; did you mean '{meant}'\?$"
    with pytest.raises(TypeError, match=text):
        kind(**{word: 1})
    assert meant in inspect.signature(kind).parameters


@pytest.mark.parametrize(
    ("word", "meant"),
    [("seed", "rng"), ("light", "lamps"), ("surface_mm", "surfaces_mm"), ("gapp", "gap")],
)
def test_a_keyword_that_there_is_not_names_the_one_that_is_meant(word, meant):
    text = rf"^plan_inspection\(\) has no argument '{word}'; did you mean '{meant}'\?$"
    with pytest.raises(TypeError, match=text):
        plan_inspection(BLOCK, RIM, CAMERA, SIGMA, **{word: 1})


def test_a_keyword_like_no_other_is_refused_alone():
    with pytest.raises(TypeError, match=r"^plan_inspection\(\) has no argument 'zzz'$"):
        plan_inspection(BLOCK, RIM, CAMERA, SIGMA, zzz=1)


@pytest.mark.parametrize(("call", "message", "hint"), WRONG)
def test_wrong_and_swapped_arguments_are_one_line(call, message, hint):
    with pytest.raises(RequestError) as caught:
        call()
    text = str(caught.value)
    assert "\n" not in text
    assert message in text
    assert hint in text


@pytest.mark.parametrize(
    "call",
    [
        lambda: resolve_entities("part.stp", RIM),
        lambda: resolve_entities(RIM, BLOCK),
        lambda: select_entities("length > 20", BLOCK),
        lambda: read_entities(BLOCK, "all"),
        lambda: compute_regions(None, RIM),
        lambda: build_aspect_graph("part.stp", RIM),
        lambda: read_dimensions("part.stp", "part.stp"),
    ],
)
def test_what_is_no_solid_is_refused_in_one_line(call):
    with pytest.raises(SolidError, match=r"^solid must be a Solid\. Got .*; read_solid reads one"):
        call()


def test_what_is_no_path_is_refused_in_one_line():
    with pytest.raises(ReadError, match=r"^path must be a path\. Got an object of type int\.$"):
        read_solid(5)
    with pytest.raises(PlanFileError, match=r"^path must be a path\. Got an object of type Solid"):
        read_plan(BLOCK)


def test_the_stored_example_is_a_whole_plan():
    """What the examples of the docstrings read."""
    assert read_plan(PLAN).complete

"""A hand-made plan that needs no search, for the tests of everything that comes after one."""

import numpy as np

from planner import Camera, Exposure, LightPlan, LitImage, PoseUncertainty, SensorSetting, look_at
from planner.plan import InspectionPlan

CAMERA = Camera(25.0, (0.00345, 0.0035), (2448, 2048), 8.0, 600.0, name="test camera")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
ENTITIES = {
    "top front": [[0.0, 0.0, 60.0], [80.0, 0.0, 60.0]],
    "top right": [[80.0, 0.0, 60.0], [80.0, 50.0, 60.0]],
    "bottom": [[0.0, 0.0, 0.0], [80.0, 0.0, 0.0]],
}
LIGHT = LightPlan(
    "placed",
    0.1,
    0.05,
    "dark",
    np.array([[40.0, -300.0, 500.0], [300.0, 25.0, 90.0]]),
    (
        (
            LitImage(
                (0,),
                {"top front": 0.3, "top right": 1.0},
                ("top right",),
                Exposure("top right", (1200, 800), "top front", 2.5),
            ),
        ),
        (LitImage((1,), {"top right": 0.76}),),
    ),
    ({}, {}),
    1,
    "test",
)


def setting(position, names, target=(40.0, 25.0, 60.0), roll=0.3, probability=0.95):
    return SensorSetting(
        cam2world=look_at([position], target, roll=roll)[0],
        entities=tuple(names),
        probability={name: probability - 0.01 * k for k, name in enumerate(names)},
        margins={"resolution_mm": 0.4, "focus_mm": 12.5, "reach": float("inf")},
        fitness=probability * len(names),
        nfev=1200,
        generations=7,
        message="converged",
        seed=3,
    )


def plan(**changes):
    fields = {
        "settings": (
            setting((40.0, -180.0, 620.0), ["top front", "top right"]),
            setting((250.0, 40.0, 600.0), ["top right"], probability=0.99),
        ),
        "lower_bound": 1,
        "uninspectable": {"bottom": "unobservable: no viewpoint of the workspace sees all of it."},
        "entities": ENTITIES,
        "camera": CAMERA,
        "pose_uncertainty": UNCERTAINTY,
        "accuracy": 0.98,
        "probability": 0.9,
        "workspace": np.array([[-900.0, -900.0, -900.0], [900.0, 900.0, 900.0]]),
        "part": "block",
        "seed": 5,
        "bound_proof": "test",
    }
    return InspectionPlan(**{**fields, **changes})

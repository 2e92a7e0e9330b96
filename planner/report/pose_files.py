"""Camera poses in the formats of other programs.

=============  =====================  ==========================  ==============  =================================
format         file                   pose                        camera axes     length, first pixel's centre
=============  =====================  ==========================  ==============  =================================
OpenCV         poses_opencv.json      world to camera, R and t    x right y down  mm, (0, 0)
COLMAP         colmap/images.txt      world to camera, q (wxyz)   x right y down  mm, (0.5, 0.5)
Open3D         poses_open3d.json      world to camera, 4x4        x right y down  mm, (0, 0); matrix column by column
ROS            poses_ros.yaml         camera to world, q (xyzw)   x right y down  metres (the optical frame, REP 103)
nerfstudio     transforms.json        camera to world, 4x4        x right y up    mm, (0.5, 0.5)
=============  =====================  ==========================  ==============  =================================

camera_ros.yaml is the camera as ROS's calibration writes it. OpenCV, COLMAP, ROS and nerfstudio get the lens
distortion; Open3D knows none: its file is for undistorted images.

Every writer takes a plan and returns text; `write_poses` writes them all. Settings are numbered from 1 in the order of
travel and their images are called ``setting_01.png`` and so on.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from planner.argument_kinds import check_kinds
from planner.files import write_text
from planner.sensor_setting import image_name

if TYPE_CHECKING:
    from planner.plan import InspectionPlan


# what `write_poses` writes
POSE_FILES = (
    "poses_opencv.json",
    "poses_open3d.json",
    "poses_ros.yaml",
    "camera_ros.yaml",
    "transforms.json",
    "colmap/cameras.txt",
    "colmap/images.txt",
    "colmap/points3D.txt",
)
# OpenCV camera axes (x right, y down, z forward) to OpenGL ones (x right, y up, z backward)
_OPENCV_TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def write_poses(plan: InspectionPlan, folder: str | os.PathLike[str]) -> list[Path]:
    """Write the poses of a plan in all formats.

    Parameters
    ----------
    plan : InspectionPlan
        The plan with the poses and the camera.
    folder : str or os.PathLike
        An existing folder.

    Returns
    -------
    list of pathlib.Path
        The written files, sorted.

    Raises
    ------
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from planner import read_plan, write_poses
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = write_poses(plan, folder)
    >>> [path.name for path in files][:3]
    ['camera_ros.yaml', 'cameras.txt', 'images.txt']
    """
    check_kinds(plan=(plan, "InspectionPlan"))
    folder = Path(folder)
    texts = (
        opencv_json(plan),
        open3d_json(plan),
        ros_yaml(plan),
        ros_camera_yaml(plan),
        nerfstudio_json(plan),
        colmap_cameras(plan),
        colmap_images(plan),
        "# no points: the poses are planned, not reconstructed\n",
    )
    (folder / "colmap").mkdir(exist_ok=True)
    for name, text in zip(POSE_FILES, texts, strict=True):
        write_text(folder / name, text)
    return sorted(folder / name for name in POSE_FILES)


def opencv_json(plan: InspectionPlan) -> str:
    """Return the poses for OpenCV: ``K``, and per setting ``R``, ``rvec`` and ``t`` with x_cam = R x_world + t, mm.

    A plan with lamps has the images of each setting, with their lamps and the pixel to expose for.
    """
    settings = []
    for k, setting in enumerate(plan.settings):
        world2cam = inverse(setting.cam2world)
        settings.append(
            {
                "name": image_name(k),
                "R": world2cam[:3, :3].tolist(),
                "rvec": Rotation.from_matrix(world2cam[:3, :3]).as_rotvec().tolist(),
                "t": world2cam[:3, 3].tolist(),
                "entities": list(setting.entities),
                **_lit_images(plan, k),
            }
        )
    data = {
        "convention": "x_cam = R x_world + t; millimetres; axes x right, y down, z forward",
        "K": np.asarray(plan.camera.matrix).tolist(),
        "distortion": list(_coefficients(plan)),
        "image_size": list(plan.camera.resolution),
        "settings": settings,
    }
    return json.dumps(data, indent=1) + "\n"


def _lit_images(plan: InspectionPlan, k: int) -> dict[str, Any]:
    """Return the images of the k-th setting of a plan with lamps."""
    if plan.light is None:
        return {}
    lit = plan.light.images[k]
    images = [
        {
            "name": image_name(k, i if len(lit) > 1 else None),
            "lamps": plan.light.lamps[list(image.lamps)].tolist(),
            "entities": list(image.contrast),
            "expose_for": image.exposure_dict(),
        }
        for i, image in enumerate(lit)
    ]
    return {"images": images}


def colmap_cameras(plan: InspectionPlan) -> str:
    """Return COLMAP's cameras.txt: one camera, PINHOLE; with distortion OPENCV, or FULL_OPENCV where k3 is not 0."""
    (width, height) = plan.camera.resolution
    matrix = np.asarray(plan.camera.matrix)
    numbers = (matrix[0, 0], matrix[1, 1], matrix[0, 2] + 0.5, matrix[1, 2] + 0.5)
    parameters = " ".join(repr(float(x)) for x in numbers)
    if plan.camera.distortion is None:
        return (
            f"# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n1 PINHOLE {width} {height} {parameters}\n"
        )
    k1, k2, p1, p2, k3 = _coefficients(plan)
    model = "OPENCV"
    names = "K1 K2 P1 P2"
    coefficients = [k1, k2, p1, p2]
    if k3:
        model = "FULL_OPENCV"
        names = "K1 K2 P1 P2 K3 K4 K5 K6"
        coefficients = [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    parameters = " ".join([parameters, *map(repr, coefficients)])
    return f"# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY {names}\n1 {model} {width} {height} {parameters}\n"


def _coefficients(plan: InspectionPlan) -> tuple[float, ...]:
    return (0.0,) * 5 if plan.camera.distortion is None else plan.camera.distortion.coefficients


def colmap_images(plan: InspectionPlan) -> str:
    """Return COLMAP's images.txt: world-to-camera quaternion and translation in mm, and no observations."""
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# (empty line: no observed points)"]
    for k, setting in enumerate(plan.settings):
        world2cam = inverse(setting.cam2world)
        x, y, z, w = Rotation.from_matrix(world2cam[:3, :3]).as_quat(canonical=True)
        numbers = " ".join(repr(float(v)) for v in (w, x, y, z, *world2cam[:3, 3]))
        lines += [f"{k + 1} {numbers} 1 {image_name(k)}", ""]
    return "\n".join(lines) + "\n"


def open3d_json(plan: InspectionPlan) -> str:
    """Return an Open3D PinholeCameraTrajectory; its matrices are stored column by column.

    Open3D knows no distortion: the intrinsics are those of undistorted images, and a field it does not read says so.
    """
    width, height = plan.camera.resolution
    version = {"version_major": 1, "version_minor": 0}
    intrinsic = {
        "width": width,
        "height": height,
        "intrinsic_matrix": np.asarray(plan.camera.matrix).T.ravel().tolist(),
    }
    parameters = [
        {
            "class_name": "PinholeCameraParameters",
            "extrinsic": inverse(setting.cam2world).T.ravel().tolist(),
            "intrinsic": intrinsic,
            **version,
        }
        for setting in plan.settings
    ]
    data: dict[str, object] = {
        "class_name": "PinholeCameraTrajectory",
        "parameters": parameters,
        **version,
    }
    if plan.camera.distortion is not None:
        data["comment"] = "for undistorted images: Open3D's pinhole camera has no lens distortion"
    return json.dumps(data, indent=1) + "\n"


def ros_yaml(plan: InspectionPlan, frame_id: str = "part") -> str:
    """Return a ROS geometry_msgs/PoseArray: camera optical frames in the part's frame, metres, quaternion x y z w."""
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", f"  frame_id: {json.dumps(frame_id)}"]
    lines.append("poses:" if plan.settings else "poses: []")
    for setting in plan.settings:
        position = np.asarray(setting.cam2world)[:3, 3] / 1000.0
        quaternion = Rotation.from_matrix(np.asarray(setting.cam2world)[:3, :3]).as_quat(
            canonical=True
        )
        lines.append(f"- position: {_flow('xyz', position)}")
        lines.append(f"  orientation: {_flow('xyzw', quaternion)}")
    return "\n".join(lines) + "\n"


def ros_camera_yaml(plan: InspectionPlan) -> str:
    """Return the camera as ROS's camera_calibration writes it, model plumb_bob: what CameraInfo is filled from."""
    camera = plan.camera
    matrix = np.asarray(plan.camera.matrix)
    tables = {
        "camera_matrix": matrix,
        "distortion_coefficients": np.array([_coefficients(plan)]),
        "rectification_matrix": np.eye(3),
        "projection_matrix": np.hstack([matrix, np.zeros((3, 1))]),
    }
    lines = [f"image_width: {camera.resolution[0]}", f"image_height: {camera.resolution[1]}"]
    lines += [f"camera_name: {json.dumps(camera.name or 'camera')}", "distortion_model: plumb_bob"]
    for name, table in tables.items():
        rows, cols = table.shape
        lines += [
            f"{name}:",
            f"  rows: {rows}",
            f"  cols: {cols}",
            f"  data: {json.dumps(table.ravel().tolist())}",
        ]
    return "\n".join(lines) + "\n"


def nerfstudio_json(plan: InspectionPlan) -> str:
    """Return a nerfstudio transforms.json: camera to world with OpenGL axes, in the part's millimetres."""
    (width, height) = plan.camera.resolution
    matrix = np.asarray(plan.camera.matrix)
    frames = [
        {
            "file_path": f"images/{image_name(k)}",
            "transform_matrix": (np.asarray(setting.cam2world) @ _OPENCV_TO_OPENGL).tolist(),
        }
        for k, setting in enumerate(plan.settings)
    ]
    k1, k2, p1, p2, k3 = _coefficients(plan)
    data = {
        "camera_model": "OPENCV",
        "fl_x": float(matrix[0, 0]),
        "fl_y": float(matrix[1, 1]),
        "cx": float(matrix[0, 2]) + 0.5,
        "cy": float(matrix[1, 2]) + 0.5,
        "w": width,
        "h": height,
        **{"k1": k1, "k2": k2, "p1": p1, "p2": p2},
        **({"k3": k3} if k3 else {}),
        "frames": frames,
    }
    return json.dumps(data, indent=1) + "\n"


def inverse(cam2world: np.ndarray) -> np.ndarray:
    """Invert a rigid motion (4, 4) without losing its exact last row."""
    cam2world = np.asarray(cam2world, dtype=float)
    world2cam = np.eye(4)
    world2cam[:3, :3] = cam2world[:3, :3].T
    world2cam[:3, 3] = -cam2world[:3, :3].T @ cam2world[:3, 3]
    return world2cam


def _flow(names: str, values: Iterable[float]) -> str:
    # YAML 1.1 reads 1e-05 as a string, so no exponents
    pairs = zip(names, values, strict=True)
    return (
        "{"
        + ", ".join(f"{n}: {np.format_float_positional(float(v), trim='0')}" for n, v in pairs)
        + "}"
    )

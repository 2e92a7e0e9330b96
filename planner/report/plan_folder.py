"""The folder of a plan: its lock, files of poses, and all that is written there."""

from __future__ import annotations

import json
import math
import os
import socket
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from aspectgraph import MemoryLimitError, graph_of, write_graphml
from aspectgraph import OutputError as GraphOutputError
from ground.convert import to_plain
from planner.argument_kinds import check_kinds, check_path
from planner.callbacks import PICTURES_SHARE, Deadline
from planner.exceptions import OutputError
from planner.files import (
    absolute,
    is_running,
    name_text,
    output_folder,
    staged_folder,
    timestamp,
    write_text,
)
from planner.measuring.images import shots_of
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError, report
from planner.report.page import make_report
from planner.report.wording import graph_sentence, regions_sentence
from planner.request.reach import TargetSpace
from planner.resume import holds_plan
from planner.sensor_setting import image_name

if TYPE_CHECKING:
    from aspectgraph import EntityAspectGraph, VisibilityRegions
    from planner.progress import Progress
    from planner.robotcell import Cell

# A folder that one process writes to at a time: another one is refused, and told who has it and
# since when.
#
# The operating system holds the lock (``flock``) and releases it when the process ends, however
# it ends: a process that was killed blocks nobody. A file system without such locks is served by
# the record in the lock file: who took the lock, and when. There a lock is stale if its process
# is of this machine and no longer runs.


try:
    import fcntl
except ImportError:
    # Windows has none
    fcntl = None  # type: ignore[assignment]

LOCK_FILE = ".aspectgraph.lock"
# descriptors of locks that this process holds; a forked worker must not keep a lock alive
_held: set[int] = set()
# how long to wait for a worker that was forked as its parent was killed to close its copy of the lock, s
_ORPHAN_S = 5.0


@dataclass(frozen=True)
class LockOwner:
    """Who holds a lock.

    Attributes
    ----------
    pid : int
        Id of the process.
    host : str
        Name of its machine.
    started : str
        What tells the process from others that had the same id; empty where that is not known.
    since : float
        When it took the lock, seconds since 1970.
    """

    pid: int
    host: str
    started: str
    since: float

    @classmethod
    def this_process(cls) -> LockOwner:
        """Return the record of a lock that this process takes now."""
        return cls(os.getpid(), socket.gethostname(), _start_of(os.getpid()), time.time())

    @property
    def gone(self) -> bool:
        """Whether the process is of this machine and surely no longer runs."""
        if self.host != socket.gethostname():
            return False
        return not is_running(self.pid) or self.started != _start_of(self.pid)

    def __str__(self) -> str:
        """Return process, machine and age."""
        return f"process {self.pid} on {self.host} for {_age(time.time() - self.since)}"


@contextmanager
def folder_lock(folder: Path, parameter: str = "out") -> Iterator[None]:
    """Hold a folder for the block.

    Parameters
    ----------
    folder : Path
        An existing folder.
    parameter : str
        What the caller knows the folder as.

    Raises
    ------
    OutputError
        If another process holds it, or the lock cannot be written.
    """
    path = folder / LOCK_FILE
    try:
        handle = _acquired(path, parameter)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError.of_rule(
            parameter, "must be a folder that can be written", f"{folder}: {error.strerror}"
        ) from None
    _held.add(handle)
    try:
        yield
    finally:
        _held.discard(handle)
        # the name goes first: whoever opens the file until then sees that it is no longer the lock
        with suppress(OSError):
            if _is_named(handle, path):
                path.unlink()
        os.close(handle)


def _acquired(path: Path, parameter: str) -> int:
    """Return the descriptor of the lock file, which this process holds."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            _take(handle, path, parameter)
            if _is_named(handle, path):
                _write_owner(handle)
                return handle
        except BaseException:
            # an interruption, too, must leave no descriptor open
            os.close(handle)
            raise
        # the owner before released it meanwhile, with its name
        os.close(handle)


def _take(handle: int, path: Path, parameter: str) -> None:
    """Lock an open file, or raise `OutputError` if another process holds it."""
    hint = ""
    try:
        if _flocked(handle):
            return
        owner = _owner_of(handle)
    except OSError:
        # this file system has no locks
        owner = _owner_of(handle)
        if owner is None or owner.gone:
            return
        hint = f"If that process has ended, delete {path}"
    raise OutputError.of_rule(
        parameter,
        "must be a folder that no other process writes to",
        f"{path.parent}, in use by {owner or 'another process'}",
        hint=hint,
    )


def _flocked(handle: int) -> bool:
    """Lock an open file, unless a process holds it; the workers of one that has ended are waited for.

    Raises
    ------
    OSError
        If this file system has no locks.
    """
    if fcntl is None:
        raise OSError
    end = time.monotonic() + _ORPHAN_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            owner = _owner_of(handle)
        if owner is None or not owner.gone or time.monotonic() > end:
            return False
        time.sleep(0.01)


def _is_named(handle: int, path: Path) -> bool:
    """Tell whether an open file still has its name."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def _write_owner(handle: int) -> None:
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, (json.dumps(asdict(LockOwner.this_process())) + "\n").encode())


def _owner_of(handle: int) -> LockOwner | None:
    """Return who took a lock, or None if its record cannot be read."""
    os.lseek(handle, 0, os.SEEK_SET)
    try:
        data: Any = json.loads(os.read(handle, 1 << 16))
        return LockOwner(
            int(data["pid"]), str(data["host"]), str(data["started"]), float(data["since"])
        )
    except (ValueError, TypeError, KeyError):
        return None


def _start_of(pid: int) -> str:
    """Return when a process began, in ticks since the machine did; empty where that is not known."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def _age(seconds: float) -> str:
    """Return a duration as a reader would say it."""
    for unit, size in (("day", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            plural = "s" if unit == "day" else ""
            return f"{int(seconds // size)} {unit}{plural}"
    return f"{max(0, int(seconds))} s"


def _forget_in_child() -> None:
    """Close locks in a forked process: they are its parent's."""
    for handle in _held:
        with suppress(OSError):
            os.close(handle)
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_in_child)


# Camera poses in the formats of other programs.
#
# ============= ===================== ========================== ==============
# ================================= format file pose camera axes length, first pixel's centre
# ============= ===================== ========================== ==============
# ================================= OpenCV poses_opencv.json world to camera, R and t x right y
# down mm, (0, 0) COLMAP colmap/images.txt world to camera, q (wxyz) x right y down mm, (0.5, 0.5)
# Open3D poses_open3d.json world to camera, 4x4 x right y down mm, (0, 0); matrix column by column
# ROS poses_ros.yaml camera to world, q (xyzw) x right y down metres (the optical frame, REP 103)
# nerfstudio transforms.json camera to world, 4x4 x right y up mm, (0.5, 0.5) =============
# ===================== ========================== ==============
# =================================
#
# camera_ros.yaml is the camera as ROS's calibration writes it. OpenCV, COLMAP, ROS and nerfstudio
# get the lens distortion; Open3D knows none: its file is for undistorted images.
#
# Every writer takes a plan and returns text; `write_poses` writes them all. Settings are numbered
# from 1 in the order of travel and their images are called ``setting_01.png`` and so on.


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
        The folder; it is made if there is none.

    Returns
    -------
    list of pathlib.Path
        The written files, sorted.

    Raises
    ------
    OutputError
        If the folder cannot be made, or a file cannot be written.

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
    check_path("folder", folder)
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
    with output_folder(folder, POSE_FILES, "folder") as place:
        for name, text in zip(POSE_FILES, texts, strict=True):
            (place / name).parent.mkdir(exist_ok=True)
            write_text(place / name, text)
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
        **_area_light(plan),
        "settings": settings,
    }
    return json.dumps(data, indent=1) + "\n"


def _area_light(plan: InspectionPlan) -> dict[str, Any]:
    """Return the light with an area, which is on in every image; nothing without one."""
    if plan.light is None or plan.light.area is None:
        return {}
    return {"light": to_plain(plan.light.area, defaults=True)}


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
    """Return COLMAP's images.txt: world-to-camera quaternion and translation in mm, and no observations.

    A setting with several lamps takes several images, each with a row.
    """
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# (empty line: no observed points)"]
    for number, shot in enumerate(shots_of(plan), start=1):
        world2cam = inverse(plan.settings[shot.setting].cam2world)
        x, y, z, w = Rotation.from_matrix(world2cam[:3, :3]).as_quat(canonical=True)
        numbers = " ".join(repr(float(v)) for v in (w, x, y, z, *world2cam[:3, 3]))
        lines += [f"{number} {numbers} 1 {shot.file}", ""]
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
    """Return a nerfstudio transforms.json: camera to world with OpenGL axes, in the part's millimetres.

    A setting with several lamps takes several images, each with a frame.
    """
    (width, height) = plan.camera.resolution
    matrix = np.asarray(plan.camera.matrix)
    frames = [
        {
            "file_path": f"images/{shot.file}",
            "transform_matrix": (
                np.asarray(plan.settings[shot.setting].cam2world) @ _OPENCV_TO_OPENGL
            ).tolist(),
        }
        for shot in shots_of(plan)
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


# What is written about a plan: all files of one plan in one folder.


# How the file of a part was read, as a plan keeps it: so the plan can be made again.


def with_source(
    plan: InspectionPlan, folder: Path, part: str | Path, reading: Mapping[str, Any]
) -> InspectionPlan:
    """Return a plan that says which file its part is, and how it was read.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    folder : Path
        Where it is written: the file is named relative to it, so that both can be moved.
    part : path
        The part's file.
    reading : mapping
        Options of `aspectgraph.read_solid`; those that are None are left out.
    """
    path = absolute(part)
    from_folder = {"relative_to": "the folder of this file"}
    try:
        name = Path(os.path.relpath(path, absolute(folder))).as_posix()
    except (OSError, ValueError):
        # on another drive
        name = str(path)
        from_folder = {}
    options = {key: value for key, value in reading.items() if value is not None}
    # names of files need not be Unicode
    return replace(plan, source={"file": name_text(name), **from_folder, **options})


# the plan first: see `staged_folder`
PLAN_FILES = ("plan.json", "report.html", "measurements.csv", "graph.graphml", *POSE_FILES)
# with more entities their joint graph is built where it can be afforded: no clock decides, so that machines agree
FEW_GRAPH_ENTITIES = 24
AFFORDABLE_BYTES = 64 * 2**20
# what `graph_of` calls its first part
JOINING = "joint graph"
_AFTER_JOINING = 3.0
# places drawn to tell how much is observable from where
_PLACES = 10_000


class Written(NamedTuple):
    """What was written about a plan.

    Attributes
    ----------
    files : list of pathlib.Path
        The most useful first.
    notes : list of str
        What was left out, and why.
    """

    files: list[Path]
    notes: list[str]


def write_outputs(
    plan: InspectionPlan,
    regions: VisibilityRegions,
    folder: Path,
    progress: Progress | None = None,
    *,
    graph_limit: int | None = None,
    deadline: Deadline | None = None,
    notes: Sequence[str] = (),
    cell: Cell | None = None,
) -> Written:
    """Write plan, report and poses, which appear in the folder together or not at all; then the joint graph.

    Files of an earlier plan do not stay. A link in the place of a file is replaced, not the file it leads to. The joint
    graph comes last because it takes the longest: with it the report is replaced by one that shows it. Beyond
    ``graph_limit`` entities it is left out; if that is None, beyond 24 if it takes much memory, and so time. What
    is not complete at the ``deadline`` is left out, pictures and the graph. ``notes`` say what else is missing.
    The report shows the arm at each setting of a plan for a ``cell``.

    Returns
    -------
    Written
        The files, and what was left out.

    Raises
    ------
    OutputError
        If they cannot be written. The folder is then as it was, or holds the whole plan without its graph.
    """
    deadline = deadline or Deadline()
    # where the time is up, there is no graph to wait for
    is_late = time.time() > deadline.at()
    without = _graph_in_time(regions, graph_limit, deadline, progress)[1] if is_late else []
    with staged_folder(folder, PLAN_FILES, "--out") as staging:
        plan.write(staging / "plan.json")
        page = make_report(
            plan,
            TargetSpace.of_plan(regions, plan),
            progress,
            [*notes, *without],
            date=(timestamp() if plan.made is None else plan.made.date).partition("T")[0],
            until=deadline.time_left(PICTURES_SHARE).until,
            cell=cell,
        )
        (staging / "report.html").write_text(page.html(), encoding="utf-8")
        # lines end as the format says, on every system
        (staging / "measurements.csv").write_bytes(plan.to_csv().encode())
        written = ["plan.json", "report.html", "measurements.csv"]
        poses = [str(path.relative_to(staging)) for path in write_poses(plan, staging)]
    if not is_late:
        graph, without = _graph_in_time(regions, graph_limit, deadline, progress)
        page.notes += without
        with staged_folder(folder, ("report.html", "graph.graphml"), "--out") as staging:
            if graph is not None:
                page.draw_graph(graph, progress, until=deadline.at())
                write_graphml(graph, staging / "graph.graphml")
                written.append("graph.graphml")
            (staging / "report.html").write_text(page.html(), encoding="utf-8")
    left_out = [*notes, *page.left_out, *without]
    return Written([folder / name for name in (*written, *poses)], left_out)


def _graph_in_time(
    regions: VisibilityRegions,
    graph_limit: int | None,
    deadline: Deadline,
    progress: Progress | None,
) -> tuple[EntityAspectGraph | None, list[str]]:
    """Return what `_joint_graph` returns, which ends with the time."""
    return _joint_graph(regions, graph_limit, _ended_at(deadline.at(), progress))


def _joint_graph(
    regions: VisibilityRegions, graph_limit: int | None, progress: Progress | None = None
) -> tuple[EntityAspectGraph | None, list[str]]:
    """Return the joint graph; or none, why it is left out, and what the regions say instead."""
    n = len(regions.entity_names)
    if graph_limit is not None and n > graph_limit:
        return None, _instead(regions, graph_limit)
    limit = AFFORDABLE_BYTES if graph_limit is None and n > FEW_GRAPH_ENTITIES else None
    try:
        report(progress, 0, n, JOINING)
        return graph_of(regions, memory_limit_bytes=limit, progress=progress), []
    except TimeIsUpError:
        return None, ["graph.graphml was not written: the time limit ended before it was complete."]
    except MemoryLimitError as error:
        # the plan does without it
        return None, [f"graph.graphml was not written: {error}"] if limit is None else _instead(
            regions, None
        )


def _ended_at(deadline: float, progress: Progress | None) -> Progress | None:
    """Return a progress that ends the work at a deadline."""
    if deadline == math.inf:
        return progress

    begun = time.time()

    def ended(done: int, total: int, label: str) -> None:
        report(progress, done, total, label)
        now = time.time()
        # what follows the joining cannot be ended, and takes some times as long
        joined = label == JOINING and done == total
        if now + (_AFTER_JOINING * (now - begun) if joined else 0.0) > deadline:
            raise TimeIsUpError

    return ended


def _instead(regions: VisibilityRegions, graph_limit: int | None) -> list[str]:
    """Say that the joint graph is left out, and what the regions say of it."""
    return [
        graph_sentence(len(regions.entity_names), graph_limit),
        regions_sentence(*_observable_shares(regions)),
    ]


def _observable_shares(regions: VisibilityRegions) -> tuple[dict[str, float], int]:
    """Return from which share of the workspace each entity is observable, and how many at most from one place."""
    low, high = regions.workspace
    seen = regions.observable(np.random.default_rng(0).uniform(low, high, (_PLACES, 3)))
    return dict(zip(regions.entity_names, seen.mean(axis=0).tolist(), strict=True)), int(
        seen.sum(axis=1).max()
    )


def rescue(plan: InspectionPlan, state: Path) -> str:
    """See that a plan that cannot be written is not lost; return where it is, in one sentence."""
    if holds_plan(state):
        return f"The plan is saved in {state}. The same command with --resume writes it without planning again."
    return _saved_elsewhere("plan", plan.write, "plan.json")


def write_graph(graph: EntityAspectGraph, path: str, parameter: str) -> None:
    """Write a joint graph; it may have taken long, so that one that cannot be written is kept elsewhere.

    Raises
    ------
    OutputError
        If it cannot be written where it should be; says where it is instead.
    """
    try:
        write_graphml(graph, path)
    except GraphOutputError as error:
        rescue = _saved_elsewhere(
            "graph", lambda place: write_graphml(graph, place), "graph.graphml"
        )
        raise OutputError(f"{parameter} {error.rule}. Got {error.got}. {rescue}") from None


def _saved_elsewhere(noun: str, write: Callable[[Path], object], name: str) -> str:
    """Write to the system's, the current or the user's folder, whichever takes it; return a sentence with the place."""
    reason = ""
    # each is tried on its own: the current folder may be deleted, and a user may have no home
    for parent in (lambda: None, Path.cwd, Path.home):
        try:
            folder = Path(tempfile.mkdtemp(prefix="aspectgraph-", dir=parent()))
        except (OSError, RuntimeError) as error:
            reason = reason or f"Got: {error}."
            continue
        try:
            write(folder / name)
        except OSError as error:
            # one of ours is a sentence that names the file
            ours = isinstance(error, OutputError | GraphOutputError)
            reason = reason or (str(error) if ours else f"Got: {error}.")
            with suppress(OSError):
                folder.rmdir()
        else:
            return f"The {noun} is in {folder / name} instead."
    return f"The {noun} cannot be saved elsewhere either: {reason}"

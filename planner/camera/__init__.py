"""The camera, its poses, and how far a real pose may be from the planned one.

Lengths are millimetres, angles radians; poses map OpenCV camera coordinates to the part's. A camera or
an uncertainty that cannot be is refused when it is made.
"""

from planner.camera.calibration import Distortion
from planner.camera.camera import Camera, camera_names
from planner.camera.pose import PoseUncertainty, aim, cam_to_paper, look_at, moved, world_to_cam

__all__ = [
    "Camera",
    "Distortion",
    "PoseUncertainty",
    "aim",
    "cam_to_paper",
    "camera_names",
    "look_at",
    "moved",
    "world_to_cam",
]

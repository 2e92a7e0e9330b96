"""Calibrations of other programs: COLMAP, ROS, OpenCV (YAML, XML, JSON), Kalibr and Autoware.

What a file holds is decided by its content, not by its name. A file says which lens it is of, and
which part of the sensor it delivers, under many names. Those that are known here are read; a name
that is not known may change the meaning of the numbers, so it is refused.
"""

from planner.camera.readers.any_calibration import calibrated_fields

__all__ = ["calibrated_fields"]

"""Cells in which the robot holds the part, and the camera stands still."""

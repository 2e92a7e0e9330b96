"""Commands about the robot: whether it reaches a plan."""

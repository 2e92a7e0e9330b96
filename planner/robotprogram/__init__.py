"""From settings to a robot program: order of the poses, moves without collision, time, uncertainty.

**Guarantee.** Every move of a program is a straight line in joints that is proven free: between the
poses that are checked, no point of the robot moves farther than the distance that is left there.
"""

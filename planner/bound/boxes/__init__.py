"""Boxes of camera poses, searched for one pose that inspects more than a given weight. Compiled loops.

What is dropped from a box is dropped for a proven reason: no pose of the box inspects it. The answer "none" is a proof,
the answer "found" comes with the pose.
"""

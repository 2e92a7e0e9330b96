"""Which lines at the ends of entities show in images, as far as their own two faces do not hide them; compiled."""

from __future__ import annotations

from typing import Any

from compiled.decorators import entry_kernel, kernel_without_refcounts
from planner.detectability.contours import SHOWS

# for dividing by a depth
_TINY = 1e-9


@entry_kernel(error_model="numpy")
def arm_images(poses: Any, pairs: Any, scale: Any, lines: Any, arms: Any, found: Any) -> int:
    """Write which arms show in images, in the order of pairs and arms; return how many there are.

    Parameters
    ----------
    poses : array (n, 4, 4)
        Cam2world.
    pairs : array of int (p, 2)
        Pose and entity.
    scale : array (4,)
        Pixels per unit of slope in x and y, and the principal point, px.
    lines : tuple
        `PartLines.compiled`.
    arms : tuple
        Where those of each entity begin (k + 1,), their contours (a,), corners, tips and other ends of the entities
        (3, a, 3).
    found : tuple
        To be written: number of the pair and of the arm (q, 2), images in px and depths in mm of the three (3, q, 3).
    """
    first, contour, points = arms
    numbers, images = found
    planes = lines[2]
    faces = lines[3]
    kinds = lines[4]
    count = 0
    for p in range(len(pairs)):
        pose = poses[pairs[p, 0]]
        k = pairs[p, 1]
        for a in range(first[k], first[k + 1]):
            e = contour[a]
            front = 0
            for f in faces[e]:
                side = (
                    planes[0, f] * pose[0, 3]
                    + planes[1, f] * pose[1, 3]
                    + planes[2, f] * pose[2, 3]
                )
                front += side > planes[3, f]
            if not SHOWS[kinds[e], front]:
                continue
            before = True
            for i in range(3):
                before &= _image(pose, scale, points[i, a], images[i, count])
            if before:
                numbers[count, 0] = p
                numbers[count, 1] = a
                count += 1
    return count


@kernel_without_refcounts(error_model="numpy")
def _image(pose: Any, scale: Any, point: Any, image: Any) -> bool:
    """Write the image of a point in px, and its depth in mm; return whether it is in front of the camera."""
    x = point[0] - pose[0, 3]
    y = point[1] - pose[1, 3]
    z = point[2] - pose[2, 3]
    depth = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    safe = max(depth, _TINY)
    image[0] = (pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z) / safe * scale[0] + scale[2]
    image[1] = (pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z) / safe * scale[1] + scale[3]
    image[2] = depth
    return depth > 0.0

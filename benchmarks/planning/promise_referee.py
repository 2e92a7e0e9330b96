"""What plans promise, P_all, against displaced cameras that share no code with the planner.

    python benchmarks/planning/promise_referee.py plan.json part.stp [more pairs] [--poses 20000] [--images 200]

For each setting and target the camera is displaced by exact rotations. Counted are the poses from which

* every point of the target is on the sensor, less the strip that is asked for around the search window,
* and between the limits of the depth of field,
* and a ray from the camera meets it first (Open3D's own ray casting, dense points),
* and the value is measured accurately: lengths on a pixel grid that lies anywhere, dimensions by the second program of
  ``tests/errors/helpers/measured_exactly.py``.

The first ``--images`` poses are also asked whether another line is nearer than the separation (to a whole edge; to more
than a fifth of a line or circle that is fitted, or to all of a twelfth), by
``benchmarks/images/seen_lines.py``; that is slow.

A promise is *over* where so few successes have a probability below 0.001. Printed are all targets with the least
promise, those that are over, and per plan how often everything held for a whole setting. The exit code is 1 if more
are over than chance allows.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binom

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "errors" / "helpers"))
sys.path.insert(0, str(Path(__file__).parents[1] / "images"))

from measured_exactly import measure, plane_of, points_of
from rendered_images import Renderer
from seen_lines import Lines

from aspectgraph import read_solid
from errors.measurands import MeasuredCircle
from planner import read_plan
from planner.request.targets import targets_of

DENSE = 24
# points of a line or circle that other lines are looked for at, in each twelfth the same number
SCANNED = 72
SHORT_MM = 0.05
P_OVER = 1e-3


def plain_geometry(target):
    """Return lines and circles as the plain tuples of the second program."""
    found = []
    for one in target.geometry:
        if isinstance(one, MeasuredCircle):
            found.append(("circle", one.centre, one.axis, one.radius_mm, one.start, one.span_rad))
        else:
            found.append(("line", one.p, one.q))
    return found


def displaced(pose, covariance, n, rng):
    """Return moves (n, 6) and poses (n, 4, 4), camera to part."""
    values, vectors = np.linalg.eigh(covariance)
    moves = rng.normal(size=(n, 6)) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    local = np.tile(np.eye(4), (n, 1, 1))
    local[:, :3, :3] = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    local[:, :3, 3] = moves[:, :3]
    return moves, np.einsum("ij,njk->nik", pose, local)


def in_camera(points, poses):
    """Return points (m, 3) in the frames of cameras (n, 4, 4)."""
    return np.einsum("nmk,nkj->nmj", points[None] - poses[:, None, :3, 3], poses[:, :3, :3])


def accurate(plan, target, pose, moves, local, rng):
    """Return in which displaced images (n,) the value is accurate."""
    camera = plan.camera
    pitch = np.array(camera.pixel_pitch_mm)
    if target.in_image:
        image = local[:, :, :2] / local[:, :, 2:] * np.diag(camera.matrix)[:2]
        grid = rng.random(image.shape)
        found = np.round(image + grid) - grid
        length = np.linalg.norm((found[:, -1] - found[:, 0]) * pitch, axis=1)
        nominal_ends = in_camera(target.ends, pose[None])[0]
        ideal = nominal_ends[:, :2] / nominal_ends[:, 2:] * np.diag(camera.matrix)[:2]
        nominal = np.linalg.norm((ideal[1] - ideal[0]) * pitch)
        return np.abs(length - nominal) <= (1 - plan.accuracy) * nominal
    how = target.localisation
    geometry = plain_geometry(target)
    counts = []
    for one in geometry:
        outline = in_camera(points_of(one, 200), pose[None])[0]
        image = outline[:, :2] / outline[:, 2:] * np.diag(camera.matrix)[:2]
        along = np.linalg.norm(np.diff(image, axis=0), axis=1).sum()
        counts.append(
            max(3, round(along / how.correlation_px)) if how.model == "fit" else how.points
        )
    world_to_cam = np.linalg.inv(pose)
    n = len(moves)
    common = {}
    if how.common_px > 0:
        common["floor_px"] = rng.normal(0.0, how.common_px, (n, len(geometry)))
    if target.surfaces_mm > 0:
        of_plane = planes_shared(target, geometry)
        offsets = rng.normal(0.0, target.surfaces_mm, (n, len(geometry)))
        common["surfaces_mm"] = offsets[:, of_plane]
    error = measure(
        target.kind,
        geometry,
        world_to_cam,
        moves,
        f=camera.image_distance_mm,
        sigma_mm=tuple(how.sigma_px * pitch),
        rng=rng,
        direction=target.direction,
        points=counts,
        pitch=tuple(pitch),
        common=common,
    )
    return np.abs(error) <= target.permitted_error


def planes_shared(target, geometry):
    """Return for each entity the first one whose plane is the same: its face is off by the same offset."""
    first = []
    planes = []
    for index in range(len(geometry)):
        point, x, y = plane_of(target.kind, geometry, target.direction, index)
        normal = np.cross(x, y)
        normal *= np.sign(normal[np.argmax(np.abs(normal))])
        same = (
            k
            for k, (other, at) in enumerate(planes)
            if abs(normal @ other) > 1 - 1e-9 and abs(normal @ point - at) < 1e-6
        )
        first.append(next(same, index))
        planes.append((normal, normal @ point))
    return np.array(first)


def target_points(target):
    """Return dense points (m, 3) of a target, both ends of an edge first and last."""
    if target.in_image:
        share = np.linspace(0, 1, DENSE)[:, None]
        return target.ends[0] * (1 - share) + target.ends[1] * share
    points = []
    for one, plain in zip(target.geometry, plain_geometry(target), strict=True):
        points.append(points_of(plain, 72 if isinstance(one, MeasuredCircle) else DENSE))
        if not isinstance(one, MeasuredCircle):
            points.append(np.array([one.p, one.q]))
    return np.concatenate(points)


def points_on_part(target, solid):
    """Return points (m, 3) of a target on the part's own edges: of a circle the middles of its chords."""
    if target.in_image:
        return target_points(target)
    found = []
    ends = solid.vertices[[edge.vertices for edge in solid.edges]]
    for one in target.geometry:
        if not isinstance(one, MeasuredCircle):
            share = np.linspace(0, 1, DENSE)[:, None]
            found.append(np.asarray(one.p) * (1 - share) + np.asarray(one.q) * share)
            continue
        middles = ends[sorted(chords_on(one, solid))].mean(axis=1)
        if one.start is not None:
            across = np.cross(one.axis, one.start)
            way = middles - one.centre
            turn = np.arctan2(way @ across, way @ one.start) % (2 * np.pi)
            middles = middles[turn <= one.span_rad]
        assert len(middles), "a circle of a plan has chords on the part"
        found.append(middles)
    return np.concatenate(found)


def judge_setting(plan, setting, lines, renderer, args, rng):
    """Yield name, promise, successes and number of poses of each target; at last those of all together."""
    camera = plan.camera
    pose = np.asarray(setting.cam2world)
    moves, poses = displaced(pose, plan.pose_uncertainty.covariance, args.poses, rng)
    near, far = camera.depth_of_field_mm
    size = np.array(camera.resolution)
    strip = plan.requirements.get("surround_px", 0.0)
    every = np.ones(args.poses, bool)
    for name in setting.entities:
        target = targets_of(plan.targets, setting)[name]
        points = target_points(target)
        good = np.empty(args.poses, bool)
        for start in range(0, args.poses, 1000):
            some = slice(start, min(start + 1000, args.poses))
            local = in_camera(points, poses[some])
            depth = local[..., 2]
            image = (
                local[..., :2] / depth[..., None] * np.diag(camera.matrix)[:2]
                + camera.matrix[:2, 2]
            )
            inside = ((image >= strip - 0.5) & (image <= size - 0.5 - strip)).all(axis=(1, 2))
            sharp = ((depth >= near) & (depth <= far)).all(axis=1)
            good[some] = inside & sharp
            if args.rays:
                solid_points = points_on_part(target, lines.solid)
                eyes = np.repeat(poses[some, :3, 3], len(solid_points), axis=0)
                seen = seen_from(lines, eyes, np.tile(solid_points, (len(local), 1)))
                good[some] &= seen.reshape(len(local), -1).all(axis=1)
            good[some] &= accurate(plan, target, pose, moves[some], local, rng)
        if plan.requirements.get("separation_px", 0.0) > 0 and args.images:
            is_apart = apart_of(target, lines, renderer, plan.requirements["separation_px"])
            apart = [is_apart(poses[k]) for k in range(min(args.images, args.poses))]
            good[: len(apart)] &= np.array(apart)
        every &= good
        yield name, setting.promise[name], int(good.sum())
    yield "together", setting.p_all_together, int(every.sum())


def seen_from(lines, eyes, points):
    """Return which points (m, 3) rays from eyes (m, 3) meet first.

    A ray may end `SHORT_MM` before its point.
    """
    import open3d as o3d

    rays = np.concatenate([eyes, points - eyes], axis=1).astype(np.float32)
    return lines.scene.cast_rays(o3d.core.Tensor(rays))[
        "t_hit"
    ].numpy() >= 1 - SHORT_MM / np.linalg.norm(points - eyes, axis=1)


def apart_of(target, lines, renderer, least_px):
    """Return a function that tells whether a target is apart from other lines in the image of a pose.

    A whole edge must be. Of a line or circle that is fitted, four fifths must be, and a point of each twelfth.
    """
    if target.in_image:
        own = own_edges(lines.solid, target.ends)
        return lambda pose: lines.nearest_px(renderer, pose, target.ends, own) >= least_px
    scanned = []
    for one, plain in zip(target.geometry, plain_geometry(target), strict=True):
        if isinstance(one, MeasuredCircle):
            scanned.append((points_of(plain, SCANNED), chords_on(one, lines.solid)))
        else:
            share = (np.arange(SCANNED)[:, None] + 0.5) / SCANNED
            ends = np.array([one.p, one.q])
            scanned.append((ends[0] * (1 - share) + ends[1] * share, carrying(lines.solid, ends)))

    def is_apart(pose):
        for points, own in scanned:
            good = lines.apart_px(renderer, pose, points, own) >= least_px
            if good.mean() < 0.8 or not good.reshape(12, -1).any(axis=1).all():
                return False
        return True

    return is_apart


def chords_on(circle, solid):
    """Return the numbers of the edges that are chords of a circle."""
    ends = solid.vertices[[edge.vertices for edge in solid.edges]]
    off = ends - circle.centre
    along = off @ circle.axis
    radius = np.linalg.norm(off - along[..., None] * circle.axis, axis=2)
    on = (np.abs(along) < 1e-3) & (np.abs(radius - circle.radius_mm) < 1e-3)
    return set(np.flatnonzero(on.all(axis=1)).tolist())


def carrying(solid, ends):
    """Return the numbers of the edges that lie on the line of a segment and overlap with it."""
    length = np.linalg.norm(ends[1] - ends[0])
    along = (ends[1] - ends[0]) / length
    found = set()
    for k, edge in enumerate(solid.edges):
        points = solid.vertices[list(edge.vertices)] - ends[0]
        share = points @ along
        off = np.linalg.norm(points - share[:, None] * along, axis=1).max()
        if off < 1e-6 and share.max() > 1e-6 and share.min() < length - 1e-6:
            found.add(k)
    return found


def own_edges(solid, ends):
    """Return the numbers of the edges on a segment."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    found = set()
    for k, edge in enumerate(solid.edges):
        points = solid.vertices[list(edge.vertices)] - ends[0]
        off = np.linalg.norm(points - (points @ along)[:, None] * along, axis=1).max()
        if off < 1e-6 and (points @ along).min() > -1e-6:
            found.add(k)
    return found


def main(argv=None):
    """Judge plans and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pairs", nargs="+", help="plan.json part, and so on")
    parser.add_argument("--poses", type=int, default=20_000)
    parser.add_argument("--images", type=int, default=200)
    parser.add_argument("--no-rays", dest="rays", action="store_false")
    args = parser.parse_args(argv)
    n_all = 0
    over = []
    print(
        f"{'plan':28} {'setting':>7} {'least promise':>14} {'found':>8} {'together':>9} {'found':>8}"
    )
    for path, part in zip(args.pairs[::2], args.pairs[1::2], strict=True):
        plan = read_plan(path)
        solid = read_solid(part)
        lines = Lines(solid)
        renderer = Renderer(solid.vertices, solid.triangles, plan.camera.matrix)
        for k, setting in enumerate(plan.settings):
            rng = np.random.default_rng([k, args.poses])
            found = list(judge_setting(plan, setting, lines, renderer, args, rng))
            for name, promise, hits in found:
                if not np.isfinite(promise):
                    continue
                n_all += 1
                if binom.cdf(hits, args.poses, promise) < P_OVER:
                    over.append((plan.part, k + 1, name, promise, hits / args.poses))
            _, promise, hits = min(found[:-1], key=lambda one: one[1])
            _, together, all_hits = found[-1]
            print(
                f"{plan.part[:28]:28} {k + 1:7} {promise:14.4f} {hits / args.poses:8.4f} "
                f"{together:9.4f} {all_hits / args.poses:8.4f}"
            )
    for part, k, name, promise, share in over:
        print(f"OVER {part} setting {k}: {name} promises {promise:.4f}, found {share:.4f}")
    print(f"{len(over)} of {n_all} promises over at p < {P_OVER:g}")
    return int(len(over) > max(1, 5 * P_OVER * n_all))


if __name__ == "__main__":
    sys.exit(main())

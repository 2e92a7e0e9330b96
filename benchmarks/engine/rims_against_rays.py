"""Compare the regions of rims of a real part with rays through three points of every chord, and settle what differs.

A pair that differs is asked again with a hundred rays to a chord, through points drawn in from the surface by a
hundred-thousandth of the part: rays that sample a chord coarsely, and those that graze, prove nothing.
"""

import argparse
import sys
import time

import numpy as np
import open3d as o3d

from aspectgraph import compute_regions, read_solid

ARRIVED = 1.0 - 1e-4
FINE = 100


def main():
    """Print how often both agree, and what a hundred rays to a chord say of the rest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="+")
    parser.add_argument("--rims", type=int, default=6)
    parser.add_argument(
        "--points", type=int, default=1000, help="viewpoints to a rim, half of them in front of it"
    )
    chosen = parser.parse_args()
    for path in chosen.parts:
        compare(path, chosen.rims, chosen.points)


def compare(path: str, n_rims: int, n_points: int) -> None:
    """Compare some rims of one part."""
    solid = read_solid(path)
    rng = np.random.default_rng(0)
    rims = [solid.rims()[i] for i in sorted(rng.permutation(len(solid.rims()))[:n_rims])]
    compute_regions(solid, rims[:1])
    started = [time.perf_counter()]
    regions = compute_regions(solid, rims, progress=lambda *_: started.append(time.perf_counter()))
    print(f"{solid.name}: {len(solid.rims())} rims; snapped by {regions.grid.snapping_mm:.2g} mm")
    scene = _scene(solid)
    diagonal = float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    print(
        "rim chords  s     cells pairs  seen   agree    only rays    only region  (settled as the region says)"
    )
    for rim, seconds in zip(rims, np.diff(started), strict=True):
        points = _viewpoints(rng, rim, diagonal, n_points)
        points = points[~_inside(scene, points)]
        engine = regions.observable(points, [rim.id])[:, 0]
        chords = _chords(solid, rim)
        coarse = _arrive(scene, points, chords, (np.arange(3) + 0.5) / 3)
        only_rays = np.flatnonzero(coarse & ~engine)
        only_region = np.flatnonzero(~coarse & engine)
        fine = (np.arange(FINE) + 0.5) / FINE
        hidden = ~_arrive(scene, points[only_rays], chords, fine)
        away = _drawn_in(solid, rim, 1e-5 * diagonal)
        free = _arrive(scene, points[only_region], away, (np.arange(3) + 0.5) / 3)
        print(
            f"{rim.id:4} {len(chords):4} {seconds:6.2f} {regions._regions[rim.id].n_leaves:5} {len(points):5} "
            f"{engine.mean():6.3f} {(engine == coarse).mean():8.4f} {len(only_rays):5} ({int(hidden.sum())}) "
            f"{len(only_region):8} ({int(free.sum())})",
            flush=True,
        )


def _scene(solid):
    scene = o3d.t.geometry.RaycastingScene()
    corners = (solid.vertices - solid.bounds.mean(axis=0)).astype(np.float32)
    scene.add_triangles(
        o3d.core.Tensor(corners), o3d.core.Tensor(solid.triangles.astype(np.uint32))
    )
    return scene, solid.bounds.mean(axis=0)


def _chords(solid, rim) -> np.ndarray:
    line = solid.vertices[[*rim.vertices, rim.vertices[0]]]
    return np.stack([line[:-1], line[1:]], axis=1)


def _drawn_in(solid, rim, distance_mm: float) -> np.ndarray:
    """Return the chords moved off the surface, along both faces' normals at a convex edge and a re-entrant one."""
    normals = np.array(
        [solid.normals[list(solid.edges[e].faces)].sum(axis=0) for e in rim.edge_ids]
    )
    return _chords(solid, rim) + distance_mm * normals[:, None]


def _viewpoints(rng, rim, diagonal: float, n: int) -> np.ndarray:
    """Half of the viewpoints anywhere around the part, half in a cone in front of the rim."""
    away = rng.normal(size=(n, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    away[n // 2 :] = 0.35 * away[n // 2 :] + rim.axis * rng.choice(
        [1, 1, 1, -1], size=(n - n // 2, 1)
    )
    return rim.centre + away * diagonal * rng.uniform(0.05, 3.0, size=(n, 1))


def _inside(scene_at, points) -> np.ndarray:
    scene, centre = scene_at
    return (
        scene.compute_occupancy(
            o3d.core.Tensor((points - centre).astype(np.float32)), nsamples=3
        ).numpy()
        > 0
    )


def _arrive(scene_at, points, chords, shares) -> np.ndarray:
    scene, centre = scene_at
    targets = (
        chords[:, None, 0] + shares[None, :, None] * (chords[:, 1] - chords[:, 0])[:, None]
    ).reshape(-1, 3)
    result = np.empty(len(points), bool)
    for k, eye in enumerate(points):
        rays = np.concatenate([np.broadcast_to(eye - centre, targets.shape), targets - eye], axis=1)
        hits = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
        result[k] = (hits >= ARRIVED).all()
    return result


if __name__ == "__main__":
    sys.exit(main())

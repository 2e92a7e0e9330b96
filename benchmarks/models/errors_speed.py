"""Speed, memory and accuracy of `errors.success_probability` against its Monte Carlo referee.

    python benchmarks/models/errors_speed.py [--edges 200000] [--samples 1000000]

Prints, per rotation s.d. (translation variance 0.03 mm2, accuracy 98 %, 25 mm lens):

* joint probabilities per second on one core;
* the largest and the root mean square difference from Monte Carlo over 40 random edges with correlated covariances, and
  the sampling noise of that Monte Carlo alone;
* how many times longer Monte Carlo takes to be as accurate: it needs p (1 - p) / difference^2 poses for that.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc

import numpy as np

from errors import simulate_success, success_probability

F = 25.0
CALL = {"focal_length_mm": F, "pixel_pitch_mm": (0.01, 0.013), "accuracy": 0.98}
ROTATION_STD = (0.002, 0.01, 0.03, 0.055)


def random_edges(n, rng):
    """Draw n edges (n, 2, 3) of 20 to 80 mm, 200 to 600 mm away, none nearly along the line of sight."""
    depth = rng.uniform(200.0, 600.0, n)
    direction = rng.normal(size=(8 * n + 100, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction = direction[np.hypot(direction[:, 0], direction[:, 1]) > 0.3][:n]
    centre = np.stack([*(rng.uniform(-0.2, 0.2, (2, n)) * depth), F - depth], axis=1)
    half = 0.5 * rng.uniform(20.0, 80.0, n)[:, None] * direction
    return np.stack([centre - half, centre + half], axis=1)


def random_covariances(n, rotation_std, rng):
    """Draw n correlated covariances (n, 6, 6) with the given standard deviation, rad, of every rotation."""
    factor = rng.normal(size=(n, 6, 12))
    covariance = factor @ np.swapaxes(factor, 1, 2)
    std = np.array([np.sqrt(0.03)] * 3 + [rotation_std] * 3)
    std = std / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return covariance * std[:, :, None] * std[:, None, :]


def best_time(function, repeat=3):
    """Return the least processor time, s, of several calls."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """Print speed and accuracy per rotation, then the memory of a large batch."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--edges", type=int, default=200_000)
    parser.add_argument("--samples", type=int, default=1_000_000)
    arguments = parser.parse_args()
    rng = np.random.default_rng(0)
    many = random_edges(arguments.edges, rng)
    few = random_edges(40, rng)

    start = time.process_time()
    success_probability(few, **CALL, pose_covariance=np.eye(6) * 1e-4)
    print(
        f"first call: {time.process_time() - start:.2f} s (compiles once, then loads from the cache)"
    )
    print(
        "rotation s.d.  per second  max diff   rms diff   MC noise (1 s.e., worst edge)  MC time / joint time"
    )
    for std in ROTATION_STD:
        shared = np.diag([0.03] * 3 + [std**2] * 3)
        joint_time = best_time(
            lambda c=shared: success_probability(many, **CALL, pose_covariance=c)
        ) / len(many)
        covariance = random_covariances(len(few), std, rng)
        start = time.process_time()
        referee = simulate_success(
            few, **CALL, pose_covariance=covariance, samples=arguments.samples, rng=1
        )
        pose_time = (time.process_time() - start) / (len(few) * arguments.samples)
        p = referee.probability
        difference = np.abs(success_probability(few, **CALL, pose_covariance=covariance) - p)
        rms = float(np.sqrt((difference**2).mean()))
        noise = np.sqrt((p * (1.0 - p)).max() / arguments.samples)
        ratio = (p * (1.0 - p)).mean() / rms**2 * pose_time / joint_time
        differences = f"{difference.max():8.5f}  {rms:9.5f}  {noise:29.5f}"
        print(f"{std:13.3f}  {1.0 / joint_time:10,.0f}  {differences}  {ratio:20,.0f}")

    million = np.broadcast_to(few[0], (1_000_000, 2, 3))
    tracemalloc.start()
    start = time.process_time()
    success_probability(million, **CALL, pose_covariance=np.diag([0.03] * 3 + [1e-4] * 3))
    peak = tracemalloc.get_traced_memory()[1]
    print(
        f"1,000,000 edges: {time.process_time() - start:.2f} s, {peak / 1e6:.0f} MB at the peak, result included"
    )


if __name__ == "__main__":
    main()

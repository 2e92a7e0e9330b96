"""Time of a rim's region against that of a straight edge, as ratios measured in one run on one core.

    python benchmarks/engine/rim_speed.py [--chords N] [PART ...]

For a plate of 20 x 20 holes and each part: processor time of the regions of all rims and of straight edges (up to
`--edges`, evenly over the part), their means and largest, and the ratios. With `--chords N`, N rims evenly over the
part are also computed chord by chord, without their free discs, and the answers of both compared at random viewpoints.
"""

import argparse
import sys
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "aspectgraph" / "helpers"))

from rimmed_solids import PITCH, PlateBuilder  # noqa: E402

from aspectgraph import Solid, read_solid  # noqa: E402
from aspectgraph.cells.arrays import holds  # noqa: E402
from aspectgraph.visibility import blocked_sets  # noqa: E402
from aspectgraph.visibility.entity_region import observable_region  # noqa: E402
from aspectgraph.visibility.visibility_regions import laid_out  # noqa: E402

HOLES = 20
N_POINTS = 20_000


def plate():
    """Return a plate of through holes, 12 chords each, on a grid of 20 mm."""
    builder = PlateBuilder(HOLES, HOLES, 6)
    for i in range(HOLES):
        for j in range(HOLES):
            builder.add((PITCH * i + PITCH // 2, PITCH * j + PITCH // 2), 25, 0)
    part = builder.part("plate of 400 holes")
    return Solid(part.vertices, part.faces, name=part.name)


def evenly(names, n):
    """Return n of some names, evenly spread."""
    return [names[int(k)] for k in np.linspace(0, len(names) - 1, min(n, len(names)))]


class Part:
    """A solid on its grid, with its rims and straight edges."""

    def __init__(self, solid):
        targets = [*solid.rims(), *(edge.id for edge in solid.straight_edges())]
        self.solid, box, self.entities, self.grid, self.scene = laid_out(solid, targets, None)
        self.cube = self.grid.cube_planes(box)
        self.rims = [name for name, entity in self.entities.items() if entity.kind == "rim"]
        self.edges = [name for name, entity in self.entities.items() if entity.kind == "edge"]

    def region(self, name):
        """Return the region of an entity and its processor time in seconds."""
        start = time.process_time()
        region = observable_region(self.scene, self.solid, self.entities[name], self.cube)
        return region, time.process_time() - start

    def seconds(self, names):
        """Return the processor times of some entities."""
        return np.array([self.region(name)[1] for name in names])

    def chord_by_chord(self, names):
        """Return processor times with and without free discs, and at how many viewpoints the answers differ."""
        points = self._viewpoints(names)
        times = []
        n_different = 0
        for name in names:
            region, own = self.region(name)
            with patch.object(blocked_sets, "free_disc", lambda *_: None):
                other, by_chords = self.region(name)
            seen, expected = (holds(r.tree, r.observable, points) for r in (region, other))
            n_different += int((seen != expected).sum())
            times.append((own, by_chords))
        return np.array(times), n_different

    def _viewpoints(self, names):
        """Return viewpoints around the part, and a third each around one of the rims and along its axis."""
        rng = np.random.default_rng(0)
        extent = np.abs(self.scene.points).max()
        points = rng.uniform(-4.0, 4.0, (N_POINTS, 3)) * extent
        for k, row in enumerate(points[: 2 * N_POINTS // 3]):
            chords = [
                self.solid.edges[e].vertices for e in self.entities[names[k % len(names)]].edge_ids
            ]
            corners = self.scene.points[np.unique(chords)]
            middle = corners.mean(axis=0)
            radius = np.linalg.norm(corners - middle, axis=1).max()
            row[:] = middle + radius * rng.normal(size=3) * 10.0 ** rng.uniform(-0.5, 1.5)
        return np.rint(points * 2.0**20).astype(np.int64)


def main():
    """Print a row per part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", type=Path, metavar="PART")
    parser.add_argument("--edges", type=int, default=60)
    parser.add_argument("--chords", type=int, default=0, metavar="N")
    chosen = parser.parse_args()
    print(f"{'part':30} rims  edge s: mean   max   rim s: mean   max   rim/edge: mean   max")
    for solid in [plate(), *map(read_solid, chosen.parts)]:
        part = Part(solid)
        for name in (part.rims[0], part.rims[-1], part.edges[0]):
            part.region(name)
        edge = part.seconds(evenly(part.edges, chosen.edges))
        rim = part.seconds(part.rims)
        print(
            f"{solid.name[:30]:30} {len(rim):4d} {edge.mean():13.3f} {edge.max():6.3f} {rim.mean():12.3f} "
            f"{rim.max():6.3f} {rim.mean() / edge.mean():15.2f} {rim.max() / edge.mean():6.2f}",
            flush=True,
        )
        if chosen.chords:
            names = evenly(part.rims, chosen.chords)
            times, n_different = part.chord_by_chord(names)
            own, other = times.sum(axis=0)
            print(
                f"  {len(names)} rims chord by chord: {other / own:.1f} times as long, at most "
                f"{(times[:, 1] / times[:, 0]).max():.0f}; {n_different} of {len(names) * N_POINTS} answers differ",
                flush=True,
            )


if __name__ == "__main__":
    main()

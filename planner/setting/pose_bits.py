"""Bits to poses and back: six genes of M bits, the paper's section 4.1.

Genes 1–3 are the position of the front nodal point in a box around the viewpoints that may be used. Genes 4–6 are pan,
tilt and roll away from looking straight at the entities. Pan and tilt end at the angle of the sensor's corner: turned
farther, the entities would leave the image. Roll is a full turn.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ga import Chromosome
from planner.camera.pose import aim, look_at


class PoseEncoding:
    """A box of positions and a range of angles, written as bits.

    Parameters
    ----------
    bounds : array (2, 3)
        Lowest and highest position, mm.
    target : array (3,)
        Point that pan = tilt = 0 looks at, mm.
    max_turn_rad : float
        Largest pan and tilt.
    gene_bits : int
        Bits per gene (M).
    gray : bool
        Gray code instead of plain binary.

    Guarantee
    ---------
    ``decode(encode(x))`` differs from x by at most half a step, range / (2^M − 1) / 2, in every parameter.
    """

    def __init__(
        self,
        bounds: np.ndarray,
        target: np.ndarray,
        max_turn_rad: float,
        gene_bits: int = 16,
        gray: bool = True,
    ) -> None:
        self.chromosome = Chromosome(6, gene_bits, gray)
        self.target = np.asarray(target, dtype=np.float64)
        turn = [max_turn_rad, max_turn_rad, np.pi]
        self.low = np.concatenate([bounds[0], np.negative(turn)])
        self.high = np.concatenate([bounds[1], turn])

    @property
    def n_bits(self) -> int:
        """Length of a chromosome."""
        return self.chromosome.n_bits

    def parameters(self, bits: np.ndarray) -> np.ndarray:
        """Return (x, y, z in mm, pan, tilt, roll in rad) (n, 6) of chromosomes (n, 6·M)."""
        return self.chromosome.decode(bits, self.low, self.high)

    def poses(self, parameters: np.ndarray) -> np.ndarray:
        """Return cam2world (n, 4, 4) of parameters (n, 6)."""
        return look_at(parameters[:, :3], self.target, *parameters[:, 3:].T)

    def parameters_of(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the parameters (n, 6) of poses (n, 4, 4), the inverse of `poses`; they may be outside the range."""
        positions = cam2world[:, :3, 3]
        turned = np.swapaxes(aim(positions, self.target), 1, 2) @ cam2world[:, :3, :3]
        angles = Rotation.from_matrix(turned).as_euler("YXZ") if len(turned) else np.empty((0, 3))
        return np.hstack([positions, angles])

    def decode(self, bits: np.ndarray) -> np.ndarray:
        """Return cam2world (n, 4, 4) of chromosomes (n, 6·M)."""
        return self.poses(self.parameters(bits))

    def encode(self, parameters: np.ndarray) -> np.ndarray:
        """Return the chromosomes (n, 6·M) nearest to parameters (n, 6); values outside the range are clipped."""
        span = self.high - self.low
        fractions = (parameters - self.low) / np.where(span > 0, span, 1.0)
        return self.chromosome.encode(np.clip(fractions, 0.0, 1.0))

    def draw_turns(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw pan, tilt and roll (n, 3): every second one looks straight at the target, the others anywhere."""
        turns = rng.uniform(self.low[3:], self.high[3:], (n, 3))
        turns[::2, :2] = 0.0
        return turns

"""Whether the noise of flat faces tells the response of a camera. It does not: a factor of 2 is open.

Noise of light L has the variance a L + b, of photons and of reading (EMVA 1288). Grey values g have it divided by
(dL/dg)². So a and b, not negative, and gamma are fitted to the variance at each grey value. Images are those that
`real_images` keeps in FOLDER. Each row has the gamma that fits best with both kinds of noise, and with one of them
alone, and chi² for each grey value. A second row is of the same images as JPEG files.

    PYTHONPATH=. python benchmarks/images/noise_levels.py FOLDER --materials matt blasted
"""

from __future__ import annotations

import argparse
import io
import itertools
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from real_images import Bench, Condition, taken
from scipy.ndimage import gaussian_filter, uniform_filter
from scipy.optimize import nnls

WHITE = 255.0
GAMMAS = np.arange(0.6, 3.01, 0.05)
KINDS = {"both": (0, 1), "photons": (0,), "reading": (1,)}
# grey values of a class, and pixels that it needs
CLASS = 4
FEWEST = 400
# of the slope of flat places, grey values for each px
MOST_SLOPE = 1.0
# share of a variance that is not understood
MISFIT = 0.03
# variance of a pixel less the mean of its four neighbours, and of rounding
LESS_NEIGHBOURS = 1.25
ROUNDING = 1 / 12


def noise_levels(image: np.ndarray) -> np.ndarray:
    """Return mean grey value, variance (as shares of white) and count of classes of grey values (c, 3)."""
    grey = image.astype(float)
    beside = grey[1:-1, :-2] + grey[1:-1, 2:] + grey[:-2, 1:-1] + grey[2:, 1:-1]
    noise = grey[1:-1, 1:-1] - beside / 4
    mean = uniform_filter(grey, 7)[1:-1, 1:-1]
    slope = np.hypot(*np.gradient(gaussian_filter(grey, 2.0)))[1:-1, 1:-1]
    flat = gaussian_filter(slope, 1.0) < MOST_SLOPE
    rows = []
    for low in np.arange(3, 250, CLASS):
        chosen = noise[flat & (mean >= low) & (mean < low + CLASS)]
        if len(chosen) < FEWEST:
            continue
        # lines and edges that are no noise
        chosen = chosen[np.abs(chosen) < 1 + 6 * np.median(np.abs(chosen))]
        variance = (chosen**2).mean() / LESS_NEIGHBOURS - ROUNDING
        rows.append(((low + CLASS / 2) / WHITE, max(variance, 1e-3) / WHITE**2, len(chosen)))
    return np.array(rows)


def misfit(levels: np.ndarray, gamma: float, kinds: tuple[int, ...]) -> float:
    """Return chi² for each class if grey values are light to the power of 1 / gamma, and noise is of some kinds."""
    grey, variance, count = levels.T
    light = grey**gamma
    slope = gamma * grey ** (gamma - 1)
    sigma = np.hypot(np.sqrt(2 / count), MISFIT)
    design = np.stack([light, np.ones_like(light)], axis=1)[:, kinds]
    _, rest = nnls(design / (variance * slope**2 * sigma)[:, None], 1 / sigma)
    return rest**2 / len(levels)


def text_of(images: list[np.ndarray]) -> str:
    """Return the gamma that fits best with each kind of noise."""
    levels = np.concatenate([noise_levels(image) for image in images])
    cells = []
    for kinds in KINDS.values():
        fits = [misfit(levels, gamma, kinds) for gamma in GAMMAS]
        best = int(np.argmin(fits))
        cells.append(f"{GAMMAS[best]:8.2f}{fits[best]:8.1f}")
    return "".join(cells)


def as_jpeg(image: np.ndarray) -> np.ndarray:
    """Return an image as a JPEG file of quality 90 has it."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=90)
    return np.array(Image.open(file))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of real_images, with the light of sharp parts")
    parser.add_argument("--materials", nargs="+", default=["matt", "blasted"])
    parser.add_argument("--responses", nargs="+", default=["linear", "1.8", "2.2", "srgb"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    options = parser.parse_args()
    bench = Bench(options.folder, None, 0)
    print(f"{'images':<28}" + "".join(f"{kind:>8}{'chi2':>8}" for kind in KINDS))
    for material, seed, response in itertools.product(
        options.materials, options.seeds, options.responses
    ):
        condition = Condition("sharp", material, "ring", response, 8, "nothing")
        rng = np.random.default_rng([seed, 2])
        images = [
            taken(light, scale, response, 8, rng)
            for light, scale in bench.light(condition, seed).values()
        ]
        name = f"{material} {seed} {response}"
        print(f"{name:<28}{text_of(images)}", flush=True)
        print(f"{name + ', JPEG':<28}{text_of([as_jpeg(image) for image in images])}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

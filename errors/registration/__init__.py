"""Registration: a camera's pose and the deviations of a part's surfaces, estimated together, with their covariance.

Algebra without images. Rows say how far points were found off their prediction and how unknowns move them; a normal
prior says what is known of the unknowns beforehand.
"""

from errors.registration.known_poses import Imaging, KnownPoses, Stretches, Values, known_poses
from errors.registration.posterior import (
    Posterior,
    Rows,
    bias_variance_of,
    posterior,
    rests_on_prior,
    surprise,
    undetermined,
)

__all__ = [
    "Imaging",
    "KnownPoses",
    "Posterior",
    "Rows",
    "Stretches",
    "Values",
    "bias_variance_of",
    "known_poses",
    "posterior",
    "rests_on_prior",
    "surprise",
    "undetermined",
]

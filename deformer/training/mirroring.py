"""Mirror images of example shapes: a symmetric body can do with its left what its right does."""

from __future__ import annotations

import numpy as np

from deformer.acap import FeatureExtractor, MirrorMap, PoissonSystem
from deformer.geometry import FloatArray, IntArray, ShapeSequence, Symmetry, most_symmetric

# Number of evenly spread shapes, of which the most symmetric one is chosen.
_SYMMETRY_CANDIDATES = 16
# The trial of mirror images: number of evenly spread examples, the share by which images must lower
# the residual of ridge regression, and the ridge as a share of the mean squared length.
_TRIAL_EXAMPLES = 64
_LEAST_GAIN = 0.1
_RIDGE = 0.01


def find_mirror(shapes: ShapeSequence) -> tuple[MirrorMap, Symmetry]:
    """The map of shapes to mirror images, in the same connectivity, and its plane.

    Args:
        shapes: N shapes. The most symmetric of some of them is the one that deformations are
            mirrored against.
    """
    candidates = _evenly_spread(len(shapes), _SYMMETRY_CANDIDATES)
    plane, n = most_symmetric([shapes.mesh(candidate) for candidate in candidates])
    rest = shapes.mesh(candidates[n])
    return MirrorMap(FeatureExtractor(rest), PoissonSystem(rest), plane), plane


def trial_examples(count: int) -> list[int]:
    """Indices of the examples that tell whether images explain all `count` of them."""
    return _evenly_spread(count, _TRIAL_EXAMPLES)


def images_explain(products: FloatArray) -> bool:
    """True if mirror images explain examples better than the other examples alone.

    Ridge regression predicts each example from all others, without and with the images (its own
    image is left out, too). If body or motion are not symmetric, images are of no more use than
    noise, and the residual does not shrink.

    Args:
        products: (2n, 2n) inner products of scaled features: of n examples, then of their images.
    """
    n = len(products) // 2
    own = np.tile(np.arange(n), 2)
    without = leave_one_out_residual(products[:n, :n], own[:n])
    both = leave_one_out_residual(products, own)
    return bool(both < (1.0 - _LEAST_GAIN) * without)


def leave_one_out_residual(products: FloatArray, own: IntArray) -> float:
    """Squared residual of examples after ridge regression on the rows of a basis, summed.

    The regression of an example leaves out the basis rows that belong to it.

    Args:
        products: (b, b) inner products of the basis' rows, of which the first n are the examples.
        own: (b,) index, below n, of the example that each row belongs to.
    """
    G, total = products, 0.0
    for n in range(own.max() + 1):
        k = np.flatnonzero(own != n)
        # About the mean of the rows in k, by inner products alone.
        centred = G[np.ix_(k, k)]
        means, mean = centred.mean(axis=0), centred.mean()
        centred = centred - means - means[:, None] + mean
        cross = G[n, k] - means - G[n, k].mean() + mean
        length = G[n, n] - 2.0 * G[n, k].mean() + mean
        ridge = _RIDGE * np.trace(centred) / len(k)
        weights = np.linalg.solve(centred + max(ridge, 1e-12) * np.eye(len(k)), cross)
        total += float(length - 2.0 * weights @ cross + weights @ centred @ weights)
    return total


def _evenly_spread(count: int, most: int) -> list[int]:
    """At most `most` of the indices below `count`, evenly spread."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist()

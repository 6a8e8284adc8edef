"""How far latent codes are from a model's examples, measured by how far unseen examples are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import LARGEST, checked_array, checked_instance
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Frames are neighbours in time as long as they are nearer to each other, in the median, than this
# share of the distance of any two examples; no more than the second share of all are left out.
_ALIKE, _LARGEST_BLOCK = 0.9, 0.1
# Examples nearer to each other than this share of the farthest one's distance are one shape.
_SAME = 1e-6


class Familiarity:
    """Distances of latent codes from the training codes, as percentiles of unseen examples.

    Distances are Mahalanobis distances by the prior's covariance, to the nearest training code.
    Each training code in turn is left out, with its neighbours in time, and is then as far from the
    rest as an unseen example: frames of a slow sequence are close to their neighbours, which says
    nothing about new poses. Neighbours are found by how fast the examples, in their order, lose
    their likeness; shapes in no order have none.

    Args:
        model: the prior with its training codes.

    Attributes:
        window: how many codes before and after one count as its neighbours in time.
        left_out: (N,) distances of the training codes left out, ascending.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Measure the distances among the training codes."""
        checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
        self._factor = model.prior.factor
        self._codes = self._whitened(model.codes)
        N, K = self._codes.shape
        order = _order(model.split.get("train", []), N)
        codes = self._codes[order]
        self.window = _window(codes)
        found = [_left_out(codes, n, self.window) for n in range(N)] if N > 1 else []
        # One code alone tells nothing; two draws from the prior are so far apart.
        self.left_out: FloatArray = np.sort(found or [np.sqrt(2.0 * K)])
        if not self.left_out[-1]:
            self.left_out = np.array([np.sqrt(2.0 * K)])
        self._unit = float(np.quantile(self.left_out, 0.95)) or float(self.left_out[-1])

    def percentile(self, z: ArrayLike) -> float:
        """How far off a latent code is, in per cent of the unseen examples.

        Args:
            z: (K,) latent code.

        Returns:
            Up to 100, the share of the examples left out that are nearer to the others than z is to
            all. Beyond, z is farther off than any of them: 100 times its distance over theirs.

        Raises:
            InputError: no code of the model.
        """
        _, distance = self._nearest(z)
        known, N = self.left_out, len(self.left_out)
        farthest = float(known[-1])
        if distance > farthest:
            return 100.0 * distance / farthest
        # Examples that are given twice are no reason to call a third one far.
        share, apart = np.arange(1, N + 1) / N, known > _SAME * farthest
        known, share = np.append(0.0, known[apart]), np.append(0.0, share[apart])
        return 100.0 * float(np.interp(distance, known, share))

    def nearest(self, z: ArrayLike) -> tuple[int, float]:
        """Row in `codes` of the training code nearest to a latent code z (K,), and its distance.

        The unit is the distance within which 95 % of the examples left out are.
        """
        row, distance = self._nearest(z)
        return row, distance / self._unit

    def _nearest(self, z: ArrayLike) -> tuple[int, float]:
        code = checked_array(z, "z", (len(self._factor),), largest=LARGEST)
        distances = np.linalg.norm(self._codes - self._whitened(code[None]), axis=1)
        row = int(distances.argmin())
        return row, float(distances[row])

    def _whitened(self, codes: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(self._factor, codes.T).T, dtype=np.float64)


def _order(train: list[int], count: int) -> IntArray:
    """Rows of the training codes in the order of the shapes they were trained from."""
    if len(train) != count:
        return np.arange(count)
    return np.argsort(np.array(train), kind="stable")


def _window(codes: FloatArray) -> int:
    """How many codes (N, K) before and after one are like it because they are near in time."""
    N = len(codes)
    largest = int(_LARGEST_BLOCK * N)
    if not largest:
        return 0
    rng = np.random.default_rng(0)
    a, b = rng.integers(N, size=(2, 2000))
    usual = np.median(np.linalg.norm(codes[a] - codes[b], axis=1)[a != b])
    for lag in range(1, largest + 1):
        apart = np.linalg.norm(codes[lag:] - codes[:-lag], axis=1)
        if np.median(apart) >= _ALIKE * usual:
            return lag - 1
    return largest


def _left_out(codes: FloatArray, n: int, window: int) -> float:
    """Distance of code n from the nearest of those that are not its neighbours in time."""
    distances = np.linalg.norm(codes - codes[n], axis=1)
    distances[max(0, n - window) : n + window + 1] = np.inf
    return float(distances.min())

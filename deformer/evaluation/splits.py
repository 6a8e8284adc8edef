"""Splits of a data set into training shapes and test shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.errors import InputError

# Of so many consecutive frames one is a training shape, as in Tan et al. 2018.
FRAMES_A_BLOCK = 10


@dataclass(frozen=True)
class Split:
    """Indices of training and test shapes, in increasing order.

    The first training shape is the reference.

    Raises:
        InputError: fewer than 2 training shapes, no test shape, or a shape in both.
    """

    train: tuple[int, ...]
    test: tuple[int, ...]

    def __post_init__(self) -> None:
        """Check both lists and sort them."""
        both = sorted(set(self.train) & set(self.test))
        if both:
            raise InputError(f"split: shape {both[0]} is to train and to test on; take it out once")
        if len(self.train) < 2 or not self.test:
            raise InputError(
                f"split: got {len(self.train)} shapes to train and {len(self.test)} to test on, "
                "expected at least 2 and 1; give more shapes or a split file"
            )
        object.__setattr__(self, "train", tuple(sorted(self.train)))
        object.__setattr__(self, "test", tuple(sorted(self.test)))


def random_split(count: int, seed: int) -> Split:
    """Train on a random half, rounded up: 36 of 71 (Tan et al. 2018, split of SCAPE)."""
    order = np.random.default_rng(seed).permutation(count).tolist()
    half = (count + 1) // 2
    return Split(tuple(order[:half]), tuple(order[half:]))


def sequence_split(count: int, seed: int) -> Split:
    """Train on one random frame of every ten (Tan et al. 2018, split of sequences)."""
    rng = np.random.default_rng(seed)
    starts = range(0, count, FRAMES_A_BLOCK)
    train = {int(rng.integers(start, min(start + FRAMES_A_BLOCK, count))) for start in starts}
    return Split(tuple(train), tuple(set(range(count)) - train))


def limit_test_shapes(test: tuple[int, ...], limit: int | None, ordered: bool) -> tuple[int, ...]:
    """At most `limit` of the test shapes: spread evenly, or the middle ones of a sequence.

    The frames of a sequence stay consecutive, because STED compares motions.
    """
    if limit is None or limit >= len(test):
        return test
    if ordered:
        start = (len(test) - limit) // 2
        return test[start : start + limit]
    picked = np.linspace(0, len(test) - 1, limit).round().astype(int)
    return tuple(test[i] for i in picked)

"""Which shapes a method may see, and which it is measured on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.errors import InputError

# Frames of a sequence of which one is trained on, as in the paper.
FRAMES_A_BLOCK = 10


@dataclass(frozen=True)
class Split:
    """Indices of shapes, in increasing order; the first to train on is the reference."""

    train: tuple[int, ...]
    test: tuple[int, ...]

    def __post_init__(self) -> None:
        """Check that there is something to learn from and to measure, and no shape is both."""
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
    """A random half to train on, the larger one: 36 of 71 (Tan et al. 2018, split of SCAPE)."""
    order = np.random.default_rng(seed).permutation(count).tolist()
    half = (count + 1) // 2
    return Split(tuple(order[:half]), tuple(order[half:]))


def sequence_split(count: int, seed: int) -> Split:
    """One frame drawn from every ten to train on (Tan et al. 2018, split of sequences)."""
    rng = np.random.default_rng(seed)
    starts = range(0, count, FRAMES_A_BLOCK)
    train = {int(rng.integers(start, min(start + FRAMES_A_BLOCK, count))) for start in starts}
    return Split(tuple(train), tuple(set(range(count)) - train))


def limited(test: tuple[int, ...], limit: int | None, ordered: bool) -> tuple[int, ...]:
    """At most `limit` of the test shapes: spread evenly, or of a sequence the ones in its middle.

    Frames that follow each other stay so, because STED compares motions.
    """
    if limit is None or limit >= len(test):
        return test
    if ordered:
        start = (len(test) - limit) // 2
        return test[start : start + limit]
    picked = np.linspace(0, len(test) - 1, limit).round().astype(int)
    return tuple(test[i] for i in picked)

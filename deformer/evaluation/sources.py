"""The data of an evaluation: data sets on disk, split, aligned and, on request, noisy.

Nothing here lets a test shape reach what is trained on: the reference is a training shape, and
each shape is aligned to it on its own.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from deformer.evaluation.splits import Split
from deformer.geometry import (
    FloatArray,
    Geodesics,
    IntArray,
    Mesh,
    MeshSequence,
    align,
    farthest_points,
)
from deformer.io import load_shapes


@dataclass(frozen=True)
class Source:
    """A data set on disk and how to read it.

    Args:
        name: its name in rows and tables.
        path: what `load_shapes` reads.
        count: number of shapes.
        fingerprint: of their vertices and faces; a changed file is another data set.
        ordered: the shapes are frames in order of time.
        align: remove each shape's rigid motion against the reference first.
        up: axis that points up in pictures.
    """

    name: str
    path: str
    count: int
    fingerprint: str
    ordered: bool = False
    align: bool = False
    up: str = "y"

    @classmethod
    def at(
        cls, name: str, path: str, *, ordered: bool = False, align: bool = False, up: str = "y"
    ) -> Source:
        """The data set at `path`; reads it once.

        Raises:
            InputError: it cannot be read.
        """
        shapes = _load(path)
        digest = hashlib.sha256(np.ascontiguousarray(shapes.vertices).tobytes())
        digest.update(np.ascontiguousarray(shapes.faces).tobytes())
        return cls(name, path, len(shapes), digest.hexdigest()[:16], ordered, align, up)


@dataclass(frozen=True, eq=False)
class SplitData:
    """A split data set.

    Args:
        train: shapes to learn from; shape 0 is the reference.
        reference: the same shape without the noise that `train` may have.
        test: (N, V, 3) shapes to measure on.
    """

    train: MeshSequence
    reference: Mesh
    test: FloatArray

    @cached_property
    def _geodesics(self) -> Geodesics:
        return Geodesics(self.reference)

    def control_vertices(self, count: int, seed: int) -> IntArray:
        """Voronoi sampling of the reference: the first drawn with `seed`, then farthest points."""
        return farthest_points(self._geodesics, count, seed)


def load_split(
    source: Source, split: Split, test: tuple[int, ...], noise: float = 0.0, seed: int = 0
) -> SplitData:
    """Load, split and align a data set.

    Args:
        source: the data set.
        split: which shapes to train on.
        test: shapes to measure on, some or all of the split's.
        noise: standard deviation of what is added to every coordinate of the training shapes, in
            bounding diagonals of the reference.
        seed: of the noise.
    """
    shapes = _load(source.path)
    train, held_out = shapes.subset(split.train), shapes.vertices[list(test)]
    reference = train.mesh(0)
    if source.align:
        train = MeshSequence(align(train.vertices, reference.vertices), shapes.faces)
        held_out = align(held_out, reference.vertices)
    if noise:
        spread = noise * reference.bounding_diagonal
        added = np.random.default_rng(seed).normal(scale=spread, size=train.vertices.shape)
        train = MeshSequence(train.vertices + added, shapes.faces)
    return SplitData(train, reference, held_out)


@lru_cache(maxsize=2)
def _load(path: str) -> MeshSequence:
    return load_shapes(path)

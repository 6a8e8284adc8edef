"""Data sets of an evaluation: read from disk, split, aligned and, on request, made noisy.

Training data never depend on a test shape: the reference is a training shape, and each shape is
aligned to it separately.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
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
    Seams,
    align,
    farthest_points,
    find_seams,
)
from deformer.io import load_shapes


@dataclass(frozen=True)
class Source:
    """A data set on disk and how to read it.

    Args:
        name: its name in rows and tables.
        path: file or directory that `load_shapes` reads.
        count: number of shapes.
        vertices: number of vertices of the surface without seams (`geometry.Seams`), on which all
            methods are measured.
        file_vertices: number of vertices of its files.
        fingerprint: hash of vertices and faces; a changed file is another data set.
        ordered: true when the shapes are frames in order of time.
        align: true to remove each shape's rigid motion against the reference.
        up: axis that points up in pictures.
    """

    name: str
    path: str
    count: int
    vertices: int
    file_vertices: int
    fingerprint: str
    ordered: bool = False
    align: bool = False
    up: str = "y"

    @classmethod
    def at(
        cls, name: str, path: str, *, ordered: bool = False, align: bool = False, up: str = "y"
    ) -> Source:
        """The data set at `path`, which is read for its fingerprint.

        Raises:
            InputError: the data set cannot be read.
        """
        shapes, seams = _load(path)
        digest = hashlib.sha256(np.ascontiguousarray(shapes.vertices).tobytes())
        digest.update(np.ascontiguousarray(shapes.faces).tobytes())
        V, digits = shapes.vertices.shape[1], digest.hexdigest()[:16]
        return cls(name, path, len(shapes), V, len(seams.closed), digits, ordered, align, up)

    def closed_vertices(self, vertices: Sequence[int]) -> tuple[int, ...]:
        """Vertices of the surface without seams, each once, from vertices of the files."""
        closed = _load(self.path)[1].closed[list(vertices)]
        return tuple(dict.fromkeys(closed.tolist()))


@dataclass(frozen=True, eq=False)
class SplitData:
    """A split data set.

    Args:
        train: training shapes; shape 0 is the reference.
        reference: the reference without the noise that `train` may have.
        test: (N, V, 3) test shapes.
    """

    train: MeshSequence
    reference: Mesh
    test: FloatArray

    @cached_property
    def _geodesics(self) -> Geodesics:
        return Geodesics(self.reference)

    def control_vertices(self, count: int, seed: int) -> IntArray:
        """Control vertices (count,) int64: the first drawn with `seed`, then farthest points.

        Voronoi sampling of the reference, as in Tan et al. 2018.
        """
        return farthest_points(self._geodesics, count, seed)


def load_split(
    source: Source, split: Split, test: tuple[int, ...], noise: float = 0.0, seed: int = 0
) -> SplitData:
    """Load, split and align a data set.

    Args:
        source: the data set.
        split: indices of training and test shapes.
        test: indices of the test shapes to use, some or all of the split's.
        noise: standard deviation of the Gaussian noise added to every coordinate of the training
            shapes, in bounding diagonals of the reference.
        seed: seed of the noise.

    Raises:
        InputError: the data set cannot be read.
    """
    shapes, _ = _load(source.path)
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
def _load(path: str) -> tuple[MeshSequence, Seams]:
    """Shapes without seams, and the seams of the files."""
    shapes = load_shapes(path)
    seams = find_seams(shapes.vertices)
    return seams.close_shapes(shapes), seams

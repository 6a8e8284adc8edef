"""Data sets of an evaluation: read from disk, split, aligned and, on request, made noisy.

Training data never depend on a test shape: the reference is a training shape, and each shape is
aligned to it separately.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
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
from deformer.io import load_shapes, with_reference


@dataclass(frozen=True)
class Reading:
    """Options of reading shapes.

    Args:
        fps: as of `load_shapes`.
        clip: as of `load_shapes`.
        reference: as of `io.with_reference`; None for none.
    """

    fps: float | None = None
    clip: str | None = None
    reference: str | None = None


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
        reading: what the path is read with.
        reference: index of the undeformed shape, on which every split trains; None is the first
            training shape.
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
    reading: Reading = field(default_factory=Reading)
    reference: int | None = None

    @classmethod
    def at(
        cls,
        name: str,
        path: str,
        *,
        ordered: bool = False,
        align: bool = False,
        up: str = "y",
        reading: Reading | None = None,
    ) -> Source:
        """The data set at `path`, which is read for its fingerprint.

        Raises:
            InputError: the data set cannot be read, or has no such reference.
        """
        reading = Reading() if reading is None else reading
        shapes, seams, reference = _load(path, reading)
        digest = hashlib.sha256(np.ascontiguousarray(shapes.vertices).tobytes())
        digest.update(np.ascontiguousarray(shapes.faces).tobytes())
        if reference is not None:
            digest.update(f"reference {reference}".encode())
        V, digits = shapes.vertices.shape[1], digest.hexdigest()[:16]
        return cls(
            name, path, len(shapes), V, len(seams.closed), digits, ordered, align, up, reading,
            reference,
        )  # fmt: skip

    def with_reference(self, split: Split) -> Split:
        """A split that trains on the reference, wherever it was."""
        if self.reference is None or self.reference in split.train:
            return split
        test = tuple(n for n in split.test if n != self.reference)
        return Split((self.reference, *split.train), test)

    def closed_vertices(self, vertices: Sequence[int]) -> tuple[int, ...]:
        """Vertices of the surface without seams, each once, from vertices of the files."""
        closed = _load(self.path, self.reading)[1].closed[list(vertices)]
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
    shapes, reference_index = load_source(source)
    order = list(split.train)
    if reference_index is not None:
        order = [reference_index, *(n for n in order if n != reference_index)]
    train, held_out = shapes.subset(order), shapes.vertices[list(test)]
    reference = train.mesh(0)
    if source.align:
        train = MeshSequence(align(train.vertices, reference.vertices), shapes.faces)
        held_out = align(held_out, reference.vertices)
    if noise:
        spread = noise * reference.bounding_diagonal
        added = np.random.default_rng(seed).normal(scale=spread, size=train.vertices.shape)
        train = MeshSequence(train.vertices + added, shapes.faces)
    return SplitData(train, reference, held_out)


def load_source(source: Source) -> tuple[MeshSequence, int | None]:
    """All shapes of a data set, without seams, and the index of the reference that it names.

    Raises:
        InputError: the data set cannot be read.
    """
    shapes, _, reference = _load(source.path, source.reading)
    return shapes, reference


@lru_cache(maxsize=2)
def _load(path: str, reading: Reading) -> tuple[MeshSequence, Seams, int | None]:
    """Shapes without seams, the seams of the files, and the index of the reference."""
    shapes, reference = load_shapes(path, fps=reading.fps, clip=reading.clip), None
    if reading.reference is not None:
        shapes, reference = with_reference(shapes, reading.reference)
    seams = find_seams(shapes.vertices)
    return seams.close_shapes(shapes), seams, reference

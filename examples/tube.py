"""Example shapes without files: a tube that bends and twists."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import Mesh, MeshSequence

LENGTH = 2.0


def tube(around: int = 24, rings: int = 60, width: float = 0.5, height: float = 0.25) -> Mesh:
    """A tube of oval cross-section along x, with V = around · rings vertices."""
    turn = 2 * np.pi * np.arange(around) / around
    x, turn = np.meshgrid(np.linspace(0, LENGTH, rings), turn, indexing="ij")
    vertices = np.stack([x, 0.5 * height * np.cos(turn), 0.5 * width * np.sin(turn)], -1)
    faces = []
    for i in range(rings - 1):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            faces += [[a, a + around, b], [b, a + around, b + around]]
    return Mesh(vertices.reshape(-1, 3), np.array(faces))


def twisted_and_bent(vertices: ArrayLike, twist: float, bend: float) -> NDArray:
    """Vertices (V, 3) twisted about x, then bent in the x-y plane, by angles in radians."""
    x, y, z = np.asarray(vertices).T
    c, s = np.cos(twist * x / LENGTH), np.sin(twist * x / LENGTH)
    y, z = c * y - s * z, s * y + c * z
    k = bend / LENGTH or 1e-12
    return np.stack(
        [(1 / k - y) * np.sin(k * x), (1 - np.cos(k * x)) / k + y * np.cos(k * x), z], -1
    )


def shapes(count: int, seed: int, around: int = 24, rings: int = 60) -> MeshSequence:
    """The tube at rest, then `count` − 1 tubes with random angles of up to 2 radians."""
    base = tube(around, rings)
    angles = np.random.default_rng(seed).uniform(-2, 2, (count, 2))
    angles[0] = 0
    return MeshSequence(
        np.stack([twisted_and_bent(base.vertices, *pair) for pair in angles]), base.faces
    )

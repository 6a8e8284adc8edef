"""Example shapes that need no files: a square bar that bends and twists."""

import numpy as np

from deformer import MeshSequence


def bar_mesh(rings=14, side=4):
    """A closed upright bar of height 1: vertices (V, 3) and faces (F, 3)."""
    t = np.arange(side) / side
    square = np.concatenate(
        [
            np.stack([t, 0 * t], 1),
            np.stack([1 + 0 * t, t], 1),
            np.stack([1 - t, 1 + 0 * t], 1),
            np.stack([0 * t, 1 - t], 1),
        ]
    )
    around = len(square)
    square = 0.2 * (square - 0.5)
    heights = np.linspace(0, 1, rings)
    walls = [np.insert(square, 1, height, axis=1) for height in heights]
    vertices = np.concatenate([*walls, [[0, 0, 0], [0, 1, 0]]])
    faces = []
    for ring in range(rings - 1):
        for i in range(around):
            a, b = ring * around + i, ring * around + (i + 1) % around
            faces += [[a, a + around, b], [b, a + around, b + around]]
    bottom, top = rings * around, rings * around + 1
    for i in range(around):
        j = (i + 1) % around
        faces += [[bottom, i, j], [top, top - 2 - i, top - 2 - j]]
    return vertices, np.array(faces)


def bend(vertices, angle, twist=0.0):
    """Bend the bar by `angle` in the plane of x and y, after twisting its top by `twist`."""
    x, y, z = vertices.T
    c, s = np.cos(twist * y), np.sin(twist * y)
    x, z = c * x + s * z, c * z - s * x
    if abs(angle) < 1e-9:
        return np.stack([x, y, z], axis=1)
    radius, turn = 1 / angle, angle * y
    return np.stack([radius - (radius - x) * np.cos(turn), (radius - x) * np.sin(turn), z], axis=1)


def bending_bar(count=12, rings=14, side=4):
    """A sequence of `count` shapes; shape 0 is straight."""
    vertices, faces = bar_mesh(rings, side)
    angles = 1.2 * np.sin(2 * np.pi * np.arange(count) / count)
    twists = 0.8 * np.sin(4 * np.pi * np.arange(count) / count)
    poses = [bend(vertices, a, t) for a, t in zip(angles, twists, strict=True)]
    return MeshSequence(np.stack(poses), faces)

"""Rigs that are made by hand, without a model."""

import numpy as np

import deformer


def two_bones(mesh):
    """A rig of two bones along x, and a clip of three poses that turn, bend and move the mesh."""
    x = mesh.vertices[:, 0]
    share = np.clip((x - x.min()) / np.ptp(x), 0, 1)
    middle, length = mesh.vertices.mean(axis=0), np.ptp(x)
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[:, :3, 3] = middle, middle + 0.3 * length * np.eye(3)[0]
    clip = np.tile(rest, (3, 1, 1, 1))
    for n in range(3):
        for b, angle in enumerate((0.2 * n, 0.7 * n)):
            c, s = np.cos(angle), np.sin(angle)
            clip[n, b, :3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        clip[n, :, :3, 3] += 0.1 * n * length
    weights, parents = np.stack([1 - share, share], axis=1), np.array([-1, 0])
    return deformer.Rig(mesh, weights, ("near", "far"), parents, rest, clip, 0.0, 0.0)

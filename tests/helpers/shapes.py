"""Meshes and smooth deformations that need no files; every builder returns a `Mesh`.

Tubes and strips lie along x, so that bends and twists along x are easy to write down.
"""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np

from deformer.geometry.mesh import Mesh, MeshSequence
from deformer.geometry.rotations import log_to_rotation
from deformer.model.model import DeformationModel
from deformer.model.storage import load_model
from deformer.network.config import PRESETS
from deformer.training.trainer import train
from paths import ROOT


def _grid_faces(rows, columns, closed=False):
    """Two triangles a cell of a grid of vertices numbered row by row."""
    faces = []
    for i in range(rows - 1):
        for j in range(columns if closed else columns - 1):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            c, d = a + columns, b + columns
            faces += [[a, c, b], [b, c, d]]
    return np.array(faces)


def strip(rows=31, columns=5, length=3.0, width=0.4):
    """A flat strip in the plane z = 0, from x = 0 to `length`."""
    x, y = np.meshgrid(
        np.linspace(0, length, rows), np.linspace(-width / 2, width / 2, columns), indexing="ij"
    )
    vertices = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    return Mesh(vertices, _grid_faces(rows, columns))


def tube(around=8, rings=15, radius=0.25, length=2.0):
    """An open tube about the x axis, from x = 0 to `length`."""
    t = 2 * np.pi * np.arange(around) / around
    x, t = np.meshgrid(np.linspace(0, length, rings), t, indexing="ij")
    vertices = np.stack([x, radius * np.cos(t), radius * np.sin(t)], -1).reshape(-1, 3)
    return Mesh(vertices, _grid_faces(rings, around, closed=True))


def icosphere(subdivisions=2, radius=1.0):
    """A closed sphere about the origin: 10·4ⁿ + 2 vertices."""
    g = (1 + 5**0.5) / 2
    corners = [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g]]
    corners += [[0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]]
    f = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4]]
    f += [[11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8]]
    f += [[3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    v, f = np.array(corners, dtype=float), np.array(f)
    for _ in range(subdivisions):
        half = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        pairs, where = np.unique(half, axis=0, return_inverse=True)
        mid = len(v) + where.reshape(-1, 3)
        v = np.concatenate([v, v[pairs].mean(axis=1)])
        a, b, c = f.T
        ab, bc, ca = mid.T
        f = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), mid.T)])
    return Mesh(radius * v / np.linalg.norm(v, axis=1, keepdims=True), f)


def join(*meshes):
    """Several meshes as one, not connected to each other."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.faces + start for m, start in zip(meshes, starts[:-1], strict=True)]),
    )


def two_components():
    """A tube and, beside it, a ball of a different size."""
    ball = icosphere(1, 0.3)
    return join(tube(), Mesh(ball.vertices + np.array([1.0, 1.0, 0.0]), ball.faces))


def awkward():
    """What real files hold: a sliver, an obtuse fan, coincident vertices, an isolated vertex.

    The tube's vertex 20 sits on top of its neighbour 21 and vertex 45 almost in the middle of an
    edge; a flat fan with a very obtuse triangle and a vertex without a face stand apart.
    """
    base = tube()
    v = base.vertices.copy()
    v[20] = v[21]
    v[45] = 0.5 * (v[44] + v[46]) + [0, 1e-7, 0]
    fan = np.array([[0, 0, 1], [1, 0, 1], [0.5, 0.02, 1], [0.5, -1, 1], [2, 0.01, 1]])
    start = len(v)
    faces = np.array([[0, 1, 2], [1, 0, 3], [1, 4, 2]]) + start
    return Mesh(np.concatenate([v, fan, [[0.3, 0.4, 3.0]]]), np.concatenate([base.faces, faces]))


def bend(vertices, angle, length=2.0):
    """Points bent in the plane of x and y: the section at x turns by angle · x / length."""
    x, y, z = np.asarray(vertices).T
    curvature = angle / length
    if abs(curvature) < 1e-12:
        return np.stack([x, y, z], -1)
    t = curvature * x
    return np.stack(
        [(1 / curvature - y) * np.sin(t), 1 / curvature * (1 - np.cos(t)) + y * np.cos(t), z], -1
    )


def twist(vertices, angle, length=2.0):
    """Points turned about the x axis by angle · x / length."""
    x, y, z = np.asarray(vertices).T
    c, s = np.cos(angle * x / length), np.sin(angle * x / length)
    return np.stack([x, c * y - s * z, s * y + c * z], -1)


def spiral(vertices, turns, length, tightening=0.5):
    """A flat strip rolled up without stretch: an exact isometry of the plane z = 0.

    The direction of the strip turns by 2π · turns over its length, its curvature rising linearly
    from (1 − tightening) to (1 + tightening) times the mean.
    """
    x, y, _ = np.asarray(vertices).T
    total = 2 * np.pi * turns

    def angle(s):
        u = s / length
        return total * ((1 - tightening) * u + tightening * u**2)

    # ∫ (cos, sin) of the angle by Gauss–Legendre on pieces much shorter than a turn.
    nodes, weights = np.polynomial.legendre.leggauss(8)
    pieces = 16 * int(np.ceil(turns))
    start = x[:, None] * np.arange(pieces) / pieces
    step = (x / pieces)[:, None, None]
    s = start[:, :, None] + 0.5 * step * (nodes + 1)
    place = (0.5 * step * weights * np.exp(1j * angle(s))).sum(axis=(1, 2))
    return np.stack([place.real, y, place.imag], -1)


def random_rotation(rng, angle=None):
    """A rotation (3, 3) about a random axis by `angle`, or by a random one up to π."""
    axis = rng.normal(size=3)
    angle = rng.uniform(0, np.pi) if angle is None else angle
    return log_to_rotation(axis * (angle / np.linalg.norm(axis)))


def sequence(count=12, around=8, rings=15):
    """A tube that bends and twists; shape 0 is straight. V = around · rings."""
    base = tube(around, rings)
    phase = 2 * np.pi * np.arange(count) / count
    poses = [bend(twist(base.vertices, 0.8 * np.sin(2 * p)), 1.2 * np.sin(p)) for p in phase]
    return MeshSequence(np.stack(poses), base.faces)


def pieces(count=12):
    """`sequence` with a ball that slides and turns beside it, and a vertex without a face.

    Nothing of the tube's own deformation says where the ball is. The vertex stays half a unit above
    the tube's first one.
    """
    tubes = sequence(count)
    ball = icosphere(1, 0.3)
    phase = 2 * np.pi * np.arange(count) / count
    turns = [random_rotation(np.random.default_rng(n), 0.5) for n in range(count)]
    balls = [
        ball.vertices @ turn.T + [1.0 + 0.4 * np.cos(3 * p), 1.0, 0.5 * np.sin(2 * p)]
        for turn, p in zip([np.eye(3), *turns[1:]], phase, strict=True)
    ]
    start = tubes.vertices.shape[1]
    points = tubes.vertices[:, :1] + [0.0, 0.0, 0.5]
    vertices = np.concatenate([tubes.vertices, np.stack(balls), points], axis=1)
    return MeshSequence(vertices, np.concatenate([tubes.faces, ball.faces + start]))


SMALL_MODEL = ROOT / "tests" / "data" / "tube-model"


def _trained(shapes, epochs) -> DeformationModel:
    with warnings.catch_warnings():  # of torch, once a process, at the first sparse product
        warnings.simplefilter("ignore")
        # These few clean shapes would ask for components less sparse, and handles much firmer,
        # than most sets do, or for less trust in the codes.
        config = replace(PRESETS["default"], components=6)
        config = config.with_training(epochs=epochs, sparsity=2.0)
        return replace(
            train(shapes, config=config, device="cpu"),
            handle_noise=0.007,
            handle_misfits=(0.0, 0.0),
        )


def train_small_model() -> DeformationModel:
    """Train what `small_model` loads."""
    return _trained(sequence(), 600)


@cache
def small_model() -> DeformationModel:
    """A model of `sequence()` with 6 components.

    It is read from a file: trained on another processor, which rounds differently, it would be
    another model, with other poses far from its examples. In this folder, this makes it anew:
    `python -c "import shapes; shapes.train_small_model().save(shapes.SMALL_MODEL)"`.
    """
    return load_model(SMALL_MODEL)


@cache
def large_model() -> DeformationModel:
    """The same of 1,440 vertices: more than the solver looks at while it searches."""
    return _trained(sequence(12, 24, 60), 120)


@cache
def pieces_model() -> DeformationModel:
    """A model of `pieces()` with 50 components, trained once for all tests (seconds)."""
    config = replace(PRESETS["default"], components=50).with_training(epochs=60, sparsity=0.02)
    return train(pieces(), config=config, device="cpu")


# One of each kind of mesh that every operator must hold on.
MESHES = {
    "tube": tube(),
    "strip": strip(),
    "sphere": icosphere(2),
    "components": two_components(),
    "awkward": awkward(),
}

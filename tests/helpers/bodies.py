"""A closed body without symmetry that bends, for tests of what goes wrong with sets of shapes."""

import numpy as np

from deformer import MeshSequence


def body(rows=12, columns=14):
    """A lumpy ellipsoid: vertices (V, 3) and faces (F, 3), counter-clockwise from outside."""
    polar = np.linspace(0, np.pi, rows + 2)[1:-1]
    around = np.arange(columns) * 2 * np.pi / columns
    t, a = (x.ravel() for x in np.meshgrid(polar, around, indexing="ij"))
    radius = 1 + 0.25 * np.sin(t) ** 2 * np.cos(a - 1) + 0.15 * np.cos(3 * t)
    ring = np.column_stack([np.sin(t) * np.cos(a), 2.5 * np.cos(t), 0.7 * np.sin(t) * np.sin(a)])
    vertices = np.vstack([radius[:, None] * ring, [0, 2.9, 0], [0, -2.2, 0]])
    top, bottom = len(ring), len(ring) + 1
    faces = []
    for j in range(columns):
        k = (j + 1) % columns
        faces += [[top, k, j], [bottom, len(ring) - columns + j, len(ring) - columns + k]]
        for i in range(rows - 1):
            one, two = i * columns, (i + 1) * columns
            faces += [[one + j, one + k, two + j], [one + k, two + k, two + j]]
    return vertices, np.array(faces)


def bending(count=8, most=1.2):
    """The body bent about z in steps, up to `most` radians at its ends, and back a little."""
    vertices, faces = body()
    shapes = []
    for n in range(count):
        angle = most * np.sin(2.2 * n / count) * vertices[:, 1] / 2.5
        c, s = np.cos(angle), np.sin(angle)
        x, y, z = vertices.T
        shapes.append(np.column_stack([c * x - s * y, s * x + c * y, z * (1 + 0.03 * n)]))
    return MeshSequence(np.array(shapes), faces)


def cut_in_two():
    """`bending()` cut along a seam, whose vertices come a second time at the end."""
    shapes = bending()
    first_half = shapes.faces[:, 0] < 90
    seam = np.intersect1d(shapes.faces[first_half], shapes.faces[~first_half])
    number = np.arange(170)
    number[seam] = 170 + np.arange(len(seam))
    faces = np.where(first_half[:, None], shapes.faces, number[shapes.faces])
    return MeshSequence(np.concatenate([shapes.vertices, shapes.vertices[:, seam]], axis=1), faces)


def turn(axis, angle):
    """Rotation (3, 3) about an axis by an angle in radians."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def grid(rows, columns):
    """A flat sheet: vertices (V, 3), one apart, and faces (F, 3)."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(float(columns)), np.arange(float(rows))))
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x, y, 0 * x]), faces

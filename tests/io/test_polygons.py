"""Polygons become triangles that cover them once, alike in all shapes of a sequence."""

import logging

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from deformer import io
from deformer.errors import InputError
from deformer.io.polygons import Polygons

DART = np.array([[0, 0, 0], [2, 0, 0], [0.6, 0.6, 0], [0, 2, 0]])
# A plus sign: every second pair of corners is reflex.
CROSS = np.array([[1, 0], [2, 0], [2, 1], [3, 1], [3, 2], [2, 2], [2, 3], [1, 3], [1, 2], [0, 2],
                  [0, 1], [1, 1]], float)  # fmt: skip


def write(path, content):
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def flat(points):
    return np.column_stack([points, np.zeros(len(points))])


def areas(vertices, faces, normal=(0, 0, 1)):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a) @ np.asarray(normal) / 2


def polygon(count):
    return Polygons(np.arange(count), np.array([count]))


def double_area(points):
    after = np.roll(points, -1, axis=0)
    return float(np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]))


def contents(suffix, points, corners):
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    order = " ".join(map(str, corners))
    if suffix == "off":
        return f"OFF\n{len(points)} 1 0\n{rows}{len(corners)} {order}\n"
    if suffix == "obj":
        lines = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
        return lines + "f " + " ".join(str(c + 1) for c in corners) + "\n"
    header = f"ply\nformat {'ascii' if suffix == 'ply' else 'binary_little_endian'} 1.0\n"
    header += f"element vertex {len(points)}\nproperty double x\nproperty double y\n"
    header += "property double z\nelement face 1\nproperty list uchar int vertex_indices\n"
    header += "end_header\n"
    if suffix == "ply":
        return f"{header}{rows}{len(corners)} {order}\n"
    body = np.asarray(points, "<f8").tobytes() + bytes([len(corners)])
    return header.encode() + body + np.asarray(corners, "<i4").tobytes()


@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "binary.ply"])
@pytest.mark.parametrize("start", range(4))
def test_concave_polygons_of_every_format_are_covered_once(tmp_path, suffix, start):
    corners = np.roll(np.arange(4), start)
    path = write(tmp_path / f"a.{suffix}", contents(suffix.split(".")[0] if "." not in suffix
                 else suffix, DART, corners))  # fmt: skip
    mesh = io.load_mesh(path)
    found = areas(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(found, [0.6, 0.6])


@pytest.mark.parametrize("start", range(12))
@pytest.mark.parametrize("reverse", [False, True])
def test_ears_of_a_cross_cover_it_once(start, reverse):
    points = np.roll(CROSS, start, axis=0)[:: -1 if reverse else 1]
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    normal = turn[:, 2] * (-1 if reverse else 1)
    vertices = flat(points) @ turn.T + 100
    faces = polygon(12).triangles(vertices, "a")
    assert faces.shape == (10, 3)
    found = areas(vertices, faces, normal)
    assert found.min() > 0.1
    np.testing.assert_allclose(found.sum(), 5)


@settings(max_examples=60)
@given(st.integers(4, 40), st.integers(0, 10**6))
def test_any_star_is_covered_once(count, seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    radii = rng.uniform(0.05, 1, count)
    points = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    gaps = np.diff([*angles, angles[0] + 2 * np.pi])
    if gaps.max() > np.pi:  # the centre would be outside
        return
    faces = polygon(count).triangles(flat(points), "a")
    found = areas(flat(points), faces)
    assert found.min() > -1e-6
    np.testing.assert_allclose(2 * found.sum(), double_area(points), atol=1e-9)
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == count - 2
    # Every side of the polygon is a side of one triangle, with the same direction.
    sides = {
        tuple(pair)
        for face in faces.tolist()
        for pair in zip(face, face[1:] + face[:1], strict=True)
    }
    assert {(i, (i + 1) % count) for i in range(count)} <= sides


def test_polygons_whose_fan_fits_stay_fans():
    rng = np.random.default_rng(1)
    counts = rng.integers(3, 8, 50)
    angles = [np.linspace(0, 2 * np.pi, n, endpoint=False) for n in counts]
    circle = np.concatenate([np.stack([np.cos(a), np.sin(a)], axis=1) for a in angles])
    vertices = np.column_stack([circle, rng.normal(scale=0.05, size=len(circle))])
    found = Polygons(np.arange(len(vertices)), counts)
    np.testing.assert_array_equal(found.triangles(vertices, "a"), found.fans())
    # A corner in the middle of a side is no reason to do anything else.
    square = np.array([[0, 0], [1, 0], [2, 0], [2, 2], [0, 2]], float)
    np.testing.assert_array_equal(polygon(5).triangles(flat(square), "a"), polygon(5).fans())


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((6, 2)),
        np.column_stack([np.arange(6.0), np.zeros(6)]),
        np.array([[0, 0], [1, 1], [1, 0], [0, 1]], float),
        np.array([[0, 0], [2, 2], [2, 0], [0, 2], [-1, 1.5]], float),
        np.full((5, 2), np.inf),
    ],
)
def test_polygons_without_an_inside_stay_fans(points):
    found = polygon(len(points)).triangles(flat(points), "a")
    assert found.shape == (len(points) - 2, 3)
    np.testing.assert_array_equal(np.sort(found.ravel())[[0, -1]], [0, len(points) - 1])


def test_polygons_that_are_too_intricate_are_refused(monkeypatch):
    monkeypatch.setattr("deformer.io.polygons._MOST_TESTS", 0)
    monkeypatch.setattr("deformer.io.polygons._TESTS_OF_CORNER", 10)
    with pytest.raises(InputError, match=r"a\.obj, polygon 0: its 12 corners"):
        polygon(12).triangles(flat(CROSS), "a.obj")


def test_the_first_shape_decides_for_all(tmp_path):
    write(tmp_path / "0.obj", contents("obj", DART, [1, 2, 3, 0]))
    write(tmp_path / "1.obj", contents("obj", DART[[0, 1, 2, 3]] * [1, -1, 1], [1, 2, 3, 0]))
    square = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    write(tmp_path / "2.obj", contents("obj", square, [1, 2, 3, 0]))
    shapes = io.load_shapes(tmp_path)
    np.testing.assert_allclose(areas(shapes.vertices[0], shapes.faces), [0.6, 0.6])
    np.testing.assert_allclose(areas(shapes.vertices[1], shapes.faces), [-0.6, -0.6])
    np.testing.assert_allclose(areas(shapes.vertices[2], shapes.faces), [2, 2])


# Faces in another order

POINTS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\n"
FIRST = "f 1 2 3 4\nf 1 5 2\nf 2 5 3\n"


@pytest.mark.parametrize(
    "faces",
    ["f 2 5 3\nf 1 2 3 4\nf 1 5 2\n", "f 3 4 1 2\nf 5 2 1\nf 2 5 3\n", "f 1 5 2\nf 1 3 4\nf 2 5 3\n"
     "f 1 2 3\n"],
)  # fmt: skip
def test_faces_in_another_order_are_taken_with_a_note(tmp_path, faces, caplog):
    write(tmp_path / "0.obj", POINTS + FIRST)
    write(tmp_path / "1.obj", POINTS + faces)
    with caplog.at_level(logging.WARNING, "deformer"):
        shapes = io.load_shapes(tmp_path)
    np.testing.assert_array_equal(shapes.faces, io.load_mesh(tmp_path / "0.obj").faces)
    assert len(shapes) == 2 and "1.obj" in caplog.text and "another order" in caplog.text


@pytest.mark.parametrize(
    ("faces", "found"),
    [
        (FIRST.replace("f 1 5 2", "f 1 2 5"), "triangle 2 is [0, 1, 4]"),
        (FIRST.replace("f 1 5 2", "f 1 5 4"), "triangle 2 is [0, 4, 3]"),
        (FIRST.replace("f 1 2 3 4", "f 1 4 3 2"), "triangle 0 is [0, 3, 2]"),
        ("f 2 5 3\n" + FIRST.replace("f 2 5 3\n", "").replace("5 2", "4 5"), "is [0, 3, 4]"),
        ("f 1 5 2\n" + FIRST.replace("f 2 5 3\n", ""), "triangle"),
        (FIRST + "f 1 4 5\n", "5 triangles, expected 4"),
    ],
)
def test_other_faces_are_refused(tmp_path, faces, found):
    write(tmp_path / "0.obj", POINTS + FIRST)
    write(tmp_path / "1.obj", POINTS + faces)
    with pytest.raises(InputError) as caught:
        io.load_shapes(tmp_path)
    assert "1.obj" in str(caught.value) and found in str(caught.value)


def test_triangles_that_a_polygon_may_be_cut_into():
    """Whichever diagonals are taken, in any order; not turned over, and not others."""
    polygons = Polygons(np.array([0, 1, 2, 3, 4, 0, 4, 5, 6]), np.array([5, 4]))
    fan, other = [[0, 1, 2], [0, 2, 3], [0, 3, 4]], [[3, 4, 1], [4, 0, 1], [1, 2, 3]]
    for five in (fan, other):
        for four in ([[0, 4, 5], [0, 5, 6]], [[6, 0, 4], [4, 5, 6]]):
            assert polygons.covers(np.array(four + five))
    assert not polygons.covers(np.array([*fan, [0, 5, 4], [0, 6, 5]]))
    assert not polygons.covers(np.array([*fan, [0, 4, 5]]))
    assert not polygons.covers(np.array([*fan, [0, 4, 5], [0, 5, 7]]))
    assert not polygons.covers(np.array([*fan[:2], [0, 4, 5], [0, 5, 6], [4, 5, 6]]))

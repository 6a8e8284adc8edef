"""Truths of the mesh types and their edge operators."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from deformer.errors import InputError
from deformer.geometry.laplacian import MAX_COTAN_WEIGHT, MIN_COTAN_WEIGHT, cotan_weights
from deformer.geometry.mesh import (
    Mesh,
    MeshSequence,
    connected_components,
    connectivity_hash,
    edges,
    one_rings,
)

TRIANGLE = np.array([[0, 1, 2]])
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def equilateral(side=1.0):
    return side * np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(3) / 2, 0]])


def random_mesh(seed):
    rng = np.random.default_rng(seed)
    return Mesh(rng.normal(size=(4, 3)), TETRAHEDRON)


def test_equilateral_triangle_weighs_half_the_cotangent_of_60_degrees():
    weights = cotan_weights(Mesh(equilateral(), TRIANGLE)).toarray()
    expected = (1 - np.eye(3)) / (2 * np.sqrt(3))
    np.testing.assert_allclose(weights, expected, rtol=1e-14)


def test_right_triangle_leaves_the_hypotenuse_at_the_lower_bound():
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), TRIANGLE)
    weights = cotan_weights(mesh).toarray()
    # Opposite angles: 90° for edge 12, 45° for the other two.
    np.testing.assert_allclose([weights[0, 1], weights[0, 2]], 0.5, rtol=1e-14)
    assert weights[1, 2] == MIN_COTAN_WEIGHT


def test_shared_edge_adds_both_triangles():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.75**0.5, 0], [0.5, -(0.75**0.5), 0]])
    weights = cotan_weights(Mesh(square, [[0, 1, 2], [1, 0, 3]])).toarray()
    np.testing.assert_allclose(weights[0, 1], 1 / np.sqrt(3), rtol=1e-14)
    np.testing.assert_allclose(weights[0, 2], 0.5 / np.sqrt(3), rtol=1e-14)


@given(st.integers(0, 10_000), st.floats(1e-6, 1e6))
def test_weights_are_symmetric_bounded_and_scale_invariant(seed, scale):
    mesh = random_mesh(seed)
    weights = cotan_weights(mesh).toarray()
    np.testing.assert_array_equal(weights, weights.T)
    np.testing.assert_array_equal(weights > 0, 1 - np.eye(4) > 0)
    larger = cotan_weights(Mesh(scale * mesh.vertices, mesh.faces)).toarray()
    np.testing.assert_allclose(larger, weights, rtol=1e-6)


@pytest.mark.parametrize(
    "vertices",
    [
        [[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]],  # obtuse sliver
        [[0, 0, 0], [1, 0, 0], [0, 1e-14, 0]],  # needle
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]],  # collinear
        [[0, 0, 0], [0, 0, 0], [1, 0, 0]],  # two coincident vertices
        [[1, 1, 1], [1, 1, 1], [1, 1, 1]],  # a point
    ],
)
def test_degenerate_triangles_keep_positive_finite_weights(vertices):
    weights = cotan_weights(Mesh(np.array(vertices, dtype=float), TRIANGLE)).toarray()
    off_diagonal = weights[~np.eye(3, dtype=bool)]
    assert np.all(off_diagonal >= MIN_COTAN_WEIGHT)
    assert np.all(off_diagonal <= MAX_COTAN_WEIGHT)
    np.testing.assert_array_equal(np.diag(weights), 0)


def test_edges_come_once_sorted_and_without_loops():
    faces = np.array([[2, 1, 0], [1, 2, 3], [4, 4, 0]])
    expected = [[0, 1], [0, 2], [0, 4], [1, 2], [1, 3], [2, 3]]
    np.testing.assert_array_equal(edges(faces), expected)


def test_one_rings_are_sorted_neighbours_and_empty_without_a_face():
    indptr, neighbours = one_rings(np.array([[4, 1, 0], [1, 4, 3]]), 6)
    rings = [neighbours[indptr[i] : indptr[i + 1]].tolist() for i in range(6)]
    assert rings == [[1, 4], [0, 3, 4], [], [1, 4], [0, 1, 3], []]


def test_components_separate_faces_that_share_no_vertex():
    count, labels = connected_components(np.array([[0, 1, 2], [3, 4, 5], [5, 6, 3]]), 8)
    assert count == 3  # the last vertex has no face
    assert len(set(labels[:3])) == len(set(labels[3:7])) == 1
    assert len({labels[0], labels[3], labels[7]}) == 3


def test_hash_tells_connectivities_apart():
    original = connectivity_hash(TETRAHEDRON, 4)
    assert original == connectivity_hash(TETRAHEDRON.astype(np.int32), 4)
    assert original != connectivity_hash(TETRAHEDRON[::-1], 4)
    assert original != connectivity_hash(TETRAHEDRON[:, [1, 2, 0]], 4)
    assert original != connectivity_hash(TETRAHEDRON, 5)


def test_arrays_are_read_only_copies():
    vertices = equilateral()
    mesh = Mesh(vertices, TRIANGLE)
    sequence = MeshSequence(vertices[None], TRIANGLE)
    vertices[0] = 9.0
    assert mesh.vertices[0, 0] == sequence.vertices[0, 0, 0] == 0.0
    for array in (mesh.vertices, mesh.faces, sequence.vertices, sequence.faces):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_types_are_float64_and_int64_whatever_comes_in():
    mesh = Mesh(equilateral().astype(np.float32), TRIANGLE.astype(np.uint16))
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)


def test_bounding_diagonal_of_a_box():
    assert Mesh([[0, 0, 0], [2, 0, 0], [2, 3, 6.0]], TRIANGLE).bounding_diagonal == 7.0


def test_sequence_gives_single_shapes_and_subsets():
    sequence = MeshSequence(np.stack([equilateral(s) for s in (1.0, 2.0, 3.0)]), TRIANGLE)
    assert len(sequence) == 3
    np.testing.assert_array_equal(sequence.mesh(1).vertices, equilateral(2.0))
    np.testing.assert_array_equal(sequence.mesh(-1).vertices, equilateral(3.0))
    chosen = sequence.subset([2, 0])
    np.testing.assert_array_equal(chosen.vertices, sequence.vertices[[2, 0]])


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda v: Mesh(v[:, :2], TRIANGLE), ["vertices", "(V, 3)", "(3, 2)"]),
        (lambda v: Mesh(v[None], TRIANGLE), ["vertices", "(V, 3)", "(1, 3, 3)"]),
        (lambda v: MeshSequence(v, TRIANGLE), ["vertices", "(N, V, 3)", "(3, 3)"]),
        (lambda v: Mesh(v, [[0, 1, 2, 2]]), ["faces", "(F, 3)", "triangulate"]),
        (lambda v: Mesh(v, np.empty((0, 3), int)), ["faces", "F > 0", "(0, 3)"]),
        (lambda v: Mesh(v, [[0.0, 1.0, 2.0]]), ["faces", "integers", "float64"]),
        (lambda v: Mesh(v, [[0, 1, 2], [0, 1, 3]]), ["faces[1]", "[0, 1, 3]", "0…2"]),
        (lambda v: Mesh(v, [[0, 1, -1]]), ["faces[0]", "[0, 1, -1]"]),
        (lambda v: Mesh(v * [1, np.nan, 1], TRIANGLE), ["vertices[0]", "nan"]),
        (lambda v: MeshSequence(v[None] / [[[1], [1], [0]]], TRIANGLE), ["[0, 2]", "inf"]),
        (lambda v: MeshSequence(v[None], TRIANGLE).mesh(1), ["shape 1", "1 shapes"]),
        (lambda v: MeshSequence(v[None], TRIANGLE).subset([0, 4]), ["shape 4", "0…0"]),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_errors_name_what_came_and_what_was_expected(make, parts):
    with pytest.raises(InputError) as caught:
        make(equilateral() + 0.0)
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


@pytest.mark.parametrize("far", [1e61, -1.5e288])
def test_positions_whose_lengths_overflow_are_refused(far):
    vertices = equilateral()
    vertices[1, 2] = far
    with pytest.raises(InputError, match=r"^vertices\[1\]: .*beyond ±1e\+60; repair"):
        Mesh(vertices, TRIANGLE)
    with pytest.raises(InputError, match=r"^vertices\[0, 1\]: .*beyond ±1e\+60; repair"):
        MeshSequence(vertices[None], TRIANGLE)
    Mesh(equilateral() * 1e59, TRIANGLE)

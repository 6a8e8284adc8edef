"""Truths of mirror images: what the right side did, the left does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deformer.acap import mirror_map
from deformer.acap.gradients import features_to_gradients
from deformer.acap.mirror_map import reflected
from deformer.geometry.mesh import MeshSequence
from deformer.geometry.metrics import e_rms
from deformer.training import mirroring
from deformer.training.mirroring import find_mirror, leave_one_out_residual
from shapes import strip


def mirror_images(shapes):
    """Images (N, V, 3) of shapes, and the plane."""
    mirror, plane = find_mirror(shapes)
    return mirror.images(shapes.vertices), plane


def images_explain(x, images):
    """What is found of examples and images (n, V, 9)."""
    rows = np.concatenate([x, images]).reshape(2 * len(x), -1)
    return mirroring.images_explain(rows @ rows.T)


def sheet(poses, skew=0.0):
    """A curved sheet, symmetric about x = 0 alone, with wings folded by angles (left, right)."""
    flat = strip(25, 9, 2.0, 0.8)
    v = flat.vertices - [1.0, 0.0, 0.0]
    v[:, 2] = 0.4 * v[:, 1] ** 2
    v[:, 1] += 0.3 * v[:, 0] ** 2
    shapes = []
    for left, right in poses:
        p = v.copy()
        p[:, 1] += skew * v[:, 0] ** 3
        for side, angle in ((-1, left), (1, right)):
            wing = side * v[:, 0] > 0.3
            hinge = np.array([0.3 * side, 0.0, 0.0])
            turn = Rotation.from_rotvec([0.0, -side * angle, 0.0])
            p[wing] = turn.apply(p[wing] - hinge) + hinge
        shapes.append(p)
    return MeshSequence(np.array(shapes), flat.faces)


def test_an_image_has_the_wings_changed_over():
    poses = [(0.0, 0.0), (0.7, 0.0), (0.2, -0.5), (0.0, 0.9)]
    shapes = sheet(poses)
    images, plane = mirror_images(shapes)
    assert plane.error < 1e-6 and abs(plane.normal[0]) == pytest.approx(1.0)
    wanted = sheet([(right, left) for left, right in poses])
    assert e_rms(wanted.vertices, images, "none") < 5.0
    # Not because nothing moved.
    assert e_rms(wanted.vertices, shapes.vertices, "none") > 50.0


def test_reflected_features_are_those_of_reflected_gradients():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(5, 7, 9))  # rotations beyond a half turn among them
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    M = np.eye(3) - 2.0 * np.outer(normal, normal)
    np.testing.assert_allclose(
        features_to_gradients(reflected(q, normal)), M @ features_to_gradients(q) @ M, atol=1e-12
    )
    np.testing.assert_allclose(reflected(reflected(q, normal), normal), q, atol=1e-12)


def test_an_image_lies_opposite_to_its_shape(monkeypatch):
    """Wherever the shapes lie; and it does not matter how many are mirrored at a time."""
    still = sheet([(0.0, 0.0), (0.7, 0.0), (0.2, -0.5), (0.0, 0.9), (0.3, 0.3)])
    away = np.array([[0, 0, 0], [3, 0, 0], [0, 2, 1], [-1, 0, 5], [2, 2, 2]], float)
    shapes = MeshSequence(still.vertices + away[:, None], still.faces)
    monkeypatch.setattr(mirror_map, "_BATCH", 2)
    images, plane = mirror_images(shapes)
    np.testing.assert_allclose(
        images.mean(axis=1), plane.mirror(shapes.vertices.mean(axis=1)), atol=1e-12
    )
    whole = mirror_images(still)[0]
    for image, other in zip(images, whole, strict=True):
        np.testing.assert_allclose(
            image - image.mean(axis=0), other - other.mean(axis=0), atol=1e-9
        )


@pytest.mark.parametrize("rest", [0, 1, 3])
def test_the_plane_is_that_of_the_most_symmetric_shape(rest):
    poses = [(0.7, 0.0), (0.2, -0.5), (0.0, 0.9), (0.4, 0.1)]
    poses[rest] = (0.0, 0.0)
    assert mirror_images(sheet(poses))[1].error < 1e-6


def test_faces_without_area_are_no_obstacle():
    """No barycentric coordinates say which of their points is meant."""
    shapes = sheet([(0.0, 0.0), (0.4, 0.0)])
    dots = np.repeat(np.arange(shapes.vertices.shape[1])[:, None], 3, axis=1)
    dotted = MeshSequence(shapes.vertices, np.concatenate([dots, shapes.faces]))
    np.testing.assert_allclose(mirror_images(dotted)[0], mirror_images(shapes)[0], atol=1e-6)


def test_what_is_crooked_stays_where_it_is():
    """The image of the shape at rest is that shape, though its two halves differ."""
    shapes = sheet([(0.0, 0.0), (0.6, 0.0)], skew=0.05)
    images, _ = mirror_images(shapes)
    assert e_rms(shapes.vertices[0], images[0], "none") < 1.0


def test_images_of_a_one_sided_motion_explain_the_other_side():
    rng = np.random.default_rng(0)
    basis = rng.normal(size=(4, 30, 9))
    codes = rng.normal(size=(10, 4))
    x = np.tensordot(codes, basis, 1)
    # Half of the examples move in the one half of the space, half in the other.
    x[:5] = np.tensordot(codes[:5, :2], basis[:2], 1)
    x[5:] = np.tensordot(codes[5:, :1], basis[2:3], 1)
    images = np.concatenate([x[5:], x[:5]]) + 0.01 * rng.normal(size=x.shape)
    images[9] = basis[3]
    assert not images_explain(x, rng.normal(size=x.shape))
    lonely = np.concatenate([x[:1], 5.0 * rng.normal(size=(6, 30, 9))])
    assert images_explain(lonely, np.roll(lonely, 1, axis=0))
    assert not images_explain(lonely, lonely)


def test_what_is_left_is_that_of_ridge_regression():
    """Against the regression written out, about the mean, with rows and not inner products."""
    rng = np.random.default_rng(1)
    x, images = rng.normal(size=(2, 6, 40)) + 3.0
    basis, own = np.concatenate([x, images]), np.tile(np.arange(6), 2)
    total = 0.0
    for n, goal in enumerate(x):
        rows = basis[own != n]
        mean = rows.mean(axis=0)
        A = (rows - mean).T
        ridge = 0.01 * (A**2).sum() / len(rows) * np.eye(len(rows))
        weights = np.linalg.solve(A.T @ A + ridge, A.T @ (goal - mean))
        total += ((goal - mean - A @ weights) ** 2).sum()
    assert leave_one_out_residual(basis @ basis.T, own) == pytest.approx(total, rel=1e-10)


@pytest.mark.parametrize("same", [0, 1, 3, 20])
def test_images_have_to_explain_a_tenth(same):
    """Of examples that have nothing in common: as many as have another's image for their twin."""
    frame = np.linalg.qr(np.random.default_rng(2).normal(size=(90, 40)))[0].T
    x, images = frame[:20], frame[20:].copy()
    images[:same] = np.roll(x, 1, axis=0)[:same]
    assert images_explain(x.reshape(20, -1, 9), images.reshape(20, -1, 9)) == (same / 20 > 0.1)


def test_images_of_shapes_that_are_all_alike_explain_nothing():
    still = np.ones((5, 4, 9))
    assert not images_explain(still, still)


@pytest.mark.parametrize("count", [2, 3])
def test_few_shapes_are_enough(count):
    images, _ = mirror_images(sheet([(0.0, 0.0), (0.4, 0.0), (0.0, 0.3)][:count]))
    assert images.shape == (count, 25 * 9, 3) and np.isfinite(images).all()

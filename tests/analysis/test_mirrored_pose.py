"""Truths of the mirror image of a pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deformer import InputError, Mesh, find_symmetry, mirrored_pose, symmetry_about
from distances import largest
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def plane(model):
    """Across the tube's axis: its two ends are each other's images."""
    return symmetry_about(model.reference, model.reference.vertices.mean(axis=0), [1.0, 0, 0])


@pytest.fixture(scope="module")
def pose(model):
    """One end of the tube is bent, far from symmetric."""
    v = model.reference.vertices.copy()
    end = v[:, 0] > 1.2
    hinge = np.array([1.2, 0.0, 0.0])
    v[end] = Rotation.from_rotvec([0.0, 0.5, 0.0]).apply(v[end] - hinge) + hinge
    return v + np.array([0.3, -0.2, 0.1])


def test_the_image_of_an_asymmetric_pose_is_the_reflected_opposite_vertices(model, plane, pose):
    image = mirrored_pose(model, pose, plane)
    wanted = plane.mirror(pose[plane.opposite])
    diagonal = model.reference.bounding_diagonal
    assert largest(image - wanted) < 0.01 * diagonal
    assert largest(image - pose) > 0.1 * diagonal, "the other end is bent now"


def test_an_image_of_an_image_is_the_pose_and_several_are_mirrored_at_once(model, plane, pose):
    both = np.stack([pose, model.reference.vertices])
    again = mirrored_pose(model, mirrored_pose(model, both, plane), plane)
    assert largest(again - both) < 1e-3 * model.reference.bounding_diagonal


def test_the_image_of_the_rest_is_the_rest_as_crooked_as_it_is(model, plane, pose):
    """Differences between the halves stay on their sides."""
    crooked = model.reference.vertices.copy()
    crooked[crooked[:, 0] > 1.5, 2] *= 1.1
    rest = Mesh(crooked, model.reference.faces)
    np.testing.assert_allclose(mirrored_pose(model, crooked, plane, rest), crooked, atol=2e-3)
    assert largest(mirrored_pose(model, crooked, plane) - crooked) > 0.01


def test_without_a_plane_it_is_the_one_of_the_rest(model, pose):
    found = mirrored_pose(model, pose)
    np.testing.assert_array_equal(found, mirrored_pose(model, pose, find_symmetry(model.reference)))


def test_a_rest_of_another_body_is_refused(model, pose):
    with pytest.raises(InputError, match="rest: expected the model's 120 vertices, got 3"):
        mirrored_pose(model, pose, rest=Mesh(np.eye(3), [[0, 1, 2]]))

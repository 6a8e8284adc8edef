"""Stretch of faces: known maps, invariances."""

import numpy as np
import pytest

from deformer import FaceStrain, InputError, Mesh
from shapes import MESHES, random_rotation, strip


def test_stretching_a_plane_along_its_axes():
    flat = strip()
    assert np.ptp(flat.vertices[:, 2]) == 0
    strain = FaceStrain(flat)
    found = strain.principal(flat.vertices * [3.0, 0.5, 9.0])
    np.testing.assert_allclose(found, np.tile([3.0, 0.5], (len(found), 1)), rtol=1e-9)
    np.testing.assert_allclose(strain.signed(flat.vertices * [3.0, 0.5, 1]), np.log2(3.0))
    np.testing.assert_allclose(strain.signed(flat.vertices * [1.0, 0.25, 1]), -2.0)


@pytest.mark.parametrize("name", MESHES)
def test_rigid_motion_stretches_nothing_and_scaling_everything(name):
    mesh = MESHES[name]
    moved = 2.5 * mesh.vertices @ random_rotation(np.random.default_rng(3)).T + [1, -2, 3]
    strain = FaceStrain(mesh)
    found = strain.principal(moved)
    flat = (found == 1.0).all(axis=1)
    assert flat.mean() < 0.2
    np.testing.assert_allclose(found[~flat], 2.5, rtol=1e-4)


def test_principal_stretches_are_singular_values():
    """Against the 3×3 map of edges and normal, one face at a time."""
    rng = np.random.default_rng(0)
    rest, bent = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    found = FaceStrain(Mesh(rest, [[0, 1, 2]])).principal(bent)[0]

    def frame(p):
        a, b = p[1] - p[0], p[2] - p[0]
        normal = np.cross(a, b)
        return np.column_stack([a, b, normal / np.linalg.norm(normal)])

    expected = np.linalg.svd(frame(bent) @ np.linalg.inv(frame(rest)), compute_uv=False)
    np.testing.assert_allclose(np.sort([*found, 1.0])[::-1], expected, rtol=1e-9)


def test_other_vertex_counts_are_refused():
    with pytest.raises(InputError, match="vertices"):
        FaceStrain(strip()).principal(np.zeros((3, 3)))

"""The rivals without components: exact handles, rigid truths, the choice of the nearest shape."""

import numpy as np
import pytest

from deformer.baselines.biharmonic import Biharmonic, NearestBiharmonic
from deformer.baselines.rigid import Arap, NearestArap
from deformer.errors import InputError
from deformer.geometry.geodesics import Geodesics
from deformer.geometry.mesh import MeshSequence
from deformer.geometry.rotations import procrustes
from deformer.geometry.sampling import farthest_points
from shapes import awkward, bend, random_rotation, sequence, twist, two_components

SHAPES = sequence(12)
REFERENCE = SHAPES.vertices[0]
CONTROL = farthest_points(Geodesics(SHAPES.mesh(0)), 12, seed=3)
METHODS = [Arap, NearestArap, Biharmonic, NearestBiharmonic]
METHODS = pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)


def rms(a, b):
    return float(np.sqrt(((a - b) ** 2).sum(-1).mean()))


@METHODS
def test_a_rigid_motion_of_the_handles_moves_the_reference(method):
    rng = np.random.default_rng(0)
    R, t = random_rotation(rng), rng.normal(size=3)
    moved = REFERENCE @ R.T + t
    pose = method().fit(SHAPES, 0).fit_handles(CONTROL, moved[CONTROL])
    np.testing.assert_allclose(pose, moved, atol=1e-6)


@METHODS
def test_handles_are_met_exactly(method):
    targets = REFERENCE[CONTROL] + 0.2 * np.random.default_rng(1).normal(size=(len(CONTROL), 3))
    pose = method().fit(SHAPES, 0).fit_handles(CONTROL, targets)
    np.testing.assert_array_equal(pose[CONTROL], targets)
    assert np.isfinite(pose).all()


@METHODS
def test_the_nearest_shape_is_found_wherever_it_stands(method):
    """A training shape that was moved comes back: exactly, and from few points."""
    rng = np.random.default_rng(2)
    R, t = random_rotation(rng), rng.normal(size=3)
    moved = SHAPES.vertices[4] @ R.T + t
    few = CONTROL[:5]
    pose = method().fit(SHAPES, 0).fit_handles(few, moved[few])
    if method.nearest:
        np.testing.assert_allclose(pose, moved, atol=1e-6)
    else:
        assert rms(pose, moved) > 0.01


@METHODS
def test_answers_do_not_depend_on_what_was_asked_before(method):
    kept, others = method().fit(SHAPES, 0), CONTROL[[1, 5, 7, 8]]
    targets = SHAPES.vertices[5][CONTROL]
    first = kept.fit_handles(CONTROL, targets)
    kept.fit_handles(others, SHAPES.vertices[2][others])
    np.testing.assert_array_equal(kept.fit_handles(CONTROL, targets), first)


@pytest.mark.parametrize("truth", [bend(REFERENCE, np.pi), twist(REFERENCE, 2.5)])
def test_arap_follows_large_rotations_and_biharmonic_does_not(truth):
    """Held at both ends a tube bends to a half circle, or twists: rotations, without stretch."""
    ends = np.flatnonzero(np.abs(REFERENCE[:, 0] - 1) > 0.8)
    arap, biharmonic = (
        method().fit(SHAPES, 0).fit_handles(ends, truth[ends]) for method in (Arap, Biharmonic)
    )
    assert rms(arap, truth) < 0.5 * rms(biharmonic, truth)


def test_biharmonic_is_smooth_where_it_is_free():
    """The discrete bi-Laplacian of the displacement vanishes at every free vertex."""
    from deformer.geometry.laplacian import cotan_weights

    targets = REFERENCE[CONTROL] + 0.1 * np.random.default_rng(1).normal(size=(len(CONTROL), 3))
    method = Biharmonic().fit(SHAPES, 0)
    pose = method.fit_handles(CONTROL, targets)
    R, t = procrustes(REFERENCE[CONTROL], targets)
    start = REFERENCE @ R.T + t
    weights = cotan_weights(SHAPES.mesh(0)).toarray()
    L = np.diag(weights.sum(1)) - weights
    a, b, c = (REFERENCE[SHAPES.faces[:, i]] for i in range(3))
    area = np.zeros(len(REFERENCE))
    np.add.at(area, SHAPES.faces, (np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6)[:, None])
    residual = L @ ((L @ (pose - start)) / area[:, None])
    free = np.setdiff1d(np.arange(len(REFERENCE)), CONTROL)
    assert np.abs(residual[free]).max() < 1e-8 * np.abs(residual[CONTROL]).max()


@METHODS
def test_a_component_without_a_control_point_is_refused(method):
    mesh = two_components()
    shapes = MeshSequence(np.stack([mesh.vertices, mesh.vertices + 1]), mesh.faces)
    last = len(mesh.vertices) - 1
    with pytest.raises(InputError, match=f"{method.name}: .*no control point"):
        method().fit(shapes, 0).fit_handles([0, 5, 9], mesh.vertices[[0, 5, 9]])
    both = np.array([0, 40, 70, last, last - 5, last - 9])
    pose = method().fit(shapes, 0).fit_handles(both, mesh.vertices[both])
    np.testing.assert_allclose(pose, mesh.vertices, atol=1e-3)


@METHODS
def test_awkward_meshes_give_a_pose_or_one_line(method):
    mesh = awkward()
    shapes = MeshSequence(np.stack([mesh.vertices, 1.1 * mesh.vertices]), mesh.faces)
    control = farthest_points(Geodesics(mesh), 12, seed=0)
    try:
        pose = method().fit(shapes, 0).fit_handles(control, 1.05 * mesh.vertices[control])
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(pose).all()

"""Truths of features: what rigid, affine and bent shapes must give, and that they come back."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from deformer import e_rms, extract_features, load_shapes, reconstruct
from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.gradients import features_to_gradients
from deformer.acap.poisson import PoissonSystem
from deformer.acap.scaler import FeatureScaler
from deformer.errors import InputError
from deformer.geometry.mesh import Mesh, MeshSequence, connected_components, edges
from deformer.geometry.rotations import log_to_rotation
from paths import DATA
from shapes import (
    MESHES,
    bend,
    random_rotation,
    sequence,
    strip,
    tube,
    twist,
    two_components,
)

IDENTITY = np.array([0, 0, 0, 1, 0, 0, 1, 0, 1.0])


def scaled(name, unit):
    return Mesh(unit * MESHES[name].vertices, MESHES[name].faces)


def parts(mesh):
    """Vertex indices of every connected component that has an edge, and of those without."""
    labels = connected_components(mesh.faces, len(mesh.vertices))[1]
    return [np.flatnonzero(labels == k) for k in range(labels.max() + 1)]


def error_without_translation(mesh, truth, estimate):
    """Largest error in diagonals of the reference; every component's translation is free."""
    difference = estimate - truth
    worst = 0.0
    for part in parts(mesh):
        away = difference[part] - difference[part].mean(axis=0)
        worst = max(worst, np.linalg.norm(away, axis=1).max())
    return worst / mesh.bounding_diagonal


def round_trip(mesh, p):
    q = FeatureExtractor(mesh).extract(p)
    assert np.isfinite(q).all()
    return error_without_translation(mesh, p, PoissonSystem(mesh).reconstruct(q))


@pytest.mark.parametrize("name", MESHES)
def test_the_reference_has_no_rotation_and_no_stretch(name):
    mesh = MESHES[name]
    q = FeatureExtractor(mesh).extract(mesh.vertices)
    np.testing.assert_allclose(q, np.broadcast_to(IDENTITY, q.shape), atol=1e-11)
    moved = FeatureExtractor(mesh).extract(mesh.vertices + np.array([5, -3, 2]))
    np.testing.assert_allclose(moved, q, atol=1e-11)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("angle", [1e-7, 1.0, 3.0, np.pi - 1e-7, np.pi])
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.filterwarnings("error")
def test_rigid_motion_is_one_rotation_without_stretch(name, angle, unit):
    mesh = scaled(name, unit)
    R = random_rotation(np.random.default_rng(int(10 * angle)), angle)
    p = mesh.vertices @ R.T + unit * np.array([1.0, -2, 3])
    q = FeatureExtractor(mesh).extract(p)
    np.testing.assert_allclose(q[:, 3:], np.broadcast_to(IDENTITY[3:], q[:, 3:].shape), atol=1e-10)
    for part in parts(mesh):
        # Constant, sign of the axis included, even where R turns by π.
        np.testing.assert_allclose(q[part, :3], np.tile(q[part[0], :3], (len(part), 1)), atol=1e-9)
        np.testing.assert_allclose(log_to_rotation(q[part[0], :3]), R, atol=1e-10)
    assert error_without_translation(mesh, p, PoissonSystem(mesh).reconstruct(q)) < 1e-9


@given(st.integers(0, 10_000), st.sampled_from(["tube", "strip", "sphere", "awkward"]))
@settings(max_examples=25)
def test_affine_maps_come_back_exactly(seed, name):
    """Strongly sheared and flattened ones too: reconstruction does not care how T was split.

    Mirrored ones only of a plane: turned inside out, a ball or a tube has no continuous
    rotations, and the interpolated ones cost accuracy.
    """
    mesh = MESHES[name]
    A = np.random.default_rng(seed).normal(size=(3, 3))
    if name != "strip":
        A *= np.sign(np.linalg.det(A))
    assert round_trip(mesh, mesh.vertices @ A.T) < 1e-8


def test_affine_map_of_a_plane_is_its_gradient():
    """A flat one-ring gives T = A on the plane exactly, and unit normal to unit normal across."""
    mesh = strip(9, 4)
    rng = np.random.default_rng(1)
    for _ in range(5):
        A = rng.normal(size=(3, 3))
        T = FeatureExtractor(mesh).gradients(mesh.vertices @ A.T)
        np.testing.assert_allclose(T[:, :, :2], np.tile(A[:, :2], (len(T), 1, 1)), atol=1e-7)
        normal = np.cross(A[:, 0], A[:, 1])
        normal /= np.linalg.norm(normal)
        np.testing.assert_allclose(T[:, :, 2], np.tile(normal, (len(T), 1)), atol=1e-7)


def test_stretch_of_a_plane_is_read_off():
    """Doubling x and halving y of the plane is S = diag(2, ½, 1) and no rotation."""
    mesh = strip(9, 4)
    q = FeatureExtractor(mesh).extract(mesh.vertices * [2, 0.5, 1])
    expected = np.array([0, 0, 0, 2, 0, 0, 0.5, 0, 1.0])
    np.testing.assert_allclose(q, np.tile(expected, (len(q), 1)), atol=1e-7)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.filterwarnings("error")
def test_bent_and_twisted_shapes_come_back(name, unit):
    mesh = MESHES[name]
    length = np.ptp(mesh.vertices[:, 0])
    shapes = [
        bend(mesh.vertices, 2.5, length),
        twist(mesh.vertices, 1.5 * np.pi, length),
        bend(twist(mesh.vertices, 1.0, length), -1.5, length),
    ]
    for p in shapes:
        assert round_trip(scaled(name, unit), unit * p) < 1e-8


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_twist_beyond_a_turn_comes_back_in_any_unit(unit):
    """Here some rotations are interpolated and the stretch makes up for it."""
    mesh = MESHES["strip"]
    assert round_trip(scaled("strip", unit), unit * twist(mesh.vertices, 2.25 * np.pi, 3.0)) < 1e-6


@given(st.integers(0, 10_000), st.sampled_from([0.01, 0.1, 0.2]))
@settings(max_examples=20)
def test_any_small_disturbance_comes_back(seed, size):
    """Features hold the shape exactly as long as no rotation goes beyond a turn."""
    mesh = MESHES["sphere"]
    p = mesh.vertices + size * 0.2 * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    assert round_trip(mesh, p) < 1e-8


@pytest.mark.filterwarnings("error")
def test_collapsed_shapes_stay_finite():
    """All vertices at one point, on a line, or mirrored: nothing to be right about, but numbers."""
    mesh = MESHES["awkward"]
    extractor, system = FeatureExtractor(mesh), PoissonSystem(mesh)
    for scale in ([0, 0, 0], [1, 0, 0], [0, 1, 1], [-1, 1, 1]):
        q = extractor.extract(mesh.vertices * np.array(scale, dtype=float))
        assert np.isfinite(q).all() and np.isfinite(system.reconstruct(q)).all()


def test_bending_is_seen_as_rotation_about_the_axis_of_the_bend():
    mesh = strip(41, 5, 2.0)
    q = FeatureExtractor(mesh).extract(bend(mesh.vertices[:, [0, 2, 1]], 2.0)[:, [0, 2, 1]])
    inner = (mesh.vertices[:, 0] > 0.2) & (mesh.vertices[:, 0] < 1.8)
    # Bent in x and z: the section at x turns by x about −y.
    expected = np.column_stack([0 * q[:, 0], -mesh.vertices[:, 0], 0 * q[:, 0]])
    np.testing.assert_allclose(q[inner, :3], expected[inner], atol=5e-3)
    np.testing.assert_allclose(q[inner, 3:], np.tile(IDENTITY[3:], (inner.sum(), 1)), atol=5e-3)


def test_twist_by_three_quarters_is_continuous_and_complete():
    mesh = tube(8, 31)
    q = FeatureExtractor(mesh).extract(twist(mesh.vertices, 1.5 * np.pi))
    i, j = edges(mesh.faces).T
    assert np.linalg.norm(q[i, :3] - q[j, :3], axis=1).max() < np.pi / 2
    np.testing.assert_allclose(np.linalg.norm(q[:, :3], axis=1).max(), 1.5 * np.pi, rtol=0.03)


def test_gradients_of_features_are_rotation_times_stretch():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(2, 7, 9))
    T = features_to_gradients(q)
    xx, xy, xz, yy, yz, zz = np.moveaxis(q[..., 3:], -1, 0)
    S = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), (0, 1), (-2, -1))
    np.testing.assert_allclose(T, log_to_rotation(q[..., :3]) @ S, atol=1e-13)


def test_features_are_the_factors_of_the_gradients():
    mesh = MESHES["tube"]
    extractor = FeatureExtractor(mesh)
    p = bend(twist(mesh.vertices, 1.0), 1.0)
    np.testing.assert_allclose(
        features_to_gradients(extractor.extract(p)), extractor.gradients(p), atol=1e-11
    )


def test_many_shapes_give_what_single_ones_give_in_any_order():
    shapes = sequence(6)
    q = extract_features(shapes)
    extractor = FeatureExtractor(shapes.mesh(0))
    for n in range(len(shapes)):
        np.testing.assert_array_equal(extractor.extract(shapes.vertices[n]), q[n])
    order = np.random.default_rng(0).permutation(np.repeat(np.arange(6), 8))
    np.testing.assert_array_equal(extract_all(extractor, shapes.vertices[order]), q[order])
    with ThreadPoolExecutor(8) as pool:
        again = list(pool.map(lambda n: extractor.extract(shapes.vertices[n]), order))
    np.testing.assert_array_equal(np.array(again), q[order])


def test_reference_may_be_any_shape_and_progress_is_told():
    shapes = sequence(5)
    told = []
    q = extract_features(
        shapes, reference=3, progress=lambda done, total: told.append((done, total))
    )
    assert told == [(n, 5) for n in range(1, 6)]
    np.testing.assert_allclose(q[3], np.tile(IDENTITY, (q.shape[1], 1)), atol=1e-11)
    np.testing.assert_allclose(reconstruct(shapes, q, reference=3), shapes.vertices, atol=1e-9)


def test_reconstruct_restores_every_component_where_it_was():
    mesh = two_components()
    rng = np.random.default_rng(4)
    ball = connected_components(mesh.faces, len(mesh.vertices))[1] == 1
    poses = [mesh.vertices]
    for _ in range(3):
        p = bend(mesh.vertices, 1.0) + rng.normal(size=3)
        p[ball] = mesh.vertices[ball] @ random_rotation(rng).T + rng.normal(size=3)
        poses.append(p)
    shapes = MeshSequence(np.array(poses), mesh.faces)
    back = reconstruct(shapes, extract_features(shapes))
    np.testing.assert_allclose(back, shapes.vertices, atol=1e-9)


def test_wrong_shapes_are_refused():
    extractor = FeatureExtractor(MESHES["tube"])
    with pytest.raises(InputError, match="connectivity"):
        extractor.extract(np.zeros((7, 3)))
    with pytest.raises(InputError, match="features"):
        features_to_gradients(np.zeros((4, 8)))


@given(st.integers(0, 1000), st.floats(-100, 100), st.floats(1e-3, 1e3))
def test_scaler_maps_the_range_to_its_limits_and_back(seed, shift, spread):
    q = shift + spread * np.random.default_rng(seed).normal(size=(3, 5, 9))
    scaler = FeatureScaler.fit(q)
    x = scaler.scale(q)
    for part in (x[..., :3], x[..., 3:]):
        np.testing.assert_allclose([part.min(), part.max()], [-0.95, 0.95], atol=1e-9)
    np.testing.assert_allclose(scaler.unscale(x), q, rtol=1e-12, atol=1e-12 * spread)
    # One range for all entries of a kind: the order of values is kept across entries.
    np.testing.assert_array_equal(np.argsort(x[..., 3:].ravel()), np.argsort(q[..., 3:].ravel()))
    np.testing.assert_allclose(scaler.unscale(x + 1) - q, np.broadcast_to(scaler.gain, q.shape))


def test_scaler_of_constant_features():
    q = np.tile(IDENTITY, (3, 4, 1))
    q[..., 3:] = 1.0
    scaler = FeatureScaler.fit(q)
    x = scaler.scale(q)
    np.testing.assert_allclose(x, 0, atol=1e-12)
    np.testing.assert_allclose(scaler.unscale(x), q)


def needs(name):
    return pytest.mark.skipif(not (DATA / name).exists(), reason=f"{name} is not here")


@needs("scape-obj")
def test_scape_comes_back():
    shapes = load_shapes(DATA / "scape-obj")
    back = reconstruct(shapes, extract_features(shapes))
    assert e_rms(shapes.vertices, back) <= 0.65  # the design's figure
    assert e_rms(shapes.vertices, back) <= 1e-4  # this implementation is exact


@needs("crane.npz")
def test_crane_comes_back(record_property):
    """Turns by nearly π against the first frame; E_rms in thousandths of the data's unit."""
    with np.load(DATA / "crane.npz") as data:
        shapes = MeshSequence(data["vertices"][::25], data["faces"])
    back = reconstruct(shapes, extract_features(shapes))
    error = e_rms(shapes.vertices, back)
    record_property("crane_e_rms", error)
    assert error <= 1e-4

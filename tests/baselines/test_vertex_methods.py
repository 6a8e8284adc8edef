"""Rival methods on vertex positions, on shapes whose components are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from deformer import InputError, MeshSequence, e_rms
from deformer.baselines._linear_basis import _RIDGES, HandleRegression, Penalty
from deformer.baselines._structured_norm import StructuredNorm, structured_norm
from deformer.baselines.clustered_pca import ClusteredPCA, segment
from deformer.baselines.pca import PCA
from deformer.baselines.splocs import SPLOCS
from deformer.baselines.structured_factors import StructuredFactors, factorise, split
from deformer.geometry import align, log_to_rotation
from deformer.geometry.geodesics import Geodesics
from deformer.geometry.sampling import farthest_points
from shapes import icosphere, random_rotation, sequence, tube

FACTORS = pytest.param(StructuredFactors, marks=pytest.mark.slow)
METHODS = [PCA, ClusteredPCA, SPLOCS, FACTORS]
LOCAL = [ClusteredPCA, SPLOCS, FACTORS]


def bumps(count=24, seed=0, scale=1.0):
    """A tube whose rings move in three places apart: shapes, the fields (3, V, 3), the codes."""
    mesh = tube(around=10, rings=41, length=4.0)
    rng = np.random.default_rng(seed)
    fields = np.zeros((3, len(mesh.vertices), 3))
    for k, (centre, way) in enumerate(zip((0.6, 2.0, 3.4), np.eye(3), strict=True)):
        height = np.maximum(0.0, 1.0 - np.abs(mesh.vertices[:, 0] - centre) / 0.35)
        fields[k] = 0.3 * height[:, None] * way
    codes = rng.uniform(-1, 1, (count, 3))
    codes[0] = 0.0
    vertices = mesh.vertices + np.tensordot(codes, fields, 1)
    return MeshSequence(scale * vertices, mesh.faces), fields, codes


def low_rank(rank=4, count=20, seed=1):
    """A sphere with random smooth fields: every shape is the mean plus `rank` components."""
    mesh = icosphere(2)
    rng = np.random.default_rng(seed)
    fields = np.sin(mesh.vertices @ rng.normal(size=(3, 3 * rank)) + rng.normal(size=3 * rank))
    fields = fields.reshape(-1, rank, 3).transpose(1, 0, 2)
    codes = rng.normal(size=(count, rank))
    return MeshSequence(mesh.vertices + 0.2 * np.tensordot(codes, fields, 1), mesh.faces)


def rebuilt(method, vertices):
    return method.decode(method.fit_codes(vertices))


def test_pca_components_are_the_principal_ones():
    shapes = low_rank()
    method = PCA().fit(shapes, 6)
    flat = method.basis.components.reshape(6, -1)
    assert_allclose(flat[:4] @ flat[:4].T, np.eye(4), atol=1e-12)
    assert not flat[4:].any()
    variance = method.encode(shapes.vertices).var(0)
    assert (np.diff(variance) <= 0).all()
    centred = (shapes.vertices - shapes.vertices.mean(0)).reshape(len(shapes), -1)
    assert_allclose(variance.sum(), centred.var(0).sum())
    covariance = centred.T @ centred / len(shapes)
    assert_allclose(covariance @ flat[0], variance[0] * flat[0], atol=1e-12)


@pytest.mark.parametrize("Rival", METHODS)
def test_more_components_come_closer_on_training_and_unseen_shapes(Rival):
    shapes = sequence(24)
    seen, unseen = shapes.subset(np.arange(0, 24, 2)), shapes.vertices[1::2]
    errors = []
    for K in (2, 5, 10):
        method = Rival().fit(seen, K)
        errors.append([e_rms(v, rebuilt(method, v), "none") for v in (seen.vertices, unseen)])
        own = e_rms(unseen, method.decode(method.encode(unseen)), "none")
        assert errors[-1][1] <= own * (1 + 1e-9) <= 1.3 * errors[-1][1]
    assert (np.diff(errors, axis=0) < 0).all()


@pytest.mark.parametrize("method", [PCA(), ClusteredPCA(2)])
def test_training_shapes_are_exact_when_there_are_components_enough(method):
    # The rank of the whole is 4, and so is that of each of 2 regions.
    shapes = low_rank()
    method.fit(shapes, 8)
    assert_allclose(rebuilt(method, shapes.vertices), shapes.vertices, atol=1e-9)
    assert_allclose(method.decode(method.encode(shapes.vertices)), shapes.vertices, atol=1e-9)


@pytest.mark.parametrize("Rival", [SPLOCS, FACTORS])
def test_local_movements_are_found_with_their_supports(Rival):
    shapes, fields, codes = bumps()
    method = Rival().fit(shapes, 3)
    for field, code in zip(fields, codes.T, strict=True):
        found = method.basis.components
        overlap = np.abs((found * field).sum((1, 2)))
        component = found[overlap.argmax()]
        moved = np.linalg.norm(component, axis=1)
        assert moved[~field.any(1)].max() < 0.02 * moved.max()
        assert np.corrcoef(component.ravel(), field.ravel())[0, 1] ** 2 > 0.97
        fitted = method.fit_codes(shapes.vertices)[:, overlap.argmax()]
        assert np.corrcoef(fitted, code)[0, 1] ** 2 > 0.99


@pytest.mark.parametrize("Rival", LOCAL)
def test_components_of_a_whole_movement_are_local_but_not_those_of_pca(Rival):
    shapes = sequence(20, rings=31)
    support = [m.fit(shapes, 4).basis.components.any(2).mean() for m in (PCA(), Rival())]
    assert support[0] > 0.99  # rounding may leave a coordinate that is zero
    assert support[1] < 0.8


@pytest.mark.parametrize("Rival", METHODS)
def test_enough_handles_recover_a_shape_of_the_training_space(Rival):
    shapes, fields, _ = bumps()
    rng = np.random.default_rng(5)
    unseen = shapes.vertices[0] + np.tensordot(rng.uniform(-1, 1, (3, 3)), fields, 1)
    method = ClusteredPCA(3) if Rival is ClusteredPCA else Rival()
    method.fit(shapes, 9 if Rival is ClusteredPCA else 3)
    handles = farthest_points(Geodesics(shapes.mesh(0)), 60, 0)
    for shape in unseen:
        pose = method.fit_handles(handles, shape[handles])
        best = e_rms(shape, rebuilt(method, shape[None])[0], "none")
        assert e_rms(shape, pose, "none") < 1.2 * best + 1e-3 * 300
        if Rival in (PCA, SPLOCS):
            assert_allclose(pose, shape, atol=1e-4)


def test_a_few_handles_give_the_conditional_mean_of_a_gaussian():
    """With all of the variance in the basis and a tiny ridge, PCA regresses on the handles."""
    shapes = low_rank(rank=3, count=40)
    method = PCA().fit(shapes, 3)
    handle = np.array([7])
    pose = method.fit_handles(handle, shapes.vertices[5, handle])
    X = shapes.vertices.reshape(40, -1)
    mean = X.mean(0)
    covariance = (X - mean).T @ (X - mean) / 40
    at = 3 * 7 + np.arange(3)
    difference = shapes.vertices[5, 7] - mean[at]
    expected = mean + covariance[:, at] @ np.linalg.solve(covariance[np.ix_(at, at)], difference)
    assert_allclose(pose.ravel(), expected, atol=1e-6)


def tumbling(count=24):
    """The shapes of `bumps`, each turned and moved at random: the place tells nothing of a code."""
    shapes, fields, _ = bumps(count)
    rng = np.random.default_rng(11)
    moved = [p @ random_rotation(rng).T + 3.0 * rng.normal(size=3) for p in shapes.vertices]
    return MeshSequence(np.stack(moved), shapes.faces), fields


def test_the_body_is_placed_freely_where_its_place_says_nothing():
    shapes, fields = tumbling()
    method = PCA().fit(shapes, 3)
    handles = farthest_points(Geodesics(shapes.mesh(0)), 40, 0)
    assert method.choice(handles).free
    rng = np.random.default_rng(5)
    shape = bumps()[0].vertices[0] + np.tensordot(rng.uniform(-1, 1, 3), fields, 1)
    shape = shape @ random_rotation(rng).T + [5.0, -2.0, 1.0]
    pose = method.fit_handles(handles, shape[handles])
    # The training shapes are aligned to the first one, from which they differ a little.
    assert e_rms(shape, pose, "none") < 0.1 * e_rms(shape, shapes.vertices[0], "rigid")


def test_the_place_is_learned_where_the_code_tells_it():
    """Each shape turns by an angle that is one of its codes."""
    shapes, _, codes = bumps()
    turns = log_to_rotation(codes[:, :1] * [[0.0, 0.0, 1.0]])
    shapes = MeshSequence(shapes.vertices @ np.swapaxes(turns, 1, 2), shapes.faces)
    assert not PCA().fit(shapes, 8).choice(np.array([3, 200, 402])).free


@pytest.mark.parametrize("free", [False, True])
def test_errors_of_candidates_are_those_of_their_shapes(free):
    """The inner products of all vertices give what decoding each candidate gives."""
    shapes = tumbling()[0] if free else low_rank()
    V = align(shapes.vertices, shapes.vertices[0]) if free else shapes.vertices
    basis = PCA().fit(MeshSequence(V[4:], shapes.faces), 5).basis
    regression = HandleRegression(basis, V[4:], shapes.vertices[:4], free)
    handles = np.arange(0, 160, 21)
    found = regression.errors(handles, 0.1, 0.0)
    targets = shapes.vertices[:4, handles]
    expected = []
    for ridge in _RIDGES:
        placed = regression.fit(handles, targets, Penalty(0.1, 0.0, 0.0), np.array([ridge]))
        expected.append(((regression.decode(placed.first()) - shapes.vertices[:4]) ** 2).sum())
    assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * max(expected))


@pytest.mark.parametrize("Rival", [PCA, ClusteredPCA])
def test_noise_that_is_told_is_not_followed(Rival):
    """Handles that are known to be off count for less, and the mesh comes closer to the truth."""
    shapes, fields, _ = bumps()
    rng = np.random.default_rng(5)
    unseen = shapes.vertices[0] + np.tensordot(rng.uniform(-1, 1, (6, 3)), fields, 1)
    method = Rival().fit(shapes, 9)
    handles = farthest_points(Geodesics(shapes.mesh(0)), 20, 0)
    given = unseen[:, handles] + 0.1 * rng.normal(size=(6, 20, 3))
    errors = [
        e_rms(unseen, np.stack([method.fit_handles(handles, q, s) for q in given]), "none")
        for s in (0.0, 0.1)
    ]
    assert errors[1] < 0.95 * errors[0]
    assert method.choice(handles, 0.1).penalty.ridge > method.choice(handles).penalty.ridge


def test_the_ridge_grows_with_what_the_training_shapes_do_not_explain():
    clean = low_rank(rank=3, count=16)
    noise = np.random.default_rng(0).normal(size=clean.vertices.shape)
    noisy = MeshSequence(clean.vertices + 0.1 * noise, clean.faces)
    handles = np.arange(0, 60, 3)
    # As many components as there are: shapes left out must be unknown to the basis, too.
    ridges = [PCA().fit(s, 15).choice(handles).penalty.ridge for s in (clean, noisy)]
    assert ridges[0] < 1e-6 < 1e-3 < ridges[1]


def test_handles_stay_sober_when_there_are_fewer_than_components():
    shapes = sequence(24)
    seen, unseen = shapes.subset(np.arange(0, 24, 2)), shapes.vertices[1::2]
    handles = farthest_points(Geodesics(shapes.mesh(0)), 2, 0)
    spread = e_rms(unseen, np.broadcast_to(seen.vertices.mean(0), unseen.shape), "none")
    for Rival in (PCA, ClusteredPCA, SPLOCS, StructuredFactors):
        method = Rival().fit(seen, 10)
        poses = np.array([method.fit_handles(handles, shape[handles]) for shape in unseen])
        assert e_rms(unseen, poses, "none") < 0.6 * spread, Rival.name


@pytest.mark.parametrize("Rival", METHODS)
@pytest.mark.parametrize("scale", [2.0**-10, 2.0**9])
def test_results_scale_with_the_shapes(Rival, scale):
    (one, *_), (other, *_) = bumps(count=10), bumps(count=10, scale=scale)
    a, b = Rival().fit(one, 5), Rival().fit(other, 5)
    handles = np.array([3, 100, 250, 400])
    # The rounds of SPLOCS end when the objective falls by less than 1e-3: BLAS's rounding, which
    # depends on where arrays lie in memory, may add or leave out a round.
    tolerance = 2e-3 if Rival is SPLOCS else 1e-9
    for pose in (rebuilt, lambda m, v: m.fit_handles(handles, v[4, handles])):
        first, second = pose(a, one.vertices), pose(b, other.vertices)
        assert_allclose(second / scale, first, rtol=1e-7, atol=tolerance)


@pytest.mark.parametrize("Rival", METHODS)
def test_the_same_seed_gives_the_same(Rival):
    shapes = sequence(10)
    one, other = (Rival().fit(shapes, 5, seed=3) for _ in range(2))
    assert np.array_equal(one.basis.components, other.basis.components)
    handles = np.array([2, 60])
    target = shapes.vertices[3, handles]
    assert np.array_equal(one.fit_handles(handles, target), other.fit_handles(handles, target))


@pytest.mark.parametrize("Rival", METHODS)
def test_fitting_again_forgets_the_first_shapes(Rival):
    first, second = sequence(10), bumps(count=10)[0]
    method = Rival().fit(first, 4)
    method.fit_handles([1, 50], first.vertices[2, [1, 50]])
    method.fit(second, 4)
    fresh = Rival().fit(second, 4)
    target = second.vertices[2, [1, 50]]
    assert np.array_equal(method.fit_handles([1, 50], target), fresh.fit_handles([1, 50], target))


def test_regions_cover_the_mesh_overlap_at_faces_and_follow_what_moves_together():
    shapes, _, _ = bumps()
    (members,) = segment(shapes.vertices, shapes.mesh(0), [3], seed=0)
    assert members.shape[0] == 3
    assert members.any(0).all()
    for face in shapes.faces:
        assert members[:, face].all(1).any(), "a face belongs to a region as a whole"
    shared = members.sum(0) > 1
    assert 0 < shared.mean() < 0.2
    for place in (0.6, 2.0, 3.4):
        ring = np.abs(shapes.vertices[0, :, 0] - place) < 0.11
        assert (members[:, ring].all(1)).any()


def test_every_region_has_components_and_shared_vertices_are_means():
    shapes = sequence(16, rings=31)
    method = ClusteredPCA(4).fit(shapes, 9)
    basis = method.basis
    supports = basis.components.any(2)
    owner = [(supports[k] <= m).all() for m in basis.members for k in range(9)]
    assert np.array(owner).reshape(4, 9).any(1).all()
    # A region's components times the number of regions of each vertex are orthonormal.
    own = (basis.components * basis.members.sum(0)[:, None]).reshape(9, -1)
    gram = own @ own.T
    same = (supports[:, None] == supports).all(2)
    assert_allclose(gram[same], np.eye(9)[same], atol=1e-10)


def test_seams_measure_how_far_regions_disagree():
    shapes = sequence(16, rings=31)
    basis = ClusteredPCA(3).fit(shapes, 7).basis
    codes = np.random.default_rng(0).normal(size=7)
    own = basis.components * basis.members.sum(0)[:, None]
    mean = np.tensordot(codes, basis.components, 1)
    disagreement = 0.0
    for m in basis.members:
        of_region = (basis.components.any(2) <= m).all(1)
        prediction = np.tensordot(codes * of_region, own, 1)
        disagreement += (((prediction - mean) * m[:, None]) ** 2).sum()
    assert_allclose(((basis.seams @ codes) ** 2).sum(), disagreement)


def norm_of(mesh, **weights):
    return structured_norm(mesh, **{"l1": 0.0, "l2": 0.0, "group": 0.0, "graph": 0.0, **weights})


def test_structured_norm_by_hand():
    pairs, weights = np.array([[0, 1]]), np.array([4.0])
    factor = np.array([[[3.0, -4.0, 0.0], [0.0, 0.0, 0.0]]])
    for name, value in {"l1": 7.0, "l2": 5.0, "group": 4.0, "graph": 10.0}.items():
        one = {"l1": 0.0, "l2": 0.0, "group": 0.0, "graph": 0.0, name: 1.0}
        assert_allclose(StructuredNorm(pairs, weights, **one).values(factor), value)


def test_proximal_map_minimises():
    """No nearby point is lower, and each term alone has its known map."""
    mesh = tube(around=5, rings=6)
    norm = structured_norm(mesh)
    rng = np.random.default_rng(0)
    given = rng.normal(size=(2, 30, 3))
    scales = np.array([1.0, 3.0])
    dual = np.zeros((2, len(norm.pairs), 3))
    for _ in range(60):
        found = norm.proximal_map(given, scales, dual)

    def value(x):
        return ((x - given) ** 2).sum((1, 2)) / 2 + scales * norm.values(x)

    at_minimum = value(found)
    assert (at_minimum < value(0.97 * found)).all() and (at_minimum < value(1.03 * found)).all()
    for _ in range(200):
        step = 10.0 ** rng.uniform(-5, -1) * rng.normal(size=found.shape)
        assert (value(found + step) > at_minimum - 1e-9).all()
    assert not norm.proximal_map(given, np.full(2, 1e3), dual.copy()).any()

    still = np.zeros_like(dual)
    only = norm_of(mesh, l1=np.sqrt(90) * 0.5).proximal_map(given, np.ones(2), still)
    assert_allclose(only, np.sign(given) * np.maximum(0, np.abs(given) - 0.5))
    only = norm_of(mesh, l2=np.sqrt(90) * 2.0).proximal_map(given, np.ones(2), still)
    length = np.linalg.norm(given, axis=(1, 2), keepdims=True)
    assert_allclose(only, given * (1 - 2.0 / length))


def test_factorisation_never_raises_its_objective_and_stays_sparse():
    shapes = sequence(14, rings=31)
    data = shapes.vertices - shapes.vertices.mean(0)
    data = data / data.std()
    norm = structured_norm(shapes.mesh(0))
    found = factorise(data, norm, 6, 64.0, 60, seed=0)
    assert len(found.objective) > 30
    assert (np.diff(found.objective) < 0).all()
    assert found.objective[-1] < 0.3 * found.objective[0]
    lengths = np.linalg.norm(found.weights, axis=0)
    residual = data - np.tensordot(found.weights, found.factors, 1)
    charge = (
        64.0 * data.size / 6 * 1e-4 / np.sqrt(14) * (norm.values(found.factors) * lengths).sum()
    )
    assert_allclose(found.objective[-1], (residual**2).sum() / 2 + charge)
    supports = [
        factorise(data, norm, 6, strength, 60, seed=0).factors.any(2).mean()
        for strength in (0.0, 64.0, 400.0)
    ]
    assert supports[2] < supports[1] < supports[0]


def test_a_factor_of_two_regions_is_split_in_two():
    shapes, fields, codes = bumps()
    together = 2 * fields[0] + fields[2]
    data = codes[:, :1, None] * together
    norm = structured_norm(shapes.mesh(0))
    found = factorise(data / data.std(), norm, 1, 1.0, 60, seed=0)
    assert_allclose(found.factors[0].any(1), together.any(1))
    pieces = split(found, norm.pairs)
    assert_allclose(np.sum(pieces, axis=0), found.factors[0])
    for piece, field in zip(pieces, (fields[0], fields[2]), strict=True):
        assert_allclose(piece.any(1), field.any(1))


@pytest.mark.parametrize("strong", [500.0, 2000.0])
def test_a_weight_too_strong_for_as_many_factors_is_lessened(strong):
    shapes, _, _ = bumps()
    norm, data = structured_norm(shapes.mesh(0)), shapes.vertices - shapes.vertices.mean(0)
    assert len(split(factorise(data / data.std(), norm, 3, strong, 100, 0), norm.pairs)) < 3
    found = StructuredFactors(strength=strong).fit(shapes, 3).basis.components
    assert found.any((1, 2)).all()


@pytest.mark.parametrize("Rival", METHODS)
def test_shapes_that_do_not_move_have_empty_components(Rival):
    mesh = tube()
    shapes = MeshSequence(np.stack([mesh.vertices] * 4), mesh.faces)
    method = Rival().fit(shapes, 3)
    assert not method.fit_codes(shapes.vertices).any()
    assert_allclose(method.fit_handles([0, 9], mesh.vertices[[0, 9]] + 1.0), mesh.vertices)


def fitted():
    return PCA().fit(sequence(6), 3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: PCA().encode(np.zeros((1, 4, 3))), "nothing is learned yet; call fit first"),
        (lambda: PCA().fit(sequence(6), 0), "components: expected at least 1, got 0"),
        (lambda: PCA().fit(sequence(1), 2), "shapes: expected at least 2 to learn from, got 1"),
        (lambda: ClusteredPCA(0), "regions: expected at least 1, got 0"),
        (lambda: ClusteredPCA(5).fit(sequence(6), 3), "at least one for each of 5 regions, got 3"),
        (lambda: StructuredFactors(strength=-1), "strength: expected at least 0, got -1"),
        (lambda: StructuredFactors(iterations=0), "iterations: expected at least 1, got 0"),
        (lambda: fitted().encode(np.zeros((120, 3))), r"\(N, 120, 3\), got \(120, 3\)"),
        (lambda: fitted().encode(np.full((1, 120, 3), np.nan)), "finite"),
        (lambda: fitted().decode(np.zeros(3)), r"shape \(N, 3\), got \(3,\)"),
        (lambda: fitted().fit_handles([], np.zeros((0, 3))), "at least one vertex"),
        (lambda: fitted().fit_handles([0.5], np.zeros((1, 3))), "got float64"),
        (lambda: fitted().fit_handles([3, 120], np.zeros((2, 3))), "vertex 120 does not exist"),
        (lambda: fitted().fit_handles([3, -1], np.zeros((2, 3))), "vertex -1 does not exist"),
        (lambda: fitted().fit_handles([3, 4, 3], np.zeros((3, 3))), "vertex 3 is given twice"),
        (lambda: fitted().fit_handles([3, 4], np.zeros((2, 2))), r"\(2, 3\), got shape \(2, 2\)"),
        (lambda: fitted().fit_handles([3], [[0, np.nan, 0]]), "finite positions"),
        (lambda: fitted().fit_handles([3], [[0, 0, 0]], -1.0), "noise: expected a finite number"),
    ],
)
def test_bad_input_gives_one_line(call, message):
    with pytest.raises(InputError, match=message) as error:
        call()
    assert "\n" not in str(error.value)

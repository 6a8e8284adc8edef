"""Truths of the sparse factor: its solutions are those of a dense solve, on any number of tasks."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import splu

from deformer.linalg import sparse_cholesky
from deformer.linalg.sparse_cholesky import SparseCholesky
from graphs import GRAPHS, NAMES, definite
from shapes import icosphere, tube
from tolerances import tolerance


@pytest.fixture
def many_tasks(monkeypatch):
    """Four tasks also on small meshes, whatever the machine."""
    monkeypatch.setattr(sparse_cholesky, "_SMALLEST_PART", 50)
    monkeypatch.setattr(sparse_cholesky, "CORES", 4)


def factor(name):
    return SparseCholesky(definite(name), GRAPHS[name][2])


def solve_single(found, b):
    """`solve_in_order` for rows in the order of the matrix."""
    x = np.ascontiguousarray(b[found.order], dtype=np.float32)
    found.solve_in_order(x)
    return x[found.inverse_order]


def close(x, expected, dtype=np.float64, factor=1.0):
    size = np.abs(expected).max()
    np.testing.assert_allclose(x / size, expected / size, **tolerance(dtype, factor))


def weighted_laplacian(mesh, spread, rng):
    """A Laplacian with weights from 10^−spread to 10^spread, held at one vertex."""
    n, f = len(mesh.vertices), mesh.faces
    i, j = f.T.ravel(), np.roll(f, 1, axis=1).T.ravel()
    weights = sparse.coo_array((10 ** rng.uniform(-spread, spread, len(i)), (i, j)), shape=(n, n))
    weights = weights + weights.T
    degree = np.asarray(weights.sum(axis=1)).ravel()
    degree[0] += 1
    return sparse.csr_array(sparse.diags_array(degree) - weights)


@NAMES
def test_a_plan_is_used_again_for_the_same_sparsity_pattern(name):
    first, A = factor(name), definite(name)
    b = np.random.default_rng(2).normal(size=(A.shape[0], 2))
    same = SparseCholesky(A + sparse.diags_array(A.diagonal()), GRAPHS[name][2], first.plan)
    assert same.plan is first.plan
    double = A.toarray() + np.diag(A.diagonal())
    close(same.solve(b), np.linalg.solve(double, b))
    # Another graph, for which the plan is wrong.
    other = sparse.csr_array(sparse.diags_array(A.diagonal()))
    found = SparseCholesky(other, GRAPHS[name][2], first.plan)
    close(found.solve(b), b / A.diagonal()[:, None])
    assert (found.plan is first.plan) == (A.nnz == other.nnz)


@NAMES
def test_solution_is_that_of_a_dense_solve(name):
    found, A = factor(name), definite(name).toarray()
    b = np.random.default_rng(1).normal(size=(len(A), 131))
    expected = np.linalg.solve(A, b)
    start = 0
    for columns in (1, 3, 7, 120):
        part = slice(start, start + columns)
        x = found.solve(b[:, part])
        assert x.dtype == np.float64
        close(x, expected[:, part], factor=10)
        start += columns
    assert found.solve(b[:, :0]).shape == (len(A), 0)


@NAMES
def test_single_precision(name):
    found, A = factor(name), definite(name).toarray()
    b = np.random.default_rng(2).normal(size=(len(A), 3))
    x = solve_single(found, b)
    assert x.dtype == np.float32
    close(x, np.linalg.solve(A, b), np.float32)


@pytest.mark.parametrize("name", ["ball", "two", "coincident", "path", "star", "no edges", "hubs"])
def test_tasks_give_what_one_gives(name, many_tasks, monkeypatch):
    parts = factor(name)
    monkeypatch.setattr(sparse_cholesky, "CORES", 1)
    whole = factor(name)
    assert len(whole.plan.tasks) == 2
    assert len(parts.plan.tasks) == 5
    b = np.random.default_rng(3).normal(size=(len(parts.order), 7))
    close(parts.solve(b), whole.solve(b))
    close(*(solve_single(found, b[:, :3]) for found in (parts, whole)), np.float32)


def test_right_hand_sides_stay_as_they_are():
    """Also where no copy is needed to order them: any layout and dtype."""
    found, A = factor("no edges"), definite("no edges").toarray()
    b = np.random.default_rng(4).integers(-9, 9, (len(A), 3))
    for given in (b, b.astype(float), np.asfortranarray(b, dtype=float), b[::-1].astype(float)):
        kept = given.copy()
        given.flags.writeable = False
        close(found.solve(given), np.linalg.solve(A, given))
        np.testing.assert_array_equal(given, kept)


def test_threads_share_a_factor(many_tasks):
    found = factor("ball")
    b = np.random.default_rng(5).normal(size=(8, len(found.order), 3))
    expected = [found.solve(x) for x in b]
    with ThreadPoolExecutor(2) as pool:
        for _ in range(10):
            for x, y in zip(pool.map(found.solve, b), expected, strict=True):
                np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-14)
            for x, y in zip(pool.map(lambda x: solve_single(found, x), b), expected, strict=True):
                close(x, y, np.float32)


def test_a_task_writes_only_its_own_rows(many_tasks, monkeypatch):
    """What several would write to, each keeps apart."""
    found = factor("ball")
    n, starts = len(found.order), found.plan.starts
    checked = []

    def one_by_one(kernel, calls):
        for call in calls:
            (x,) = (a for a in call if np.shape(a)[:1] == (n,) and np.ndim(a) == 2)
            before = x.copy()
            kernel(*call)
            others = np.delete(np.arange(n), np.arange(starts[call[0]], starts[call[1]]))
            np.testing.assert_array_equal(x[others], before[others])
            checked.append(kernel)

    monkeypatch.setattr(sparse_cholesky, "run_calls", one_by_one)
    b = np.random.default_rng(6).normal(size=(n, 7))
    expected = np.linalg.solve(definite("ball").toarray(), b)
    close(found.solve(b), expected, factor=10)
    close(solve_single(found, b[:, :3]), expected[:, :3], np.float32)
    assert len(checked) == 4 * 4


@pytest.mark.parametrize("kind", [sparse.csr_array, sparse.csc_array, sparse.coo_array])
def test_formats_and_entries_in_halves(kind):
    A = definite("tube")
    halves = np.repeat(A.data / 2, 2), np.repeat(A.indices, 2), 2 * A.indptr
    b = np.random.default_rng(6).normal(size=(A.shape[0], 3))
    expected = factor("tube").solve(b)
    close(SparseCholesky(kind(A), GRAPHS["tube"][2]).solve(b), expected)
    close(SparseCholesky(kind(sparse.csr_array(halves)), GRAPHS["tube"][2]).solve(b), expected)


@pytest.mark.parametrize("mesh", [tube(12, 30), icosphere(3)], ids=["tube", "ball"])
@pytest.mark.parametrize(("spread", "residual"), [(0, 1e-13), (3, 1e-10), (6, 1e-7), (9, 1e-4)])
def test_ill_scaled_matrices(mesh, spread, residual):
    """Weights as of slivers: solutions are as near to the truth as those of another solver.

    Explicit inverses of blocks leave larger residuals than substitution does.
    """
    rng = np.random.default_rng(7)
    A = weighted_laplacian(mesh, spread, rng)
    x = rng.normal(size=(A.shape[0], 3))
    b = A @ x
    found = SparseCholesky(A, mesh.vertices).solve(b)
    other = splu(sparse.csc_array(A), diag_pivot_thresh=0, options={"SymmetricMode": True}).solve(b)
    assert np.abs(found - x).max() < 20 * np.abs(other - x).max()
    assert np.abs(A @ found - b).max() < residual * np.abs(b).max()


@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf])
def test_a_matrix_that_is_not_definite_is_refused(value):
    points = GRAPHS["ball"][2]
    with pytest.raises(np.linalg.LinAlgError, match=r"not positive definite|infs or NaNs"):
        SparseCholesky(value * sparse.eye_array(len(points)), points)


def test_a_matrix_that_is_indefinite_only_as_a_whole_is_refused():
    """Each diagonal entry is positive, a sum over all is not."""
    mesh = icosphere(3)
    A = weighted_laplacian(mesh, 0, np.random.default_rng(8))
    A = A - 0.1 * sparse.eye_array(A.shape[0])
    assert A.diagonal().min() > 0 and A.sum() < 0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        SparseCholesky(A, mesh.vertices)


def test_bytes_per_solve():
    """Blocks (w + m, w) and their lower parts (m, w) once more, of four bytes."""
    found = factor("ball")
    w, m = np.diff(found.plan.starts), np.diff(found.plan.bounds)
    assert found.bytes_per_solve == 4 * (w * (w + 2 * m)).sum()


@pytest.mark.parametrize("seed", range(3))
def test_nearly_singular_matrices(seed):
    """Grams of fewer vectors than rows, definite by a ridge alone: rounding must not undo it."""
    mesh = icosphere(3)
    rng = np.random.default_rng(seed)
    n = len(mesh.vertices)
    some = rng.choice(n, n // 2, replace=False)
    M = weighted_laplacian(mesh, 2, rng)[some]
    gram = M.T @ M
    gram = gram + 1e-10 * gram.diagonal().mean() * sparse.eye_array(n)
    b = gram @ rng.normal(size=(n, 1))
    found = SparseCholesky(gram, mesh.vertices).solve(b)
    assert (
        np.abs(M @ found - M @ np.linalg.lstsq(gram.toarray(), b)[0]).max()
        < 1e-3 * np.abs(M @ found).max()
    )

"""Graphs that sparse factorisations are tested on."""

import numpy as np
import pytest
from scipy import sparse

from deformer.geometry.mesh import Mesh, edges
from shapes import MESHES, icosphere, join, tube


def _graphs():
    """Name: number of vertices, edges (E, 2), points (n, 3)."""
    rng = np.random.default_rng(0)
    meshes = {**MESHES, "ball": icosphere(3)}
    moved = icosphere(2)
    meshes["two"] = join(tube(12, 30), Mesh(moved.vertices + np.array([0.5, 0, 0]), moved.faces))
    found = {k: (len(m.vertices), edges(m.faces), m.vertices) for k, m in meshes.items()}

    n, pairs, points = found["ball"]
    shuffled = rng.permutation(n)[pairs]
    found["coincident"] = n, shuffled, np.zeros((n, 3))
    found["scattered"] = n, shuffled, rng.normal(size=(n, 3))

    place = rng.permutation(500)
    line = np.empty((500, 3))
    line[place] = np.outer(np.arange(500), [1.0, 0, 2.0])
    found["path"] = 500, np.column_stack([place[:-1], place[1:]]), line

    others = np.delete(np.arange(300), 137)
    star = np.column_stack([np.full(299, 137), others])
    found["star"] = 300, star, rng.normal(size=(300, 3))

    cells = np.arange(512).reshape(8, 8, 8)
    steps = [
        (cells[1:], cells[:-1]),
        (cells[:, 1:], cells[:, :-1]),
        (cells[..., 1:], cells[..., :-1]),
    ]
    pairs = np.concatenate([np.column_stack([a.ravel(), b.ravel()]) for a, b in steps])
    found["cube"] = 512, pairs, np.argwhere(cells >= 0).astype(float)

    # Many small pieces below many hubs: more rows than there was room for at first.
    hub, other = np.arange(250), np.arange(250, 1250)
    pairs = np.stack(np.meshgrid(hub, other), -1).reshape(-1, 2)
    points = rng.normal(size=(1250, 3)) + np.outer(np.arange(1250) < 250, [20.0, 0, 0])
    found["hubs"] = 1250, pairs, points

    found["complete"] = 70, np.column_stack(np.triu_indices(70, 1)), rng.normal(size=(70, 3))
    found["no edges"] = 200, np.empty((0, 2), dtype=int), rng.normal(size=(200, 3))
    found["one vertex"] = 1, np.empty((0, 2), dtype=int), np.ones((1, 3))
    return found


GRAPHS = _graphs()
NAMES = pytest.mark.parametrize("name", GRAPHS)


def definite(name, seed=0):
    """A random symmetric positive definite matrix of that graph, well conditioned."""
    n, pairs, _ = GRAPHS[name]
    rng = np.random.default_rng(seed)
    half = sparse.coo_array((rng.uniform(-1, 1, len(pairs)), tuple(pairs.T)), shape=(n, n))
    A = sparse.csr_array(half + half.T)
    return sparse.csr_array(A + sparse.diags_array(np.asarray(abs(A).sum(axis=1)).ravel() + 0.5))

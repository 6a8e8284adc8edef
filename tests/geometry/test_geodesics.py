"""Truths of geodesic distances and of farthest-point sampling."""

import json
import os
import subprocess
import sys
import time
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from deformer import Geodesics, farthest_points
from deformer.errors import InputError
from deformer.geometry.mesh import Mesh, connected_components
from paths import ROOT
from shapes import awkward, icosphere, strip, tube, two_components


def random_pairs(V, count=10):
    return np.random.default_rng(0).choice(V, size=(count, 2), replace=False)


def test_distances_in_a_plane_are_euclidean():
    mesh = strip(41, 41, 1.0, 1.0)
    geodesics = Geodesics(mesh)
    for source in (0, 20 * 41 + 20, 1000):
        expected = np.linalg.norm(mesh.vertices - mesh.vertices[source], axis=1)
        # Within 4 % of the distance, beside the width of a cell.
        np.testing.assert_allclose(geodesics.row(source), expected, rtol=0.04, atol=0.5 / 40)
        assert geodesics.row(source)[source] == 0


def test_distances_on_a_sphere_are_arcs():
    mesh = icosphere(3, radius=2.0)
    geodesics = Geodesics(mesh)
    arcs = 2.0 * np.arccos(np.clip(mesh.vertices @ mesh.vertices[5] / 4, -1, 1))
    np.testing.assert_allclose(geodesics.row(5), arcs, rtol=0.05, atol=0.1)
    np.testing.assert_allclose(geodesics.extent, 2 * np.pi, rtol=0.05)
    np.testing.assert_allclose(geodesics.normalised_row(5), geodesics.row(5) / geodesics.extent)


@pytest.mark.parametrize("mesh", [tube(16, 31), icosphere(3)], ids=["tube", "sphere"])
def test_distances_are_nearly_symmetric(mesh):
    geodesics = Geodesics(mesh)
    for i, j in random_pairs(len(mesh.vertices)):
        there, back = geodesics.row(i)[j], geodesics.row(j)[i]
        assert abs(there - back) < 0.03 * geodesics.extent


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_distances_have_the_unit_of_the_mesh(unit):
    mesh = tube()
    large = Geodesics(Mesh(unit * mesh.vertices, mesh.faces))
    small = Geodesics(mesh)
    np.testing.assert_allclose(large.row(7), unit * small.row(7), rtol=1e-6)
    np.testing.assert_allclose(large.extent, unit * small.extent, rtol=1e-6)
    np.testing.assert_allclose(large.normalised_row(7), small.normalised_row(7), rtol=1e-6)


def test_other_components_are_reached_over_links():
    mesh = two_components()
    labels = connected_components(mesh.faces, len(mesh.vertices))[1]
    (i, j), geodesics = mesh.links[0], Geodesics(mesh)
    row = geodesics.row(3)
    other = labels != labels[3]
    end = j if labels[3] == labels[j] else i
    gap = np.linalg.norm(mesh.vertices[i] - mesh.vertices[j])
    # Through the link, and no way is shorter than the straight one.
    assert row[i + j - end] == pytest.approx(row[end] + gap, rel=0.1)
    assert (row[other] > row[end]).all()
    straight = np.linalg.norm(mesh.vertices - mesh.vertices[3], axis=1)
    assert (row[other] >= straight[other] * (1 - 1e-12)).all()


@pytest.mark.filterwarnings("error")
def test_awkward_meshes_have_distances():
    """Slivers, coincident vertices and a vertex without a face."""
    mesh = awkward()
    V = len(mesh.vertices)
    geodesics = Geodesics(mesh)
    for i in (0, 20, 21, 45, V - 3):
        row = geodesics.row(i)
        assert np.isfinite(row).all() and (row >= 0).all()
    assert geodesics.row(20)[21] < 0.1
    alone = geodesics.row(V - 1)
    assert alone[-1] == 0 and alone[:-1].min() > 1.9
    assert len(set(farthest_points(geodesics, V, seed=1))) == V


def test_threads_may_share_the_rows():
    """Also while rows are dropped: between a look-up and its row, another thread may drop it."""

    class Slow(OrderedDict):
        def __contains__(self, vertex):
            found = super().__contains__(vertex)
            time.sleep(1e-4)
            return found

    mesh = tube(6, 9)
    expected = [Geodesics(mesh).row(vertex) for vertex in range(3)]
    shared = Geodesics(mesh, cache_rows=2)
    shared._cache = Slow()

    def ask(first):
        for n in range(60):
            assert np.array_equal(shared.row((first + n) % 3), expected[(first + n) % 3])

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(ask, range(3)))


def test_rows_are_kept_and_cannot_be_written():
    geodesics = Geodesics(tube(), cache_rows=2)
    first = geodesics.row(1)
    assert geodesics.row(1) is first
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 1.0
    geodesics.row(2)
    geodesics.row(3)
    # Row 1 has left the cache; it comes out the same again.
    np.testing.assert_array_equal(geodesics.row(1), first)


@pytest.mark.parametrize("vertex", [-1, 120])
def test_vertices_that_do_not_exist_are_refused(vertex):
    with pytest.raises(InputError, match=f"vertex {vertex} .*0…119"):
        Geodesics(tube()).row(vertex)


def test_farthest_points_are_different_seeded_and_spread():
    mesh = icosphere(3)
    geodesics = Geodesics(mesh)
    chosen = farthest_points(geodesics, 20, seed=4)
    assert len(set(chosen)) == 20 and chosen.dtype == np.int64
    np.testing.assert_array_equal(farthest_points(geodesics, 20, seed=4), chosen)
    assert any((farthest_points(geodesics, 20, seed=s) != chosen).any() for s in (5, 6))
    # More points are the same ones and then others.
    np.testing.assert_array_equal(farthest_points(geodesics, 25, seed=4)[:20], chosen)

    def separation(vertices):
        directions = mesh.vertices[vertices]
        cosines = (directions @ directions.T)[~np.eye(len(vertices), dtype=bool)]
        return np.arccos(np.clip(cosines, -1, 1)).min()

    # 20 caps of this radius cover 20 · (1 − cos r)/2 ≥ 1 of the sphere at r = 0.45.
    assert separation(chosen) > 0.45
    rng = np.random.default_rng(0)
    at_random = [rng.choice(len(mesh.vertices), 20, replace=False) for _ in range(5)]
    assert separation(chosen) > 2 * max(separation(vertices) for vertices in at_random)


def test_each_point_is_the_farthest_from_those_before():
    geodesics = Geodesics(tube(12, 21))
    chosen = farthest_points(geodesics, 8, start=[17])
    assert chosen[0] == 17
    for n in range(1, 8):
        nearest = np.min([geodesics.row(int(i)) for i in chosen[:n]], axis=0)
        assert nearest[chosen[n]] == nearest.max()
    np.testing.assert_array_equal(farthest_points(geodesics, 5, start=chosen[:3]), chosen[:5])


def test_points_are_different_even_where_all_distances_are_zero():
    class Nowhere(Geodesics):
        def row(self, vertex):
            return np.zeros(len(self.mesh.vertices))

    assert len(set(farthest_points(Nowhere(tube()), 120, seed=0))) == 120


def test_every_component_gets_a_point_early():
    mesh = two_components()
    labels = connected_components(mesh.faces, len(mesh.vertices))[1]
    for seed in range(4):
        assert set(labels[farthest_points(Geodesics(mesh), 2, seed=seed)]) == {0, 1}


@pytest.mark.parametrize("count", [0, 121])
def test_impossible_counts_are_refused(count):
    with pytest.raises(InputError, match="1…120"):
        farthest_points(Geodesics(tube()), count, seed=0)


_MEMORY = """
import json
import numpy as np
from deformer import Geodesics, PoissonSystem, farthest_points
from deformer.acap.features import FeatureExtractor
from memory import peak_memory
from shapes import strip, tube

mesh = strip(200, 200, 1.0, 1.0)
small = tube()
Geodesics(small).row(0), FeatureExtractor(small).extract(small.vertices), PoissonSystem(small)
before = peak_memory()
geodesics = Geodesics(mesh)
chosen = farthest_points(geodesics, 20, seed=0)
extractor = FeatureExtractor(mesh)
system = PoissonSystem(mesh)
system.reconstruct(extractor.extract(mesh.vertices))
system.position_coefficients(system.green_rows(chosen))
print(json.dumps({"V": len(mesh.vertices), "growth": peak_memory() - before}))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="resource is not there")
def test_memory_does_not_grow_with_the_square_of_the_vertices():
    """40,000 vertices: V × V floats would be 12.8 GB, V × 20 are 6 MB; peak growth < 0.6 GB."""
    environment = dict(os.environ)
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(ROOT / "tests" / "helpers")])
    environment["OMP_NUM_THREADS"] = "1"
    done = subprocess.run(
        [sys.executable, "-c", _MEMORY], env=environment, capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["V"] == 40_000
    assert found["growth"] < 0.6e9

"""Tiles in a file give the numbers that tiles in memory give, and the same factorisation."""

import numpy as np
import pytest

from deformer.training import site_tiles
from deformer.training.site_tiles import SiteTiles, sites_of_a_tile
from deformer.training.sparse_components import Factorisation, LocalisedSettings
from deformer.workspace import LEAST_MEMORY, StoredArray, Workspace

N, M, D = 7, 53, 3
LINE = np.linspace(0.0, 1.0, M)


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    monkeypatch.setattr(site_tiles, "_TILE", 100)
    monkeypatch.setattr(site_tiles, "_LEAST_SITES", 4)


@pytest.fixture
def values():
    return np.random.default_rng(0).normal(size=(N, M, D)).astype(np.float32)


def stored(values, folder):
    """Tiles in a file."""
    tiles = SiteTiles(values.shape, values.dtype, Workspace(LEAST_MEMORY, folder))
    assert isinstance(tiles.tiles, StoredArray)
    tiles.write(0, values[:4])
    tiles.write(4, values[4:])
    return tiles


def whole(tiles):
    out = np.concatenate([tile for tile in (t.copy() for _, t in tiles.each())], axis=1)
    return out.reshape(tiles.shape)


def test_tiles_hold_every_number_once(values, tmp_path):
    assert sites_of_a_tile(N, M, D) == 4
    for tiles in (SiteTiles.of(values), stored(values, tmp_path)):
        assert tiles.count == 14
        np.testing.assert_array_equal(whole(tiles), values)
        np.testing.assert_array_equal(tiles.read(slice(2, 5)), values[2:5])
        np.testing.assert_array_equal(tiles.site(52), values[:, 52])
        np.testing.assert_array_equal(whole(tiles.subset(np.array([5, 0, 0]))), values[[5, 0, 0]])
        doubled = tiles.map(lambda part: 2.0 * part, np.float64)
        assert doubled.dtype == np.float64
        np.testing.assert_array_equal(whole(doubled), 2.0 * values)
        doubled.divide(4.0)
        np.testing.assert_array_equal(whole(doubled), 0.5 * values)
    assert not any(tmp_path.iterdir())  # files without a name


@pytest.mark.parametrize("signed", [True, False])
def test_a_factorisation_does_not_depend_on_where_the_data_are(values, tmp_path, signed):
    states = []
    for data in (SiteTiles.of(values), stored(values, tmp_path)):
        problem = Factorisation(
            data, lambda site: np.abs(LINE - LINE[site]), 4, LocalisedSettings(0.5, signed=signed)
        )
        problem.start()
        for _ in range(5):
            problem.round()
        states.append((problem.terms(), problem.state))
    assert states[0][0] == states[1][0]
    for name, array in states[0][1].items():
        np.testing.assert_array_equal(states[1][1][name], array)


def test_a_factorisation_by_tiles_is_that_of_one_tile(values, monkeypatch):
    found = []
    for numbers in (100, 10**6):
        monkeypatch.setattr(site_tiles, "_TILE", numbers)
        data = SiteTiles.of(values.astype(np.float64))
        assert (data.count == 1) == (numbers > 100)
        problem = Factorisation(
            data, lambda site: np.abs(LINE - LINE[site]), 4, LocalisedSettings(0.5)
        )
        problem.start()
        residual = values - (problem.W @ problem.C).reshape(values.shape)
        assert problem.terms()[0] == pytest.approx(0.5 * np.square(residual).sum())
        for _ in range(5):
            problem.round()
        found.append(problem)
    one, other = found
    np.testing.assert_allclose(one.W, other.W, atol=1e-9)
    np.testing.assert_allclose(one.C, other.C, atol=1e-9)
    assert one.objective() == pytest.approx(other.objective(), rel=1e-12)


def test_the_start_takes_the_site_of_the_largest_residual(values):
    """As plain deflation does, with the residual itself."""
    X = values.astype(np.float64)
    problem = Factorisation(
        SiteTiles.of(X), lambda site: np.abs(LINE - LINE[site]), 6, LocalisedSettings(0.5)
    )
    problem.start()
    residual = X.copy()
    for k in range(6):
        assert problem.centres[k] == np.square(residual).sum(axis=(0, 2)).argmax()
        component = problem.C[k].reshape(M, D)
        residual -= problem.W[:, k, None, None] * component

"""The comparison of components on the noisy flag: its measures are what they say."""

import json
from functools import cache

import numpy as np
import pytest
from flag.cloth import Fabric, Simulation, rectangle
from flag.comparison import (
    EdgeComponents,
    NetworkComponents,
    corner_shares,
    explained,
    motion_shares,
    rebuilt,
    strongest,
    swing_explained,
)
from flag.noise import add_noise
from flag.quality import swing_angles
from flag.wind import turbulent_wind
from PIL import Image

import deformer
from deformer import MeshSequence
from deformer.baselines.edges import EdgeSplocs

pytestmark = pytest.mark.slow

COLUMNS, ROWS = 13, 9


@cache
def frames():
    """21 frames of a coarse flag, the flat one first."""
    cloth = rectangle(COLUMNS, ROWS, 0.12, Fabric())
    flag = Simulation(cloth, turbulent_wind(np.random.default_rng(0)))
    shapes = [cloth.rest]
    for _ in range(20):
        flag.run(0.1)
        shapes.append(flag.x.copy())
    return MeshSequence(np.stack(shapes), cloth.faces)


@cache
def network():
    return NetworkComponents(deformer.train(frames(), 5, epochs=20))


@cache
def edges():
    return EdgeComponents(EdgeSplocs(noise=0.03).fit(frames(), 5), frames().vertices)


class Table:
    """Components whose codes are some coordinates of vertex 0."""

    name = "table"
    reference = np.zeros(3)
    extremes = strengths = np.array([1.0, 3.0, 2.0])
    supports = np.zeros((3, COLUMNS * ROWS))

    def codes(self, vertices):
        return vertices[:, 0]

    def support(self, component):
        return self.supports[component]


def test_motion_shares_part_motion_from_noise():
    rng = np.random.default_rng(0)
    clean = np.zeros((20000, 1, 3))
    clean[:, 0] = rng.normal(size=(20000, 3)) * [1.0, 2.0, 0.0]
    noisy = clean + rng.normal(size=clean.shape) * [0.0, 1.0, 1.0]
    shares = motion_shares(Table(), clean, noisy)
    np.testing.assert_allclose(shares, [1.0, 0.8, 0.0], atol=0.01)


def test_swing_explained_is_one_where_an_activation_is_the_angle():
    shapes, rng = frames().vertices[1:], np.random.default_rng(1)
    told = np.zeros_like(shapes)
    told[:, 0, 0] = 3.0 - 0.5 * swing_angles(shapes, (COLUMNS, ROWS))
    told[:, 0, 1] = rng.normal(size=len(shapes))
    table, shape = Table(), (COLUMNS, ROWS)
    assert swing_explained(table, shapes, told, np.array([0]), shape) == pytest.approx(1.0)
    assert swing_explained(table, shapes, told, np.array([1]), shape) < 0.3


def test_strongest_come_first_and_corner_shares_are_of_the_free_corners():
    assert strongest(Table(), 2).tolist() == [1, 2]
    table, rest = Table(), frames().vertices[0]
    table.supports = np.zeros((3, len(rest)))
    table.supports[0, -1] = 1.0  # the upper free corner
    table.supports[1, [0, -ROWS]] = 1.0  # at the pole, and the lower free corner
    table.supports[2, :ROWS] = 1.0
    np.testing.assert_allclose(corner_shares(table, rest), [1.0, 0.5, 0.0])


def test_explained_is_one_for_the_frames_and_zero_for_the_flat_flag():
    shapes, rest = frames().vertices[1:], frames().vertices[0]
    flat = np.broadcast_to(rest, shapes.shape)
    assert explained(shapes, shapes + 3.0, rest) == pytest.approx(1.0)
    assert explained(shapes, flat - 2.0, rest) == pytest.approx(0.0, abs=1e-9)


def test_explained_can_leave_out_rigid_motion_and_does_not_by_itself():
    shapes, rest = frames().vertices[1:], frames().vertices[0]
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # the wind turned
    flat = np.broadcast_to(rest, shapes.shape)
    assert explained(shapes, shapes @ R.T + 3.0, rest, rigid=True) == pytest.approx(1.0)
    assert explained(shapes, flat @ R.T, rest, rigid=True) == pytest.approx(0.0, abs=1e-9)
    assert explained(shapes, shapes @ R.T, rest) < 0.0


@pytest.mark.parametrize("learned", [network, edges])
def test_all_components_rebuild_what_the_method_does_and_none_the_reference(learned):
    components, some = learned(), frames().vertices[[4, 9]]
    everything = np.arange(5)
    whole = components.shapes(components.codes(some))
    np.testing.assert_allclose(rebuilt(components, some, everything), whole, atol=1e-9)
    still = rebuilt(components, some, everything[:0])
    np.testing.assert_allclose(still, components.shapes(components.reference[None])[[0, 0]])
    rest = frames().vertices[0]
    assert explained(some, whole, rest, rigid=True) > 0.5
    for k in range(5):
        support = components.support(k)
        assert support.shape == (len(rest),)
        assert support.max() == pytest.approx(1.0)
        assert support.min() >= 0.0


def test_strength_of_an_edge_component_is_the_change_of_features_it_makes():
    components = edges()
    method = EdgeSplocs(noise=0.03).fit(frames(), 5)
    weights = method.weights(frames().vertices)
    for k in range(5):
        away = (weights[:, k] - weights[0, k])[:, None, None] * method.components[k]
        sizes = np.sqrt((away**2).sum(axis=(1, 2)))
        assert components.strengths[k] == pytest.approx(sizes.max())
        assert components.extremes[k] == pytest.approx(weights[sizes.argmax(), k])


def test_strength_of_a_network_component_is_the_farther_end():
    model = deformer.train(frames(), 3, epochs=5)
    components = NetworkComponents(model)
    base = model.scaler.scale(model.decoder.features(components.reference))
    for k in range(3):
        for end in (model.codes[:, k].min(), model.codes[:, k].max()):
            code = components.reference.copy()
            code[k] = end
            far = np.sqrt(((model.scaler.scale(model.decoder.features(code)) - base) ** 2).sum())
            if end == components.extremes[k]:
                assert far == pytest.approx(components.strengths[k])
            else:
                assert far <= components.strengths[k]


def test_the_example_runs_and_its_model_is_kept(load_example, tmp_path, monkeypatch):
    example = load_example("11_flag_components")
    clean = frames().vertices
    noisy = add_noise(clean, 0.002, np.random.default_rng(0))
    files = [tmp_path / "clean.npz", tmp_path / "noisy.npz"]
    for file, vertices in zip(files, (clean, noisy), strict=True):
        np.savez(file, vertices=vertices, faces=frames().faces)
    out = tmp_path / "out"
    monkeypatch.setattr(example, "SIZE", (60, 50))
    example.main(*files, out, components=4, epochs=3, stills=2)
    results = json.loads((out / "results.json").read_text())
    assert set(results) == {"Deformer", "SPLOCS edges"}
    assert all(sorted(row["components"]) == [0, 1, 2, 3] for row in results.values())
    assert Image.open(out / "components.png").width > 5 * 60
    model = deformer.load_model(out / "model")
    assert model.split == {"train": [0, 5, 10, 15, 20], "test": model.split["test"]}
    # What takes the noise off hardly changes the frame that has none.
    assert np.abs(model.reference.vertices - clean[0]).mean() < 0.1 * 0.002
    before = (out / "model" / "weights.safetensors").stat().st_mtime_ns
    example.main(*files, out, components=4, epochs=3, stills=2)
    assert (out / "model" / "weights.safetensors").stat().st_mtime_ns == before

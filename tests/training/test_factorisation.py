"""Truths of training by alternating least squares: monotone, exact to resume, a true decoder."""

import signal
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.scaler import FeatureScaler
from deformer.errors import InputError
from deformer.geometry.geodesics import Geodesics
from deformer.geometry.mesh import one_rings
from deformer.network.config import FactorisationSettings, ModelConfig, resolve_config
from deformer.network.decoder import Decoder
from deformer.training.checkpoints import has_checkpoint
from deformer.training.factorisation import factor
from deformer.training.sparse_components import Factorisation
from shapes import sequence

CONFIG = ModelConfig(components=4, training=FactorisationSettings(epochs=12, sparsity=2.0))


@pytest.fixture(scope="module")
def data():
    """Scaled features, their scaler and geodesics of the small sequence."""
    shapes = sequence(8)
    extractor = FeatureExtractor(shapes.mesh(0))
    q = extract_all(extractor, shapes.vertices)
    scaler = FeatureScaler.fit(q)
    return scaler.scale(q), scaler, Geodesics(shapes.mesh(0))


def stop_after(epochs):
    def stop(progress):
        if progress.done == epochs:
            raise KeyboardInterrupt

    return stop


def test_the_loss_never_rises_and_its_terms_are_reported(data):
    seen = []
    result = factor(*data, CONFIG, on_progress=seen.append)
    assert [p.done for p in seen] == list(range(1, 13))
    losses = [p.loss for p in seen]
    assert all(b <= a * (1 + 1e-5) for a, b in pairwise(losses))
    assert losses[-1] < losses[0]
    for p in seen:
        assert p.stage == "training" and p.total == 12 and p.range == 0.0
        assert p.loss == pytest.approx(p.reconstruction + p.sparsity)
    assert (result.loss, result.reconstruction) == (seen[-1].loss, seen[-1].reconstruction)
    assert result.epochs == 12 and not result.interrupted


def test_code_zero_is_the_undeformed_shape(data):
    """And training shapes come back from their projections the better, the more components."""
    x, scaler, geodesics = data
    mesh = geodesics.mesh
    rings = one_rings(mesh.faces, len(mesh.vertices))
    errors = []
    for components in (1, 3, 6):
        config = replace(CONFIG, components=components).with_training(sparsity=0.05, epochs=30)
        decoder = Decoder(factor(*data, config).weights, scaler, *rings)
        rest = decoder.features(np.zeros(components))
        np.testing.assert_allclose(
            rest, np.tile([0, 0, 0, 1, 0, 0, 1, 0, 1], (len(rest), 1)), atol=1e-5
        )
        q = scaler.unscale(x)
        back = np.array([decoder.features(decoder.project(features)) for features in q])
        errors.append(np.square(back - q).sum())
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("stops", [(5,), (1, 4, 11)], ids=str)
def test_resuming_is_exact(data, stops, tmp_path):
    whole = factor(*data, CONFIG)
    for n, epochs in enumerate(stops):
        part = factor(
            *data, CONFIG, checkpoint=tmp_path, resume=n > 0, on_progress=stop_after(epochs)
        )
        assert part.interrupted and part.epochs == epochs
    resumed = factor(*data, CONFIG, checkpoint=tmp_path, resume=True)
    assert not resumed.interrupted and resumed.epochs == 12
    for name, array in whole.weights.arrays.items():
        np.testing.assert_array_equal(resumed.weights.arrays[name], array, err_msg=name)
    assert (resumed.loss, resumed.reconstruction) == (whole.loss, whole.reconstruction)
    assert resumed.seconds > part.seconds


def test_resuming_makes_no_start_of_its_own(data, tmp_path, monkeypatch):
    begun = []
    monkeypatch.setattr(
        Factorisation, "start", lambda self, start=Factorisation.start: begun.append(start(self))
    )
    options = {"checkpoint": tmp_path}
    factor(*data, CONFIG, **options, on_progress=stop_after(2))
    assert len(begun) == 1
    factor(*data, CONFIG, **options, resume=True)
    assert len(begun) == 1


def test_control_c_ends_after_the_round_under_way(data, tmp_path, monkeypatch):
    calls = []
    move = Factorisation.move_centres

    def interrupted(self):
        calls.append(1)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        move(self)

    monkeypatch.setattr(Factorisation, "move_centres", interrupted)
    part = factor(*data, CONFIG, checkpoint=tmp_path)
    assert part.interrupted and part.epochs == 3 and has_checkpoint(tmp_path)


def test_a_checkpoint_of_other_shapes_is_refused(data, tmp_path):
    factor(*data, CONFIG, checkpoint=tmp_path, on_progress=stop_after(2))
    x, *rest = data
    with pytest.raises(InputError, match="other shapes"):
        factor(0.9 * x, *rest, CONFIG, checkpoint=tmp_path, resume=True)
    with pytest.raises(InputError, match="other config"):
        factor(x, *rest, CONFIG.with_training(sparsity=1.0), checkpoint=tmp_path, resume=True)


def test_what_is_trained_by_adam_is_not_factored(data):
    with pytest.raises(InputError, match="factorisation"):
        factor(*data, resolve_config("paper"))

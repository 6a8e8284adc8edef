"""Truths of what a training finds out on shapes that it leaves out of a trial."""

from __future__ import annotations

import numpy as np
import pytest

from deformer import HandleSolver, MeshSequence, train
from deformer.errors import InputError
from deformer.geometry.geodesics import Geodesics
from deformer.geometry.sampling import farthest_points
from deformer.network.config import FactorisationSettings, ModelConfig
from deformer.parallel import run_to_end
from deformer.training import settings_search
from deformer.training.cross_validation import (
    choose_noise,
    held_out_errors,
    held_out_fits,
    held_out_turns,
    misfit_recoveries,
)
from deformer.training.factorisation import factor
from deformer.training.trials import Trials, exact_fits
from shapes import bend, sequence, tube, twist

QUICK = ModelConfig(components=4, training=FactorisationSettings(epochs=4), mirrored=False)


def test_errors_are_those_of_the_shapes_left_out():
    """log of the root mean square, by noise; the largest noise is fitted first."""
    shapes = sequence(12)
    asked = []

    def learn(kept):
        left = sorted(set(range(12)) - set(kept.tolist()))
        assert 0 in kept and len(left) == 3

        def fit(vertices, targets, noises):
            asked.append((len(vertices), tuple(noises)))
            (shape,) = [s for s in shapes.vertices[left] if (s[vertices] == targets).all()]
            return [shape + noise for noise in noises]

        return fit

    noises = (0.1, 0.2, 0.4)
    errors = held_out_errors(learn, shapes, Geodesics(shapes.mesh(0)), noises, 0)
    np.testing.assert_allclose(errors, np.log(noises))
    assert asked == [(count, (0.4, 0.2, 0.1)) for count in (10, 10, 10, 40, 40, 40)]
    # None can be left out of three.
    few = shapes.subset([0, 1, 2])
    assert held_out_fits(3) == 0
    assert choose_noise(learn, few, Geodesics(few.mesh(0)), noises, 0) == 0.2


@pytest.mark.parametrize("count", [3, 4, 6, 11, 12, 40])
def test_few_shapes_are_left_out_one_by_one(count):
    turns = held_out_turns(count)
    left_out = np.concatenate(turns)
    assert len(set(left_out)) == len(left_out) and 0 < left_out.min() <= left_out.max() < count
    if count < 12:
        assert len(turns) == min(count - 1, 5) and {len(turn) for turn in turns} == {1}
    else:
        assert len(turns) == 1 and len(left_out) == 3
    assert held_out_turns(2) == []


def test_misfit_errors_are_of_positions_and_of_edges():
    """A shape that is moved has an error in position alone; scaled edges have none either."""
    shapes = sequence(5)
    asked = []

    def fit(vertices, targets, noises):
        (shape,) = [s for s in shapes.vertices if (s[vertices] == targets).all()]
        asked.append(len(vertices))
        return [shape + noise * np.sin(7.0 * shape) for noise in noises]

    noises = (1e-4, 2e-4, 4e-4)
    geodesics = Geodesics(shapes.mesh(0))
    for turn in range(4):
        cases = misfit_recoveries(shapes, geodesics, turn)
        errors = np.array([run_to_end(case.errors(fit, noises))[1] for case in cases])
        # Both errors are proportional to the deformation while it is small.
        assert errors.shape == (2, 3)
        np.testing.assert_allclose(np.diff(errors), np.log(2.0), rtol=0.01)
    assert asked == [5, 40] * 4


@pytest.mark.parametrize(
    ("errors", "least", "most"),
    [
        ([-1.0, -1.01, -1.04, -1.01, -1.0, -0.5, 0.0], 0.0, 0.0),  # better, but not by enough
        ([-1.0, -1.1, -1.2, -1.5, -1.2, -1.0, 0.0], 0.0499, 0.0501),
        ([-1.0, -1.1, -1.5, -1.5, -1.1, -1.0, 0.0], 0.035, 0.036),  # between two that are as good
        ([-1.0, -1.1, -1.2, -1.50, -1.51, -1.0, 0.0], 0.071, 0.085),  # nearer to the better one
        ([1.0, 0.9, 0.6, 0.3, 0.0, -0.3, -0.6], 0.399, 0.401),
    ],
)
def test_the_misfit_is_the_best_unless_none_is_as_good(errors, least, most, monkeypatch):
    calls = []

    def scripted(self, config, noise, misfits, turns):
        calls.append((misfits, turns))
        return enumerate([np.array([errors, np.arange(len(misfits), 0, -1)])] * len(turns))

    monkeypatch.setattr(Trials, "misfit_errors", scripted)
    model = train(sequence(6), config=QUICK.with_training(sparsity=2.0), device="cpu")
    few, many = model.handle_misfits
    assert least <= few <= most and many == pytest.approx(settings_search.HANDLE_MISFITS[-1])
    assert calls == [(settings_search.HANDLE_MISFITS, [0, 1, 2, 3, 4])]


@pytest.mark.parametrize(("best", "asked"), [(0, False), (-1, True)])
def test_many_examples_that_want_a_small_noise_are_trusted(best, asked, monkeypatch):
    calls = []

    def noise_errors(self, configs, noises):
        errors = np.ones(len(noises))
        errors[best] = 0.0
        return enumerate([errors] * len(configs))

    def scripted(self, config, noise, misfits, turns):
        calls.append(misfits)
        return enumerate([np.array([np.arange(len(misfits), dtype=float)] * 2)] * len(turns))

    monkeypatch.setattr(Trials, "noise_errors", noise_errors)
    monkeypatch.setattr(Trials, "misfit_errors", scripted)
    model = train(sequence(12), config=QUICK.with_training(sparsity=2.0), device="cpu")
    assert model.handle_misfits == (0.0, 0.0) and bool(calls) == asked


def test_two_shapes_are_trusted_as_little_as_few_are():
    model = train(sequence(2), config=QUICK.with_training(sparsity=2.0), device="cpu")
    assert min(model.handle_misfits) > 0


@pytest.mark.parametrize(
    ("least", "chosen"),
    [
        ([-1.0, -1.1, -1.1], 2.0),  # better, but not by enough to be less sparse
        ([-1.0, -1.3, -1.4], 0.2),
        ([-1.0, -1.1, -1.6], 0.02),
        ([-1.0, -1.3, -0.9], 0.2),
        ([-1.0, -1.01, -1.3], 0.02),
        ([-1.0, -0.9], 2.0),  # no better: another trial is not made
    ],
)
def test_components_are_less_sparse_only_where_that_recovers_more(least, chosen, monkeypatch):
    tried = iter(least)

    def scripted(self, configs, noises):
        found = np.full((len(configs), len(noises)), 1.0)
        found[:, 2] = [next(tried) for _ in configs]
        return enumerate(found)

    monkeypatch.setattr(Trials, "noise_errors", scripted)
    model = train(sequence(6), config=QUICK, device="cpu")
    assert model.config.training.sparsity == chosen
    assert model.handle_noise == settings_search.HANDLE_NOISES[2]
    assert next(tried, None) is None


def test_poses_of_every_noise_are_relaxed_to_the_end():
    """So that noises compare: by way of a larger one, a noise gives the pose of a cold solve."""
    shapes = sequence(12)
    config = QUICK.with_training(sparsity=2.0)
    solver = HandleSolver(train(shapes.subset(range(6)), config=config, device="cpu"))
    control = farthest_points(solver.model.geodesics, 6, 0)
    # Targets that no example comes near: exact handles have much to do.
    targets = shapes.vertices[8, control] * [1.0, 1.5, 1.0]
    later, cold = (
        list(exact_fits(solver, "noise", control, targets, tried))[-1]
        for tried in ([0.008, 0.002], [0.002])
    )
    assert np.abs(later - cold).max() < 5e-3


def test_a_sparsity_that_is_given_is_kept():
    model = train(sequence(12), config=QUICK.with_training(sparsity=1.5), device="cpu")
    assert model.config.training.sparsity == 1.5


@pytest.mark.slow
def test_many_clean_examples_of_few_motions_ask_for_less_sparsity():
    """And are recovered better with it than with the sparsity for a few dozen bodies."""
    base = tube(8, 15)
    rng = np.random.default_rng(0)
    angles = rng.uniform(-1, 1, size=(90, 2))
    angles[0] = 0
    poses = np.stack([bend(twist(base.vertices, 0.8 * a), 1.2 * b) for a, b in angles])
    known, unseen = MeshSequence(poses[:80], base.faces), poses[80:]
    config = ModelConfig(components=20, training=FactorisationSettings(epochs=30))
    chosen = train(known, config=config, device="cpu")
    assert (chosen.config.training.sparsity or 2.0) < 2.0
    sparse = train(known, config=config.with_training(sparsity=2.0), device="cpu")
    handles = farthest_points(chosen.geodesics, 10, 0)
    missed = []
    for model in (chosen, sparse):
        solver = HandleSolver(model)
        squares = []
        for shape in unseen:
            solver.set_handles(handles, shape[handles], hard=True)
            squares.append(((solver.solve().vertices - shape) ** 2).mean())
        missed.append(np.mean(squares))
    assert missed[0] < 0.8 * missed[1]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "best"), [(3, 0), (5, 0), (12, 0), (12, -1)])
def test_progress_counts_all_that_trials_may_do(count, best, monkeypatch):
    """The total is known at first; trials of the misfit that are not needed count as done."""
    true_errors = Trials.noise_errors

    def noise_errors(*args):
        for n, errors in true_errors(*args):
            errors = np.ones_like(errors)
            errors[best] = 0.0
            yield n, errors

    monkeypatch.setattr(Trials, "noise_errors", noise_errors)
    seen = []
    train(sequence(count), config=QUICK, device="cpu", on_progress=seen.append)
    counted = [(p.done, p.total) for p in seen if p.stage == "cross-validation"]
    noises, misfits = len(settings_search.HANDLE_NOISES), len(settings_search.HANDLE_MISFITS)
    # Three sparsities of 4 rounds; then the turns of the misfit, with 5 and with 40 handles.
    of_noise = {3: 0, 5: 3 * (4 + 2 * noises), 12: 3 * (4 + 6 * noises)}[count]
    turns = {3: [1, 1], 5: [1, 1, 1, 1], 12: [3]}[count]
    total = of_noise + sum(4 + 2 * misfits * held_out for held_out in turns)
    # The third sparsity is not tried: the second is no better.
    tried = 2 * of_noise // 3
    expected = [*range(1, tried + 1), *range(of_noise + 1, total + 1)]
    if count == 12 and best == 0:
        expected = [*range(1, tried + 1), total]
    # The turn that leaves out the noises' shapes has their model: its rounds count as done at once.
    if count > 3:
        expected = [n for n in expected if not of_noise < n < of_noise + 4]
    assert counted == [(n, total) for n in expected]


def test_control_c_while_settings_are_chosen_is_passed_on():
    def stop(progress):
        if progress.stage == "cross-validation" and progress.done == 2:  # once, as a key does
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(sequence(12), config=QUICK, device="cpu", on_progress=stop)


def test_only_a_whole_training_chooses():
    with pytest.raises(InputError, match="sparsity"):
        factor(np.zeros((2, 3, 9)), None, None, QUICK)  # type: ignore[arg-type]

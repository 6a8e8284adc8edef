"""Frames without smoothness: each the pose that `HandleSolver` finds, whatever the others are."""

from __future__ import annotations

import numpy as np
import pytest

from deformer import Floor, HandleSolver, fit_sequence
from deformer.editing import separate_frames
from deformer.errors import InputError
from distances import largest
from shapes import small_model

HANDLES = [4, 40, 64, 112]
KINDS = ["pin", "exact", "soft", "soft"]
FRAMES = 30


@pytest.fixture(scope="module")
def model():
    return small_model()


def pulled(model, seed, count=FRAMES):
    """Targets (count, 4, 3) that pull hard: from one drawn pose to another; the pin stays."""
    start = model.reference.vertices[HANDLES]
    pulls = (
        0.08
        * model.reference.bounding_diagonal
        * np.random.default_rng(seed).normal(size=(2, len(HANDLES), 3))
    )
    pulls[:, 0] = 0.0
    share = np.linspace(0.0, 1.0, count)[:, None, None]
    return start + (1.0 - share) * pulls[0] + share * pulls[1]


def alone(model, targets, kinds=KINDS, **settings):
    solver = HandleSolver(model, freedom="auto", **settings)
    solver.set_handles(HANDLES, targets, kinds=kinds)
    return solver.solve().vertices


def fitted(model, targets, **settings):
    return fit_sequence(
        model,
        HANDLES,
        targets,
        kinds=KINDS,
        smoothness=0.0,
        freedom="auto",
        relaxation=20,
        **settings,
    )


@pytest.mark.parametrize("noise", [0.007, 0.02])
@pytest.mark.parametrize("misfit", [0.0, 0.01])
def test_every_frame_is_the_pose_of_its_handles(model, noise, misfit):
    targets, settings = pulled(model, 1), {"noise": noise, "misfit": misfit}
    found = fitted(model, targets, **settings)
    for frame in (0, 5, 12, 19, 29):
        pose = alone(model, targets[frame], **settings)
        assert largest(found.vertices[frame] - pose) < 1e-3 * model.reference.bounding_diagonal


def test_every_frame_has_the_noise_that_it_asks_for(model):
    """Frames that pull too far change nothing in those that do not.

    A pose's noise is what it asks for to 5 per cent.
    """
    near = model.decode(model.codes[4])[HANDLES]
    D = model.reference.bounding_diagonal
    targets = np.repeat(near[None], 9, axis=0)
    targets[4:] += 0.15 * D * np.array([[0, 0, 1], [0, 1, 0]] * 2)
    found = fitted(model, targets, noise=None, misfit=0.0)
    for frame, bound in ((0, 1e-3), (3, 1e-3), (5, 2e-2), (8, 2e-2)):
        pose = alone(model, targets[frame], misfit=0.0)
        assert largest(found.vertices[frame] - pose) < bound * D
    fixed = fitted(model, targets, noise=model.handle_noise, misfit=0.0)
    assert largest(fixed.vertices[5] - found.vertices[5]) > 5e-2 * D


def test_a_frame_does_not_depend_on_the_others(model):
    targets, other = pulled(model, 2), pulled(model, 3)
    kept = [0, 7, 12, 20]
    other[kept] = targets[kept]
    first, second = (fitted(model, goals, noise=0.007) for goals in (targets, other))
    apart = largest(first.vertices[kept] - second.vertices[kept])
    assert apart < 5e-4 * model.reference.bounding_diagonal
    assert largest(first.vertices - second.vertices) > 0.05 * model.reference.bounding_diagonal


def test_key_frames_are_found_from_several_starts_wherever_the_others_lead(model, monkeypatch):
    """One after the other, a frame came to the minimum that the one before led to."""
    monkeypatch.setattr(separate_frames, "_KEY_STEPS", 1)
    targets, D = pulled(model, 7), model.reference.bounding_diagonal
    wild = np.full_like(targets, np.nan)
    wild[:] = targets + 0.4 * D * np.random.default_rng(1).normal(size=(FRAMES, 1, 3))
    keys = [3, 17, 29]
    wild[keys] = targets[keys]
    found = fitted(model, wild, noise=0.007, key_frames=keys[::-1])
    for frame in keys:
        pose = alone(model, targets[frame], noise=0.007)
        assert largest(found.vertices[frame] - pose) < 1e-3 * D
    again = fitted(model, targets, noise=0.007, key_frames=keys)
    np.testing.assert_allclose(again.vertices[keys], found.vertices[keys], atol=1e-9 * D)


def test_a_key_frame_that_does_not_exist_is_named(model):
    with pytest.raises(InputError, match=r"key_frames\[1\]: frame 30 does not exist"):
        fitted(model, pulled(model, 1), key_frames=[2, 30])


def test_frames_that_see_some_of_the_handles_are_poses_of_those(model):
    targets = pulled(model, 4)
    weights = np.ones((FRAMES, len(HANDLES)))
    weights[10:20, 2:] = 0.0
    weights[14] = 0.0
    found = fitted(model, targets, weights=weights, noise=0.007)
    solver = HandleSolver(model, freedom="auto", noise=0.007)
    solver.set_handles(HANDLES[:2], targets[11, :2], kinds=KINDS[:2])
    D = model.reference.bounding_diagonal
    assert largest(found.vertices[11] - solver.solve().vertices) < 1e-3 * D
    assert largest(found.vertices[14] - model.decode(model.latent_mean)) < 1e-3 * D


def test_a_mean_beyond_the_examples_costs_no_bends_in_its_frame(model):
    """As in a pose: handles on the surface of the frame's mean move nothing."""
    means = np.array([model.codes[2], 2.5 * model.codes[5] - 1.5 * model.latent_mean])
    targets = np.array([model.decode(z)[HANDLES] for z in means])
    found = fitted(model, targets, mean=means, noise=0.007)
    np.testing.assert_allclose(found.z, means, atol=1e-4)


def test_frames_stay_above_a_floor_as_poses_do(model):
    targets = pulled(model, 5)
    height = float(np.quantile(model.decode(model.latent_mean)[:, 1], 0.2))
    found = fitted(model, targets, noise=0.007, floor=Floor(height))
    assert found.vertices[..., 1].min() > height - 1e-9


def test_both_backends_relax_a_frame_to_its_end(model):
    targets = pulled(model, 6)
    one, other = (fitted(model, targets, noise=0.007, backend=b) for b in ("numba", "torch"))
    assert largest(one.vertices - other.vertices) < 1e-3 * model.reference.bounding_diagonal

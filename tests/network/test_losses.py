"""The terms of the loss against hand computation."""

import numpy as np
import pytest
import torch

from deformer.geometry.geodesics import Geodesics
from deformer.network import losses
from shapes import tube


def test_reconstruction_is_summed_over_a_shape_and_averaged_over_shapes():
    x = torch.zeros(4, 2, 9)
    estimate = torch.zeros(4, 2, 9)
    estimate[0, 0, 0] = 3.0
    estimate[1, 1, 5] = 4.0
    assert losses.reconstruction(x, estimate).item() == (9 + 16) / 2
    assert losses.reconstruction(estimate, x).item() == (9 + 16) / 2


def test_sparsity_is_the_weighted_sum_of_block_norms_over_components():
    C = torch.zeros(3, 2, 2)
    C[0, :, 0] = torch.tensor([3.0, 4.0])  # norm 5, Λ 0.5
    C[1, :, 0] = torch.tensor([0.0, -2.0])  # norm 2, Λ 1
    C[2, :, 1] = torch.tensor([1.0, 0.0])  # norm 1, Λ 0
    locality = torch.tensor([[0.5, 1.0], [1.0, 1.0], [1.0, 0.0]])
    assert losses.sparsity(C, locality).item() == pytest.approx((2.5 + 2) / 2)


def test_sparsity_has_a_finite_gradient_where_blocks_are_zero():
    C = torch.zeros(3, 2, 2, requires_grad=True)
    losses.sparsity(C, torch.ones(3, 2)).backward()
    assert torch.isfinite(C.grad).all()


def test_latent_range_counts_what_goes_beyond_the_limit():
    z = torch.tensor([[1.0, -7.0, 5.0], [-2.0, 6.0, 4.0], [0.5, 1.0, -5.5]])
    # Largest magnitudes 2, 7, 5.5 against 5: 0, 2 and 0.5.
    assert losses.latent_range(z, 5.0).item() == pytest.approx(2.5 / 3)
    assert losses.latent_range(z, 7.5).item() == 0.0


def test_the_total_is_the_weighted_sum_of_the_terms():
    rng = torch.Generator().manual_seed(0)
    x, estimate = torch.randn(2, 4, 3, 9, generator=rng)
    C = torch.randn(4, 2, 5, generator=rng)
    z, locality = 8 * torch.randn(3, 5, generator=rng), torch.rand(4, 5, generator=rng)
    found = losses.loss(
        x, estimate, z, C, locality, sparsity_weight=0.3, range_weight=0.7, range_limit=4.0
    )
    expected = (
        losses.reconstruction(x, estimate)
        + 0.3 * losses.sparsity(C, locality)
        + 0.7 * losses.latent_range(z, 4.0)
    )
    assert found.total.item() == pytest.approx(expected.item())
    # The paper's weights and limit are the defaults.
    papers = losses.loss(x, estimate, z, C, locality)
    assert papers.sparsity.item() == pytest.approx(0.5 * losses.sparsity(C, locality).item())
    assert papers.latent_range.item() == pytest.approx(0.5 * losses.latent_range(z, 5.0).item())


def test_latent_range_leaves_small_codes_alone():
    z = torch.tensor([[1.0, -2.0]], requires_grad=True)
    losses.latent_range(z, 5.0).backward()
    assert z.grad.abs().max() == 0


def test_locality_rises_between_its_bounds():
    distance = np.array([0.0, 0.2, 0.25, 0.3, 0.4, 0.9, np.inf])
    found = losses.locality_row(distance, 0.2, 0.4)
    np.testing.assert_allclose(found, [0, 0, 0.25, 0.5, 1, 1, 1], atol=1e-12)


def test_centres_are_the_vertices_with_the_largest_blocks():
    C = torch.zeros(5, 2, 3)
    C[3, :, 0] = torch.tensor([1.0, 1.0])
    C[1, 0, 0] = 1.3  # a larger entry, a smaller block than √2
    C[4, 1, 1] = -2.0
    C[0, 0, 2] = 0.1
    assert losses.centres(C).tolist() == [3, 4, 0]


def test_locality_follows_the_centres():
    mesh = tube()
    geodesics = Geodesics(mesh)
    locality = losses.Locality(geodesics, 0.2, 0.4)
    rng = np.random.default_rng(0)
    C = torch.tensor(0.1 * rng.normal(size=(len(mesh.vertices), 2, 3)), dtype=torch.float32)
    # From the second to the third only one of them moves.
    for moved in (np.array([3, 50, 90]), np.array([7, 11, 119]), np.array([60, 11, 119])):
        with torch.no_grad():
            C *= 0.1
            C[moved, 0, torch.arange(3)] = 1.0
        found = locality.update(C)
        np.testing.assert_array_equal(losses.centres(C).numpy(), moved)
        for k in range(3):
            distance = geodesics.normalised_row(int(moved[k]))
            expected = np.clip((distance - 0.2) / 0.2, 0, 1)
            np.testing.assert_allclose(found[:, k].numpy(), expected, atol=1e-6)
            assert found[moved[k], k] == 0
    assert found.dtype == C.dtype and not found.requires_grad

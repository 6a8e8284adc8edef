"""Truths of the latent prior."""

import numpy as np
import pytest

from deformer.model.latent_prior import fit_prior


def correlated(K, rng):
    A = rng.normal(size=(K, K))
    return A @ A.T / K + 0.1 * np.eye(K)


@pytest.mark.parametrize("N", [1, 2, 3, 4, 5, 11, 40])
@pytest.mark.parametrize("K", [1, 2, 30])
def test_covariance_is_symmetric_positive_definite(N, K):
    codes = np.random.default_rng(N).normal(size=(N, K)) + 5
    prior = fit_prior(codes)
    np.testing.assert_allclose(prior.mean, codes.mean(axis=0))
    assert prior.covariance.shape == (K, K)
    np.testing.assert_allclose(prior.covariance, prior.covariance.T, atol=1e-12)
    assert np.linalg.eigvalsh(prior.covariance)[0] > 0
    factor = prior.factor
    np.testing.assert_allclose(factor @ factor.T, prior.covariance, atol=1e-10)
    np.testing.assert_array_equal(factor, np.tril(factor))


@pytest.mark.filterwarnings("error")
def test_equal_and_partly_constant_codes_are_no_trouble():
    for codes in (np.ones((6, 3)), np.eye(6, 3) * [1, 0, 0], np.zeros((2, 3))):
        assert np.linalg.eigvalsh(fit_prior(codes).covariance)[0] > 0


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_many_samples_recover_the_covariance(unit):
    rng = np.random.default_rng(1)
    truth = correlated(5, rng)
    mean = rng.normal(size=5)
    codes = unit * rng.multivariate_normal(mean, truth, size=20_000)
    prior = fit_prior(codes)
    np.testing.assert_allclose(prior.mean, unit * mean, atol=0.05 * unit)
    np.testing.assert_allclose(prior.covariance, unit**2 * truth, atol=0.05 * unit**2)


def test_correlation_survives_few_samples():
    """Components that move together stay together: the covariance is no diagonal."""
    rng = np.random.default_rng(2)
    s = rng.normal(size=(12, 1))
    codes = s * [1.0, -1.0, 2.0] + 0.1 * rng.normal(size=(12, 3))
    found = fit_prior(codes).covariance
    correlation = found / np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert correlation[0, 1] < -0.7 and correlation[0, 2] > 0.7


def test_shrinking_makes_unseen_codes_likelier():
    """Against the sample covariance with a small ridge, on codes of the same distribution."""
    rng = np.random.default_rng(3)
    truth = correlated(20, rng)
    train, test = np.split(rng.multivariate_normal(np.zeros(20), truth, size=1024), [24])
    prior = fit_prior(train)

    def surprise(covariance):
        away = np.linalg.solve(np.linalg.cholesky(covariance), (test - prior.mean).T)
        return 0.5 * (away**2).sum(axis=0).mean() + 0.5 * np.linalg.slogdet(covariance)[1]

    plain = np.cov(train, rowvar=False, bias=True)
    assert surprise(prior.covariance) < surprise(plain + 1e-3 * np.eye(20))
    assert surprise(prior.covariance) < surprise(np.eye(20) * np.diag(plain).mean() * 10)


def test_likely_codes_are_those_unseen():
    """From few codes, the squared distance of others is about K: neither proud nor shy."""
    rng = np.random.default_rng(4)
    truth = correlated(12, rng)
    ratios = []
    for _ in range(20):
        train, test = np.split(rng.multivariate_normal(np.zeros(12), truth, size=420), [20])
        prior = fit_prior(train)
        away = np.linalg.solve(prior.factor, (test - prior.mean).T)
        ratios.append((away**2).mean())
    assert 0.7 < np.mean(ratios) < 1.3


def test_images_count_where_they_tell_of_codes():
    """Images drawn as the codes are make others likelier; images from elsewhere are left out."""
    rng = np.random.default_rng(5)
    truth = correlated(10, rng)
    codes, alike, others = np.split(
        rng.multivariate_normal(np.zeros(10), truth, size=1024), [12, 24]
    )
    foreign = 30.0 + rng.normal(size=codes.shape)
    plain = fit_prior(codes)
    np.testing.assert_array_equal(fit_prior(codes, foreign).covariance, plain.covariance)
    np.testing.assert_array_equal(fit_prior(codes, foreign).mean, plain.mean)

    def surprise(prior):
        away = np.linalg.solve(prior.factor, (others - prior.mean).T)
        return 0.5 * (away**2).sum(axis=0).mean() + np.log(np.diag(prior.factor)).sum()

    assert surprise(fit_prior(codes, alike)) < surprise(plain)

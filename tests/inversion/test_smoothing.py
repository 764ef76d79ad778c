"""Smoothing chosen by cross-validation, with noise that neighbours share."""

import numpy as np
import pytest

from analysis.inversion.penalised_fit import Smoothing, shared_noise


def fit(y, correlation):
    eye = np.eye(len(y))
    bend = np.diff(eye, 2, axis=0)
    return Smoothing(eye, correlation, bend.T @ bend, len(y)).fit(y, float(y @ y))


def test_shared_noise_is_not_taken_for_signal():
    n, pitch, box = 120, 1.0, 4.0
    truth = 3 * np.sin(np.arange(n) / n * 2 * np.pi)
    correlation = shared_noise(np.eye(n)[:, None, :], pitch, box)[:, 0]
    root = np.linalg.cholesky(correlation + 1e-9 * np.eye(n))
    rng = np.random.default_rng(2)
    aware, unaware, coverage = [], [], []
    for _ in range(20):
        y = truth + root @ rng.normal(size=n)
        known, blind = fit(y, correlation), fit(y, np.eye(n))
        aware.append(np.mean((known.coefficients - truth) ** 2))
        unaware.append(np.mean((blind.coefficients - truth) ** 2))
        coverage.append(np.mean((known.coefficients - truth) ** 2 < np.diag(known.covariance)))
    assert np.mean(aware) < 0.6 * np.mean(unaware)
    assert 0.5 < np.mean(coverage) < 0.85


@pytest.mark.parametrize("stated", [1.0, 0.25])
def test_the_stated_uncertainty_is_the_error_also_where_the_noise_is_larger_than_told(stated):
    """`stated` is what the noise is thought to be over what it is: chi2 tells."""
    n, rng, pulls = 120, np.random.default_rng(3), []
    truth = 3 * np.sin(np.arange(n) / n * 2 * np.pi)
    for _ in range(30):
        found = fit((truth + rng.normal(size=n)) / stated, np.eye(n))
        error = stated * found.coefficients - truth
        pulls.append(error / (stated * np.sqrt(np.diag(found.covariance))))
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def test_the_stated_uncertainty_covers_what_smoothing_takes_away():
    """Of truths whose second differences are as random as the penalty supposes."""
    n, rng, pulls = 120, np.random.default_rng(5), []
    for _ in range(40):
        truth = np.cumsum(np.cumsum(0.05 * rng.normal(size=n)))
        found = fit(truth + rng.normal(size=n), np.eye(n))
        pulls.append((found.coefficients - truth) / np.sqrt(np.diag(found.covariance)))
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def test_what_the_penalty_leaves_free_comes_out_exactly():
    line = 2 + 0.1 * np.arange(40)
    found = fit(line, np.eye(40))
    assert found.coefficients == pytest.approx(line, abs=1e-6)
    assert found.chi2 == pytest.approx(0, abs=1e-6)


def test_what_lies_in_a_wide_gap_is_as_smooth_as_what_was_measured():
    """Half of the 60 unknowns are all but free of the measurements: they must not decide how strong
    a smoothing is tried.
    """
    n, rng = 120, np.random.default_rng(4)
    t = (np.arange(n) + 0.5) / n
    basis, truth = np.cos(np.pi * np.outer(t, np.arange(60))), 3 * np.sin(2 * np.pi * t)
    bend, known = np.diff(basis, 2, axis=0), np.abs(np.arange(n) - 60) > 15
    X = basis[known]
    for _ in range(20):
        y = truth[known] + 0.1 * rng.normal(size=known.sum())
        found = Smoothing(X.T @ X, X.T @ X, bend.T @ bend, len(y)).fit(X.T @ y, float(y @ y))
        assert np.abs(basis @ found.coefficients - truth).max() < 0.5


def test_unknowns_that_nothing_determines_are_refused():
    gram = np.array([[1.0, 1.0], [1.0, -5.0]])
    with pytest.raises(ValueError, match="do not determine"):
        Smoothing(gram, gram, np.eye(2), 5)

"""Estimates put together do not care for order, units or who says nothing."""

from __future__ import annotations

import numpy as np
import pytest

from flinders.summary.pooling import differences_from_others, p_value_of, pool


def some(rng: np.random.Generator, count: int, size: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Estimates of zero that scatter as they claim."""
    roots = [rng.normal(size=(size, size)) + 2.0 * np.eye(size) for _ in range(count)]
    return [root @ rng.normal(size=size) for root in roots], [root @ root.T for root in roots]


@pytest.mark.parametrize("seed", range(5))
def test_order_does_not_matter(seed: int) -> None:
    estimates, covariances = some(np.random.default_rng(seed), 4, 9)
    there, back = pool(estimates, covariances), pool(estimates[::-1], covariances[::-1])
    assert np.allclose(there.mean, back.mean)
    assert np.allclose(there.scatter, back.scatter)
    assert there.p_value == pytest.approx(back.p_value)


@pytest.mark.parametrize("seed", range(5))
def test_units_do_not_matter(seed: int) -> None:
    estimates, covariances = some(np.random.default_rng(seed), 3, 5)
    unit = np.array([1e-6, 1.0, 1e6, 3.0, 0.1])
    plain = pool(estimates, covariances)
    scaled = pool([unit * one for one in estimates], [np.outer(unit, unit) * one for one in covariances])
    assert np.allclose(scaled.mean, unit * plain.mean)
    assert np.allclose(scaled.covariance, np.outer(unit, unit) * plain.covariance)
    assert scaled.chi_square == pytest.approx(plain.chi_square, rel=1e-6)


def test_the_mean_is_that_of_least_squares() -> None:
    estimates, covariances = some(np.random.default_rng(1), 3, 4)
    precisions = [np.linalg.inv(covariance) for covariance in covariances]
    expected = np.linalg.inv(sum(precisions)) @ sum(p @ e for p, e in zip(precisions, estimates, strict=True))
    found = pool(estimates, covariances)
    assert np.allclose(found.mean, expected)
    assert np.allclose(found.covariance, np.linalg.inv(sum(precisions)))


@pytest.mark.nightly
def test_chi_square_is_that_of_true_claims() -> None:
    rng = np.random.default_rng(2)
    chances = [pool(*some(rng, 3, 9)).p_value for _ in range(400)]
    assert np.mean(chances) == pytest.approx(0.5, abs=0.05)
    assert np.mean(np.array(chances) < 0.05) < 0.09


def test_scatter_is_found_without_bias() -> None:
    rng = np.random.default_rng(3)
    claimed, between = np.diag([0.01, 0.01, 0.01]), np.diag([4.0, 1.0, 0.25])
    trials = [list(rng.multivariate_normal(np.zeros(3), claimed + between, 5)) for _ in range(400)]
    found = np.mean([pool(trial, [claimed] * 5).scatter for trial in trials], axis=0)
    assert np.allclose(np.diag(found), np.diag(between), rtol=0.15)


def test_who_knows_nothing_has_no_voice() -> None:
    knows, ignorant = np.diag([0.01, 0.01]), np.diag([0.01, 1e6])
    estimates = [np.array([0.0, 1.0]), np.array([0.0, 1.1]), np.array([0.0, 3000.0])]
    found = pool(estimates, [knows, knows, ignorant])
    assert found.mean[1] == pytest.approx(1.05, abs=0.001)
    assert found.scatter[1, 1] < 0.01


def test_what_all_hold_stays_held() -> None:
    held = np.diag([0.01, 0.0])
    found = pool([np.array([1.0, 7.0]), np.array([1.1, 7.0])], [held, held])
    assert found.mean[1] == 7.0
    assert found.freedom == 1
    assert found.covariance[1, 1] == found.scatter[1, 1] == 0.0


def test_each_is_compared_with_the_mean_of_the_others() -> None:
    estimates, covariances = some(np.random.default_rng(4), 4, 3)
    for i, (off, covariance) in enumerate(differences_from_others(estimates, covariances)):
        others = pool(estimates[:i] + estimates[i + 1 :], covariances[:i] + covariances[i + 1 :])
        assert np.allclose(off, estimates[i] - others.mean)
        assert np.allclose(covariance, covariances[i] + others.covariance)


def test_nothing_to_compare_is_chance() -> None:
    assert p_value_of(0.0, 0) == 1.0
    assert pool([np.zeros(3)] * 2, [np.eye(3)] * 2).p_value == 1.0

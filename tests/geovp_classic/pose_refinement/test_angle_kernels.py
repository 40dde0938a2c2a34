"""What covariances of angles say of how far those go."""

from __future__ import annotations

import numpy as np
import pytest

from geovp_classic.pose_refinement.angle_kernels import (
    Kernel,
    covariance_of_differences,
    integrated_ornstein_uhlenbeck,
    matern52,
)

NOW = np.zeros(1)


def went(kernel: Kernel, seconds: float) -> float:
    """The variance of what an angle goes in that time."""
    there = np.array([seconds])
    return float(covariance_of_differences(kernel, there, 0.0, there, 0.0)[0, 0])


def test_an_angle_that_returns_goes_no_farther_than_twice_its_variance() -> None:
    kernel = matern52(0.3, time_constant_s=0.5)
    assert went(kernel, 0.0) == pytest.approx(0)
    assert went(kernel, 0.1) < went(kernel, 0.2) < went(kernel, 1.0)
    assert went(kernel, 100.0) == pytest.approx(2 * 0.3**2)


def test_an_angle_that_wanders_goes_on_at_its_rate_at_first_and_like_a_random_walk_later() -> None:
    kernel = integrated_ornstein_uhlenbeck(2.0, time_constant_s=0.5)
    assert went(kernel, 1e-3) == pytest.approx((2.0 * 1e-3) ** 2, rel=1e-3)
    # Far beyond the lasting time the variance grows by 2 deviation^2 lasting a second (Green-Kubo).
    assert went(kernel, 101.0) - went(kernel, 100.0) == pytest.approx(2 * 2.0**2 * 0.5)


@pytest.mark.parametrize("kernel", [matern52(0.3, 0.5), integrated_ornstein_uhlenbeck(2.0, 0.5)])
def test_differences_are_those_of_angles_that_go_like_this(kernel: Kernel) -> None:
    random = np.random.default_rng(0)
    times_s = np.linspace(0, 2, 9)
    # Any angles against the first one: drawn by the kernel's covariance of differences, compared as
    # differences anew.
    known = covariance_of_differences(kernel, times_s[1:], 0.0, times_s[1:], 0.0)
    drawn = np.concatenate(
        [np.zeros((50_000, 1)), random.multivariate_normal(np.zeros(8), known, 50_000)], axis=1
    )
    steps = np.diff(drawn, axis=1)
    expected = covariance_of_differences(
        kernel, times_s[1:], times_s[:-1], times_s[1:], times_s[:-1]
    )
    np.testing.assert_allclose(np.cov(steps.T), expected, atol=0.03 * expected.max())


def test_what_is_compared_with_itself_does_not_vary() -> None:
    same = covariance_of_differences(
        integrated_ornstein_uhlenbeck(1.0, 1.0),
        np.array([0.7]),
        np.array([0.7]),
        np.array([1.0, 2.0]),
        0.0,
    )
    np.testing.assert_allclose(same, 0, atol=1e-12)

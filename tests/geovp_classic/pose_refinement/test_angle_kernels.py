"""Covariances of angles and of their differences."""

import numpy as np
import pytest

from geovp_classic.pose_refinement.angle_kernels import (
    IntegratedOrnsteinUhlenbeck,
    Kernel,
    Matern52,
    covariance_of_differences,
)


def variance(kernel: Kernel, seconds: float) -> float:
    """Return the variance of the change of an angle in that time."""
    end = np.array([seconds])
    return float(covariance_of_differences(kernel, end, 0.0, end, 0.0)[0, 0])


def test_an_angle_that_returns_changes_by_at_most_twice_its_variance() -> None:
    kernel = Matern52(0.3, time_constant_s=0.5)
    assert variance(kernel, 0.0) == pytest.approx(0)
    assert variance(kernel, 0.1) < variance(kernel, 0.2) < variance(kernel, 1.0)
    assert variance(kernel, 100.0) == pytest.approx(2 * 0.3**2)


def test_an_angle_that_drifts_becomes_a_random_walk() -> None:
    kernel = IntegratedOrnsteinUhlenbeck(2.0, time_constant_s=0.5)
    assert variance(kernel, 1e-3) == pytest.approx((2.0 * 1e-3) ** 2, rel=1e-3)
    # Later its variance grows by 2 deviation^2 time_constant per second (Green-Kubo).
    growth = variance(kernel, 101.0) - variance(kernel, 100.0)
    assert growth == pytest.approx(2 * 2.0**2 * 0.5)


@pytest.mark.parametrize("kernel", [Matern52(0.3, 0.5), IntegratedOrnsteinUhlenbeck(2.0, 0.5)])
def test_covariances_of_steps_follow_from_those_of_angles(kernel: Kernel) -> None:
    times_s = np.linspace(0, 2, 9)
    later_s = times_s[1:]
    angles = covariance_of_differences(kernel, later_s, 0.0, later_s, 0.0)
    step_from_angle = np.eye(8) - np.eye(8, k=-1)
    steps = covariance_of_differences(kernel, later_s, times_s[:-1], later_s, times_s[:-1])
    np.testing.assert_allclose(step_from_angle @ angles @ step_from_angle.T, steps, atol=1e-9)

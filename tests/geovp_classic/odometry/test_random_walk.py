"""Random walks through measurements with noise, drift, outliers and gaps."""

import numpy as np
import pytest

from geovp_classic.odometry.random_walk import RandomWalk


@pytest.mark.parametrize("step", [0.0, 0.03])
def test_true_values_lie_within_two_deviations(step: float) -> None:
    rng = np.random.default_rng(5)
    truth = np.cumsum(rng.normal(0, step, 300))
    measured = truth + rng.normal(0, 0.1, 300)
    measured[::7] = np.nan
    measured[3::11] += 2.0  # outliers
    mean, deviation = RandomWalk().smooth(measured, np.full(300, 0.05), np.ones(300))
    assert np.mean(np.abs(mean - truth) < 2 * deviation) > 0.9
    assert deviation.mean() < 0.1


def test_a_constant_is_the_mean_of_its_measurements() -> None:
    measured = np.array([0.9, 1.1, 1.0, np.nan])
    mean, deviation = RandomWalk(step=1e-6).smooth(measured, np.full(4, 0.1), np.ones(4))
    np.testing.assert_allclose(mean, 1.0, atol=1e-3)
    np.testing.assert_allclose(deviation, 0.1 / np.sqrt(3), rtol=0.1)


def test_values_after_an_infinite_step_are_unrelated() -> None:
    measured = np.repeat([0.0, 5.0], 10)
    step_ratio = np.ones(20)
    step_ratio[10] = np.inf
    mean, _ = RandomWalk().smooth(measured, np.full(20, 0.1), step_ratio)
    np.testing.assert_allclose(mean, measured, atol=1e-3)

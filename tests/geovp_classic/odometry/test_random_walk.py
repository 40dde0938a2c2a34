"""Random walks through measurements with noise, drift, outliers and gaps."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from geovp_classic.odometry.random_walk import RandomWalk, rauch_tung_striebel


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


def test_values_after_an_infinite_step_are_unrelated() -> None:
    measured = np.repeat([0.0, 5.0], 10)
    step_ratio = np.ones(20)
    step_ratio[10] = np.inf
    mean, _ = RandomWalk().smooth(measured, np.full(20, 0.1), step_ratio)
    np.testing.assert_allclose(mean, measured, atol=1e-3)


def test_the_smoother_agrees_with_filterpys() -> None:
    rng = np.random.default_rng(1)
    measured = rng.normal(0, 1.0, 40)
    noise2 = rng.uniform(0.1, 2.0, 40)
    steps2 = rng.uniform(0.01, 1.0, 39)
    means, variances, lag_covariances = rauch_tung_striebel(measured, 1 / noise2, steps2, 1e3)

    filter_ = KalmanFilter(dim_x=1, dim_z=1)
    filter_.F = filter_.H = np.eye(1)
    filter_.P = np.array([[1e3]])
    steps = list(np.concatenate([[0.0], steps2])[:, None, None])
    filtered = filter_.batch_filter(list(measured), Qs=steps, Rs=list(noise2[:, None, None]))
    reference = filter_.rts_smoother(*filtered[:2], Qs=steps)
    np.testing.assert_allclose(means, reference[0][:, 0, 0], atol=1e-9)
    np.testing.assert_allclose(variances, reference[1][:, 0, 0], atol=1e-9)
    gains = reference[2][:-1, 0, 0]
    np.testing.assert_allclose(lag_covariances, gains * reference[1][1:, 0, 0], atol=1e-9)

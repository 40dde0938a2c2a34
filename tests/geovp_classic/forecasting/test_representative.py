"""Representative futures are nested, and closer to the truth than as many draws."""

from dataclasses import dataclass

import numpy as np
import pytest

from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.representative import ImageDistance, Representative
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1
TIMES_S = STEP_S * np.arange(10, 30)


def circle(turn_rad_s: float = 0.1) -> Trajectory:
    times_s = STEP_S * np.arange(10)
    return Trajectory(
        se3.exp(times_s[:, None] * np.array([0, 0, 8.0, 0, turn_rad_s, 0])), times_s, True
    )


@dataclass(frozen=True)
class Sides:
    """A forecaster of a straight path; a quarter of its draws are on the left, others right."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        futures = np.tile(past.world_from_cam[-1], (num_samples, len(times_s), 1, 1))
        if num_samples > 1:
            futures[..., 0, 3] += np.where(np.arange(num_samples) % 4 == 0, -0.5, 0.6)[:, None]
        return futures


def test_every_side_is_shown_and_the_likelier_side_comes_first() -> None:
    futures = Representative(Sides(), num_draws=40).forecast(circle(), TIMES_S, 3)
    aside_m = futures[:, -1, 0, 3] - circle().world_from_cam[-1, 0, 3]
    np.testing.assert_allclose(aside_m, [0, 0.6, -0.5], atol=1e-9)


@pytest.mark.parametrize("source", [MotionPrior(), TurnRateKalman()])
def test_futures_are_nested_and_begin_with_the_centre(source: Forecaster) -> None:
    past, few = circle(), Representative(source)
    futures = few.forecast(past, TIMES_S, 10)
    np.testing.assert_allclose(futures[:1], source.forecast(past, TIMES_S))
    np.testing.assert_allclose(few.forecast(past, TIMES_S, 4), futures[:4])
    np.testing.assert_allclose(few.forecast(past, TIMES_S), futures[:1])


@pytest.mark.parametrize("turn_rad_s", [0.0, 0.3])
def test_ten_futures_are_as_good_as_fifteen_draws(turn_rad_s: float) -> None:
    past = circle(turn_rad_s)
    truths = MotionPrior(seed=7).forecast(past, TIMES_S, 300)

    def nearest(futures: FloatArray) -> float:
        return float(distance(truths, futures).min(axis=1).mean())

    ten = nearest(Representative().forecast(past, TIMES_S, 10))
    assert ten < np.mean(
        [nearest(MotionPrior(seed=seed).forecast(past, TIMES_S, 15)) for seed in (1, 2, 3, 4)]
    )


def distance(truths: FloatArray, futures: FloatArray) -> FloatArray:
    metric = ImageDistance()
    return metric.between(*(metric.motions(truths[0], poses) for poses in (truths, futures)))


def test_distances_are_angles_in_the_image() -> None:
    still, turned, aside = (np.tile(np.eye(4), (1, 5, 1, 1)) for _ in range(3))
    turned[..., :3, :3] = se3.exp(np.array([0, 0, 0, 0, 0.02, 0]))[:3, :3]
    aside[..., 0, 3] = 0.02 * ImageDistance().depth_m
    for futures in (turned, aside):
        assert distance(still, futures)[0, 0] == pytest.approx(0.02)

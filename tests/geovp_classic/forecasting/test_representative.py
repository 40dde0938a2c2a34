"""Few futures that stand for many: nested, weighted, and nearer to what comes than as many draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.representative import (
    DEPTH_M,
    FARTHEST_RAD,
    Representative,
    image_motions,
)
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
    """Straight ahead; drawn futures leave it to the left in one draw of four, else to the right."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        futures = np.tile(past.world_from_cam[-1], (num_samples, len(times_s), 1, 1))
        if num_samples > 1:
            futures[..., 0, 3] += np.where(np.arange(num_samples) % 4 == 0, -0.5, 0.6)[:, None]
        return futures


def test_every_side_is_shown_the_likelier_one_first_and_weighted() -> None:
    futures, weights = Representative(Sides(), num_draws=40).weighted(circle(), TIMES_S, 3)
    np.testing.assert_allclose(
        futures[:, -1, 0, 3] - circle().world_from_cam[-1, 0, 3], [0, 0.6, -0.5], atol=1e-9
    )
    np.testing.assert_allclose(weights, [0, 0.75, 0.25])


@pytest.mark.parametrize("source", [MotionPrior(), TurnRateKalman()])
def test_the_first_is_the_centre_and_fewer_are_the_first_of_more(source: Forecaster) -> None:
    past, few = circle(), Representative(source)
    futures, weights = few.weighted(past, TIMES_S, 10)
    np.testing.assert_array_equal(futures[:1], source.forecast(past, TIMES_S))
    np.testing.assert_array_equal(few.forecast(past, TIMES_S, 4), futures[:4])
    np.testing.assert_array_equal(few.forecast(past, TIMES_S), futures[:1])
    assert weights.sum() == pytest.approx(1)
    assert weights.min() >= 0


@pytest.mark.parametrize("turn_rad_s", [0.0, 0.3])
def test_ten_come_as_near_as_fifteen_draws(turn_rad_s: float) -> None:
    past = circle(turn_rad_s)
    truths = MotionPrior(seed=7).forecast(past, TIMES_S, 300)

    def nearest(futures: FloatArray) -> float:
        return float(np.mean([distance(truth, futures).min() for truth in truths]))

    ten = nearest(Representative().forecast(past, TIMES_S, 10))
    assert ten < np.mean(
        [nearest(MotionPrior(seed=seed).forecast(past, TIMES_S, 15)) for seed in (1, 2, 3, 4)]
    )


def distance(truth: FloatArray, futures: FloatArray) -> FloatArray:
    motions = np.linalg.norm(image_motions(truth, futures), axis=-1)
    return np.asarray(np.minimum(motions, FARTHEST_RAD).mean(axis=-1))


def test_distances_are_angles_in_the_image() -> None:
    still, turned, aside = (np.tile(np.eye(4), (1, 5, 1, 1)) for _ in range(3))
    turned[..., :3, :3] = se3.exp(np.array([0, 0, 0, 0, 0.02, 0]))[:3, :3]
    aside[..., 0, 3] = 0.02 * DEPTH_M
    for futures in (turned, aside):
        assert distance(still[0], futures)[0] == pytest.approx(0.02)


def test_more_than_there_are_draws_is_refused() -> None:
    with pytest.raises(BadData, match="5 of 4 draws asked for: set num_draws higher"):
        Representative(num_draws=4).forecast(circle(), TIMES_S, 5)
    with pytest.raises(BadData, match="num_draws is 1, expected 2 or more"):
        Representative(num_draws=1)


def test_the_unit_of_the_past_changes_nothing() -> None:
    metric = circle()
    steps_m = np.linalg.norm(np.diff(metric.world_from_cam[:, :3, 3], axis=0), axis=1).mean()
    poses = metric.world_from_cam.copy()
    poses[:, :3, 3] /= steps_m
    scaled = Trajectory(poses, metric.times_s, is_metric=False)
    unit = past_motion.in_metres(scaled)[1]
    in_metres = poses.copy()
    in_metres[:, :3, 3] *= unit
    ours, theirs = (
        Representative(TurnsOfTheCentre(unit_m)).forecast(past, TIMES_S, 6)
        for past, unit_m in (
            (scaled, unit),
            (Trajectory(in_metres, metric.times_s, is_metric=True), 1.0),
        )
    )
    theirs[..., :3, 3] /= unit
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


@dataclass(frozen=True)
class TurnsOfTheCentre:
    """Draws to the side by up to a metre and turned by up to 0.05 rad, whatever the unit."""

    metres_per_unit: float

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        futures = np.tile(past.world_from_cam[-1], (num_samples, len(times_s), 1, 1))
        if num_samples == 1:
            return futures
        aside, turn = np.random.default_rng(0).uniform(-1, 1, (2, num_samples))
        twists = np.zeros((num_samples, 1, 6))
        twists[:, 0, 0], twists[:, 0, 4] = aside / self.metres_per_unit, 0.05 * turn
        return np.asarray(futures @ se3.exp(twists))

"""Interacting multiple models: constant velocity, CTRV and CTRA (Blom & Bar-Shalom 1988).

A vehicle switches between the models as a Markov chain. Each model has a Kalman filter. At every
step the filters start from a mixture of all beliefs, and their likelihoods update the probabilities
of the models.
"""

from dataclasses import dataclass, replace

import numpy as np
from filterpy.kalman import IMMEstimator

from geovp_classic.forecasting.kalman import ExtendedFilter, KalmanForecaster, fitted
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Interacting(KalmanForecaster):
    """Three extended Kalman filters whose probabilities follow from the past."""

    # All settings were chosen on KITTI odometry 00, 02, 08 and 09 by the displacement over 2 s.
    # Probability that the vehicle keeps its model from one pose to the next; among .8, .9, .97
    stay_probability: float = 0.9
    # Noise of all models (slip), of constant velocity and CTRV (speed), and of constant velocity
    # (turn). Other noise is that of the filters with a single model.
    slip_noise: float = 0.02  # m / sqrt(s)
    speed_noise: float = 0.1  # m/s / sqrt(s)
    turn_noise: float = 0.01  # rad/s / sqrt(s)
    # Turn rate and acceleration that a model does not have are forgotten within a millisecond.
    forgotten_hz: float = 1000.0

    @property
    def models(self) -> tuple[VehicleModel, ...]:
        """Return the models: constant velocity, CTRV and CTRA."""
        turn_rate = replace(
            fitted("turn-rate"),
            slip_noise=self.slip_noise,
            speed_noise=self.speed_noise,
            acceleration_damping_hz=self.forgotten_hz,
        )
        velocity = replace(turn_rate, turn_noise=self.turn_noise, turn_damping_hz=self.forgotten_hz)
        acceleration = replace(fitted("acceleration-damped"), slip_noise=self.slip_noise)
        return velocity, turn_rate, acceleration

    def filtered(
        self,
        measured: FloatArray,  # [P, 3], as (x, z, yaw), yaw unwrapped
        times_s: FloatArray,  # [P]
    ) -> list[tuple[float, ExtendedFilter]]:
        """Return the filters at the last measurement, with the probabilities of their models."""
        filters = []
        for model in self.models:
            belief = self.initial_belief(measured, times_s, model, num_states=6)
            filters.append(ExtendedFilter(model, belief))
        count = len(filters)
        switch = np.full((count, count), (1 - self.stay_probability) / (count - 1))
        np.fill_diagonal(switch, self.stay_probability)
        estimator = IMMEstimator(filters, np.full(count, 1 / count), switch)
        for dt_s, state in zip(np.diff(times_s), measured[1:], strict=True):
            estimator.predict(dt_s)
            estimator.update(state)
        return list(zip(estimator.mu.tolist(), filters, strict=True))

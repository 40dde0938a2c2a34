"""Maximum-likelihood fit of the Kalman forecasters' process noise."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from geovp_classic.forecasting import kalman
from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.types import FloatArray, Trajectory

Window = tuple[Trajectory, Trajectory]  # past and future


@dataclass(frozen=True)
class Candidate(TurnRateKalman):
    """An extended Kalman filter with any constants."""

    candidate: VehicleModel = field(default_factory=lambda: kalman.fitted("turn-rate"))

    @property
    def model(self) -> VehicleModel:
        """Return the candidate."""
        return self.candidate


def fit(windows: Sequence[Window], start: VehicleModel, max_evaluations: int = 400) -> VehicleModel:
    """Return the constants of maximum likelihood; those that are 0 stay 0.

    The measurement noise stays as well: recorded poses are smoother than any odometry.
    """
    constants = asdict(start)
    free = [name for name, value in constants.items() if value > 0][:-2]

    def model_of(log_values: FloatArray) -> VehicleModel:
        return replace(start, **dict(zip(free, np.exp(log_values), strict=True)))

    best = minimize(
        lambda log_values: -log_density(windows, model_of(log_values)),
        np.log([constants[name] for name in free]),
        method="Nelder-Mead",
        options={"maxfev": max_evaluations, "xatol": 1e-2},
    )
    return model_of(best.x)


def log_density(windows: Sequence[Window], model: VehicleModel) -> float:
    """Return the mean log density of true futures at several horizons (a composite likelihood).

    One-step innovations alone would give a noise that is wrong after two seconds.
    """
    steps = np.array([1, 3, 5, 10, 15, 20]) - 1  # .1 to 2 s ahead
    forecaster = Candidate(candidate=model, body_motion=None)
    densities = []
    for past, future in windows:
        distribution = forecaster.distribution(past, future.times_s)
        states = distribution.states_of(future.world_from_cam)
        densities.append(distribution.log_density(states[None])[0, steps])
    return float(np.mean(densities))

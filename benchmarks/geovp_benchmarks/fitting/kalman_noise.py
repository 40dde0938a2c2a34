"""Maximum-likelihood fit of the Kalman forecasters' process and measurement noise.

The objective is the mean log density of (x, z, yaw) at several horizons given the past (a composite
likelihood). One-step innovations alone would give a noise that is wrong after two seconds.
"""

from collections.abc import Mapping, Sequence
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
        """The candidate."""
        return self.candidate


@dataclass(frozen=True)
class NoiseFit:
    """Settings of the fit."""

    horizons: tuple[int, ...] = (1, 3, 5, 10, 15, 20)  # steps
    max_evaluations: int = 400
    min_position_noise_m: float = 1e-3  # recorded poses are smoother than any odometry
    min_yaw_noise_rad: float = 1e-4

    def fit(
        self,
        windows: Sequence[Window],
        start: VehicleModel,
    ) -> VehicleModel:
        """Return the most likely constants for (past, future) pairs; those that are 0 stay 0."""
        free = {name: value for name, value in asdict(start).items() if value > 0}

        def model_of(log_values: FloatArray) -> VehicleModel:
            values = np.exp(log_values).tolist()
            model = replace(start, **dict(zip(free, values, strict=True)))
            return replace(
                model,
                position_noise_m=max(model.position_noise_m, self.min_position_noise_m),
                yaw_noise_rad=max(model.yaw_noise_rad, self.min_yaw_noise_rad),
            )

        best = minimize(
            lambda log_values: -self.log_density(windows, model_of(log_values)),
            np.log(list(free.values())),
            method="Nelder-Mead",
            options={
                "maxfev": self.max_evaluations,
                "xatol": 1e-2,
                "fatol": 1e-4,
                "adaptive": True,
            },
        )
        return model_of(best.x)

    def log_density(
        self,
        windows: Sequence[Window],
        model: VehicleModel,
    ) -> float:
        """Return the mean log density of the true futures."""
        forecaster = Candidate(candidate=model, body_motion=None)
        steps = np.array(self.horizons) - 1
        densities = []
        for past, future in windows:
            selected = steps[steps < len(future)]
            distribution = forecaster.distribution(past, future.times_s)
            states = distribution.states_of(future.world_from_cam)
            densities.append(distribution.log_density(states[None])[0, selected])
        return float(np.mean(densities))


def as_toml(fitted: Mapping[str, VehicleModel]) -> str:
    """Return the text of `turn_rate.toml`."""
    lines = [
        "# Constants of the Kalman forecasters, written by `geovp forecast fit-kalman`.",
        "# Fitted to ground-truth poses of KITTI odometry (Geiger et al. 2012), CC BY-NC-SA 3.0.",
    ]
    for name, model in fitted.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {float(f'{value:.5g}')}" for key, value in asdict(model).items()]
    return "\n".join(lines) + "\n"

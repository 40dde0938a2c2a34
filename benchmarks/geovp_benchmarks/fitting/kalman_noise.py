"""Maximum-likelihood fit of the Kalman forecasters' process and measurement noise.

The objective is the mean log density of (x, z, yaw) at several horizons given the past (a composite
likelihood). One-step innovations alone would give a noise that is wrong after two seconds. All
windows are filtered at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.kalman import Belief, initial_belief, planar_states
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class NoiseFit:
    """Settings of the fit."""

    horizons: tuple[int, ...] = (1, 3, 5, 10, 15, 20)  # steps
    max_evaluations: int = 700
    # Recorded poses are smoother than any odometry.
    min_noise: dict[str, float] = field(
        default_factory=lambda: {"position_noise_m": 1e-3, "yaw_noise_rad": 1e-4}
    )

    def fit(
        self, windows: Sequence[tuple[Trajectory, Trajectory]], start: VehicleModel
    ) -> VehicleModel:
        """Return the most likely constants for (past, future) pairs; those that are 0 stay 0."""
        states, times_s = planar_windows(windows)
        num_past = len(windows[0][0])
        steps = np.array(self.horizons) - 1
        steps = steps[steps < states.shape[1] - num_past]
        free = {name: value for name, value in asdict(start).items() if value > 0}
        minima = [self.min_noise.get(name, 1e-5) for name in free]

        def model_of(log_values: FloatArray) -> VehicleModel:
            values = np.clip(np.exp(log_values), minima, 20.0)
            return replace(start, **dict(zip(free, values.tolist(), strict=True)))

        def loss(log_values: FloatArray) -> float:
            densities = log_densities(states, times_s, num_past, model_of(log_values))
            return -float(densities[:, steps].mean())

        best = minimize(
            loss,
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


def planar_windows(
    windows: Sequence[tuple[Trajectory, Trajectory]],
) -> tuple[FloatArray, FloatArray]:
    """Return states [N, P + F, 3] of (past, future) pairs, and their times [N, P + F]."""
    states = []
    times_s = []
    for past, future in windows:
        whole = past.then(future)
        plane = past_motion.vehicle_from_cam(past)
        states.append(planar_states(whole.world_from_cam, len(past), plane))
        times_s.append(whole.times_s)
    return np.stack(states), np.stack(times_s)


def log_densities(
    states: FloatArray,  # [N, P + F, 3]
    times_s: FloatArray,  # [N, P + F]
    num_past: int,
    model: VehicleModel,
) -> FloatArray:
    """Return log densities [N, F] of the true future under the extended Kalman filter."""
    belief = initial_belief(states, times_s, model)
    steps_s = np.diff(times_s, axis=1)
    densities = []
    for step in range(1, states.shape[1]):
        belief = _predicted(model, belief, steps_s[:, step - 1])
        if step < num_past:
            belief = _updated(belief, states[:, step], model.measurement_noise)
        else:
            mean, covariance = belief
            error = states[:, step] - mean[:, :3]
            densities.append(_log_gaussian(error, covariance[:, :3, :3]))
    return np.stack(densities, axis=1)


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


def _predicted(model: VehicleModel, belief: Belief, dt_s: FloatArray) -> Belief:
    """Return beliefs after dt [N], as `TurnRateKalman.prediction` for one."""
    state, covariance = belief
    jacobian = model.jacobian(state, dt_s)
    covariance = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    return model.transition(state, dt_s), covariance + model.process_noise(state, dt_s)


def _updated(belief: Belief, measured: FloatArray, noise: FloatArray) -> Belief:
    """Return beliefs after measurements [N, 3] of their first three states."""
    state, covariance = belief
    innovation_covariance = covariance[:, :3, :3] + noise
    gain = np.swapaxes(np.linalg.solve(innovation_covariance, covariance[:, :3]), -1, -2)
    innovation = measured - state[:, :3]
    updated = covariance - gain @ covariance[:, :3]
    symmetric = 0.5 * (updated + np.swapaxes(updated, -1, -2))
    return state + (gain @ innovation[..., None])[..., 0], symmetric


def _log_gaussian(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the log density [N] of errors [N, 3] with covariances [N, 3, 3]."""
    white = np.linalg.solve(covariance, error[..., None])[..., 0]
    log_determinant = np.linalg.slogdet(2 * np.pi * covariance)[1]
    return np.asarray(-0.5 * ((error * white).sum(-1) + log_determinant))

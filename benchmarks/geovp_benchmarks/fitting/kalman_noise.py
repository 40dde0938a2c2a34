"""Fit the process and measurement noise of the Kalman forecasters by maximum likelihood of the
train poses.

The objective is the mean log density of (x, z, yaw) at several horizons given the past of the
window (a composite likelihood): one-step innovations alone would give a noise that is right for a
tenth of a second and wrong for two. All windows are filtered at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
from scipy.optimize import minimize

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.kalman import (
    extended_prediction,
    initial_belief,
    joseph_update,
    planar_states,
)
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.types import FloatArray, Trajectory

HORIZONS = (1, 3, 5, 10, 15, 20)
LEAST = {
    "position_noise_m": 1e-3,
    "yaw_noise_rad": 1e-4,
}  # of recorded poses, which are smoother than any odometry
NOTE = """# Constants of the Kalman forecasters, written by `geovp forecast fit-kalman`.
# Fitted to ground-truth poses of KITTI odometry (Geiger et al. 2012), CC BY-NC-SA 3.0; the poses are not included.
"""


def initial_models() -> dict[str, VehicleModel]:
    """The first guess of every variant that is fitted, by name; a constant of 0 stays 0."""
    constant_speed = VehicleModel(0.0, 0.0, 0.85, 0.02, 0.8, 0.2, 0.0)
    accelerated = replace(constant_speed, speed_noise=0.1, acceleration_noise=0.8)
    damped = replace(accelerated, acceleration_damping_hz=0.2, turn_damping_hz=0.5)
    return {"turn-rate": constant_speed, "acceleration": accelerated, "acceleration-damped": damped}


def planar_windows(
    windows: Sequence[tuple[Trajectory, Trajectory]],
) -> tuple[FloatArray, FloatArray]:
    """States [N, P + F, 3] of (past, future) pairs on their own planes, and their times [N, P + F]
    in seconds.
    """
    states, times_s = [], []
    for past, future in windows:
        whole = past.then(future)
        states.append(
            planar_states(whole.world_from_cam, len(past), past_motion.vehicle_from_cam(past))
        )
        times_s.append(whole.times_s - past.times_s[-1])
    return np.stack(states), np.stack(times_s)


def log_densities(
    states: FloatArray,  # [N, P + F, 3]
    times_s: FloatArray,  # [N, P + F]
    num_past: int,
    model: VehicleModel,
) -> FloatArray:
    """Log densities [N, F] of the true future under the extended Kalman filter."""
    belief = initial_belief(states[:, :num_past], times_s, model)
    densities = []
    for step in range(1, states.shape[1]):
        belief = extended_prediction(model, belief, times_s[:, step] - times_s[:, step - 1])
        if step < num_past:
            belief = joseph_update(belief, states[:, step], model.measurement_noise)
        else:
            densities.append(
                _log_gaussian(states[:, step] - belief[0][:, :3], belief[1][:, :3, :3])
            )
    return np.stack(densities, axis=1)


def fit(
    windows: Sequence[tuple[Trajectory, Trajectory]],
    start: VehicleModel,
    max_evaluations: int = 700,
) -> VehicleModel:
    """The most likely constants for (past, future) pairs; those that are 0 at the start stay 0."""
    (states, times_s), num_past = planar_windows(windows), len(windows[0][0])
    horizons = [horizon - 1 for horizon in HORIZONS if horizon <= states.shape[1] - num_past]
    free = {name: value for name, value in asdict(start).items() if value > 0}
    least = np.array([LEAST.get(name, 1e-5) for name in free])

    def model_of(log_values: FloatArray) -> VehicleModel:
        values = np.maximum(np.exp(np.clip(log_values, -20, 3)), least)
        return replace(start, **dict(zip(free, values.tolist(), strict=True)))

    def loss(log_values: FloatArray) -> float:
        return -float(
            log_densities(states, times_s, num_past, model_of(log_values))[:, horizons].mean()
        )

    options = {"maxfev": max_evaluations, "xatol": 1e-2, "fatol": 1e-4, "adaptive": True}
    with np.errstate(all="ignore"):
        found = minimize(loss, np.log(list(free.values())), method="Nelder-Mead", options=options)
    return model_of(found.x)


def as_toml(fitted: Mapping[str, VehicleModel]) -> str:
    """The text of `turn_rate.toml`."""
    tables = [
        "\n".join(
            [
                f"[{name}]",
                *(f"{field} = {float(f'{value:.5g}')}" for field, value in asdict(model).items()),
            ]
        )
        for name, model in fitted.items()
    ]
    return "\n\n".join([NOTE.rstrip(), *tables]) + "\n"


def _log_gaussian(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Log density [N] of errors [N, 3] with covariances [N, 3, 3]."""
    white = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.asarray(
        -0.5 * ((error * white).sum(-1) + np.linalg.slogdet(2 * np.pi * covariance)[1])
    )

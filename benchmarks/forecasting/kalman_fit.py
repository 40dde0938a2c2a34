"""Fit the constants of the Kalman forecasters by maximum likelihood of the train poses.

What is maximised is the mean log density of (x, z, yaw) at several horizons given the past of the window (a composite
likelihood): one-step innovations alone would make a noise that is right for a tenth of a second and wrong for two.
All windows are filtered at once by the same lines of `kalman_filters` and `motion_models` that a single forecast uses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import minimize

from benchmarks.forecasting.windows import Window
from geovp_classic.forecasting import kalman_filters, past_motion
from geovp_classic.forecasting.kalman_filters import KalmanConstants
from geovp_classic.forecasting.motion_models import NUM_STATES, YAW, VehicleModel
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray

HORIZONS = (1, 3, 5, 10, 15, 20)
LEAST = {"position_noise_m": 1e-3, "yaw_noise_rad": 1e-4}  # recorded poses look perfect; nobody's odometry is
NOTE = """# Constants of the Kalman forecasters, written by `geovp forecast fit-kalman`.
# Fitted to ground-truth poses of KITTI odometry (Geiger et al. 2012), CC BY-NC-SA 3.0; the poses are not included.
"""


@dataclass(frozen=True)
class Start:
    """Where the search begins; a constant that begins at 0 stays there."""

    constants: KalmanConstants
    num_states: int


def starts() -> dict[str, Start]:
    """The variants that are fitted, by name."""
    plain = VehicleModel(0.0, 0.0, 0.85, 0.02, 0.8, 0.2, 0.0)
    accelerated = replace(plain, acceleration_damping_hz=0.2, speed_noise=0.1, acceleration_noise=0.8)
    damped = replace(accelerated, turn_damping_hz=0.5)
    undamped = replace(accelerated, acceleration_damping_hz=0.0)
    return {
        "turn-rate": Start(KalmanConstants(plain, 0.01, 0.001), NUM_STATES - 1),
        "acceleration": Start(KalmanConstants(undamped, 0.01, 0.001), NUM_STATES),
        "acceleration-damped": Start(KalmanConstants(damped, 0.01, 0.001), NUM_STATES),
    }


@dataclass(frozen=True)
class Stack:
    """Windows on their own planes, one behind the other."""

    states: FloatArray  # [N, P + F, 3], yaw unwrapped
    times_s: FloatArray  # [N, P + F], 0 at the last past step
    num_past: int


def stacked(windows: Sequence[Window]) -> Stack:
    """Windows of equal length as arrays."""
    states, times_s = [], []
    for window in windows:
        whole, reference = window.past.then(window.future), window.past.world_from_cam[-1]
        state = planar.reduce(whole.world_from_cam, reference, past_motion.vehicle_from_cam(window.past))
        state[:, YAW] = np.unwrap(state[:, YAW])
        state[:, YAW] -= state[len(window.past) - 1, YAW]
        states.append(state)
        times_s.append(whole.times_s - window.past.times_s[-1])
    return Stack(np.stack(states), np.stack(times_s), len(windows[0].past))


def log_densities(stack: Stack, constants: KalmanConstants, num_states: int) -> FloatArray:
    """Log densities [N, F] of the true future under the extended filter."""
    past, noise = stack.states[:, : stack.num_past], constants.measurement_noise
    state, spread = kalman_filters.start(past, stack.times_s, constants, num_states)
    densities, measures, model = [], np.eye(3, num_states), constants.model
    for step in range(1, stack.states.shape[1]):
        dt_s = stack.times_s[:, step] - stack.times_s[:, step - 1]
        jacobian = model.jacobian(state, dt_s)
        spread = jacobian @ spread @ np.swapaxes(jacobian, 1, 2) + model.noise(state, dt_s)
        spread, state = kalman_filters.symmetric(spread), model.moved(state, dt_s)
        off = stack.states[:, step] - state[:, :3]
        if step >= stack.num_past:
            densities.append(_gaussian(off, spread[:, :3, :3]))
            continue
        gain = np.swapaxes(np.linalg.solve(spread[:, :3, :3] + noise, spread[:, :3]), 1, 2)
        kept = np.eye(num_states) - gain @ measures
        spread = kept @ spread @ np.swapaxes(kept, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
        spread, state = kalman_filters.symmetric(spread), state + (gain @ off[..., None])[..., 0]
    return np.stack(densities, axis=1)


def fit(windows: Sequence[Window], start: Start, max_evaluations: int = 700) -> KalmanConstants:
    """The most likely constants."""
    stack, names = stacked(windows), _free(start.constants)
    num_future = stack.states.shape[1] - stack.num_past
    horizons = [horizon - 1 for horizon in HORIZONS if horizon <= num_future]

    def loss(log_values: FloatArray) -> float:
        constants = _with(start.constants, names, _bounded(names, log_values))
        return -float(log_densities(stack, constants, start.num_states)[:, horizons].mean())

    begin = np.log([_get(start.constants, name) for name in names])
    options = {"maxfev": max_evaluations, "xatol": 1e-2, "fatol": 1e-4, "adaptive": True}
    with np.errstate(all="ignore"):
        found = minimize(loss, begin, method="Nelder-Mead", options=options)
    return _with(start.constants, names, _bounded(names, found.x))


def as_toml(fitted: dict[str, KalmanConstants]) -> str:
    """The text of `turn_rate.toml`."""
    lines = [NOTE]
    for name, constants in fitted.items():
        lines.append(f"[{name}]")
        lines += [f"{field} = {float(f'{_get(constants, field):.5g}')}" for field in _names()]
        lines.append("")
    return "\n".join(lines)


def _gaussian(off: FloatArray, covariance: FloatArray) -> FloatArray:
    white = np.linalg.solve(covariance, off[..., None])[..., 0]
    density: FloatArray = -0.5 * ((off * white).sum(-1) + np.linalg.slogdet(2 * np.pi * covariance)[1])
    return density


def _names() -> tuple[str, ...]:
    return (*(field.name for field in fields(VehicleModel)), "position_noise_m", "yaw_noise_rad")


def _get(constants: KalmanConstants, name: str) -> float:
    owner = constants if name in ("position_noise_m", "yaw_noise_rad") else constants.model
    return float(getattr(owner, name))


def _free(constants: KalmanConstants) -> tuple[str, ...]:
    return tuple(name for name in _names() if _get(constants, name) > 0)


def _bounded(names: Sequence[str], log_values: FloatArray) -> FloatArray:
    least = np.array([LEAST.get(name, 1e-5) for name in names])
    return np.clip(np.exp(np.clip(log_values, -20, 3)), least, None)


def _with(constants: KalmanConstants, names: Sequence[str], values: FloatArray) -> KalmanConstants:
    new = {name: float(value) for name, value in zip(names, values, strict=True)}
    own = {name: new.pop(name) for name in ("position_noise_m", "yaw_noise_rad") if name in new}
    return replace(constants, model=replace(constants.model, **new), **own)

"""Kalman forecasters on the vehicle's plane: constant turn rate, with or without acceleration,
extended or unscented.

Past poses are measurements of (x, z, yaw); for the future the filter predicts without any. Yaw is
unwrapped before filtering and never wrapped inside, so +-pi is no special place. Height, pitch and
roll are those of the last pose, on the plane that the past motion suggests. With one sample the
futures are the filter's mean, with more they are paths drawn from it. A single past pose is held in
the mean, with a wide covariance.

The process and measurement noise in `turn_rate.toml` is fitted by maximum likelihood: `geovp
forecast fit-kalman`.
"""

import functools
import tomllib
from dataclasses import dataclass, field
from importlib import resources

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, unscented_transform

from geovp_classic.errors import UnknownComponent
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import BodyMotion
from geovp_classic.forecasting.motion_models import SPEED, TURN, YAW, VehicleModel
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

START_DEVIATION = np.array(
    [20.0, 2.0, 3.0]
)  # of speed, turn rate and acceleration before any measurement


@functools.cache
def fitted(name: str) -> VehicleModel:
    """The constants of a table of `turn_rate.toml`; UnknownComponent for a name that it does not
    hold.
    """
    tables = tomllib.loads(
        (resources.files("geovp_classic.poses") / "turn_rate.toml").read_text("utf-8")
    )
    if name not in tables:
        raise UnknownComponent(
            f"no fitted constants are called {name!r}: known are {', '.join(sorted(tables))}"
        )
    return VehicleModel(**tables[name])


Belief = tuple[FloatArray, FloatArray]  # state [..., n] and covariance [..., n, n]


def planar_states(
    world_from_cam: FloatArray,  # [T, 4, 4]
    num_past: int,
    vehicle_from_cam: FloatArray,  # [4, 4]
) -> FloatArray:
    """(x, z, yaw) [T, 3] on the plane of the last past camera, yaw unwrapped and 0 there."""
    states = planar.reduce(world_from_cam, world_from_cam[num_past - 1], vehicle_from_cam)
    yaw_rad = np.unwrap(states[:, YAW])
    states[:, YAW] = yaw_rad - yaw_rad[num_past - 1]  # after any number of full turns
    return states


def extended_prediction(model: VehicleModel, belief: Belief, dt_s: FloatArray | float) -> Belief:
    """The belief after dt [...], linearised at the present state, for any number of filters at
    once.
    """
    state, covariance = belief
    jacobian = model.jacobian(state, dt_s)
    covariance = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2) + model.process_noise(
        state, dt_s
    )
    return model.transition(state, dt_s), _symmetric(covariance)


def joseph_update(
    belief: Belief,
    measured: FloatArray,  # [..., 3], of the first three states
    noise: FloatArray,  # [3, 3]
) -> Belief:
    """The belief after a linear measurement, in Joseph form, for any number of filters at once.

    It serves the unscented filter, too, since the measurement is linear: 3.4 times as fast as
    filterpy's update, and for 350 filters thirty times.
    """
    state, covariance = belief
    gain = np.swapaxes(
        np.linalg.solve(covariance[..., :3, :3] + noise, covariance[..., :3, :]), -1, -2
    )
    kept = np.eye(state.shape[-1]) - gain @ np.eye(3, state.shape[-1])
    covariance = kept @ covariance @ np.swapaxes(kept, -1, -2) + gain @ noise @ np.swapaxes(
        gain, -1, -2
    )
    return state + (gain @ (measured - state[..., :3])[..., None])[..., 0], _symmetric(covariance)


def initial_belief(
    measured: FloatArray,  # [..., P, 3], yaw unwrapped
    times_s: FloatArray,  # [..., P]
    model: VehicleModel,
) -> Belief:
    """A wide belief at the first pose, with the velocity of the first step."""
    state = np.zeros((*measured.shape[:-2], model.num_states))
    state[..., :3] = measured[..., 0, :]
    if measured.shape[-2] > 1:
        dt_s = times_s[..., 1] - times_s[..., 0]
        step, yaw = measured[..., 1, :] - measured[..., 0, :], measured[..., 0, YAW]
        state[..., SPEED] = (step[..., 0] * np.sin(yaw) + step[..., 1] * np.cos(yaw)) / dt_s
        state[..., TURN] = step[..., 2] / dt_s
    variances = np.concatenate(
        [np.diag(model.measurement_noise), START_DEVIATION[: model.num_states - 3] ** 2]
    )
    return state, np.broadcast_to(np.diag(variances), (*state.shape, model.num_states)).copy()


@dataclass(frozen=True)
class TurnRateKalman:
    """Constant turn rate and speed (CTRV), extended Kalman filter."""

    constants: str = "turn-rate"
    seed: int = 0
    body_motion: BodyMotion | None = field(
        default_factory=BodyMotion
    )  # None: height, pitch and roll stay

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]: the mean, or draws when more than one is asked for."""
        if num_samples == 1:
            mean = self.distribution(past, times_s)
            poses = planar.lift(mean.means, mean.world_from_reference, mean.vehicle_from_cam)
        else:
            poses = self._drawn(past, times_s, num_samples)
        return (
            poses if self.body_motion is None else self.body_motion.added_to(poses, past, times_s)
        )

    def _drawn(self, past: Trajectory, times_s: FloatArray, num_samples: int) -> FloatArray:
        """Planar futures [S, F, 4, 4]."""
        steps_s = np.diff(past_motion.seconds_ahead(past, times_s), prepend=0.0)
        belief, plane, unit = self._filtered(past)
        paths = _sample_paths(
            self.model, belief, steps_s, num_samples, np.random.default_rng(self.seed)
        )
        return planar.lift(paths * unit, past.world_from_cam[-1], plane)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive Gaussian of (x, z, yaw) at every future time."""
        steps_s = np.diff(past_motion.seconds_ahead(past, times_s), prepend=0.0)
        belief, plane, unit = self._filtered(past)
        means, covariances = [], []
        for dt_s in steps_s.tolist():
            belief = self.prediction(belief, dt_s)
            means.append(belief[0][:3] * unit)
            covariances.append(belief[1][:3, :3] * unit[:, None] * unit)
        modes = (np.ones(1), np.stack(means)[None], np.stack(covariances)[None])
        motion = self.body_motion if len(past) > 1 else None
        body = None if motion is None else motion.distribution(past, times_s)
        return PlanarForecast(*modes, past.world_from_cam[-1], plane, body)

    @property
    def model(self) -> VehicleModel:
        """The vehicle with the fitted constants."""
        return fitted(self.constants)

    def prediction(self, belief: Belief, dt_s: float) -> Belief:
        """The belief after dt."""
        return extended_prediction(self.model, belief, dt_s)

    def filtered(self, measured: FloatArray, times_s: FloatArray) -> Belief:
        """The belief at the last of measured (x, z, yaw) [P, 3], yaw unwrapped."""
        belief, noise = initial_belief(measured, times_s, self.model), self.model.measurement_noise
        for dt_s, state in zip(np.diff(times_s).tolist(), measured[1:], strict=True):
            belief = joseph_update(self.prediction(belief, dt_s), state, noise)
        return belief

    def _filtered(self, past: Trajectory) -> tuple[Belief, FloatArray, FloatArray]:
        """The belief at the last pose, vehicle_from_cam of its plane, and (x, z, yaw) of the past's
        unit for its 1.
        """
        metric, metres_per_unit = past_motion.in_metres(past)
        plane = past_motion.vehicle_from_cam(metric)
        belief = self.filtered(
            planar_states(metric.world_from_cam, len(metric), plane), metric.times_s
        )
        return belief, plane, np.array([1 / metres_per_unit, 1 / metres_per_unit, 1.0])


class TurnRateUnscented(TurnRateKalman):
    """Constant turn rate and speed (CTRV), unscented Kalman filter."""

    def prediction(self, belief: Belief, dt_s: float) -> Belief:
        """The belief after dt by filterpy's sigma points, all moved at once: 5 times as fast as its
        filter's loop.
        """
        points = MerweScaledSigmaPoints(self.model.num_states, alpha=0.5, beta=2.0, kappa=0.0)
        moved = self.model.transition(points.sigma_points(*belief), dt_s)
        noise = self.model.process_noise(belief[0], dt_s)
        mean, covariance = unscented_transform(moved, points.Wm, points.Wc, noise)
        return mean, _symmetric(covariance)


@dataclass(frozen=True)
class AccelerationKalman(TurnRateKalman):
    """Constant turn rate and acceleration (CTRA), extended Kalman filter; damped or not as its
    constants say.
    """

    constants: str = "acceleration-damped"  # or "acceleration"


def _sample_paths(
    model: VehicleModel,
    belief: Belief,
    steps_s: FloatArray,
    num_samples: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Paths [S, F, 3]: a start drawn from the belief, then the motion with process noise."""
    states = belief[0] + rng.standard_normal((num_samples, model.num_states)) @ _root(belief[1]).T
    path = []
    for dt_s in steps_s:
        noise = _root(model.process_noise(states, dt_s)) @ rng.standard_normal(
            (num_samples, model.num_states, 1)
        )
        states = model.transition(states, dt_s) + noise[..., 0]
        path.append(states[:, :3])
    return np.stack(path, axis=1)


def _symmetric(covariance: FloatArray) -> FloatArray:
    """The mean of a covariance [..., n, n] and its transpose, which differ by rounding."""
    return 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def _root(covariance: FloatArray) -> FloatArray:
    """A with A A' = covariance, also where that is singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])

"""Heave, pitch and roll of the vehicle's body over its plane, predicted from the past motion.

The last pose contains suspension motion, which decays within a second. A linear map of the past
twists predicts it; the residual is Student's t, and its scale grows with the past motion.

The coefficients are fitted to ground-truth poses of KITTI odometry 00, 02, 08 and 09 (Geiger et
al. 2012) by `benchmarks/studies/fitting`. The poses are CC BY-NC-SA 3.0 and not included.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.special import stdtr

from geovp_classic import files
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

BODY_AXES = [Axis.DOWN, Axis.PITCH, Axis.ROLL]  # heave, pitch, roll


@dataclass(frozen=True)
class BodyCoefficients:
    """Linear map of scaled past twists [N, P, 6] per second to body motion at F steps."""

    step_s: float
    scale: FloatArray  # [P * 6], root mean squares of the features
    weights: FloatArray  # [P * 6, F * 3], metres and radians
    spread: FloatArray  # [5, F * 3], of the logarithm of a residual's scale
    degrees: FloatArray  # [3], of freedom of Student's t: heave, pitch, roll


@dataclass(frozen=True)
class BodyForecast:
    """Heave (m, downwards), pitch and roll (rad) over the plane; all are independent."""

    means: FloatArray  # [F, 3]
    scales: FloatArray  # [F, 3], of Student's t
    degrees: FloatArray  # [3], of freedom

    def log_density(self, states: FloatArray) -> FloatArray:
        """Return the log density [N, F] at states [N, F, 3]."""
        from scipy import stats  # takes half a second to import

        density = stats.t.logpdf(states, self.degrees, self.means, self.scales)
        return density.sum(axis=-1)

    def ranks(self, states: FloatArray) -> FloatArray:
        """Return the probability [F, 3] of the central interval that ends at each state [F, 3]."""
        distance = np.abs(states - self.means) / self.scales
        return 2 * stdtr(self.degrees, distance) - 1

    def sample(
        self,
        num_samples: int,
        seed: int,
    ) -> FloatArray:
        """Draw states [N, F, 3], independent from step to step."""
        rng = np.random.default_rng(seed)
        drawn = rng.standard_t(self.degrees, (num_samples, *self.means.shape))
        return self.means + self.scales * drawn


@dataclass(frozen=True)
class BodyMotion:
    """Heave, pitch and roll for the poses of a planar forecast."""

    coefficients: Path | None = None  # a file; None: the packaged one

    def added_to(
        self,
        world_from_cam: FloatArray,  # [S, F, 4, 4]
        past: Trajectory,
        times_s: FloatArray,  # [F]
    ) -> FloatArray:
        """Return planar futures [S, F, 4, 4] with body motion; unchanged after a single pose."""
        if len(past) < 2:
            return world_from_cam
        twists = np.zeros((len(times_s), 6))
        twists[:, BODY_AXES] = self.distribution(past, times_s).means
        return world_from_cam @ se3.exp(twists)

    def distribution(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
    ) -> BodyForecast:
        """Return body motion at F times after at least two metric poses.

        It is 0 at the last pose and constant beyond the fitted 2.1 s.
        """
        fitted = load(self.coefficients)
        num_past_steps = len(fitted.scale) // 6
        twists = past_motion.twists_per_s(past, fitted.step_s, num_past_steps)
        # The mean is linear in the changes of the past motion, and so is the logarithm of the scale
        # in those of its size. Changes beyond four root mean squares are outliers, in the fit as
        # well.
        features = np.clip(changes(twists[None]) / fitted.scale, -4.0, 4.0)
        log_scales = motion_features(twists[None]) @ fitted.spread

        # From the steps of the fit to the times
        steps = (times_s - past.times_s[-1]) / fitted.step_s

        def interpolated(states: FloatArray) -> FloatArray:
            nodes = np.concatenate([np.zeros((1, 3)), states.reshape(-1, 3)])
            spline = make_interp_spline(np.arange(len(nodes)), nodes, k=1)
            return spline(np.minimum(steps, len(nodes) - 1))

        means = interpolated(features @ fitted.weights)
        scales = interpolated(np.exp(log_scales))
        return BodyForecast(means, scales, fitted.degrees)


def changes(
    twists: FloatArray,  # [N, P, 6], per second
) -> FloatArray:
    """Return twists [N, P * 6] less their mean speed: 0 for steady straight driving."""
    mean_speed = twists[..., Axis.FORWARD].mean(axis=1, keepdims=True)
    changes = twists.copy()
    changes[..., Axis.FORWARD] -= mean_speed
    return changes.reshape(len(changes), -1)


def motion_features(
    twists: FloatArray,  # [N, P, 6], per second
    noise_floor: tuple[float, ...] = (0.05, 0.01, 0.01),  # m/s, rad/s
) -> FloatArray:
    """Return [N, 5]: 1, and logarithms of heave, pitch and roll rates and of the speed."""
    rates = np.sqrt((twists[..., BODY_AXES] ** 2).mean(axis=1))
    speed = np.abs(twists[..., Axis.FORWARD]).mean(axis=1)
    log_rates = np.log(np.hypot(rates, noise_floor))
    return np.column_stack([np.ones(len(twists)), log_rates, np.log1p(speed)])


def over_plane(
    world_from_cam: FloatArray,  # [F, 4, 4]
    past: Trajectory,
) -> FloatArray:
    """Return heave, pitch and roll [F, 3] of poses [F, 4, 4] over the past motion's plane."""
    reference = past.world_from_cam[-1]
    plane = past_motion.vehicle_from_cam(past)
    flat = planar.lift(planar.reduce(world_from_cam, reference, plane), reference, plane)
    return se3.log(se3.inverse(flat) @ world_from_cam)[:, BODY_AXES]


@functools.cache
def load(path: Path | None) -> BodyCoefficients:
    """Read the coefficients of a file (None: the packaged one); raise BadData for another file."""
    source = path or files.PACKAGED / "body_motion.npz"
    arrays = files.read_npz(source)
    advice = "fit one with `benchmarks/studies fitting`"
    with files.checked(f"{source} holds no body motion", advice):
        names = ("scale", "weights", "spread", "degrees")
        columns = [arrays[name].astype(np.float64) for name in names]
        return BodyCoefficients(float(arrays["step_s"]), *columns)

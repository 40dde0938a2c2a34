"""Heave, pitch and roll of the vehicle's body over its plane, foretold from the past motion.

The last pose is taken in mid-bounce: a forecast that keeps its height, pitch and roll is off by a
tenth of a degree one frame later, and the springs bring the body back. A linear map of the past
twists foretells most of the first frames and little of the last ones, which belong to a road that
poses don't show. What it leaves is spread as Student's t, the wider the livelier the past was.

The coefficients are fitted by `geovp forecast fit-body-motion` to ground-truth poses of KITTI
odometry 00, 02, 08 and 09 (Geiger et al. 2012); they are CC BY-NC-SA 3.0 and not included.
"""

import functools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_network import FORWARD
from geovp_classic.forecasting.sampling import BodyForecast
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

NUM_PAST_STEPS = 9
FARTHEST = 4.0  # of a feature, in its root mean squares
HEAVE, PITCH, ROLL = 1, 3, 5  # of a twist (v, w) in the camera's frame
CALM = np.array(
    [0.05, 0.01, 0.01]
)  # m/s and rad/s, of heave, pitch and roll: smaller motion is noise


@dataclass(frozen=True)
class Coefficients:
    """A linear map of scaled past twists."""

    step_s: float
    scale: FloatArray  # [P * 6], root mean squares of the features
    weights: FloatArray  # [P * 6, F * 3], metres and radians
    spread: FloatArray  # [5, F * 3], of the logarithm of a residual's scale
    degrees: FloatArray  # [3], of freedom of its Student's t: heave, pitch, roll

    def __call__(self, twists: FloatArray) -> FloatArray:
        """Heave (m, downwards), pitch and roll (rad) [N, F, 3] at F steps after twists per second
        [N, P, 6].
        """
        return (features(twists, self.scale) @ self.weights).reshape(len(twists), -1, 3)

    def scales(self, twists: FloatArray) -> FloatArray:
        """The scale [N, F, 3] of what the map leaves."""
        return np.exp(liveliness(twists) @ self.spread).reshape(len(twists), -1, 3)


@dataclass(frozen=True)
class BodyMotion:
    """Adds heave, pitch and roll to the poses of a planar forecast."""

    coefficients: Path | None = None  # a file of `fit-body-motion`; None: the packaged one

    def added_to(
        self, world_from_cam: FloatArray, past: Trajectory, times_s: FloatArray
    ) -> FloatArray:
        """Planar futures [S, F, 4, 4] with the body's motion; as they are after a single pose.

        Beyond the fitted 2.1 s the last state stays.
        """
        if len(past) < 2:
            return world_from_cam
        twists = np.zeros((len(times_s), 6))
        twists[:, [HEAVE, PITCH, ROLL]] = self.distribution(past, times_s).means
        return world_from_cam @ se3.exp(twists)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> BodyForecast:
        """Heave, pitch and roll at F times after at least two past poses, heave in the unit of the
        past.
        """
        fitted = load(self.coefficients)
        metric, metres_per_unit = past_motion.in_metres(past)
        twists = past_motion.twists_per_s(metric, fitted.step_s, NUM_PAST_STEPS)[None]
        unit = np.array([1 / metres_per_unit, 1.0, 1.0])
        known = (
            np.concatenate([np.zeros((1, 3)), states[0]]) * unit
            for states in (fitted(twists), fitted.scales(twists))
        )
        means, scales = (
            _between(values, (times_s - past.times_s[-1]) / fitted.step_s) for values in known
        )
        return BodyForecast(means, scales, fitted.degrees)


def features(twists: FloatArray, scale: FloatArray) -> FloatArray:
    """Scaled and bounded twists [N, P * 6], forward speed less its mean: all are 0 for an even
    drive straight ahead.
    """
    own = twists.copy()
    own[..., FORWARD] -= own[..., FORWARD].mean(axis=1, keepdims=True)
    return np.clip(own.reshape(len(own), -1) / scale, -FARTHEST, FARTHEST)


def liveliness(twists: FloatArray) -> FloatArray:
    """What the scale of a residual depends on [N, 5]: 1, logarithms of heave, pitch and roll rates,
    and of speed.
    """
    rates = np.sqrt((twists[..., [HEAVE, PITCH, ROLL]] ** 2).mean(axis=1))
    speed = np.abs(twists[..., FORWARD]).mean(axis=1)
    return np.column_stack([np.ones(len(twists)), np.log(np.hypot(rates, CALM)), np.log1p(speed)])


def over_plane(world_from_cam: FloatArray, past: Trajectory) -> FloatArray:
    """Heave, pitch and roll [F, 3] of poses [F, 4, 4] over the plane that the past
    motion suggests.
    """
    reference, plane = past.world_from_cam[-1], past_motion.vehicle_from_cam(past)
    flat = planar.lift(planar.reduce(world_from_cam, reference, plane), reference, plane)
    return se3.log(se3.inverse(flat) @ world_from_cam)[:, [HEAVE, PITCH, ROLL]]


@functools.cache
def load(path: Path | None) -> Coefficients:
    """The coefficients of a file (None: the packaged one), read once; BadData when it does not hold
    them.
    """
    source = path or Path(str(resources.files("geovp_classic.poses") / "body_motion.npz"))
    try:
        arrays = files.finite_arrays(source)
        names = ("scale", "weights", "spread", "degrees")
        return Coefficients(
            float(arrays["step_s"]), *(np.asarray(arrays[name], np.float64) for name in names)
        )
    except (ValueError, KeyError, TypeError) as error:
        raise BadData(
            f"{source} holds no body motion ({error}): write one with fit-body-motion"
        ) from error


def _between(nodes: FloatArray, steps: FloatArray) -> FloatArray:
    """Values [F, 3] at F numbers of steps, from those at 0, 1, ...; the last ones beyond."""
    return np.stack([np.interp(steps, np.arange(len(nodes)), column) for column in nodes.T], axis=1)

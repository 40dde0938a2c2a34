"""Heave, pitch and roll of the vehicle's body over its plane, foretold from the past motion.

The last pose is taken in mid-bounce: a forecast that keeps its height, pitch and roll is off by a tenth of a degree one
frame later, and the springs bring the body back. A linear map of the past twists foretells most of the first frames
and little of the last ones, which belong to a road that poses don't show.

The coefficients are fitted by `geovp forecast fit-body-motion` to ground-truth poses of KITTI odometry 00, 02, 08 and
09 (Geiger et al. 2012); they are CC BY-NC-SA 3.0 and not included.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_network import FORWARD
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

NUM_PAST_STEPS = 9
FARTHEST = 4.0  # of a feature, in its root mean squares
HEAVE, PITCH, ROLL = 1, 3, 5  # of a twist (v, w) in the camera's frame


@dataclass(frozen=True)
class Coefficients:
    """A linear map of scaled past twists."""

    step_s: float
    scale: FloatArray  # [P * 6], root mean squares of the features
    weights: FloatArray  # [P * 6, F * 3], metres and radians

    def __call__(self, twists: FloatArray) -> FloatArray:
        """Heave (m, downwards), pitch and roll (rad) [N, F, 3] at F steps after twists per second [N, P, 6]."""
        return (features(twists, self.scale) @ self.weights).reshape(len(twists), -1, 3)


@dataclass(frozen=True)
class BodyMotion:
    """Adds heave, pitch and roll to the poses of a planar forecast."""

    coefficients: Path | None = None  # a file of `fit-body-motion`; None: the packaged one

    def added_to(self, world_from_cam: FloatArray, past: Trajectory, times_s: FloatArray) -> FloatArray:
        """Planar futures [S, F, 4, 4] with the body's motion; as they are after a single pose.

        Beyond the fitted 2.1 s the last state stays.
        """
        if len(past) < 2:
            return world_from_cam
        fitted = load(self.coefficients)
        metric, metres_per_unit = past_motion.in_metres(past)
        states = fitted(past_motion.twists_per_s(metric, fitted.step_s, NUM_PAST_STEPS)[None])[0]
        nodes_s = fitted.step_s * np.arange(len(states) + 1)
        twists = np.zeros((len(times_s), 6))
        for column, values in zip((HEAVE, PITCH, ROLL), states.T, strict=True):
            twists[:, column] = np.interp(times_s - past.times_s[-1], nodes_s, np.append(0.0, values))
        twists[:, HEAVE] /= metres_per_unit
        return world_from_cam @ se3.exp(twists)


def features(twists: FloatArray, scale: FloatArray) -> FloatArray:
    """Scaled and bounded twists [N, P * 6], forward speed less its mean: all are 0 for an even drive straight ahead."""
    own = twists.copy()
    own[..., FORWARD] -= own[..., FORWARD].mean(axis=1, keepdims=True)
    return np.clip(own.reshape(len(own), -1) / scale, -FARTHEST, FARTHEST)


def over_plane(world_from_cam: FloatArray, past: Trajectory) -> FloatArray:
    """Heave, pitch and roll [F, 3] of poses [F, 4, 4] over the plane that the past motion suggests."""
    reference, plane = past.world_from_cam[-1], past_motion.vehicle_from_cam(past)
    flat = planar.lift(planar.reduce(world_from_cam, reference, plane), reference, plane)
    return se3.log(se3.inverse(flat) @ world_from_cam)[:, [HEAVE, PITCH, ROLL]]


@functools.cache
def load(path: Path | None) -> Coefficients:
    """The coefficients of a file (None: the packaged one), read once; BadData when it does not hold them."""
    source = path or Path(str(resources.files("geovp_classic.poses") / "body_motion.npz"))
    try:
        arrays = files.finite_arrays(source)
        scale, weights = (np.asarray(arrays[name], np.float64) for name in ("scale", "weights"))
        return Coefficients(float(arrays["step_s"]), scale, weights)
    except (ValueError, KeyError, TypeError) as error:
        raise BadData(f"{source} holds no body motion ({error}): write one with fit-body-motion") from error

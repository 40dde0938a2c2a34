"""Heave, pitch and roll of the vehicle's body over its plane, predicted from the past motion.

The last pose contains suspension motion, which decays within a second. A linear map of the past
twists predicts it; the residual is Student's t, and its scale grows with the past motion.

`geovp forecast fit-body-motion` fits the coefficients to ground-truth poses of KITTI odometry 00,
02, 08 and 09 (Geiger et al. 2012). They are CC BY-NC-SA 3.0 and not included.
"""

import functools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.forecasting.sampling import BodyForecast
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

BODY_AXES = [Axis.DOWN, Axis.PITCH, Axis.ROLL]  # heave, pitch, roll


@dataclass(frozen=True)
class Coefficients:
    """Linear map of scaled past twists [N, P, 6] per second to body motion at F steps."""

    step_s: float
    scale: FloatArray  # [P * 6], root mean squares of the features
    weights: FloatArray  # [P * 6, F * 3], metres and radians
    spread: FloatArray  # [5, F * 3], of the logarithm of a residual's scale
    degrees: FloatArray  # [3], of freedom of Student's t: heave, pitch, roll
    max_feature: float = 4.0  # in root mean squares; larger twists are outliers
    noise_floor: tuple[float, float, float] = (
        0.05,
        0.01,
        0.01,
    )  # m/s, rad/s: noise of the rates

    @property
    def num_past_steps(self) -> int:
        """P, the number of past steps."""
        return len(self.scale) // 6

    def means(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return heave (m, downwards), pitch and roll (rad) [N, F, 3]."""
        return (self.features(twists) @ self.weights).reshape(
            len(twists), -1, 3
        )

    def scales(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return the scales [N, F, 3] of the residual."""
        return np.exp(self.motion_features(twists) @ self.spread).reshape(
            len(twists), -1, 3
        )

    def features(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return scaled and clipped changes [N, P * 6]."""
        return np.clip(
            changes(twists) / self.scale, -self.max_feature, self.max_feature
        )

    def motion_features(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return [N, 5]: 1, and logarithms of heave, pitch and roll rates and of the speed."""
        rates = np.sqrt((twists[..., BODY_AXES] ** 2).mean(axis=1))
        speed = np.abs(twists[..., Axis.FORWARD]).mean(axis=1)
        log_rates = np.log(np.hypot(rates, self.noise_floor))
        return np.column_stack(
            [np.ones(len(twists)), log_rates, np.log1p(speed)]
        )


@dataclass(frozen=True)
class BodyMotion:
    """Heave, pitch and roll for the poses of a planar forecast."""

    coefficients: Path | None = (
        None  # a file of `fit-body-motion`; None: the packaged one
    )

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

        It is constant beyond the fitted 2.1 s.
        """
        fitted = load(self.coefficients)
        twists = past_motion.twists_per_s(
            past, fitted.step_s, fitted.num_past_steps
        )[None]
        steps = (times_s - past.times_s[-1]) / fitted.step_s
        means = _interpolated(fitted.means(twists)[0], steps)
        scales = _interpolated(fitted.scales(twists)[0], steps)
        return BodyForecast(means, scales, fitted.degrees)


def changes(
    twists: FloatArray,  # [N, P, 6], per second
) -> FloatArray:
    """Return twists [N, P * 6] less their mean speed: 0 for steady straight driving."""
    changes = twists.copy()
    changes[..., Axis.FORWARD] -= changes[..., Axis.FORWARD].mean(
        axis=1, keepdims=True
    )
    return changes.reshape(len(changes), -1)


def over_plane(
    world_from_cam: FloatArray,  # [F, 4, 4]
    past: Trajectory,
) -> FloatArray:
    """Return heave, pitch and roll [F, 3] of poses [F, 4, 4] over the past motion's plane."""
    reference = past.world_from_cam[-1]
    plane = past_motion.vehicle_from_cam(past)
    flat = planar.lift(
        planar.reduce(world_from_cam, reference, plane), reference, plane
    )
    return se3.log(se3.inverse(flat) @ world_from_cam)[:, BODY_AXES]


@functools.cache
def load(path: Path | None) -> Coefficients:
    """Read the coefficients of a file (None: the packaged one); raise BadData for another file."""
    source = path or Path(
        str(resources.files("geovp_classic.poses") / "body_motion.npz")
    )
    try:
        arrays = files.finite_arrays(source)
        return Coefficients(
            step_s=float(arrays["step_s"]),
            scale=arrays["scale"].astype(np.float64),
            weights=arrays["weights"].astype(np.float64),
            spread=arrays["spread"].astype(np.float64),
            degrees=arrays["degrees"].astype(np.float64),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise BadData(
            f"{source} holds no body motion ({error}): write one with fit-body-motion"
        ) from error


def _interpolated(
    states: FloatArray,  # [F, 3], at 1..F steps
    steps: FloatArray,  # [T]
) -> FloatArray:
    """Return values [T, 3] at T numbers of steps from states [F, 3] at 1..F steps; 0 at step 0."""
    nodes = np.concatenate([np.zeros((1, 3)), states])
    spline = make_interp_spline(np.arange(len(nodes)), nodes, k=1)
    return spline(np.minimum(steps, len(states)))

"""Training windows of recorded drives, and their augmentation."""

from collections.abc import Iterable

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import over_plane
from geovp_classic.forecasting.motion_network import with_mirrored
from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.geometry import planar, se3
from geovp_classic.types import BoolArray, FloatArray, Trajectory

STEP_S = 0.1037  # KITTI's frame interval

# Past twists [N, P, 6] per second; future x, z, yaw, heave, pitch and roll [N, F, 6].
Windows = tuple[FloatArray, ...]


def joined(sequences: Iterable[tuple[FloatArray, ...]]) -> tuple[FloatArray, ...]:
    """Return the arrays of all sequences, one after the other."""
    return tuple(map(np.concatenate, zip(*sequences, strict=True)))


def cut(
    trajectory: Trajectory,
    num_past: int = 9,
    num_future: int = 21,  # a little more than 20 frames with jittering times
    stride: int = 2,  # frames between two windows
) -> Windows:
    """Return all windows of a trajectory that a car can have driven, and their mirror images.

    The states are those on and over the plane along which the camera has travelled.
    """
    is_drivable = drivable_steps(trajectory)
    twists = []
    states = []
    for last in range(num_past, len(trajectory), stride):
        first = last - num_past
        past = trajectory[first : last + 1]
        times_s = past.times_s[-1] + STEP_S * np.arange(1, num_future + 1)
        end = np.searchsorted(trajectory.times_s, times_s[-1])
        if end < len(trajectory) and is_drivable[first:end].all():
            future = se3.interpolate(trajectory.world_from_cam, trajectory.times_s, times_s)
            plane = past_motion.vehicle_from_cam(past)
            flat = planar.reduce(future, past.world_from_cam[-1], plane)
            twists.append(past_motion.twists_per_s(past, STEP_S, num_past))
            states.append(np.column_stack([flat, over_plane(future, past)]))
    if not states:
        raise BadData("no stretch of 3.1 s that a car can have driven: give other poses")
    mirrored = states * np.array([-1.0, 1.0, -1.0, 1.0, 1.0, -1.0])
    return with_mirrored(np.array(twists)), np.concatenate([states, mirrored])


def drivable_steps(trajectory: Trajectory) -> BoolArray:
    """Return which steps [T - 1] between metric poses a car can have driven.

    KITTI's ground truth comes from satellite navigation and an inertial unit. Where it is
    corrected, the camera slides sideways or upwards, or changes its speed by a metre per second
    between two frames. A car's rear axle moves along the car: velocity across it is explained by
    the camera's position ahead of the axle, its direction and the tyres' slip.
    """
    step_s = np.diff(trajectory.times_s)
    poses = trajectory.world_from_cam
    twists = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) / step_s[:, None]
    speed = twists[:, Axis.FORWARD]
    turn_rate = twists[:, Axis.YAW]
    regressors = np.column_stack([turn_rate, speed, speed**2 * turn_rate])

    def residual(factors: FloatArray) -> FloatArray:
        across = twists[:, [Axis.RIGHT, Axis.DOWN]] - regressors @ factors.reshape(3, 2)
        return across.ravel()

    # The Cauchy loss tolerates steps that are off by more than 0.1 m/s.
    fit = least_squares(residual, np.zeros(6), loss="cauchy", f_scale=0.1, x_scale="jac")
    # Bumps in the road cancel out over half a second; ordinary driving accelerates by 3 to 4 m/s^2.
    across = uniform_filter1d(residual(fit.x).reshape(-1, 2), 5, axis=0)
    acceleration = np.diff(speed, prepend=speed[:1]) / step_s
    return (np.hypot(*across.T) <= 0.25) & (np.abs(acceleration) <= 5.0)


def augmented(windows: Windows, rng: np.random.Generator) -> Windows:
    """Change some windows as other drives and an odometry would.

    Four in ten are scaled to longer paths of the same turns, up to motorway speeds: recorded speeds
    end at 15 m/s, and a monocular scale may be wrong. Three in a hundred are stationary: recordings
    are cut where the car waits. Half of the pasts have the errors of an odometry, up to 4 cm and
    0.1 degrees per step. A quarter is short, with the first twist repeated.
    """
    twists, states = windows
    num_steps = twists.shape[1]
    shape = (len(twists), 1, 1)
    scale = np.exp((rng.random(shape) < 0.4) * rng.uniform(-0.2, 0.8, shape))
    is_moving = rng.random(shape) > 0.03
    level = (rng.random(shape) < 0.5) * np.exp(rng.uniform(-3.0, 0.7, shape))
    noise_per_s = np.repeat([0.02, np.radians(0.05)], 3) / STEP_S
    twists = twists * is_moving * scale ** [1, 1, 1, 0, 0, 0]
    twists += level * noise_per_s * rng.standard_normal(twists.shape)
    num_missing = (rng.random(shape) < 0.25) * rng.integers(0, num_steps, shape)
    steps = np.maximum(np.arange(num_steps)[:, None], num_missing)
    twists = np.take_along_axis(twists, steps, axis=1)
    return twists, states * is_moving * scale ** [1, 1, 0, 1, 0, 0]


def along_path(
    deviations: FloatArray,  # [N, F, 3]
    path: FloatArray,  # [N, F, 3]
) -> FloatArray:
    """Return deviations (x, z, yaw) [N, F, 3] from a path as (right, ahead, yaw) of it."""
    x, z, yaw = np.moveaxis(deviations, -1, 0)
    cos = np.cos(path[..., 2])
    sin = np.sin(path[..., 2])
    return np.stack([cos * x - sin * z, sin * x + cos * z, yaw], axis=-1)

"""Which recorded poses a car could have driven: jumps of the localisation are not motion, and are not to be learnt.

KITTI's ground truth comes from satellite navigation and an inertial unit. Where it is corrected, the recorded camera
slides sideways or upwards, or is a metre per second faster from one frame to the next. A car's rear axle moves along
the car, apart from a little slip of the tyres, and a driver changes its speed within limits.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from geovp_classic.forecasting.motion_network import FORWARD, YAW_RATE
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray, Trajectory

ACROSS_M_S = 0.25  # over AVERAGED steps; bumps in the road cancel out within half a second
ACCELERATION_M_S2 = 5.0  # ordinary driving stays below 3 to 4; an emergency stop, which has more, is left out as well
AVERAGED = 5
USUAL_NOISE_M_S = 0.1  # of one step's velocity: what is much further off has no say in the fit of a sequence
SIDEWAYS, DOWN = 0, 1


def drivable(trajectory: Trajectory) -> BoolArray:
    """Whether each step [N - 1] between poses, in metres, moves along the vehicle, at nearly the speed before it.

    Sideways velocity is explained by the camera's place before the rear axle, its direction and the tyres' slip; the
    vertical one by its direction. What is left over is velocity across the vehicle.
    """
    step_s = np.diff(trajectory.times_s)[:, None]
    poses = trajectory.world_from_cam
    rates = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) / step_s
    speed, turn = rates[:, FORWARD], rates[:, YAW_RATE]
    sideways = _unexplained(rates[:, SIDEWAYS], np.stack([turn, speed, speed**2 * turn], axis=1))
    vertical = _unexplained(rates[:, DOWN], speed[:, None])
    across = np.hypot(uniform_filter1d(sideways, AVERAGED), uniform_filter1d(vertical, AVERAGED))
    acceleration = np.diff(speed, prepend=speed[:1]) / step_s[:, 0]
    return np.asarray((across <= ACROSS_M_S) & (np.abs(acceleration) <= ACCELERATION_M_S2))


def _unexplained(velocity: FloatArray, causes: FloatArray) -> FloatArray:
    """What a linear regression on the causes [N, C] leaves of a velocity [N]; outliers don't bend it (Cauchy loss)."""

    def left(factors: FloatArray) -> FloatArray:
        return velocity - causes @ factors

    start = np.zeros(causes.shape[1])
    return left(least_squares(left, start, loss="cauchy", f_scale=USUAL_NOISE_M_S, x_scale="jac").x)

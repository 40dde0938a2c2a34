"""Which recorded poses a car could have driven: jumps of the localisation are not motion, and are
left out of fits.

KITTI's ground truth comes from satellite navigation and an inertial unit. Where it is corrected,
the recorded camera slides sideways or upwards, or is a metre per second faster from one frame to
the next. A car's rear axle moves along the car, apart from a little slip of the tyres, and a driver
changes its speed within limits.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from geovp_classic.forecasting.motion_network import FORWARD, YAW_RATE
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray, Trajectory

MAX_ACROSS_M_S = 0.25  # mean of AVERAGED steps; bumps in the road cancel out within half a second
MAX_ACCELERATION_M_S2 = (
    5.0  # ordinary driving stays below 3 to 4; an emergency stop, with more, is left out as well
)
AVERAGED = 5
OUTLIER_M_S = (
    0.1  # of one step's velocity: residuals beyond it count little in the fit of a sequence
)
SIDEWAYS, DOWN = 0, 1


def drivable(trajectory: Trajectory) -> BoolArray:
    """Whether each step [N - 1] between poses, in metres, moves along the vehicle, at nearly the
    speed before it.

    Sideways velocity is explained by the camera's place before the rear axle, its direction and the
    tyres' slip; the vertical one by its direction. The residual is velocity across the vehicle.
    """
    step_s = np.diff(trajectory.times_s)[:, None]
    poses = trajectory.world_from_cam
    twists = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) / step_s
    speed, turn = twists[:, FORWARD], twists[:, YAW_RATE]
    sideways = _regression_residual(
        twists[:, SIDEWAYS], np.stack([turn, speed, speed**2 * turn], axis=1)
    )
    vertical = _regression_residual(twists[:, DOWN], speed[:, None])
    across = np.hypot(uniform_filter1d(sideways, AVERAGED), uniform_filter1d(vertical, AVERAGED))
    acceleration = np.diff(speed, prepend=speed[:1]) / step_s[:, 0]
    return np.asarray((across <= MAX_ACROSS_M_S) & (np.abs(acceleration) <= MAX_ACCELERATION_M_S2))


def _regression_residual(
    velocity: FloatArray,  # [N]
    regressors: FloatArray,  # [N, C]
) -> FloatArray:
    """Residual [N] of a robust linear regression (Cauchy loss)."""

    def residual(factors: FloatArray) -> FloatArray:
        return velocity - regressors @ factors

    start = np.zeros(regressors.shape[1])
    return residual(
        least_squares(residual, start, loss="cauchy", f_scale=OUTLIER_M_S, x_scale="jac").x
    )

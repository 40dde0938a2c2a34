"""Detection of recorded poses that a car cannot have driven, so that fits leave them out.

KITTI's ground truth comes from satellite navigation and an inertial unit. Where it is corrected,
the recorded camera slides sideways or upwards, or changes its speed by a metre per second between
two frames. A car's rear axle moves along the car, apart from a little slip of the tyres.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray, Trajectory


@dataclass(frozen=True)
class Drivability:
    """Limits of a car's motion."""

    max_across_m_s: float = 0.25  # averaged, so that bumps in the road cancel out
    num_averaged: int = 5  # steps, half a second
    max_acceleration_m_s2: float = 5.0  # ordinary driving stays below 3 to 4
    outlier_m_s: float = 0.1  # scale of the Cauchy loss of one step's velocity

    def steps(self, trajectory: Trajectory) -> BoolArray:
        """Return which steps [T - 1] between metric poses a car can have driven.

        Sideways velocity is explained by the camera's position ahead of the rear axle, its
        direction and the tyres' slip; vertical velocity by the camera's direction.
        """
        step_s = np.diff(trajectory.times_s)
        poses = trajectory.world_from_cam
        twists = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) / step_s[:, None]
        speed = twists[:, Axis.FORWARD]
        turn_rate = twists[:, Axis.YAW]
        regressors = np.column_stack([turn_rate, speed, speed**2 * turn_rate])
        sideways = self._residual(regressors, twists[:, Axis.RIGHT])
        vertical = self._residual(speed[:, None], twists[:, Axis.DOWN])
        across = np.hypot(
            uniform_filter1d(sideways, self.num_averaged),
            uniform_filter1d(vertical, self.num_averaged),
        )
        acceleration = np.diff(speed, prepend=speed[:1]) / step_s
        is_along = across <= self.max_across_m_s
        return np.asarray(is_along & (np.abs(acceleration) <= self.max_acceleration_m_s2))

    def _residual(
        self,
        regressors: FloatArray,  # [N, C]
        velocity: FloatArray,  # [N]
    ) -> FloatArray:
        """Return the residual [N] of a robust linear regression on regressors [N, C]."""

        def residual(factors: FloatArray) -> FloatArray:
            return velocity - regressors @ factors

        start = np.zeros(regressors.shape[1])
        fit = least_squares(residual, start, loss="cauchy", f_scale=self.outlier_m_s, x_scale="jac")
        return residual(fit.x)

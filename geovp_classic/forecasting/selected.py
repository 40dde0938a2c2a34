"""Choice between forecasters by hindcast: how well each forecast the last observed poses.

Every candidate sees the first poses only, and forecasts the remaining ones. The error is the angle
by which the content of the image moves between the forecast and the true pose, because views are
what the forecast is for. A vehicle's motion prior is preferred where it applies.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.forecasting.persistent_turn import PersistentTurn
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class DrivingTest:
    """Whether a past is that of a road vehicle whose camera looks where it drives, or back."""

    # Of the path, along the viewing axis: a camera that looks up to 25 degrees aside
    min_forward_fraction: float = 0.9
    # Of pitch and roll, root mean square; roads shake a car by less, a walker shakes more
    max_shake_rad_s: float = 0.15
    # A full lock turns a car by a radian in 5 m.
    max_curvature_rad_m: float = 0.2
    # A third of a walker's speed: a slower path is mostly noise, whose direction is no drive's. Set
    # by hand.
    min_speed_m_s: float = 0.5

    def passes(self, past: Trajectory) -> bool:
        """Return whether metric poses are those of a vehicle that drives forward."""
        if len(past) < 2:
            return False
        steps_s = np.diff(past.times_s)
        weights = steps_s / steps_s.sum()  # a short step is mostly noise
        twists = se3.log(se3.steps(past.world_from_cam)) / steps_s[:, None]
        path = weights @ np.linalg.norm(twists[:, :3], axis=1)
        forward = weights @ twists[:, Axis.FORWARD]
        shake = np.sqrt((weights @ twists[:, [Axis.PITCH, Axis.ROLL]] ** 2).mean())
        turn_rate = abs(weights @ twists[:, Axis.YAW])
        return bool(
            past.is_metric
            and path >= self.min_speed_m_s
            and forward >= self.min_forward_fraction * path
            and shake <= self.max_shake_rad_s
            and turn_rate <= self.max_curvature_rad_m * path
        )


@dataclass(frozen=True)
class Selected:
    """The candidate that forecast the observed past best; `select` tells which one it is."""

    # Preferred where it applies; "none": never
    prior: Forecaster | None = MotionPrior()
    driving: DrivingTest = DrivingTest()
    # Without assumptions about vehicles; the first one is used after less than `min_past` poses. On
    # the videos of other cameras, constant turns, velocities and stops beside it gain nothing.
    candidates: tuple[Forecaster, ...] = (PersistentTurn(),)
    # Others must have less than this fraction of the prior's error: better by a quarter, which
    # keeps it on KITTI
    prior_ratio: float = 0.75
    # ... and by a pixel of an image of 256 pixels and 65 degrees
    negligible_rad: float = 0.005
    # The first candidate's error, likewise, must be undercut by a tenth: hindcasts are noisy
    default_ratio: float = 0.9
    # poses from which a candidate forecasts; chosen on 16 field videos among 4, 5 and 6
    min_past: int = 5
    num_cuts: int = 4  # ends of such a past, evenly spaced; at least two poses follow each
    # Depth of the scene as the path of so many seconds: 9 m for a car in town, 1.5 m for a walker
    depth_s: float = 1.0
    max_error_rad: float = 0.3  # images further apart have nothing in common
    ahead_ratio: float = 0.5  # effect of a metre ahead to a metre aside, half-way to the border

    def __post_init__(self) -> None:
        if not self.candidates:
            raise BadData("selected: candidates is empty, expected one forecaster or more")
        if self.min_past < 2 or self.num_cuts < 1:
            raise BadData(
                f"selected: min_past is {self.min_past} and num_cuts {self.num_cuts}, expected 2 "
                "past poses or more and 1 cut or more"
            )

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4] of the selected candidate."""
        return self.select(past).forecast(past, times_s, num_samples)

    def select(self, past: Trajectory) -> Forecaster:
        """Return the prior where it applies and is not clearly worse, or the best candidate."""
        # A vehicle's prior applies to vehicles alone; a short past tests no forecaster
        prior = self.prior if self.driving.passes(past) else None
        default = self.candidates[0]
        if len(past) < self.min_past + 2:
            return prior or default
        # The prior stays unless the best candidate is clearly better, and so does the default
        errors = [self.hindcast_error(each, past) for each in self.candidates]
        best = int(np.argmin(errors))
        if prior is not None:
            prior_error = self.hindcast_error(prior, past)
            if errors[best] >= self.prior_ratio * prior_error - self.negligible_rad:
                return prior
        if errors[best] >= self.default_ratio * errors[0]:
            return default
        return self.candidates[best]

    def hindcast_error(self, forecaster: Forecaster, past: Trajectory) -> float:
        """Return the mean error, in radians of the image, of forecasts of the past's own end."""
        # Depth turns an error of position into an angle
        length = se3.step_lengths(past.world_from_cam).sum()
        scene_depth = length / (past.times_s[-1] - past.times_s[0]) * self.depth_s
        # Forecast the rest of the past from several cuts of it
        cuts = np.linspace(self.min_past, len(past) - 2, self.num_cuts).round().astype(int)
        means = []
        for cut in np.unique(cuts):
            forecast = forecaster.forecast(past[:cut], past.times_s[cut:])[0]
            twists = se3.log(se3.inverse(past.world_from_cam[cut:]) @ forecast)
            if scene_depth > 0:
                twists[:, :3] /= scene_depth
            twists[:, Axis.FORWARD] *= self.ahead_ratio
            angles = np.linalg.norm(twists, axis=1)
            means.append(np.minimum(angles, self.max_error_rad).mean())
        return float(np.mean(means))

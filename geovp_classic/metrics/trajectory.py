"""How far predicted camera poses are from the real ones, step by step.

Both trajectories must be in one world frame: `relative_to_last_observed` puts each into its own
last observed camera, the one place where a forecast and the truth agree by definition. Numbers per
horizon step [F]; a metric that has but one number for the whole future gives it at the last step
and NaN before, so that the mean over the steps that have a value prints it unchanged.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

SAME_TIME_S = 1e-3


@dataclass(frozen=True)
class TranslationError:
    """Distance between the predicted and the real camera centre; NaN unless both trajectories are
    in metres.
    """

    unit: ClassVar[str] = "m"
    higher_is_better: ClassVar[bool] = False
    bounds: ClassVar[tuple[float, float]] = (0.0, math.inf)

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Metres per step [F]; BadData when the trajectories are not of the same instants."""
        _check_instants(predicted, target)
        if not (predicted.is_metric and target.is_metric):
            return np.full(len(target), np.nan)
        offset = predicted.world_from_cam[:, :3, 3] - target.world_from_cam[:, :3, 3]
        return np.linalg.norm(offset, axis=-1)


@dataclass(frozen=True)
class RotationError:
    """Angle of the one rotation that turns the predicted camera into the real one (geodesic
    distance on SO(3)).
    """

    unit: ClassVar[str] = "deg"
    higher_is_better: ClassVar[bool] = False
    bounds: ClassVar[tuple[float, float]] = (0.0, 180.0)

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Degrees per step [F], 0 to 180; BadData when the trajectories are not of the same
        instants.
        """
        return np.rad2deg(se3.rotation_angle_rad(_target_from_predicted(predicted, target)))


@dataclass(frozen=True)
class YawError(RotationError):
    """Angle between the predicted and the real viewing direction within the real camera's x-z
    plane.

    The part of the rotation error that shifts a street view sideways: a pixel per 1 / fx radians.
    """

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Degrees per step [F], 0 to 180; BadData when the trajectories are not of the same
        instants.
        """
        forward = _target_from_predicted(predicted, target)[:, :3, 2]
        return np.abs(np.rad2deg(np.arctan2(forward[:, 0], forward[:, 2])))


@dataclass(frozen=True)
class AverageDisplacement(TranslationError):
    """ADE: the mean of the translation errors of all steps, given at the last one; NaN before, NaN
    without metres.
    """

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """[F]: NaN but for the last step; BadData when the trajectories are not of the same
        instants.
        """
        return _at_last_step(len(target), super().__call__(predicted, target).mean())


@dataclass(frozen=True)
class FinalDisplacement(TranslationError):
    """FDE: the translation error of the last step, given there; NaN before, NaN without metres."""

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """[F]: NaN but for the last step; BadData when the trajectories are not of the same
        instants.
        """
        return _at_last_step(len(target), super().__call__(predicted, target)[-1])


@dataclass(frozen=True)
class ScaleUncertainty:
    """The predictor's own relative standard deviation of its metres: what errors in metres rest on.

    0 for metres that are given, NaN without metres.
    """

    unit: ClassVar[str] = "%"
    higher_is_better: ClassVar[bool] = False
    bounds: ClassVar[tuple[float, float]] = (0.0, math.inf)

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Per cent [F], the same at every step; BadData when the trajectories are not of the same
        instants.
        """
        _check_instants(predicted, target)
        percent = 100 * (predicted.scale_uncertainty or 0.0) if predicted.is_metric else np.nan
        return np.full(len(target), percent)


def relative_to_last_observed(
    past: Trajectory,
    futures: FloatArray,  # [F, 4, 4], world_from_cam in the past's world frame and unit
    times_s: FloatArray,  # [F]
) -> Trajectory:
    """The futures as seen from the last observed camera: a world frame that any prediction shares
    with the truth.
    """
    last_from_world = se3.inverse(past.world_from_cam[-1])
    return Trajectory(last_from_world @ futures, times_s, past.is_metric, past.scale_uncertainty)


def _target_from_predicted(predicted: Trajectory, target: Trajectory) -> FloatArray:
    """The predicted cameras in the real cameras' frames [F, 4, 4]."""
    _check_instants(predicted, target)
    return se3.inverse(target.world_from_cam) @ predicted.world_from_cam


def _at_last_step(num_future: int, value: float) -> FloatArray:
    values = np.full(num_future, np.nan)
    values[-1] = value
    return values


def _check_instants(predicted: Trajectory, target: Trajectory) -> None:
    if len(predicted) != len(target) or len(target) == 0:
        raise BadData(
            f"metric: {len(predicted)} predicted poses for {len(target)} real ones, expected "
            "one each"
        )
    apart_s = np.abs(predicted.times_s - target.times_s).max()
    if apart_s > SAME_TIME_S:
        raise BadData(
            f"metric: predicted and real poses are up to {apart_s:.3g} s apart: compare the "
            "same instants"
        )

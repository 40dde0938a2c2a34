"""Errors of predicted camera poses, step by step.

Both trajectories must be in one world frame. `relative_to_last_observed` puts each into its last
observed camera, where forecast and truth agree by definition. Metrics return one number per horizon
step [F] and raise BadData unless both trajectories have the same instants. A metric with one number
for the whole future returns it at the last step and NaN before.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory


class _Error(ABC):
    """A number that is best at 0; errors in metres are NaN unless both trajectories have metres."""

    unit: ClassVar[str]
    higher_is_better = False
    bounds = (0.0, math.inf)

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Return the error at each step [F]."""
        _check_instants(predicted, target)
        if self.unit == "m" and not (predicted.is_metric and target.is_metric):
            return np.full(len(target), np.nan)
        return self.errors(se3.inverse(target.world_from_cam) @ predicted.world_from_cam)

    @abstractmethod
    def errors(self, target_from_predicted: FloatArray) -> FloatArray:
        """Return the error at each step [F] from predicted in real cameras' frames [F, 4, 4]."""


@dataclass(frozen=True)
class TranslationError(_Error):
    """Distance between predicted and real camera centre; NaN unless both are in metres."""

    unit = "m"

    def errors(self, target_from_predicted: FloatArray) -> FloatArray:
        """Return metres per step [F]."""
        return np.linalg.norm(target_from_predicted[:, :3, 3], axis=-1)


@dataclass(frozen=True)
class RotationError(_Error):
    """Angle between predicted and real orientation (geodesic distance on SO(3))."""

    unit = "deg"
    bounds = (0.0, 180.0)

    def errors(self, target_from_predicted: FloatArray) -> FloatArray:
        """Return degrees per step [F], 0 to 180."""
        return np.rad2deg(se3.rotation_angle_rad(target_from_predicted))


@dataclass(frozen=True)
class YawError(RotationError):
    """Angle between predicted and real viewing direction in the real camera's x-z plane.

    This part of the rotation error shifts a street view sideways, a pixel per 1 / fx radians.
    """

    def errors(self, target_from_predicted: FloatArray) -> FloatArray:
        """Return degrees per step [F], 0 to 180."""
        x, _, z = target_from_predicted[:, :3, 2].T
        return np.abs(np.rad2deg(np.arctan2(x, z)))


@dataclass(frozen=True)
class AverageDisplacement(TranslationError):
    """ADE: mean translation error of all steps, returned at the last step."""

    def errors(self, target_from_predicted: FloatArray) -> FloatArray:
        """Return metres [F], NaN before the last step."""
        distances = super().errors(target_from_predicted)
        distances[-1] = distances.mean()
        distances[:-1] = np.nan
        return distances


@dataclass(frozen=True)
class FinalDisplacement(TranslationError):
    """FDE: translation error of the last step, returned there."""

    def errors(self, target_from_predicted: FloatArray) -> FloatArray:
        """Return metres [F], NaN before the last step."""
        distances = super().errors(target_from_predicted)
        distances[:-1] = np.nan
        return distances


@dataclass(frozen=True)
class ScaleUncertainty:
    """Relative standard deviation of the predictor's metres; 0 for given metres."""

    unit = "%"
    higher_is_better = False
    bounds = (0.0, math.inf)

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Return per cent [F], the same at all steps; NaN without metres."""
        _check_instants(predicted, target)
        percent = 100 * (predicted.scale_uncertainty or 0.0)
        return np.full(len(target), percent if predicted.is_metric else np.nan)


def relative_to_last_observed(
    past: Trajectory,
    futures: FloatArray,  # [F, 4, 4], world_from_cam in the past's world frame and unit
    times_s: FloatArray,  # [F]
) -> Trajectory:
    """Return the futures in the frame of the last observed camera."""
    last_from_world = se3.inverse(past.world_from_cam[-1])
    return Trajectory(
        last_from_world @ futures,
        times_s,
        past.is_metric,
        past.scale_uncertainty,
    )


def _check_instants(predicted: Trajectory, target: Trajectory) -> None:
    if len(predicted) != len(target):
        raise BadData(
            f"metric: {len(predicted)} predicted poses for {len(target)} real ones, expected one "
            "each"
        )
    offset_s = np.abs(predicted.times_s - target.times_s).max()
    if offset_s > 1e-3:
        raise BadData(
            f"metric: predicted and real poses are up to {offset_s:.3g} s apart: compare the "
            "same instants"
        )

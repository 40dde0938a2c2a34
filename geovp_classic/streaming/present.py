"""What live views are made of: a scene, the motion in it, and when these are not to be trusted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import interp1d

from geovp_classic.forecasting.past_motion import vehicle_from_cam
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.predictors.hindcast import ShownScene
from geovp_classic.streaming.commands import Command, commanded_poses
from geovp_classic.streaming.recent_frames import Frame
from geovp_classic.streaming.settings import LiveSettings
from geovp_classic.types import BoolArray, FloatArray, Trajectory


def forecast(
    forecaster: Forecaster, past: Trajectory, settings: LiveSettings
) -> tuple[FloatArray, FloatArray]:
    """Return times [F] from the last frame on, and futures [S, F, 4, 4], the central one first."""
    # Times up to the end of the path that is planned at the latest view
    end_s = settings.max_ahead_s + settings.path_s
    ahead_s = np.arange(0, end_s + settings.path_step_s, settings.path_step_s)
    times_s = past.times_s[-1] + ahead_s

    # The central future is shown; the spread of the others is the uncertainty of the path
    futures = forecaster.forecast(past, times_s[1:])[:1]
    if past.is_metric and len(past) >= settings.min_frames:
        samples = forecaster.forecast(past, times_s[1:], settings.num_path_samples)
        futures = np.concatenate([futures, samples])

    # All futures start at the last frame, so that views between the two can be interpolated
    shape = (len(futures), 1, 4, 4)
    last = np.broadcast_to(past.world_from_cam[-1], shape)
    return times_s, np.concatenate([last, futures], axis=1)


@dataclass(frozen=True)
class Present:
    """A scene with the motion in it; all in the world frame of its odometry."""

    settings: LiveSettings
    scene: ShownScene
    past: Trajectory
    tracked: BoolArray
    times_s: FloatArray  # [F], from the last frame on
    futures: FloatArray  # [S, F, 4, 4], the central one first

    def poses(self, times_s: FloatArray) -> FloatArray:
        """Return the poses [F, 4, 4] of the central future."""
        return se3.interpolate(self.futures[0], self.times_s, times_s)

    def path(
        self,
        time_s: float,
        commands: Sequence[Command],
        last_from_present: FloatArray | None,  # [4, 4]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the poses [M, 4, 4] and times [M] of the path from a time on.

        It is given, commanded, or else forecast.
        """
        settings = self.settings
        last = self.past.world_from_cam[-1]
        start_s = float(self.past.times_s[-1])
        now_s = max(time_s, start_s)
        ahead_s = np.arange(settings.path_step_s, settings.path_s, settings.path_step_s)
        times_s = now_s + np.append(0, ahead_s)
        if last_from_present is not None:
            return last @ last_from_present[None], times_s[:1]
        if not commands:
            return self.poses(times_s), times_s
        plane = vehicle_from_cam(self.past)
        return commanded_poses(commands, last, plane, start_s, times_s), times_s

    def drawn_path(
        self,
        path: FloatArray,  # [M, 4, 4], from the present on
        times_s: FloatArray,  # [M]
        is_given: bool,
        height_m: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the path on the ground [M, 2] and its sides [2, M, 2] in pixels of the present.

        Its uncertainty is one standard deviation of the sampled futures, if it is forecast,
        but at least half the width of the vehicle.
        """
        # Half the width of the path: that of the vehicle, or the spread of the futures sideways
        right = path[:, :3, 0]
        half_m = np.full(len(path), self.settings.vehicle_width_m / 2)
        if not is_given and len(self.futures) > 1:
            sampled = interp1d(self.times_s, self.futures[1:, :, :3, 3], axis=1)(times_s)
            lateral = ((sampled - path[:, :3, 3]) * right).sum(axis=-1)
            half_m = np.maximum(half_m, np.sqrt((lateral**2).mean(axis=0)))

        # The path and its sides lie on the ground, below the camera
        down = self.past.world_from_cam[-1, :3, :3] @ vehicle_from_cam(self.past)[1, :3]
        ground = path[:, :3, 3] + height_m * down
        offset = half_m[:, None] * right
        points = np.stack([ground, ground - offset, ground + offset])

        # Project them into the present view
        in_view = se3.transform(se3.inverse(path[0]), points)
        pixels, depth = pinhole.project(in_view, self.scene.context.intrinsics)
        is_ahead = depth > self.settings.min_path_depth_m
        pixels = np.where(is_ahead[..., None], pixels, np.nan)
        return pixels[0], pixels[1:]

    def caution(self, age_s: float, confidence: float, is_given: bool) -> str | None:
        """Return why a shown prediction may be wrong; a given motion is not the image's."""
        settings = self.settings
        if not is_given and self.scene.verdict.shown_by == "image-motion":
            return "the motion of the image is continued, since the scene predicts it worse"
        if age_s > settings.max_sure_age_s:
            return f"the newest image is {age_s:.1f} s old"
        if confidence < settings.min_sure_confidence:
            return f"the confidence is {100 * confidence:.0f} %"
        return None


@dataclass(frozen=True)
class LiveState:
    """The newest frame, and the present that the last usable one led to."""

    newest: Frame | None = None  # usable or not
    is_blank: bool = False  # the newest frame
    present: Present | None = None

    def warning(self, settings: LiveSettings, time_s: float, is_given: bool) -> str | None:
        """Return why no prediction is to be trusted at a time; the motion may be given."""
        present = self.present
        num_frames = 0 if present is None else len(present.past)
        if present is None or num_frames < settings.min_frames:
            return f"too few usable frames since the start: {num_frames}"
        if self.is_blank:
            return "the newest frame is blank"
        ahead_s = time_s - present.past.times_s[-1]
        if ahead_s < -settings.max_gap_s:
            return f"the view is {-ahead_s:.1f} s before the last usable frame: use one clock"
        if ahead_s > settings.max_ahead_s:
            return f"the last usable frame is {ahead_s:.1f} s old"
        if present.tracked.mean() < settings.min_tracked:
            return "the camera's motion could not be tracked"
        if present.scene.verdict.shown_by == "last-frame":
            return "the scene does not predict the newest frames"
        if is_given and not present.past.is_metric:
            return "the scale of the scene is unknown"
        return None

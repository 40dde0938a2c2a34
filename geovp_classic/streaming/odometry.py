"""Monocular odometry that is updated frame by frame."""

from dataclasses import replace

import numpy as np

from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.odometry.monocular import Monocular, Path
from geovp_classic.odometry.tracking import Image, Tracker
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Intrinsics,
    Trajectory,
)


class StreamOdometry:
    """Poses of the last frames: tracked once per frame, adjusted in a sliding window.

    The methods and settings are those of `Monocular` for clips, whose window ends with the clip.
    """

    def __init__(
        self,
        settings: Monocular,
        camera: Intrinsics,
        height_m: float | None,
        num_frames: int,
        min_frames: int,  # before the scale is measured
    ) -> None:
        self.settings = settings
        self.camera = camera
        self._height_m = height_m
        self._num_frames = num_frames
        self._min_frames = min_frames
        keyframes = settings.tracking.keyframes.for_clip(num_frames)
        tracking = replace(settings.tracking, keyframes=keyframes)
        self._tracker = Tracker(tracking, camera)
        self._images: list[Image] = []  # the last ones
        self._num_starts = 0
        self._scale: ScaleEstimator | None = None

    def push(self, grey: ByteArray, time_s: float) -> None:
        """Track the next image [H, W]."""
        corners = self.settings.tracking.corners.detect(grey)
        image = Image(grey, corners, time_s)
        tracker = self._tracker
        tracker.push(image)
        if not tracker.map.is_full:  # a full one is adjusted at each keyframe
            tracker.map.adjust(num_fixed=1)
        tracker.forget(self._num_frames)
        self._images = [*self._images, image][-self._num_frames :]

    @property
    def path(self) -> Path:
        """Return the path through the last frames, in an arbitrary unit."""
        return Path(self._images, *self._tracker.poses())

    def measure_scale(self) -> None:
        """Measure the scale with the newest image; with all images at first, or after a restart."""
        path = self.path
        num_images = len(path.images)
        if num_images < self._min_frames:
            return
        first = num_images - 1
        num_starts = self._tracker.num_starts
        if self._scale is None or num_starts != self._num_starts:
            self._num_starts = num_starts
            self._scale = self.settings.scale.estimator(self.camera, self._height_m, path.pitch_rad)
            first = 1
        for now in range(first, num_images):
            before = self._far_enough(path, now, self._scale.unit)
            path.measure(self._scale, before, now)
        self._scale.finalize(path.length, path.duration_s)

    def _far_enough(self, path: Path, now: int, unit: float) -> int:
        """Return the nearest image before another one that is far enough away for the scale."""
        settings = self.settings
        min_baseline_m = settings.min_baseline_heights * (self._height_m or 0.0)
        positions = path.world_from_cam[:, :3, 3]
        before = now - 1
        for stride in settings.scale_strides:
            if stride > now:
                break
            before = now - stride
            baseline = np.linalg.norm(positions[now] - positions[before])
            if baseline * unit > min_baseline_m:
                break
        return before

    def past(self) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory of the last frames [P], and which were tracked [P]."""
        poses, tracked = self._tracker.poses()
        uncertainty = np.inf
        if self._scale is not None:
            units = self._scale.units
            unit = units[-1] if len(units) else self._scale.unit
            poses[:, :3, 3] *= unit
            uncertainty = self._scale.uncertainty
        times_s = np.array([image.time_s for image in self._images])
        past = self.settings.trajectory(poses, times_s, uncertainty)
        return past, tracked

    @property
    def is_lost(self) -> bool:
        """Return whether the newest frames could not be tracked for longer than is bridged."""
        _, tracked = self._tracker.poses()
        num_bridged = self.settings.tracking.max_bridged + 1
        return len(tracked) > num_bridged and not tracked[-num_bridged:].any()

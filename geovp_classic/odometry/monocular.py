"""Monocular visual odometry with metric scale."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from geovp_classic.geometry import pinhole, planar, se3
from geovp_classic.interfaces import Scale, ScaleEstimator
from geovp_classic.observation import ImageStream, observations_of
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.odometry.tracking import Image, Tracker, Tracking, track_clip
from geovp_classic.parallel import parallel_map, single_threaded_blas
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
)


@dataclass(frozen=True)
class Monocular:
    """Tracked corners, two-view initialisation, resection, bundle adjustment, and scale.

    `frames` chooses between the protocol's images ("crop") and the uncropped ones ("full",
    PrivilegedInput.FULL_FRAMES). A clip is bundle-adjusted as a whole.
    """

    scale: Scale = GroundPlane()
    frames: ImageStream = "crop"
    tracking: Tracking = Tracking()
    # Images between two that the scale is measured with; the first that is long enough is used.
    # Images less than this many camera heights apart say little about the road.
    scale_strides: tuple[int, ...] = (1, 2, 4)
    min_baseline_heights: float = 1 / 3
    max_uncertainty: float = 0.2  # relative, of a scale that counts as measured

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs that the scale needs, and the uncropped frames if asked for."""
        full = PrivilegedInput.FULL_FRAMES if self.frames == "full" else PrivilegedInput.NONE
        return self.scale.needs | full

    @single_threaded_blas
    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Return the past trajectory [P], and which steps were tracked [P].

        The trajectory is metric if the scale is, and could be measured or assumed, or if the camera
        never moved. Raise Incompatible if the clip lacks an input.
        """
        # Observe
        view = observations_of(context, self.frames)
        times_s = context.times_s[: context.num_past]
        steps = np.flatnonzero(view.is_usable)
        greys = view.greys[steps]
        corners = parallel_map(self.tracking.corners.detect, greys)
        images = list(map(Image, greys, corners, times_s[steps]))

        # Track
        path = self._track_images(images, view.intrinsics)
        is_measured = longest_segment(path.tracked, self.tracking.max_bridged)
        if is_measured.sum() >= 2:
            path = path.select(is_measured)
            steps = steps[is_measured]

        # Scale
        estimator = self.fit_scale(path, view.intrinsics, context.camera_height_m)

        # Bridge
        poses = path.world_from_cam.copy()
        poses[:, :3, 3] *= estimator.unit
        world_from_cam: FloatArray = np.tile(poses[:1], (len(times_s), 1, 1))
        if len(steps) >= 2:
            world_from_cam = se3.interpolate(poses, times_s[steps], times_s)
        tracked: BoolArray = np.zeros(len(times_s), dtype=bool)
        tracked[steps] = path.tracked
        return self.trajectory(world_from_cam, times_s, estimator.uncertainty), tracked

    def track_sequence(
        self,
        frames: Iterable[ByteArray],  # [H, W, 3] or [H, W] each
        times_s: FloatArray,  # [T]
        intrinsics: Intrinsics,
        camera_height_m: float | None = None,
    ) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory [T] of a whole drive, and which images were tracked [T].

        Images are read one by one, and adjusted in a sliding window of keyframes.
        """
        tracker = Tracker(self.tracking, intrinsics)
        estimator = self.scale.estimator(intrinsics, camera_height_m)
        num_starts = 1
        updated = []  # steps
        for index, (frame, time_s) in enumerate(zip(frames, times_s, strict=True)):
            grey = pinhole.grey8(frame)
            tracker.push(Image(grey, self.tracking.corners.detect(grey), float(time_s)))
            if tracker.num_starts > num_starts:
                estimator.restart()
                num_starts = tracker.num_starts
            if tracker.new_pair is not None:
                estimator.update(*tracker.new_pair)
                updated.append(index)
        poses, tracked = tracker.poses()
        steps = se3.steps(poses)
        length = float(se3.step_lengths(poses).sum())
        estimator.finalize(length, float(times_s[-1] - times_s[0]))
        if len(estimator.units):
            units = np.interp(np.arange(1, len(times_s)), updated, estimator.units)
            steps[:, :3, 3] *= units[:, None]
        world_from_cam = np.stack(list(accumulate(steps, np.matmul, initial=np.eye(4))))
        return self.trajectory(world_from_cam, times_s, estimator.uncertainty), tracked

    def _track_images(self, images: list[Image], intrinsics: Intrinsics) -> Path:
        """Track the images of a clip, and adjust all of them together."""
        tracker = track_clip(self.tracking, images, intrinsics)
        tracker.map.adjust(num_fixed=1)
        return Path(images, *tracker.poses())

    def fit_scale(
        self, path: Path, intrinsics: Intrinsics, height_m: float | None
    ) -> ScaleEstimator:
        """Measure the scale with every image and an earlier one.

        This is the one before it, unless the camera is too slow.
        """
        mean_step = path.length / max(len(path.images) - 1, 1)
        best: ScaleEstimator | None = None
        for stride in self.scale_strides:
            estimator = self.scale.estimator(intrinsics, height_m, path.pitch_rad)
            for now in range(stride, len(path.images)):
                path.measure(estimator, now - stride, now)
            estimator.finalize(path.length, path.duration_s)
            is_measured = estimator.uncertainty < self.max_uncertainty
            if best is None or is_measured:
                best = estimator
            baseline_m = stride * mean_step * best.unit
            min_baseline_m = self.min_baseline_heights * (height_m or 0.0)
            if is_measured and baseline_m > min_baseline_m:
                break
        assert best is not None
        return best

    def trajectory(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        uncertainty: float,
    ) -> Trajectory:
        """Return a metric trajectory, or one with a mean step of 1 if the scale is unknown."""
        steps = se3.step_lengths(world_from_cam)
        if self.scale.is_metric and np.isfinite(uncertainty):
            return Trajectory(world_from_cam, times_s, True, uncertainty)
        moves = steps.sum() > 0
        if moves:
            world_from_cam[:, :3, 3] /= steps.mean()
        return Trajectory(world_from_cam, times_s, self.scale.is_metric and not moves, None)


@dataclass(frozen=True)
class Path:
    """Tracked path of images, in an arbitrary unit."""

    images: list[Image]  # P
    world_from_cam: FloatArray  # [P, 4, 4]
    tracked: BoolArray  # [P]

    @property
    def length(self) -> float:
        """Return the sum of the steps."""
        return float(se3.step_lengths(self.world_from_cam).sum())

    @property
    def duration_s(self) -> float:
        """Return the time from the first to the last image."""
        return self.images[-1].time_s - self.images[0].time_s

    @property
    def pitch_rad(self) -> float:
        """Return the mean angle of the viewing axis above the direction of travel."""
        steps = se3.steps(self.world_from_cam)
        is_tracked = self.tracked[:-1] & self.tracked[1:]
        return planar.travel_pitch_rad(steps[is_tracked, :3, 3])

    def measure(self, estimator: ScaleEstimator, before: int, now: int) -> None:
        """Update an estimate of the scale with two of the images if both were tracked."""
        if self.tracked[before] and self.tracked[now]:
            poses = self.world_from_cam
            before_from_now = se3.inverse(poses[before]) @ poses[now]
            greys = self.images[before].grey, self.images[now].grey
            estimator.update(*greys, before_from_now)

    def select(self, mask: BoolArray) -> Path:
        """Return the path through some of the images [P]."""
        images = [self.images[index] for index in np.flatnonzero(mask)]
        return Path(images, self.world_from_cam[mask], self.tracked[mask])


def longest_segment(
    tracked: BoolArray,  # [P]
    max_bridged: int,  # images in a row, before tracking restarts
) -> BoolArray:
    """Return which poses [P] belong to the restart with most tracked ones.

    Poses of different restarts are related by continued motion only. The image of a restart, which
    is the last one of a gap, counts as well.
    """
    steps = np.flatnonzero(tracked)
    restarts = np.flatnonzero(np.diff(steps) > max_bridged + 1) + 1
    segments = np.split(steps, restarts)
    segment = max(reversed(segments), key=len)  # the last one of equally long ones
    is_measured: BoolArray = np.zeros(len(tracked), dtype=bool)
    is_measured[segment] = True
    if len(segment) and segment[0] > steps[0]:
        is_measured[segment[0] - 1] = True
    return is_measured

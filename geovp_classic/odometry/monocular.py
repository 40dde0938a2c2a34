"""Monocular visual odometry with metric scale, for clips, whole sequences and streams."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import Scale
from geovp_classic.observation import ImageStream, Observer, observations_of, stream_needs
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.odometry.segment_scale import SegmentScale, TrackedImages, joined
from geovp_classic.odometry.tracking import Image, Tracker, TrackerSettings
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
    tracking: TrackerSettings = TrackerSettings()
    # Images between two that the scale is measured with; the first that is long enough is used.
    # Images less than this many camera heights apart say little about the road: its pixels, up to
    # 10 heights ahead, shift by few pixels.
    scale_strides: tuple[int, ...] = (1, 2, 4)
    min_baseline_heights: float = 1 / 3
    # Relative, of a scale that counts as measured: the least spread of `SpeedPrior`
    max_uncertainty: float = 0.2

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs that the scale needs, and the uncropped frames if asked for."""
        return self.scale.needs | stream_needs(self.frames)

    @single_threaded_blas
    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Return the past trajectory [P], and which steps were tracked [P].

        The trajectory is metric if the scale is, and could be measured or assumed, or if the camera
        never moved. Raise Incompatible if the clip lacks an input.
        """
        view = observations_of(context, self.frames)
        times_s = context.past_s
        steps = np.flatnonzero(view.is_usable)
        greys = view.greys[steps]
        corners = parallel_map(lambda grey: self.tracking.corners.detect(grey, view.mask), greys)
        run = MonocularRun(self, view.intrinsics, context.camera_height_m, window=len(steps))
        for image in map(Image, greys, corners, times_s[steps]):
            run.push(image)
        trajectory, is_tracked = run.finish(times_s)
        tracked: BoolArray = np.zeros(len(times_s), bool)
        tracked[steps] = is_tracked
        return trajectory, tracked

    def track_sequence(
        self,
        frames: Iterable[ByteArray],  # [H, W, 3] or [H, W] each
        times_s: FloatArray,  # [T]
        intrinsics: Intrinsics,
        camera_height_m: float | None = None,
        num_masked: int = 30,
    ) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory [T] of a whole drive, and which images were tracked [T].

        Images are adjusted in a sliding window of keyframes. They are read `num_masked` at a time,
        with one scene mask: by default those of 3 s at 10 Hz, as in `FocalLengthEstimator`.
        """
        run = MonocularRun(self, intrinsics, camera_height_m)
        images = zip(map(pinhole.grey8, frames), times_s.tolist(), strict=True)
        while batch := list(itertools.islice(images, num_masked)):
            mask, _ = Observer().scene(np.stack([grey for grey, _ in batch]))
            for grey, time_s in batch:
                run.push(self.image(grey, time_s, mask))
        return run.finish(times_s)

    def image(self, grey: ByteArray, time_s: float, mask: BoolArray | None = None) -> Image:
        """Return an image [H, W] with its corners; masked pixels [H, W] have none."""
        return Image(grey, self.tracking.corners.detect(grey, mask), time_s)

    def fit_scale(
        self, images: TrackedImages, intrinsics: Intrinsics, height_m: float | None
    ) -> SegmentScale:
        """Measure the scale with every image and an earlier one.

        This is the one before it, unless the camera is too slow.
        """
        mean_step = images.length / max(len(images.times_s) - 1, 1)
        best: SegmentScale | None = None
        for stride in self.scale_strides:
            scale = SegmentScale(self.scale.estimator(intrinsics, height_m, images.pitch_rad))
            for now in range(stride, len(images.times_s)):
                scale.update_with(images, now - stride, now)
            scale.finalize(images)
            is_measured = scale.estimator.uncertainty < self.max_uncertainty
            if best is None or is_measured:
                best = scale
            baseline_m = stride * mean_step * best.estimator.unit
            if is_measured and baseline_m > self.min_baseline_m(height_m):
                break
        assert best is not None
        return best

    def min_baseline_m(self, height_m: float | None) -> float:
        """Return the distance from which two images say something about the road."""
        return self.min_baseline_heights * (height_m or 0.0)

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


class MonocularRun:
    """Odometry of one camera that is fed frame by frame.

    With a window, the last images are remembered, adjusted together and used for the scale whenever
    the past is read: those of a clip once, at its end, and those of a stream after each image.
    Without one, all poses of a drive are remembered. Its keyframes are adjusted as they come, in
    a sliding window, and the scale is measured between them.
    """

    def __init__(
        self,
        settings: Monocular,
        camera: Intrinsics,
        height_m: float | None,
        window: int | None = None,  # images
        min_images: int = 1,  # in the window, before the scale is measured
    ) -> None:
        self.settings = settings
        self.camera = camera
        self._height_m = height_m
        self._window = window
        self._min_images = min_images
        tracking = settings.tracking
        self._scale = SegmentScale(settings.scale.estimator(camera, height_m))
        if window is not None:
            tracking = replace(tracking, keyframes=tracking.keyframes.for_clip(window))
        self._tracker = Tracker(tracking, camera)
        self._num_images = 0
        self._num_measured = 0  # images that the scale was measured with
        self._times_s: list[float] = []  # of the remembered images
        self._greys: list[ByteArray] = []  # of the window

    def push(self, image: Image) -> None:
        """Track the next image."""
        tracker = self._tracker
        tracker.push(image)
        self._times_s.append(image.time_s)
        if self._window is None:
            # The images of the newest two keyframes are at hand now, and not later
            if tracker.new_pair is not None:
                self._scale.update(self._num_images, tracker.segment, *tracker.new_pair)
        else:
            self._greys = [*self._greys, image.grey][-self._window :]
            self._times_s = self._times_s[-self._window :]
            tracker.forget(self._window)
        self._num_images += 1

    def past(self) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory through the remembered images [P], and which were tracked [P]."""
        return self.finish(np.array(self._times_s))

    def finish(self, times_s: FloatArray) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory at times [T], and which of the remembered images were tracked [P].

        Times of images that were not pushed are bridged, as are lost images.
        """
        # Adjust the window as a whole
        if self._window is not None:
            self._tracker.adjust()
        images, is_localised = self._tracked_images()
        localised = images.select(is_localised) if is_localised.any() else images

        # Measure the scale
        self._measure_scale(images, localised)
        units = self._scale.units(localised)
        estimator = self._scale.estimator

        # Segments without a measurement are lost: their unit is unknown. If none has one, the unit
        # of the longest segment is assumed or arbitrary, and the others are lost.
        is_used = np.isfinite(units)
        if not is_used.any():
            is_used = localised.in_longest_segment
            units[:] = estimator.unit
        used = localised.select(is_used)
        poses = joined(used, units[is_used])

        # Bridge the others at constant velocity
        world_from_cam: FloatArray = np.tile(poses[:1], (len(times_s), 1, 1))
        if len(poses) >= 2:
            world_from_cam = se3.interpolate(poses, used.times_s, times_s)
        tracked = images.tracked & np.isin(images.numbers, used.numbers)
        return self.settings.trajectory(world_from_cam, times_s, estimator.uncertainty), tracked

    @property
    def is_lost(self) -> bool:
        """Return whether the newest frames could not be tracked for longer than is bridged."""
        tracked = self._tracker.poses().tracked
        num_bridged = self.settings.tracking.max_bridged + 1
        return len(tracked) > num_bridged and not tracked[-num_bridged:].any()

    def _tracked_images(self) -> tuple[TrackedImages, BoolArray]:
        """Return the remembered images [P], and which of them are localised [P]."""
        path = self._tracker.poses()
        num_images = len(path.tracked)
        images = TrackedImages(
            np.arange(self._num_images - num_images, self._num_images),
            np.array(self._times_s),
            self._greys,
            path.world_from_cam,
            path.tracked,
            path.segments,
        )
        return images, path.is_localised

    def _measure_scale(self, images: TrackedImages, localised: TrackedImages) -> None:
        """Measure the scale with the images of the window that are new."""
        if self._window is not None and self._num_measured == 0:
            # The first images together: their steps say which baseline is long enough
            if len(images.numbers) < self._min_images:
                return
            self._scale = self.settings.fit_scale(localised, self.camera, self._height_m)
        else:
            if self._window is not None:
                for now in np.flatnonzero(images.numbers >= self._num_measured).tolist():
                    self._scale.update_with(images, self._far_enough(images, now), now)
            self._scale.finalize(localised)
        self._num_measured = self._num_images

    def _far_enough(self, images: TrackedImages, now: int) -> int:
        """Return the nearest image before another one that is far enough away for the scale."""
        settings = self.settings
        positions = images.world_from_cam[:, :3, 3]
        before = now - 1
        for stride in settings.scale_strides:
            if stride > now:
                break
            before = now - stride
            baseline = np.linalg.norm(positions[now] - positions[before])
            if baseline * self._scale.estimator.unit > settings.min_baseline_m(self._height_m):
                break
        return before

"""Monocular visual odometry: the camera's path from its images alone, in metres when the scale can tell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Scale
from geovp_classic.odometry.features import FeatureName, front_end
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.scale import GroundPlane
from geovp_classic.odometry.tracking import Pace, Tracker
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.types import BoolArray, ByteArray, Context, ExtraView, FloatArray, Grant, Intrinsics, Trajectory

MAX_BACKLOG = 200  # settled poses that wait for the first word of the scale


@dataclass(frozen=True)
class Step:
    """One image's pose as a stream knows it at once."""

    world_from_cam: FloatArray  # [4, 4]; the first image's is the identity
    tracked: bool  # False where the last motion was continued instead
    confidence: float  # of the scale, 0 (unknown: lengths are in no unit) to 1


@dataclass(frozen=True)
class Monocular:
    """Tracked or described features, a two-view start, location on a sliding map, bundle adjustment, a scale.

    `frames` chooses between the protocol's images ("crop") and the uncropped ones ("wide", Grant.WIDE_FRAMES).
    Sliding windows are for streams; a clip is adjusted as a whole.
    """

    features: FeatureName = "corners"
    scale: Scale = field(default_factory=GroundPlane)
    frames: Literal["crop", "wide"] = "crop"
    radial: float = 0.0  # distortion known to be left in the images (`Lens.radial`); learnt further in turns
    num_features: int = 600
    window: int = 16  # keyframes, of a stream
    max_bundle_points: int = 300
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise BadData for numbers that nothing can be tracked with."""
        if self.num_features < 50 or self.window < 3 or self.max_bundle_points < 20:
            raise BadData(
                f"num_features is {self.num_features}, window {self.window}, max_bundle_points "
                f"{self.max_bundle_points}: expected at least 50, 3 and 20"
            )

    @property
    def needs(self) -> Grant:
        """What the scale needs, and the uncropped images if asked for."""
        return self.scale.needs | (Grant.WIDE_FRAMES if self.frames == "wide" else Grant.NONE)

    @single_threaded_blas
    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The past trajectory [P] and which steps were tracked [P]; Incompatible when the clip lacks what it needs.

        The trajectory is metric when the scale is and could be found, or when the camera never moved.
        """
        view = _view(context, self.frames)
        gauge = self.scale.gauge(view.intrinsics, context.camera_height_m)
        times_s = context.times_s[: context.num_past]
        pace = Pace(len(times_s), 0.001, max_bundle_points=self.max_bundle_points, adjust_every=5)
        lens = Lens(view.intrinsics, self.radial)
        tracker = Tracker(front_end(self.features, self.num_features), lens, pace, self.seed)
        greys = [as_grey(frame) for frame in view.frames]
        for grey, time_s in zip(greys, times_s, strict=True):
            tracker.push(grey, float(time_s))
        tracker.adjust_all()
        poses, tracked = tracker.take_settled(all_of_them=True)
        gap = min(2, len(poses) - 1)  # images further apart say more about the road
        for now in range(gap, len(poses), gap) if gap else ():
            before = now - gap
            if tracked[now] and tracked[before]:
                before_from_now = se3.inverse(poses[before]) @ poses[now]
                gauge.update(greys[before], greys[now], before_from_now, tracker.radial.mean)
        return _trajectory(poses, times_s, self.scale.is_metric, gauge.unit, gauge.confidence), tracked

    def stream(self, intrinsics: Intrinsics, camera_height_m: float | None = None) -> Stream:
        """A tracker for images that come one by one."""
        return Stream(self, intrinsics, camera_height_m)

    def track_sequence(
        self,
        frames: Iterable[ByteArray],  # [H, W, 3] or [H, W] each
        times_s: FloatArray,  # [T]
        intrinsics: Intrinsics,
        camera_height_m: float | None = None,
    ) -> tuple[Trajectory, BoolArray]:
        """The trajectory [T] of a whole drive and its marks [T], in memory that does not grow but for the poses.

        Poses are those known when they leave the window of keyframes, so better than what `stream` says at once.
        """
        stream = self.stream(intrinsics, camera_height_m)
        poses: list[FloatArray] = []
        marks: list[BoolArray] = []
        for frame, time_s in zip(frames, times_s, strict=True):
            stream.push(frame, float(time_s))
            settled, tracked = stream.take_settled()
            poses.append(settled)
            marks.append(tracked)
        settled, tracked = stream.take_settled(all_of_them=True)
        path = np.concatenate([*poses, settled])
        is_metric = self.scale.is_metric and (stream.confidence > 0 or not _moves(path))
        trajectory = Trajectory(path if is_metric else _unit_steps(path), np.asarray(times_s), is_metric)
        return trajectory, np.concatenate([*marks, tracked])


class Stream:
    """Odometry image by image, in memory that does not grow."""

    def __init__(self, odometry: Monocular, intrinsics: Intrinsics, camera_height_m: float | None) -> None:
        """A stream that has seen nothing yet."""
        lens = Lens(intrinsics, odometry.radial)
        pace = Pace(odometry.window, max_bundle_points=odometry.max_bundle_points)
        self._tracker = Tracker(front_end(odometry.features, odometry.num_features), lens, pace, odometry.seed)
        self._gauge = odometry.scale.gauge(intrinsics, camera_height_m)
        self._num_starts = 0
        self._now, self._settled = _Path(), _Path()
        self._backlog: list[tuple[FloatArray, bool]] = []

    @property
    def confidence(self) -> float:
        """Of the scale, from 0 (unknown) to 1."""
        return self._gauge.confidence

    def push(self, frame: ByteArray, time_s: float) -> Step:
        """Take the next image [H, W, 3] or [H, W] and say where the camera is."""
        tracked = self._tracker.push(as_grey(frame), time_s)
        poses, marks = self._tracker.take_settled()
        self._backlog += list(zip(poses, marks.tolist(), strict=True))
        if self._tracker.num_starts != self._num_starts:
            if self._num_starts:
                self._gauge.restart()
            self._num_starts = self._tracker.num_starts
        pair = self._tracker.new_pair
        if pair is not None:
            self._gauge.update(pair.before, pair.now, pair.before_from_now, pair.radial)
        world_from_cam = self._now.extended(self._tracker.world_from_cam, self._gauge.unit)
        return Step(world_from_cam, tracked, self.confidence)

    def take_settled(self, *, all_of_them: bool = False) -> tuple[FloatArray, BoolArray]:
        """Poses [T, 4, 4] and marks [T] since the last call that later images cannot change."""
        if all_of_them:
            poses, marks = self._tracker.take_settled(all_of_them=True)
            self._backlog += list(zip(poses, marks.tolist(), strict=True))
        elif self.confidence == 0 and len(self._backlog) < MAX_BACKLOG:
            return np.zeros((0, 4, 4)), np.zeros(0, dtype=bool)
        path = [self._settled.extended(pose, self._gauge.unit) for pose, _ in self._backlog]
        tracked = np.array([mark for _, mark in self._backlog], dtype=bool)
        self._backlog = []
        return np.array(path).reshape(-1, 4, 4), tracked


class _Path:
    """A path in metres, made of steps in units that may change."""

    def __init__(self) -> None:
        self.last: FloatArray | None = None
        self.world_from_cam: FloatArray = np.eye(4)

    def extended(self, pose: FloatArray, unit: float) -> FloatArray:
        if self.last is not None:
            step = se3.inverse(self.last) @ pose
            step[:3, 3] *= unit
            self.world_from_cam = se3.orthonormalised(self.world_from_cam @ step)
        self.last = pose
        return self.world_from_cam


def as_grey(frame: ByteArray) -> ByteArray:
    """An image [H, W, 3] or [H, W] as grey [H, W]."""
    if frame.ndim == 2:
        return frame
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _view(context: Context, which: str) -> ExtraView:
    if which == "crop":
        return ExtraView(context.frames, context.intrinsics, np.eye(4))
    if context.wide is None:
        raise Incompatible("the odometry wants wide frames, the clip has none: use frames = 'crop' or another data set")
    return context.wide


def _trajectory(
    poses: FloatArray, times_s: FloatArray, wants_metres: bool, unit: float, confidence: float
) -> Trajectory:
    is_metric = wants_metres and (confidence > 0 or not _moves(poses))
    if not is_metric:
        return Trajectory(_unit_steps(poses), times_s, False)
    scaled = poses.copy()
    scaled[:, :3, 3] *= unit
    return Trajectory(scaled, times_s, True)


def _moves(poses: FloatArray) -> bool:
    return bool(np.ptp(poses[:, :3, 3], axis=0).max(initial=0.0) > 0)


def _unit_steps(poses: FloatArray) -> FloatArray:
    """The poses with steps of mean length 1, unless the camera stands."""
    lengths = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    mean = float(lengths.mean()) if len(lengths) else 0.0
    scaled = poses.copy()
    scaled[:, :3, 3] /= mean if mean > 1e-9 else 1.0
    return scaled

"""Monocular visual odometry: the camera's path from its images alone, in metres when the scale can
tell.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, planar, se3
from geovp_classic.interfaces import Scale, ScaleEstimator
from geovp_classic.observation import frame_screening, stream
from geovp_classic.odometry import consistency
from geovp_classic.odometry.features import CornerTracker, all_corners
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.tracking import MAX_BRIDGED, KeyframePolicy, Tracker
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

SCALE_STRIDES = (1, 2, 4)  # from image to image, to measure the scale with
SHORTEST_HEIGHTS = 1 / 3  # camera heights between two images; less says little about the road
MAX_BACKLOG = 200  # final poses that wait until the scale is known


@dataclass(frozen=True)
class Step:
    """The pose of the latest image of a stream."""

    world_from_cam: FloatArray  # [4, 4]; the first image's is the identity
    tracked: bool  # False where the last motion was continued instead
    confidence: float  # of the scale, 0 (unknown: lengths are in no unit) to 1


@dataclass(frozen=True)
class Monocular:
    """Tracked corners, two-view initialisation, localisation in a sliding map, bundle adjustment,
    and scale.

    `frames` chooses between the protocol's images ("crop") and the uncropped ones ("full",
    PrivilegedInput.FULL_FRAMES). Sliding windows are for streams; a clip is bundle-adjusted as a
    whole.
    """

    scale: Scale = field(default_factory=GroundPlane)
    frames: Literal["crop", "full"] = "crop"
    radial: float = (
        0.0  # distortion known to be left in the images (`Lens.radial`); refined in turns
    )
    num_features: int = 450
    window: int = 16  # keyframes, of a stream
    max_bundle_points: int = 300  # 0: no bundle adjustment
    seed: int = 0

    def __post_init__(self) -> None:
        if self.num_features < 50 or self.window < 3 or 0 < self.max_bundle_points < 20:
            raise BadData(
                f"num_features is {self.num_features}, window {self.window}, max_bundle_points "
                f"{self.max_bundle_points}: expected at least 50, 3 and 20 (or 0: no bundle "
                "adjustment)"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """What the scale needs, and the uncropped images if asked for."""
        return self.scale.needs | (
            PrivilegedInput.FULL_FRAMES if self.frames == "full" else PrivilegedInput.NONE
        )

    @single_threaded_blas
    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The past trajectory [P] and which steps were tracked [P]; Incompatible when the clip
        lacks what it needs.

        The trajectory is metric when the scale is and could be found or assumed, or when the camera
        never moved; its `scale_uncertainty` says how well it is known.
        """
        view = stream(context, self.frames)
        all_times_s = context.times_s[: context.num_past]
        kept = view.is_usable
        times_s = all_times_s[kept]
        greys = list(view.greys[kept])
        if consistency.is_standing(greys):
            greys = greys[-1:] * len(greys)  # whatever crosses or covers the street
        poses, tracked, error, radial = self._path(greys, times_s, view.intrinsics)
        if consistency.is_sideways(poses):
            # Two views of a turn also fit a sharper one with a step to the side; other views may
            # not.
            backward, marks, backward_error, backward_radial = self._path(
                greys[::-1], -times_s[::-1], view.intrinsics
            )
            if backward_error < error:
                poses, tracked, radial = (
                    se3.inverse(backward[-1]) @ backward[::-1],
                    marks[::-1],
                    backward_radial,
                )
        known = consistency.driven(poses, times_s) & consistency.measured(tracked, MAX_BRIDGED)
        poses, tracked = frame_screening.bridged(poses, times_s, known), tracked & known
        estimator = self._measured_scale(
            greys, poses, tracked, radial, view.intrinsics, context.camera_height_m
        )
        estimator.finalize(float(_step_lengths(poses).sum()), float(times_s[-1] - times_s[0]))
        poses[:, :3, 3] *= estimator.unit
        found: FloatArray = np.tile(np.eye(4), (len(kept), 1, 1))
        marks = np.zeros(len(kept), dtype=bool)
        found[kept], marks[kept] = poses, tracked
        found = frame_screening.bridged(found, all_times_s, kept)
        return _trajectory(found, all_times_s, self.scale.is_metric, estimator.uncertainty), marks

    def _path(
        self, greys: list[ByteArray], times_s: FloatArray, intrinsics: Intrinsics
    ) -> tuple[FloatArray, BoolArray, float, float]:
        """Poses [P, 4, 4] of all images, which are tracked [P], the error of their map and the
        lens's `radial`.
        """
        policy = KeyframePolicy(
            len(times_s), 0.001, max_bundle_points=self.max_bundle_points, adjust_every=5
        )
        tracker = Tracker(
            CornerTracker(self.num_features), Lens(intrinsics, self.radial), policy, self.seed
        )
        for grey, time_s, corners in zip(
            greys, times_s, parallel_map(all_corners, greys), strict=True
        ):
            tracker.push(grey, float(time_s), corners)
        tracker.adjust_all()
        return (
            *tracker.take_final(all_of_them=True),
            tracker.map.reprojection_error,
            tracker.radial.mean,
        )

    def _measured_scale(
        self,
        greys: list[ByteArray],
        poses: FloatArray,  # [P, 4, 4]
        tracked: BoolArray,  # [P]
        radial: float,
        intrinsics: Intrinsics,
        height_m: float | None,
    ) -> ScaleEstimator:
        """The scale by every image and an earlier one: the one before it, unless the camera is too
        slow for that.
        """
        pitch_rad = planar.travel_pitch_rad(
            (se3.inverse(poses[:-1]) @ poses[1:])[tracked[:-1] & tracked[1:], :3, 3]
        )
        found: ScaleEstimator | None = None
        step = float(_step_lengths(poses).sum()) / max(len(poses) - 1, 1)
        for stride in SCALE_STRIDES:
            estimator = self.scale.estimator(intrinsics, height_m, pitch_rad)
            for before, now in zip(range(len(poses)), range(stride, len(poses)), strict=False):
                if tracked[before] and tracked[now]:
                    estimator.update(
                        greys[before], greys[now], se3.inverse(poses[before]) @ poses[now], radial
                    )
            found = estimator if found is None or estimator.confidence > 0 else found
            if found.confidence > 0 and stride * step * found.unit > SHORTEST_HEIGHTS * (
                height_m or 0
            ):
                break
        assert found is not None
        return found

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
        """The trajectory [T] of a whole drive and which images were tracked [T]; only the list of
        poses grows.

        Poses are taken when they leave the window of keyframes, so they are better than those of
        `Stream.push`.
        """
        stream = self.stream(intrinsics, camera_height_m)
        poses: list[FloatArray] = []
        marks: list[BoolArray] = []
        for frame, time_s in zip(frames, times_s, strict=True):
            stream.push(frame, float(time_s))
            settled, tracked = stream.take_final()
            poses.append(settled)
            marks.append(tracked)
        settled, tracked = stream.take_final(all_of_them=True)
        trajectory = _trajectory(
            np.concatenate([*poses, settled]), times_s, self.scale.is_metric, stream.uncertainty
        )
        return trajectory, np.concatenate([*marks, tracked])


class Stream:
    """Odometry image by image, in memory that does not grow."""

    def __init__(
        self, odometry: Monocular, intrinsics: Intrinsics, camera_height_m: float | None
    ) -> None:
        lens = Lens(intrinsics, odometry.radial)
        policy = KeyframePolicy(odometry.window, max_bundle_points=odometry.max_bundle_points)
        self._tracker = Tracker(CornerTracker(odometry.num_features), lens, policy, odometry.seed)
        self._estimator = odometry.scale.estimator(intrinsics, camera_height_m)
        self._num_starts = 0
        self._path, self._final_path = _Path(), _Path()
        self._backlog: list[tuple[FloatArray, bool]] = []

    @property
    def confidence(self) -> float:
        """Of the scale, from 0 (unknown) to 1."""
        return self._estimator.confidence

    @property
    def uncertainty(self) -> float:
        """Relative standard deviation of the scale; infinite while unknown."""
        return self._estimator.uncertainty

    @single_threaded_blas
    def push(self, frame: ByteArray, time_s: float) -> Step:
        """Take the next image [H, W, 3] or [H, W] and say where the camera is."""
        tracked = self._tracker.push(pinhole.grey8(frame), time_s)
        poses, marks = self._tracker.take_final()
        self._backlog += list(zip(poses, marks.tolist(), strict=True))
        if self._tracker.num_starts != self._num_starts:
            if self._num_starts:
                self._estimator.restart()
            self._num_starts = self._tracker.num_starts
        pair = self._tracker.new_pair
        if pair is not None:
            self._estimator.update(pair.before, pair.now, pair.before_from_now, pair.radial)
        world_from_cam = self._path.extended(self._tracker.world_from_cam, self._estimator.unit)
        return Step(world_from_cam, tracked, self.confidence)

    def take_final(self, *, all_of_them: bool = False) -> tuple[FloatArray, BoolArray]:
        """Poses [T, 4, 4] and marks [T] that have become final since the last call."""
        if all_of_them:
            poses, marks = self._tracker.take_final(all_of_them=True)
            self._backlog += list(zip(poses, marks.tolist(), strict=True))
        elif self.confidence == 0 and len(self._backlog) < MAX_BACKLOG:
            return np.zeros((0, 4, 4)), np.zeros(0, dtype=bool)
        metric_poses = [
            self._final_path.extended(pose, self._estimator.unit) for pose, _ in self._backlog
        ]
        tracked = np.array([mark for _, mark in self._backlog], dtype=bool)
        self._backlog = []
        return np.array(metric_poses).reshape(-1, 4, 4), tracked


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


def _step_lengths(poses: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1))


def _trajectory(
    poses: FloatArray, times_s: FloatArray, is_scaled: bool, uncertainty: float
) -> Trajectory:
    """The trajectory in metres when the scale is known or nothing moved, else with steps of mean
    length 1.
    """
    lengths, is_known = _step_lengths(poses), is_scaled and np.isfinite(uncertainty)
    is_metric = bool(is_known or (is_scaled and not (lengths > 0).any()))
    mean = float(lengths.mean()) if len(lengths) else 0.0
    scaled = poses.copy()
    scaled[:, :3, 3] /= mean if mean > 1e-9 and not is_metric else 1.0
    return Trajectory(scaled, np.asarray(times_s), is_metric, uncertainty if is_known else None)

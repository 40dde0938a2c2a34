"""Trajectory file of any SLAM or structure-from-motion system as an odometry."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from geovp_classic.data.formats import pose_files, sequence_paths
from geovp_classic.data.recordings.scans import nearest
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Scale
from geovp_classic.observation import observations_of
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.segment_scale import TrackedImages
from geovp_classic.types import (
    BoolArray,
    Context,
    FloatArray,
    IntArray,
    PrivilegedInput,
    Trajectory,
)


@dataclass(frozen=True)
class RecordedOdometry:
    """Past poses from a trajectory file of a whole sequence.

    `path` is a TUM or KITTI file of world_from_cam; "{sequence}" in it stands for the clip's
    sequence. A TUM file has times on the clock of the data set, in seconds or nanoseconds, and
    lacks lost frames. A KITTI file has a pose for every frame. Only poses of the observed frames
    are used: lost ones are interpolated, or extrapolated at the ends, and marked. As part of
    `chained` with a forecaster this is a pose source.

    The file may depend on later frames, as after loop closure or a global bundle adjustment. This
    cannot be detected: report it with the results, or record each pose as it was when its frame
    arrived.
    """

    path: Path
    # "metric": the file is in metres. A scale such as "ground-plane" measures them.
    scale: Literal["metric"] | Scale = "metric"
    max_difference_s: float = 0.02  # between the times of a frame and its pose, as in TUM's tools

    def __post_init__(self) -> None:
        sequence_paths.check_exists(self.path, "a TUM or KITTI trajectory")
        _read_file.cache_clear()  # files may have changed since another one was built

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the scale."""
        return PrivilegedInput.NONE if self.scale == "metric" else self.scale.needs

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Return the past trajectory [P], and which poses are in the file [P].

        With fewer than two recorded poses the camera is assumed to be stationary.
        """
        times_s = context.past_s
        poses, rows = self._read(context)
        tracked = rows >= 0
        world_from_cam: FloatArray = np.tile(np.eye(4), (len(times_s), 1, 1))
        if tracked.sum() >= 2:
            observed = poses[rows[tracked]]
            world_from_cam = se3.interpolate(observed, times_s[tracked], times_s)
        if self.scale == "metric":
            return Trajectory(world_from_cam, times_s, is_metric=True), tracked
        view = observations_of(context, "crop")
        odometry = Monocular(self.scale)
        images = TrackedImages(
            np.arange(len(times_s)),
            times_s,
            list(view.greys),
            world_from_cam,
            tracked & view.is_usable,
            np.zeros(len(times_s), dtype=int),
        )
        scale = odometry.fit_scale(images, view.intrinsics, context.camera_height_m)
        estimator = scale.estimator
        world_from_cam[:, :3, 3] *= estimator.unit
        return odometry.trajectory(world_from_cam, times_s, estimator.uncertainty), tracked

    def _read(self, context: Context) -> tuple[FloatArray, IntArray]:
        """Return all poses [N, 4, 4] and the row [P] of each observed frame, -1 if it is lost."""
        sequence, numbers = context.frame_numbers()
        recorded_s, poses = _read_file(sequence_paths.of_sequence(self.path, sequence))
        if recorded_s is None:
            return poses, np.where(numbers < len(poses), numbers, -1)
        times_s = context.past_s
        if recorded_s[-1] < times_s[0] or recorded_s[0] > times_s[-1]:
            raise BadData(
                f"{self.path} has poses from {recorded_s[0]:.3f} to {recorded_s[-1]:.3f} s "
                f"({pose_files.clock_of(recorded_s)}), clip {context.name} starts at "
                f"{times_s[0]:.3f} s: give times on the data set's clock, "
                f"{pose_files.clock_of(times_s)} in seconds or nanoseconds"
            )
        return poses, nearest(times_s, recorded_s, self.max_difference_s)


@functools.lru_cache(maxsize=4)
def _read_file(path: Path) -> tuple[FloatArray | None, FloatArray]:
    """Read times [N], None for a KITTI file, and poses [N, 4, 4], once per process."""
    if pose_files.has_times(path):
        times, poses = pose_files.read_tum(path)
        return pose_files.in_seconds(times), poses
    return None, pose_files.read_kitti(path)

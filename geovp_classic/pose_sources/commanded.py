"""Motion commanded by an operator: a trajectory file, or a speed and a turn rate."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import Context, FloatArray, Motion, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Commanded:
    """The recorded past, after which the camera moves as commanded: by a trajectory file, or by
    speed and turn rate.

    `futures` is a TUM or KITTI file of the commanded motion; only how poses lie to one another
    counts, so its world frame is free. A TUM file starts at the last observed frame, whatever time
    it states there, and is read at the times to predict (screw motion in between). A KITTI file has
    no times: its first pose is the last observed frame's, and one pose follows for every frame to
    predict.

    Without a file the camera keeps `speed_m_s` along its viewing axis and turns right by
    `turn_deg_s` about its own vertical; that needs metric poses. A file is taken to be in the unit
    of the recorded poses.
    """

    futures: Path | None = None
    speed_m_s: float | None = None
    turn_deg_s: float = 0.0

    def __post_init__(self) -> None:
        if (self.futures is None) == (self.speed_m_s is None):
            raise BadData(
                "commanded needs either futures, a trajectory file, or speed_m_s: give exactly "
                "one of them"
            )
        if self.futures is not None and self.turn_deg_s != 0:
            raise BadData(
                "commanded by a trajectory file has its turns from there: leave turn_deg_s out"
            )
        if self.futures is not None and not self.futures.is_file():
            raise BadData(
                f"{self.futures} is missing, expected a TUM or KITTI trajectory of the "
                "commanded motion"
            )

    needs = PrivilegedInput.PAST_POSES  # the recorded past poses, on which the command goes on

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded past and the commanded future, one sample; Incompatible when the clip has no
        poses.
        """
        if context.past is None:
            raise Incompatible(
                "commanded goes on from recorded past poses, the clip has none: choose another clip"
            )
        times_s = context.times_s[context.num_past - 1 :]
        last_from_cam = (
            self._constant_turn(context.past, times_s)
            if self.futures is None
            else self._read(times_s)
        )
        futures = context.past.world_from_cam[-1] @ last_from_cam
        return Motion(context.past, futures[None], np.ones(context.num_past, dtype=bool))

    def _constant_turn(self, past: Trajectory, times_s: FloatArray) -> FloatArray:
        """last_from_cam [F, 4, 4] of the commanded speed and turn rate."""
        assert self.speed_m_s is not None
        if not past.is_metric:
            raise Incompatible(
                "speed_m_s is in metres, the recorded poses are not: command by a trajectory file"
            )
        twist_per_s = np.array([0.0, 0.0, self.speed_m_s, 0.0, np.deg2rad(self.turn_deg_s), 0.0])
        return se3.exp((times_s[1:] - times_s[0])[:, None] * twist_per_s)

    def _read(self, times_s: FloatArray) -> FloatArray:
        """last_from_cam [F, 4, 4] of the commanded trajectory."""
        assert self.futures is not None
        if not pose_files.has_times(self.futures):
            _, poses = pose_files.read_kitti(self.futures)
            if len(poses) != len(times_s):
                count = len(times_s)
                expected = (
                    f"{count}: the last observed frame's and one for each of {count - 1} to predict"
                )
                raise BadData(f"{self.futures}: {len(poses)} poses, expected {expected}")
            return se3.inverse(poses[0]) @ poses[1:]
        commanded = pose_files.read_tum(self.futures)
        duration_s, wanted_s = (
            commanded.times_s[-1] - commanded.times_s[0],
            times_s[-1] - times_s[0],
        )
        if duration_s < wanted_s - 1e-6:
            raise BadData(
                f"{self.futures} lasts {duration_s:.3g} s, expected at least the {wanted_s:.3g} "
                "s to predict"
            )
        read_at_s = commanded.times_s[0] + times_s[1:] - times_s[0]
        return se3.inverse(commanded.world_from_cam[0]) @ _at(commanded, read_at_s)


def _at(trajectory: Trajectory, times_s: FloatArray) -> FloatArray:
    """world_from_cam [F, 4, 4] at any times within the trajectory, a screw motion between its
    poses.
    """
    after = np.clip(np.searchsorted(trajectory.times_s, times_s), 1, len(trajectory) - 1)
    before_s, after_s = trajectory.times_s[after - 1], trajectory.times_s[after]
    fraction = (times_s - before_s) / (after_s - before_s)
    poses = trajectory.world_from_cam
    return se3.interpolate(poses[after - 1], poses[after], fraction)

"""Motion commanded by an operator: a trajectory file, or a speed and a turn rate."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.odometry.recorded_past import recorded
from geovp_classic.types import Context, FloatArray, Motion, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Commanded:
    """The recorded past, after which the camera moves as commanded.

    `futures` is a TUM or KITTI file of the commanded motion in any world frame, in the unit of the
    recorded poses. A TUM file starts at the last observed frame, whatever its first time, and is
    interpolated at the times to predict. A KITTI file has no times: its first pose is that of the
    last observed frame, followed by one pose for every frame to predict.

    Without a file the camera keeps its speed along the viewing axis and turns right about its own
    vertical; that needs metric poses.
    """

    futures: Path | None = None
    speed_m_s: float | None = None
    turn_deg_s: float = 0.0

    needs = PrivilegedInput.PAST_POSES

    def __post_init__(self) -> None:
        if (self.futures is None) == (self.speed_m_s is None):
            raise BadData(
                "commanded needs either futures, a trajectory file, or speed_m_s: give exactly "
                "one of them"
            )
        if self.futures is None:
            return
        if self.turn_deg_s != 0:
            raise BadData("a trajectory file already commands the turns: leave turn_deg_s out")
        if not self.futures.is_file():
            raise BadData(f"{self.futures} is missing, expected a TUM or KITTI trajectory")

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the recorded past and the commanded future; raise Incompatible without poses."""
        past = recorded(context.past, "past")
        ahead_s = context.future_s - context.past_s[-1]
        if self.futures is None:
            last_from_cam = self._constant_turn(past, ahead_s)
        elif pose_files.has_times(self.futures):
            last_from_cam = _read_tum(self.futures, ahead_s)
        else:
            last_from_cam = _read_kitti(self.futures, len(ahead_s))
        futures = past.world_from_cam[-1] @ last_from_cam
        tracked = np.ones(context.num_past, bool)
        return Motion(past, futures[None], tracked, is_commanded=True)

    def _constant_turn(self, past: Trajectory, ahead_s: FloatArray) -> FloatArray:
        """Return last_from_cam [F, 4, 4] of the commanded speed and turn rate."""
        if not past.is_metric:
            raise Incompatible(
                "speed_m_s is in metres, the recorded poses are not: command by a trajectory file"
            )
        turn_rad_s = np.radians(self.turn_deg_s)
        twist_per_s = np.array([0.0, 0.0, self.speed_m_s, 0.0, turn_rad_s, 0.0])
        return se3.exp(ahead_s[:, None] * twist_per_s)


def _read_tum(path: Path, ahead_s: FloatArray) -> FloatArray:
    """Return last_from_cam [F, 4, 4] at times after the first pose of a file."""
    commanded = pose_files.read_trajectory(path)
    command_s = commanded.times_s - commanded.times_s[0]
    if command_s[-1] < ahead_s[-1] - 1e-6:
        raise BadData(
            f"{path} lasts {command_s[-1]:.3g} s, expected at least the {ahead_s[-1]:.3g} s to "
            "predict"
        )
    last_from_cam = se3.inverse(commanded.world_from_cam[0]) @ commanded.world_from_cam
    return se3.interpolate(last_from_cam, command_s, ahead_s)


def _read_kitti(path: Path, num_future: int) -> FloatArray:
    """Return last_from_cam [F, 4, 4] of a file with one pose per frame."""
    poses = pose_files.read_kitti(path)
    if len(poses) != num_future + 1:
        raise BadData(
            f"{path}: {len(poses)} poses, expected {num_future + 1}: the last observed frame's and "
            f"one for each of {num_future} to predict"
        )
    return se3.inverse(poses[0]) @ poses[1:]

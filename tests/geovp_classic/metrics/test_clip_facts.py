"""What trajectories made by hand say: headings in degrees, speeds in metres a second."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geovp_classic.geometry import se3
from geovp_classic.metrics.clip_facts import clip_facts
from geovp_classic.types import Clip, FloatArray, Intrinsics, PrivilegedInput, Trajectory

CAMERA = Intrinsics(4.0, 4.0, 1.5, 1.5, 4, 4)
PAST, RATE_HZ = 3, 10.0


def clip(headings_deg: FloatArray, step_m: float = 0.8, *, is_metric: bool = True) -> Clip:
    """A drive along its headings, positive to the right, seen from a world that is turned by an odd
    angle.
    """
    headings_rad = np.deg2rad(headings_deg)
    ahead = np.stack(
        [np.sin(headings_rad), np.zeros_like(headings_rad), np.cos(headings_rad)], axis=-1
    )
    positions = np.cumsum(step_m * ahead, axis=0)
    poses = se3.compose(
        Rotation.from_rotvec(headings_rad[:, None] * np.array([0, 1, 0])).as_matrix(), positions
    )
    world_from_start = se3.compose(
        Rotation.from_euler("XYZ", [0.7, -2.0, 0.3]).as_matrix(), np.array([5.0, 1, 2])
    )
    times_s = 100 + np.arange(len(poses)) / RATE_HZ
    frames = np.zeros((len(poses), 4, 4, 3), np.uint8)
    return Clip(
        "drive", frames, times_s, CAMERA, Trajectory(world_from_start @ poses, times_s, is_metric)
    )


def facts_of(drive: Clip) -> dict[str, float]:
    return clip_facts(*drive.split(PAST, ~PrivilegedInput.NONE))


@pytest.mark.parametrize(
    ("headings_deg", "yaw_deg"),
    [
        ([-40, -20, 0, 2, 4, 6, 8], 8.0),  # what the past did does not count
        ([0, 0, 0, -2, -4, -6, -8], 8.0),  # nor which way it turns
        ([0, 0, 0, 7, 12, 7, 0], 12.0),  # a double bend turns, though it ends as it began
        ([0, 0, 0, 60, 120, 180, 240], 240.0),  # round a roundabout
    ],
)
def test_turning_is_the_largest_change_of_heading(
    headings_deg: list[float], yaw_deg: float
) -> None:
    assert facts_of(clip(np.array(headings_deg, dtype=float)))["yaw_deg"] == pytest.approx(yaw_deg)


def test_facts_need_poses_and_speeds_need_metres() -> None:
    assert set(facts_of(clip(np.zeros(8), is_metric=False))) == {"yaw_deg"}
    assert facts_of(replace(clip(np.zeros(8)), trajectory=None)) == {}


def test_speed_is_per_second_and_step_per_frame() -> None:
    drive = clip(np.zeros(8), step_m=0.5)
    slow_s = drive.times_s * 2  # the same path at 5 Hz
    trajectory = Trajectory(drive.trajectory.world_from_cam, slow_s, is_metric=True)
    facts = facts_of(replace(drive, times_s=slow_s, trajectory=trajectory))
    assert (facts["speed_m_s"], facts["step_m"]) == pytest.approx((2.5, 0.5))

"""The latency study: what is known of the motion helps, and faults of the channel cost little."""

import numpy as np
import pytest
import street

from geovp_classic.geometry import planar
from geovp_classic.streaming.commands import commanded_poses
from geovp_classic.types import Clip
from studies import latency

EXACT = latency.Setup(stride=15, speed_error_fraction=0.0, yaw_rate_error_rad_s=0.0)


@pytest.fixture(scope="module")
def clip() -> Clip:
    return street.clip(num_frames=42)


def test_views_with_known_motion_beat_the_late_image(clip: Clip) -> None:
    ((views, real, warned),) = latency.presents(clip, EXACT)
    assert warned == 0
    errors = {
        method: np.abs(np.asarray(frames, float) - real).mean(axis=(1, 2, 3))
        for method, frames in views.items()
    }
    soon = slice(0, 6)  # up to a second
    late = errors["late image"][soon]
    assert (errors["live, forecast"][soon] < 0.9 * late).all()
    for method in ("live, commanded", "live, recorded motion"):
        assert (errors[method][soon] < 0.7 * late).all(), method


def test_recorded_commands_lead_to_the_recorded_pose(clip: Clip) -> None:
    commands = latency.commanded(clip, range(20, 30), EXACT, np.random.default_rng(0))
    poses = clip.trajectory.world_from_cam
    level = planar.level_vehicle_from_cam()
    end_s = clip.times_s[30:31]
    end = commanded_poses(commands, poses[20], level, clip.times_s[20], end_s)
    expected, actual = (planar.reduce(pose[None], poses[20], level) for pose in (poses[30], end[0]))
    np.testing.assert_allclose(actual, expected, atol=0.05)

"""Commanded motion is made of arcs."""

import numpy as np

from geovp_classic.geometry import planar, se3
from geovp_classic.streaming import Command
from geovp_classic.streaming.commands import commanded_poses
from geovp_classic.types import FloatArray

LEVEL = planar.level_vehicle_from_cam()


def states(commands: list[Command], times_s: list[float], start_s: float = 0.0) -> FloatArray:
    """Return (x, z, yaw) [F, 3] after the start."""
    last = se3.exp(np.array([4.0, 1.0, -2.0, 0.0, 0.3, 0.0]))
    poses = commanded_poses(commands, last, LEVEL, start_s, np.array(times_s))
    return planar.reduce(poses, last, LEVEL)


def test_a_quarter_circle_to_the_right() -> None:
    quarter_s = np.pi / 2 / 0.5
    end = states([Command(0.0, 3.0, 0.5)], [quarter_s])
    radius_m = 3.0 / 0.5
    np.testing.assert_allclose(end, [[radius_m, radius_m, np.pi / 2]], atol=1e-9)


def test_the_first_command_is_valid_before_its_time_and_old_ones_are_not() -> None:
    np.testing.assert_allclose(states([Command(5.0, 2.0, 0.0)], [1.0])[:, 1], [2.0])
    commands = [Command(0.0, 50.0, 0.0), Command(1.0, 2.0, 0.0)]
    np.testing.assert_allclose(states(commands, [3.0], start_s=2.0)[:, 1], [2.0])

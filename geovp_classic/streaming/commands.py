"""Motion that is commanded, such as by a remote driver, instead of forecast."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Command:
    """Speed and yaw rate of the vehicle from a time on, until the next command."""

    time_s: float
    speed_m_s: float  # negative: in reverse
    yaw_rate_rad_s: float  # positive: to the right

    def __post_init__(self) -> None:
        if not np.isfinite([self.time_s, self.speed_m_s, self.yaw_rate_rad_s]).all():
            raise BadData(f"{self} must be finite: leave out commands that are not known")


def commanded_poses(
    commands: Sequence[Command],  # in increasing time, at least one
    world_from_last: FloatArray,  # [4, 4], the camera at the start
    vehicle_from_cam: FloatArray,  # [4, 4], of `planar.level_vehicle_from_cam`
    start_s: float,
    times_s: FloatArray,  # [F], increasing, from the start on
) -> FloatArray:
    """Return the poses [F, 4, 4] of a camera that moves as commanded, along arcs.

    The first command is also valid before its time. Raise BadData for commands out of order.
    """
    begins_s = np.array([command.time_s for command in commands])
    if len(begins_s) == 0 or (np.diff(begins_s) < 0).any():
        raise BadData(
            "commands must be given in increasing time, at least one: sort them by time_s"
        )
    # The path consists of arcs between times at which a command begins or a pose is asked for
    nodes_s = np.union1d(begins_s[begins_s > start_s], [start_s, *times_s])
    nodes_s = nodes_s[nodes_s <= times_s[-1]]
    in_force = np.searchsorted(begins_s, nodes_s[:-1], side="right") - 1
    valid = [commands[max(index, 0)] for index in in_force]
    twists_per_s = np.zeros((len(valid), 6))  # of the vehicle
    twists_per_s[:, 2] = [command.speed_m_s for command in valid]
    twists_per_s[:, 4] = [command.yaw_rate_rad_s for command in valid]
    # Chain the arcs, and pick the poses at the times asked for
    arcs = se3.exp(twists_per_s * np.diff(nodes_s)[:, None])
    nodes = list(accumulate(arcs, np.matmul, initial=np.eye(4)))
    start_from_vehicle = np.stack(nodes)[np.searchsorted(nodes_s, times_s)]
    last_from_vehicle = se3.inverse(vehicle_from_cam) @ start_from_vehicle
    return world_from_last @ last_from_vehicle @ vehicle_from_cam

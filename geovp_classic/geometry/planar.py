"""Trajectories on the vehicle's plane: reduced to (x, z, yaw) and lifted back.

The plane is the ground plane of one reference step, the last observed frame. Its frame "vehicle"
has the origin of that camera, y along the plane's normal (downwards), z along the camera's heading
in the plane and x to the right. Reducing keeps x, z and the heading's yaw about the normal of each
step; height, pitch and roll are those of the reference step.
"""

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


def level_vehicle_from_cam(pitch_rad: float = 0.0, roll_rad: float = 0.0) -> FloatArray:
    """vehicle_from_cam [4, 4] of a camera that looks `pitch_rad` above the plane and is rolled
    clockwise by `roll_rad`.

    With both 0 the vehicle's plane is the camera's own x-z plane.
    """
    cos_p, sin_p, cos_r, sin_r = (
        np.cos(pitch_rad),
        np.sin(pitch_rad),
        np.cos(roll_rad),
        np.sin(roll_rad),
    )
    pitch = np.array([[1, 0, 0], [0, cos_p, -sin_p], [0, sin_p, cos_p]])
    roll = np.array([[cos_r, -sin_r, 0], [sin_r, cos_r, 0], [0, 0, 1]])
    return se3.compose(pitch @ roll, np.zeros(3))


def travel_pitch_rad(
    steps: FloatArray,  # [N, 3], each in its own camera's frame
) -> float:
    """How far a camera looks above the direction in which it travels, on average, in radians; 0
    without any step.
    """
    _, down, ahead = (steps * np.where(steps[:, 2:] < 0, -1.0, 1.0)).sum(
        axis=0
    )  # backing up is along the road as well
    return float(np.arctan2(down, ahead))


def reduce(
    world_from_cam: FloatArray,  # [..., T, 4, 4]
    world_from_reference: FloatArray,  # [4, 4], the reference camera
    vehicle_from_cam: FloatArray,  # [4, 4], from level_vehicle_from_cam
) -> FloatArray:
    """(x, z, yaw_rad) [..., T, 3] of every camera on the reference's plane; yaw is positive to the
    right.
    """
    vehicle_from_world = vehicle_from_cam @ se3.inverse(world_from_reference)
    vehicle_from_vehicle = vehicle_from_world @ world_from_cam @ se3.inverse(vehicle_from_cam)
    forward = vehicle_from_vehicle[..., :3, 2]
    yaw_rad = np.arctan2(forward[..., 0], forward[..., 2])
    return np.stack(
        [vehicle_from_vehicle[..., 0, 3], vehicle_from_vehicle[..., 2, 3], yaw_rad], axis=-1
    )


def lift(
    states: FloatArray,  # [..., T, 3] as (x, z, yaw_rad)
    world_from_reference: FloatArray,  # [4, 4]
    vehicle_from_cam: FloatArray,  # [4, 4]
) -> FloatArray:
    """world_from_cam [..., T, 4, 4]: the reference camera's height, pitch and roll at every (x, z,
    yaw).
    """
    x, z, yaw_rad = states[..., 0], states[..., 1], states[..., 2]
    zero, one, cos_y, sin_y = np.zeros_like(x), np.ones_like(x), np.cos(yaw_rad), np.sin(yaw_rad)
    rows = [cos_y, zero, sin_y, zero, one, zero, -sin_y, zero, cos_y]
    rotation = np.stack(rows, axis=-1).reshape(*x.shape, 3, 3)
    vehicle_from_vehicle = se3.compose(rotation, np.stack([x, zero, z], axis=-1))
    return (
        world_from_reference
        @ se3.inverse(vehicle_from_cam)
        @ vehicle_from_vehicle
        @ vehicle_from_cam
    )

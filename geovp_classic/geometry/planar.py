"""Reduction of trajectories to the vehicle's plane as (x, z, yaw), and back.

The plane is the ground plane of one reference step, the last observed frame. Its frame "vehicle"
has the origin of that camera, y along the plane's normal (downwards), z along the camera's heading
in the plane and x to the right. The reduction keeps x, z and the yaw of each step. Height, pitch
and roll are those of the reference step.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


def level_vehicle_from_cam(pitch_rad: float = 0.0, roll_rad: float = 0.0) -> FloatArray:
    """Return vehicle_from_cam [4, 4] of a camera tilted against the plane.

    The camera looks `pitch_rad` above the plane and is rolled clockwise by `roll_rad`. With both 0
    the plane is the camera's own x-z plane.
    """
    rotation = Rotation.from_euler("XZ", [pitch_rad, roll_rad]).as_matrix()
    return se3.compose(rotation, np.zeros(3))


def travel_pitch_rad(
    steps: FloatArray,  # [N, 3], each in its own camera's frame
) -> float:
    """Return the mean angle of the viewing axis above the direction of travel; 0 without steps."""
    forwards = np.where(steps[:, 2:] < 0, -steps, steps)  # reversing is along the road, too
    _, down, ahead = forwards.sum(axis=0)
    return float(np.arctan2(down, ahead))


def reduce(
    world_from_cam: FloatArray,  # [..., T, 4, 4]
    world_from_reference: FloatArray,  # [4, 4], the reference camera
    vehicle_from_cam: FloatArray,  # [4, 4], from level_vehicle_from_cam
) -> FloatArray:
    """Return (x, z, yaw_rad) [..., T, 3] on the reference's plane; yaw is positive to the right."""
    reference_from_cam = se3.inverse(world_from_reference) @ world_from_cam
    vehicle_from_vehicle = vehicle_from_cam @ reference_from_cam @ se3.inverse(vehicle_from_cam)
    position = vehicle_from_vehicle[..., :3, 3]
    forward = vehicle_from_vehicle[..., :3, 2]
    yaw_rad = np.arctan2(forward[..., 0], forward[..., 2])
    return np.stack([position[..., 0], position[..., 2], yaw_rad], axis=-1)


def lift(
    states: FloatArray,  # [..., T, 3] as (x, z, yaw_rad)
    world_from_reference: FloatArray,  # [4, 4]
    vehicle_from_cam: FloatArray,  # [4, 4]
) -> FloatArray:
    """Return world_from_cam [..., T, 4, 4] with the reference's height, pitch and roll."""
    turns = np.zeros((*states.shape[:-1], 6))
    turns[..., 4] = states[..., 2]
    vehicle_from_vehicle = se3.exp(turns)
    vehicle_from_vehicle[..., [0, 2], 3] = states[..., :2]
    reference_from_cam = se3.inverse(vehicle_from_cam) @ vehicle_from_vehicle @ vehicle_from_cam
    return world_from_reference @ reference_from_cam

"""Planar motion: futures reduced to (x, z, yaw) on the ground plane."""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import planar
from geovp_classic.interfaces import PoseSource
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class Planar:
    """A pose source whose futures are reduced to the vehicle's plane (GT-2D from GT-3D).

    The plane is that of the last observed frame. Height, pitch and roll stay as in that frame; the
    past is unchanged.
    """

    source: PoseSource
    pitch_deg: float = 0.0  # of the camera, upwards from the plane
    roll_deg: float = 0.0  # of the camera, clockwise

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the source."""
        return self.source.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the source's motion with planar futures."""
        motion = self.source.estimate(context.only(self.source.needs), num_samples)
        pitch_rad = np.radians(self.pitch_deg)
        roll_rad = np.radians(self.roll_deg)
        vehicle_from_cam = planar.level_vehicle_from_cam(pitch_rad, roll_rad)
        world_from_last = motion.past.world_from_cam[-1]
        states = planar.reduce(motion.futures, world_from_last, vehicle_from_cam)
        futures = planar.lift(states, world_from_last, vehicle_from_cam)
        return replace(motion, futures=futures)

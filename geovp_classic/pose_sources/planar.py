"""Planar motion: futures reduced to (x, z, yaw) on the ground plane."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import planar
from geovp_classic.interfaces import PoseSource
from geovp_classic.types import Context, FloatArray, Motion, PrivilegedInput


@dataclass(frozen=True)
class Planar:
    """Any source whose futures are reduced to (x, z, yaw) on the vehicle's plane and lifted back
    (GT-2D from GT-3D).

    The plane is that of the last observed frame: the camera looks `pitch_deg` above it and is
    rolled clockwise by `roll_deg`. With both 0 it is the camera's own x-z plane. Height, pitch and
    roll stay as they are in that frame; the past is kept as it is.
    """

    source: PoseSource
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def needs(self) -> PrivilegedInput:
        """What the source needs."""
        return self.source.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The source's motion with flattened futures."""
        motion = self.source.estimate(context.only(self.source.needs), num_samples)
        vehicle_from_cam = planar.level_vehicle_from_cam(
            np.deg2rad(self.pitch_deg), np.deg2rad(self.roll_deg)
        )
        world_from_last = motion.past.world_from_cam[-1]
        states = planar.reduce(motion.futures, world_from_last, vehicle_from_cam)
        futures: FloatArray = planar.lift(states, world_from_last, vehicle_from_cam)
        return Motion(motion.past, futures, motion.tracked)

"""Planar motion: futures reduced to (x, z, yaw) on the ground plane."""

from dataclasses import dataclass, replace

from geovp_classic.geometry import planar
from geovp_classic.interfaces import PoseSource
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class Planar:
    """A pose source whose futures are reduced to the vehicle's plane (GT-2D from GT-3D).

    The plane is the x-z plane of the last observed camera. Height, pitch and roll stay as in that
    frame; the past is unchanged.
    """

    source: PoseSource

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the source."""
        return self.source.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the source's motion with planar futures."""
        motion = self.source.estimate(context.only(self.source.needs), num_samples)
        plane = motion.past.world_from_cam[-1], planar.level_vehicle_from_cam()
        futures = planar.lift(planar.reduce(motion.futures, *plane), *plane)
        return replace(motion, futures=futures)

"""A camera that stands shows what it showed: resampling from uncropped frames must not blur the
last one.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.interfaces import Scene
from geovp_classic.rendering import patches
from geovp_classic.types import FloatArray, Intrinsics, Views

MOVED_PX = 0.05  # of the nearest surface, below which a camera stands


@dataclass(frozen=True)
class StandingScene:
    """A static scene that shows the last observed frame itself from where that was taken."""

    scene: Scene
    last: patches.Source  # the last observed frame, at the size asked for
    largest_inverse_depth: float  # of it, per unit of the poses

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F]."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        moved = se3.inverse(self.last.world_from_source) @ world_from_cam
        moved_rad = (
            se3.rotation_angle_rad(moved)
            + np.linalg.norm(moved[:, :3, 3], axis=1) * self.largest_inverse_depth
        )
        stands = intrinsics.fx_px * moved_rad < MOVED_PX
        if intrinsics != self.last.camera or not stands.any():
            return views
        frames = np.where(stands[:, None, None, None], self.last.frame, views.frames)
        return Views(frames, views.covered | stands[:, None, None], views.depths)

"""Reuse of the last observed frame while the camera is stationary.

Resampling it from uncropped frames would blur it.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.interfaces import Scene
from geovp_classic.rendering.source import Source
from geovp_classic.types import FloatArray, Intrinsics, Views


@dataclass(frozen=True)
class StationaryScene:
    """A static scene that shows the last observed frame itself where that was taken."""

    scene: Scene
    last: Source  # the last observed frame, as large as its camera
    max_inverse_depth: float  # of the scene, per unit of the poses
    max_shift_px: float = (
        0.05  # of the nearest surface, while the camera is stationary
    )

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4] at the times [F]."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if intrinsics != self.last.camera:
            return views
        motion = se3.inverse(self.last.world_from_source) @ world_from_cam
        distance = np.linalg.norm(motion[:, :3, 3], axis=1)
        shift_rad = (
            se3.rotation_angle_rad(motion) + distance * self.max_inverse_depth
        )
        is_stationary = (intrinsics.fx_px * shift_rad < self.max_shift_px)[
            :, None, None
        ]
        frames = np.where(
            is_stationary[..., None], self.last.frame, views.frames
        )
        return Views(frames, views.covered | is_stationary, views.depths)

"""A static scene with moving patches in front of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.interfaces import Scene
from geovp_classic.rendering.source import Source
from geovp_classic.types import FloatArray, Intrinsics, Views
from geovp_classic.types.layers import MovingPatch


@dataclass(frozen=True)
class LayeredScene:
    """Views of a static scene, with patches of the last frame where they have moved to."""

    static: Scene
    last: Source
    last_s: float
    patches: Sequence[MovingPatch]

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """Return the views from the poses [F, 4, 4] at the times [F]."""
        views = self.static.view(world_from_cam, times_s, intrinsics)
        frames, covered, depths = views.frames.copy(), views.covered.copy(), views.depths.copy()
        moving = np.zeros_like(covered)
        for step, (pose, time_s) in enumerate(zip(world_from_cam, times_s, strict=True)):
            for patch in self.patches:
                moved = self._moved(patch, pose, float(time_s), intrinsics)
                if moved is None:
                    continue
                image, weight, depth = moved
                weight = weight[..., None]
                blended = weight * image + (1 - weight) * frames[step]
                frames[step] = np.clip(np.rint(blended), 0, 255)
                is_shown = weight[..., 0] > 0.5
                covered[step] |= is_shown
                moving[step] |= is_shown
                depths[step][is_shown] = depth
        return Views(frames, covered, depths, moving)

    def _moved(
        self, patch: MovingPatch, world_from_cam: FloatArray, time_s: float, camera: Intrinsics
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """Return image, weight [H, W] and depth of a patch in a view; None behind the camera.

        The moving patch is a static one, seen from a camera that is displaced the other way.
        """
        displaced = world_from_cam.copy()
        displaced[:3, 3] -= patch.velocity_per_s * (time_s - self.last_s)
        cam_from_last = se3.inverse(displaced) @ self.last.world_from_source
        # The plane at this depth of the last camera (Hartley & Zisserman 2004, eq. 13.2).
        plane = cam_from_last[:3, :3].copy()
        plane[:, 2] += patch.inverse_depth * cam_from_last[:3, 3]
        ray_from_last = np.linalg.inv(self.last.camera.matrix)
        view_from_last = camera.matrix @ plane @ ray_from_last
        rows, columns = np.nonzero(patch.mask)
        scale = plane[2] @ ray_from_last @ [columns.mean(), rows.mean(), 1]
        if scale < 0.05:  # behind the camera, or twenty times as large
            return None
        per_px = 1 / self.last.resolution
        resolution = np.array(
            [[per_px, 0, per_px / 2 - 0.5], [0, per_px, per_px / 2 - 0.5], [0, 0, 1]]
        )
        warped = cv2.warpPerspective(
            self.last.frame,
            view_from_last @ resolution,
            camera.size_px,
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
        weight = cv2.warpPerspective(patch.mask.astype(np.float32), view_from_last, camera.size_px)
        return warped.astype(np.float32), weight, float(scale / patch.inverse_depth)

"""Several samples a pixel: edges of things are smooth, and surfaces of nearly equal depth are blended, not in turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import Scene
from geovp_classic.types import FloatArray, Intrinsics, Views


@dataclass(frozen=True)
class Supersampled:
    """A scene whose views are drawn finer and averaged over each pixel."""

    scene: Scene
    samples: int  # along each side of a pixel

    def view(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> Views:
        """The scene from the poses [F, 4, 4]; covered where half of the samples are, as deep as the nearest of them."""
        size_px = intrinsics.width_px, intrinsics.height_px
        fine = self.scene.view(world_from_cam, intrinsics.resized(*(side * self.samples for side in size_px)))
        frames = np.stack([pinhole.resize(frame, size_px) for frame in fine.frames])
        shares = (len(frames), size_px[1], self.samples, size_px[0], self.samples)
        covered = fine.covered.reshape(shares).mean(axis=(2, 4)) >= 0.5
        nearest = np.where(fine.covered, fine.depths, np.inf).reshape(shares).min(axis=(2, 4))
        return Views(frames, covered, np.where(covered, nearest, 0).astype(np.float32))

"""Dense reprojection of one frame's pixels into another frame.

A pixel (u, v, 1) with inverse depth q reprojects to A (u, v, 1) + q b. Here A = K R K^-1, and
b = K t is the epipole (Hartley & Zisserman 2004, eq. 13.2). As q grows from 0 (infinity), the
pixel moves along its epipolar line.
"""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class Epipolar:
    """The maps A and b from this frame's pixels into another frame."""

    infinity: FloatArray  # A [3, 3] float32
    epipole: FloatArray  # b [3] float32

    @classmethod
    def of(
        cls,
        camera: Intrinsics,
        other_from_this: FloatArray,  # [4, 4]
        other_camera: Intrinsics | None = None,  # the same camera by default
    ) -> Self:
        """Return the maps of a motion between two cameras."""
        other = other_camera or camera
        infinity = other.matrix @ other_from_this[:3, :3] @ np.linalg.inv(camera.matrix)
        epipole = other.matrix @ other_from_this[:3, 3]
        return cls(infinity.astype(np.float32), epipole.astype(np.float32))

    def project(
        self,
        inverse_depth: FloatArray,  # [H, W]
    ) -> tuple[FloatArray, FloatArray]:
        """Return pixels [H, W, 2] of the other frame, and depth there over depth here [H, W].

        Points behind the other camera, where this ratio is not positive, are mapped far outside.
        """
        q = np.asarray(inverse_depth, dtype=np.float32)
        height, width = q.shape
        u = np.arange(width, dtype=np.float32)
        v = np.arange(height, dtype=np.float32)[:, None]
        x, y, ratio = (
            a[0] * u + (a[1] * v + a[2]) + q * b
            for a, b in zip(self.infinity, self.epipole, strict=True)
        )
        z = np.maximum(ratio, np.float32(1e-3))
        pixels = cv2.merge((x / z, y / z))
        return pixels, ratio

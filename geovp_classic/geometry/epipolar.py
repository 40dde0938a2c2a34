"""Dense projection of one frame's pixels into another frame, and triangulation from there;
compiled.

A pixel (u, v, 1) with inverse depth q projects to A (u, v, 1) + q b, with A = K R K^-1 and b = K t,
the epipole (Hartley & Zisserman 2004, eq. 13.2): as q grows from 0 (infinity), it moves along its
epipolar line.
"""

from dataclasses import dataclass
from typing import Self

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, Intrinsics

IN_FRONT = 1e-3  # smallest z, relative to the ray
DAMPING = (
    1e-3  # squared pixels per unit of inverse depth: without parallax the result is infinitely far
)
_IN_FRONT, _DAMPING = np.float32(IN_FRONT), np.float32(DAMPING)


@dataclass(frozen=True)
class Epipolar:
    """The maps A and b that project this frame's pixels into the other frame."""

    infinity: FloatArray  # A [3, 3] float32
    epipole: FloatArray  # b [3] float32

    @classmethod
    def of(
        cls, camera: Intrinsics, other_from_this: FloatArray, other_camera: Intrinsics | None = None
    ) -> Self:
        """The geometry of a motion [4, 4]; the other camera is the same one unless it is given."""
        other = camera if other_camera is None else other_camera
        infinity = other.matrix @ other_from_this[:3, :3] @ np.linalg.inv(camera.matrix)
        return cls(
            infinity.astype(np.float32),
            (other_from_this[:3, 3] @ other.matrix.T).astype(np.float32),
        )

    def project(
        self,
        # [H, W] of this frame, or of every `stride_px`-th pixel of it each way
        inverse_depth: FloatArray,
        stride_px: int = 1,
    ) -> tuple[FloatArray, FloatArray]:
        """Pixels [H, W, 2] float32 of the other frame, and the depth there over the depth here [H,
        W].

        Points behind the other camera, where this ratio is not positive, are far outside.
        """
        q = np.ascontiguousarray(inverse_depth, dtype=np.float32)
        pixels, ratio = np.empty((*q.shape, 2), np.float32), np.empty(q.shape, np.float32)
        _project(self.infinity, self.epipole, q, np.float32(stride_px), pixels, ratio)
        return pixels, ratio

    def triangulate(
        self,
        pixels: FloatArray,  # [H, W, 2] float32 in the other frame, of all pixels of this one
    ) -> FloatArray:
        """The inverse depth [H, W] float32 that projects nearest to the pixels, by linear least
        squares.
        """
        inverse_depth = np.empty(pixels.shape[:2], np.float32)
        _triangulate(
            self.infinity,
            self.epipole,
            np.ascontiguousarray(pixels, dtype=np.float32),
            inverse_depth,
        )
        return inverse_depth


def inside(pixels: FloatArray, camera: Intrinsics, border_px: float = 0.0) -> BoolArray:
    """Which pixels [..., 2] lie in the image, up to `border_px` beyond the centres of its outermost
    pixels.
    """
    u, v = pixels[..., 0], pixels[..., 1]
    right, bottom = camera.width_px - 1 + border_px, camera.height_px - 1 + border_px
    return np.asarray((u >= -border_px) & (u <= right) & (v >= -border_px) & (v <= bottom))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _project(
    a: FloatArray,  # [3, 3] float32
    b: FloatArray,  # [3] float32
    inverse_depth: FloatArray,  # [H, W] float32
    stride_px: np.float32,
    pixels: FloatArray,  # [H, W, 2] float32, written
    ratio: FloatArray,  # [H, W] float32, written
) -> None:
    for row in range(inverse_depth.shape[0]):
        v = stride_px * np.float32(row)
        x0, y0, z0 = a[0, 1] * v + a[0, 2], a[1, 1] * v + a[1, 2], a[2, 1] * v + a[2, 2]
        for column in range(inverse_depth.shape[1]):
            u, q = stride_px * np.float32(column), inverse_depth[row, column]
            z = z0 + a[2, 0] * u + q * b[2]
            scale = np.float32(1) / max(z, _IN_FRONT)
            pixels[row, column, 0] = (x0 + a[0, 0] * u + q * b[0]) * scale
            pixels[row, column, 1] = (y0 + a[1, 0] * u + q * b[1]) * scale
            ratio[row, column] = z


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _triangulate(
    a: FloatArray, b: FloatArray, pixels: FloatArray, inverse_depth: FloatArray
) -> None:
    """The pixel p times z is x and y: (b_xy - p b_z) q = p a_z - a_xy."""
    for row in range(pixels.shape[0]):
        v = np.float32(row)
        x0, y0, z0 = a[0, 1] * v + a[0, 2], a[1, 1] * v + a[1, 2], a[2, 1] * v + a[2, 2]
        for column in range(pixels.shape[1]):
            u, p_u, p_v = np.float32(column), pixels[row, column, 0], pixels[row, column, 1]
            z = a[2, 0] * u + z0
            along_u, along_v = b[0] - p_u * b[2], b[1] - p_v * b[2]
            missing_u, missing_v = p_u * z - (a[0, 0] * u + x0), p_v * z - (a[1, 0] * u + y0)
            square = along_u * along_u + along_v * along_v + _DAMPING
            inverse_depth[row, column] = (along_u * missing_u + along_v * missing_v) / square

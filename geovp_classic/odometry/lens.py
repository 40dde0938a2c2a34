"""Pixels to rays and back for a lens that is not quite the pinhole it is said to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class Lens:
    """A camera with a little radial distortion left: ideal ray = seen ray * (1 + radial * |seen ray|^2)."""

    camera: Intrinsics
    radial: float = 0.0

    @property
    def focal_px(self) -> float:
        """One focal length for turning distances on z = 1 into pixels."""
        return float(np.sqrt(self.camera.fx_px * self.camera.fy_px))

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Ideal rays [..., 2] on the plane z = 1 of pixels [..., 2]."""
        return self._each(_rays, pixels, self.radial)

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Where ideal rays [..., 2] are seen [..., 2]; the inverse of `rays`, by three fixed-point steps."""
        return self._each(_pixels, rays, self.radial)

    def seen_rays(self, pixels: FloatArray) -> FloatArray:
        """Rays [..., 2] of pixels as a perfect pinhole would have them."""
        return self._each(_rays, pixels, 0.0)

    def _each(self, kernel: Callable[..., FloatArray], places: FloatArray, radial: float) -> FloatArray:
        camera, flat = self.camera, np.ascontiguousarray(places, dtype=np.float64).reshape(-1, 2)
        focal, centre = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        return kernel(flat, focal, centre, float(radial)).reshape(np.shape(places))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _rays(
    pixels: FloatArray,  # [N, 2]
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: float,
) -> FloatArray:
    """Rays [N, 2] of pixels."""
    rays = np.empty_like(pixels)
    for n in range(len(pixels)):
        x, y = (pixels[n, 0] - centre[0]) / focal[0], (pixels[n, 1] - centre[1]) / focal[1]
        stretch = 1 + radial * (x * x + y * y)
        rays[n, 0], rays[n, 1] = x * stretch, y * stretch
    return rays


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _pixels(
    rays: FloatArray,  # [N, 2]
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: float,
) -> FloatArray:
    """Pixels [N, 2] of rays."""
    pixels = np.empty_like(rays)
    for n in range(len(rays)):
        x, y = pixel(rays[n, 0], rays[n, 1], focal, centre, radial)
        pixels[n, 0], pixels[n, 1] = x, y
    return pixels


@numba.njit(nogil=True, cache=True, error_model="numpy")
def pixel(
    x: float, y: float, focal: tuple[float, float], centre: tuple[float, float], radial: float
) -> tuple[float, float]:
    """Where the ideal ray (x, y) is seen."""
    seen_x, seen_y = x, y
    for _ in range(3 if radial != 0 else 0):
        stretch = 1 + radial * (seen_x * seen_x + seen_y * seen_y)
        seen_x, seen_y = x / stretch, y / stretch
    return seen_x * focal[0] + centre[0], seen_y * focal[1] + centre[1]

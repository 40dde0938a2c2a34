"""Pixels to rays and back for a lens that is not quite the pinhole it is said to be."""

from __future__ import annotations

from dataclasses import dataclass

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
        seen = self.seen_rays(pixels)
        return seen if self.radial == 0 else seen * (1 + self.radial * (seen**2).sum(axis=-1, keepdims=True))

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Where ideal rays [..., 2] are seen [..., 2]; the inverse of `rays`, by three fixed-point steps."""
        seen = np.asarray(rays, dtype=np.float64)
        for _ in range(3 if self.radial else 0):
            seen = rays / (1 + self.radial * (seen**2).sum(axis=-1, keepdims=True))
        camera = self.camera
        pixels: FloatArray = seen * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
        return pixels

    def seen_rays(self, pixels: FloatArray) -> FloatArray:
        """Rays [..., 2] of pixels as a perfect pinhole would have them."""
        camera = self.camera
        return (np.asarray(pixels, dtype=np.float64) - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)

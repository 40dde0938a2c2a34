"""Pixels to rays and back for a camera with a little radial distortion."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class Lens:
    """A camera with a little radial distortion left: undistorted ray = distorted ray * (1 + radial
    * |its|^2).
    """

    camera: Intrinsics
    radial: float = 0.0

    @property
    def focal_px(self) -> float:
        """One focal length for turning distances on z = 1 into pixels."""
        return float(np.sqrt(self.camera.fx_px * self.camera.fy_px))

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Undistorted rays [..., 2] on the plane z = 1 of pixels [..., 2]."""
        return undistorted(self.distorted_rays(pixels), self.radial)

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Pixels [..., 2] of undistorted rays [..., 2]; the inverse of `rays`, by three fixed-point
        steps.
        """
        distorted, camera, pixels = rays, self.camera, np.empty(np.shape(rays))
        for _ in range(3 if self.radial else 0):
            distorted = rays / _stretch(distorted, self.radial)
        pixels[..., 0] = distorted[..., 0] * camera.fx_px + camera.cx_px
        pixels[..., 1] = distorted[..., 1] * camera.fy_px + camera.cy_px
        return pixels

    def distorted_rays(self, pixels: FloatArray) -> FloatArray:
        """Rays [..., 2] of pixels by the pinhole model alone."""
        camera, rays = self.camera, np.empty(np.shape(pixels))
        rays[..., 0] = (pixels[..., 0] - camera.cx_px) / camera.fx_px
        rays[..., 1] = (pixels[..., 1] - camera.cy_px) / camera.fy_px
        return rays


def undistorted(distorted: FloatArray, radial: float) -> FloatArray:
    """Undistorted rays [..., 2] of distorted ones [..., 2]."""
    return distorted * _stretch(distorted, radial)


def _stretch(distorted: FloatArray, radial: float) -> FloatArray:
    x, y = distorted[..., :1], distorted[..., 1:]
    return 1 + radial * (x * x + y * y)

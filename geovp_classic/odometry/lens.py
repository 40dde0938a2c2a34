"""Pinhole camera with a little radial distortion."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class Lens:
    """Camera whose undistorted ray is the distorted ray times 1 + radial * |distorted ray|^2."""

    camera: Intrinsics
    radial: float = 0.0

    @property
    def focal_px(self) -> float:
        """Return one focal length, which turns distances on z = 1 into pixels."""
        return float(np.sqrt(self.camera.fx_px * self.camera.fy_px))

    def distorted_rays(self, pixels: FloatArray) -> FloatArray:
        """Return the rays [..., 2] of pixels [..., 2] by the pinhole model alone."""
        return pinhole.unproject(pixels, 1.0, self.camera)[..., :2]

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return the undistorted rays [..., 2] of pixels [..., 2]."""
        return undistort(self.distorted_rays(pixels), self.radial)

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels [..., 2] of undistorted rays [..., 2], by fixed-point iteration."""
        distorted = rays
        for _ in range(3 if self.radial else 0):
            distorted = rays / _stretch(distorted, self.radial)
        return pinhole.project(homogeneous(distorted), self.camera)[0]


def undistort(distorted: FloatArray, radial: float) -> FloatArray:
    """Return undistorted rays [..., 2] of distorted ones."""
    return distorted * _stretch(distorted, radial)


def _stretch(distorted: FloatArray, radial: float) -> FloatArray:
    return 1 + radial * (distorted**2).sum(axis=-1, keepdims=True)

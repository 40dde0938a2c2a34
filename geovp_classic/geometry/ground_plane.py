"""The ground plane, fitted in inverse depth, where every plane is linear in the image."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.types import BoolArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class GroundPlane:
    """The plane normal . point = height in the camera's frame, y down."""

    normal: FloatArray  # [3], unit length, pointing down
    height: float  # of the camera above it, in the poses' unit
    # camera heights; farther ground need not be plane
    max_range_heights: float = 20.0

    def inverse_depth(self, camera: Intrinsics) -> FloatArray:
        """Return the inverse depth [H, W] float32 of the plane; negative above its horizon."""
        return (pinhole.rays(camera) @ self.normal / self.height).astype(
            np.float32
        )

    def is_near(
        self,
        inverse_depth: FloatArray,  # [...]
    ) -> BoolArray:
        """Return where points are within the range of the plane."""
        return inverse_depth * self.height * self.max_range_heights > 1


@dataclass(frozen=True)
class GroundFit:
    """RANSAC (Fischler & Bolles 1981) and least squares on the lower half of an image."""

    num_trials: int = 80
    stride_px: int = 4  # of the pixels that are used
    max_relative_error: float = 0.05  # of the inverse depth of an inlier
    min_inlier_fraction: float = 0.2  # of the lower half
    # between the plane's normal and the camera's y axis
    min_upright_cosine: float = 0.9
    # farther points draw the plane to the foot of upright objects
    max_range_heights: float = 20.0
    seed: int = 0

    def fit(
        self,
        inverse_depth: FloatArray,  # [H, W]
        camera: Intrinsics,
    ) -> GroundPlane | None:
        """Return the plane with most inliers; None without enough of them."""
        lower_half = np.s_[
            camera.height_px // 2 :: self.stride_px, :: self.stride_px
        ]
        rays = pinhole.rays(camera)[lower_half].reshape(-1, 3)
        values = inverse_depth[lower_half].ravel().astype(np.float64)
        planes = self._candidates(rays, values)
        if not len(planes):
            return None
        plane = planes[
            np.argmax(self._is_inlier(planes, rays, values).sum(axis=1))
        ]
        for _ in range(4):
            is_inlier = self._is_inlier(plane[None], rays, values)[0]
            weight = is_inlier / np.maximum(
                rays @ plane, 1e-12
            )  # for relative errors
            plane = np.linalg.lstsq(
                rays * weight[:, None], values * weight, rcond=None
            )[0]
        inlier_fraction = self._is_inlier(plane[None], rays, values).mean()
        if (
            not self._is_upright(plane[None])[0]
            or inlier_fraction < self.min_inlier_fraction
        ):
            return None
        inverse_height = float(np.linalg.norm(plane))
        return GroundPlane(
            plane / inverse_height, 1 / inverse_height, self.max_range_heights
        )

    def _candidates(self, rays: FloatArray, values: FloatArray) -> FloatArray:
        """Return upright planes [N, 3] through random triples of points, as normal / height."""
        rng = np.random.default_rng(self.seed)
        triples = rng.integers(0, len(values), (self.num_trials, 3))
        triples = triples[np.abs(np.linalg.det(rays[triples])) > 1e-6]
        planes = np.linalg.solve(rays[triples], values[triples][..., None])[
            ..., 0
        ]
        return planes[self._is_upright(planes)]

    def _is_upright(self, planes: FloatArray) -> BoolArray:
        """Return which planes [N, 3] lie below an upright camera."""
        inverse_heights = np.linalg.norm(planes, axis=1)
        return planes[:, 1] > np.maximum(
            self.min_upright_cosine * inverse_heights, 1e-12
        )

    def _is_inlier(
        self, planes: FloatArray, rays: FloatArray, values: FloatArray
    ) -> BoolArray:
        """Return which points [M] lie on which planes [N] and within their range: [N, M]."""
        expected = planes @ rays.T
        inverse_heights = np.linalg.norm(planes, axis=1, keepdims=True)
        is_near = expected * self.max_range_heights > inverse_heights
        is_close = (
            np.abs(expected - values) < self.max_relative_error * expected
        )
        return is_near & is_close

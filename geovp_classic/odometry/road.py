"""The road ahead as a plane, fitted by aligning two images of it.

A plane is the vector m = n / h [3] in the camera's frame: n its unit normal, pointing down, h the
camera's height, so that m . x = 1 for the points x of the plane. A ray r of the road hits it at
r / (m . r), and another camera observes it along R r + t (m . r), which is linear in m.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.geometry.robust import geman_mcclure_weight
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class RoadMeasurement:
    """Plane of the road [3], and the standard deviation of the logarithm of its height."""

    plane: FloatArray
    deviation: float


@dataclass(frozen=True)
class RoadAligner:
    """Search and direct alignment of the road in two images (Irani & Anandan 1999)."""

    # Part of the road that is used, in camera heights. Nearer, the hood or the image's end hides
    # it. Farther, a pitch of .25 degrees changes its distance by 4 % and more. The width is 2.8
    # heights, 4.6 m at KITTI's: a lane and its margins.
    min_distance: float = 2.5
    max_distance: float = 10.0
    half_width: float = 1.4
    # For three unknowns; more take more time, and neighbouring pixels say the same.
    max_samples: int = 1000
    search_stride: int = 3  # the search uses one sample of three
    # Of the samples, in the other image: else a correlation of few pixels is high by chance.
    min_visible_fraction: float = 0.5
    # A quarter of the variance of both images is common. For 300 independent samples, chance
    # exceeds .2 once in 3,700 planes.
    min_correlation: float = 0.5
    blur_px: float = 1.0  # of the images, against noise and aliasing of the far road
    # Window of the local mean that the search subtracts: ten times the blur to both sides
    mean_px: int = 21
    # Of the alignment: on 03[0, 60) of KITTI, the median is 2 and the maximum 4.
    max_rounds: int = 6
    # Relative length of the step that ends the alignment, a tenth of `GroundPlane.error`
    min_step: float = 0.005
    # Standard deviation of grey values, of sensor and compression
    grey_noise: float = 2.0
    # Scale of Geman and McClure's weights, in standard deviations of the differences: beyond two,
    # weights are below a quarter.
    robust_deviations: float = 2.0
    # Of a height's logarithm; above it the road has no texture. As large as `GroundPlane.error`.
    max_deviation: float = 0.05

    def blurred(self, grey: ByteArray) -> FloatArray:
        """Return the grey image [H, W] as float32, blurred."""
        return cv2.GaussianBlur(grey, (0, 0), self.blur_px).astype(np.float32)

    def samples(self, camera: Intrinsics, normal: FloatArray) -> FloatArray:
        """Return pixels [N, 2] of the road ahead, evenly spread over the image.

        The road's unit normal [3] in the camera points down.
        """
        # Pixels of the rows that may show it
        horizon = (1 / self.max_distance - normal[2]) / normal[1]  # on z = 1
        top = int(np.clip(camera.cy_px + camera.fy_px * horizon, 0, camera.height_px - 2))
        u = np.arange(2, camera.width_px - 2)
        v = np.arange(top, camera.height_px - 2)
        x = (u - camera.cx_px) / camera.fx_px
        y = (v[:, None] - camera.cy_px) / camera.fy_px
        inverse_depth = normal[0] * x + normal[1] * y + normal[2]
        # Those on the road: the ray r hits it at r / (m . r), with a height of 1
        is_road = np.abs(x) < self.half_width * inverse_depth
        is_road &= inverse_depth < 1 / self.min_distance
        is_road &= inverse_depth > 1 / self.max_distance
        rows, columns = np.nonzero(is_road)
        road = np.stack([u[columns], v[rows]], axis=1)
        # Every pixel of a coarser grid
        stride = max(1, int(np.ceil(np.sqrt(len(road) / self.max_samples))))
        return road[(road % stride == 0).all(axis=1)].astype(np.float64)

    def search(
        self,
        pair: RoadPair,
        pixels: FloatArray,  # [N, 2]
        planes: FloatArray,  # [M, 3]
    ) -> tuple[FloatArray, float]:
        """Return the plane [3] with the largest correlation, and that.

        The local mean is subtracted from the images, so that exposure does not matter.
        """
        size_px = (self.mean_px, self.mean_px)
        before, now = (image - cv2.blur(image, size_px) for image in (pair.before, pair.now))
        pixels = pixels[:: self.search_stride]
        rays = pinhole.unproject(pixels, 1.0, pair.camera)
        values = sample(now, pixels)
        correlations = self.correlation(before, values, pair, rays, planes)
        best = int(correlations.argmax())
        return planes[best], float(correlations[best])

    def align(
        self,
        pair: RoadPair,
        pixels: FloatArray,  # [N, 2] of the second image
        start: FloatArray,  # [3], with the expected pitch and roll
        tilt_rad: float,  # standard deviation of pitch and roll
    ) -> RoadMeasurement | None:
        """Return the plane near the start that aligns both images best.

        This is Gauss-Newton on the difference of grey values (Lucas & Kanade 1981), with
        Geman-McClure weights against other surfaces. The result is None if the road is not visible,
        has no texture, or looks different.
        """
        fields = np.stack([pair.before, *pinhole.gradient(pair.before)], axis=-1)
        target = sample(pair.now, pixels)
        rays = pinhole.unproject(pixels, 1.0, pair.camera)
        prior_information = _tilt_information(start, tilt_rad)
        plane = start
        for _ in range(self.max_rounds):
            # Differences of grey values, and their derivatives by the plane
            linear = self._linearise(pair, fields, target, rays, plane)
            if linear is None:
                return None
            difference, jacobian = linear
            # Robust weights; 1.4826 times the median deviation is a normal standard deviation
            spread = max(self.grey_noise, 1.4826 * float(np.median(np.abs(difference))))
            max_difference = self.robust_deviations * spread
            weight = geman_mcclure_weight(difference, max_difference) / spread**2
            # Eliminate the change of brightness (Schur complement of its normal equation)
            mean = weight @ jacobian / weight.sum()
            jacobian -= mean
            # Normal equations with the prior of pitch and roll
            information = jacobian.T * weight @ jacobian + prior_information
            gradient = jacobian.T * weight @ difference
            gradient += prior_information @ (plane - start)
            step = -np.linalg.solve(information, gradient)
            plane = plane + step
            if np.abs(step).max() < self.min_step * np.linalg.norm(plane):
                break
        # Deviation of log h = -log |m|, and the verdict whether this is a road
        covariance = np.linalg.inv(information)
        deviation = float(np.sqrt(plane @ covariance @ plane) / (plane @ plane))
        correlation = self.correlation(pair.before, target, pair, rays, plane)
        if deviation > self.max_deviation or correlation < self.min_correlation:
            return None
        return RoadMeasurement(plane, deviation)

    def correlation(
        self,
        before: FloatArray,  # [H, W] float32
        values: FloatArray,  # [N] grey values now
        pair: RoadPair,
        rays: FloatArray,  # [N, 3] of the values, z = 1
        planes: FloatArray,  # [..., 3] in the camera now
    ) -> FloatArray:
        """Return the normalised cross-correlations [...] of both images if the road is a plane.

        They are -1 where too little of the plane is visible in the other image.
        """
        _, pixels, visible = pair.project(rays, planes)
        values_before = sample(before, pixels)
        a = _normalised(np.broadcast_to(values, visible.shape), visible)
        b = _normalised(values_before, visible)
        is_visible = visible.mean(axis=-1) >= self.min_visible_fraction
        return np.where(is_visible, (a * b).sum(axis=-1), -1.0)

    def _linearise(
        self,
        pair: RoadPair,
        fields: FloatArray,  # [H, W, 3] float32: the image before and its derivatives
        target: FloatArray,  # [N] grey values now
        rays: FloatArray,  # [N, 3]
        plane: FloatArray,  # [3]
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the differences of visible grey values and their jacobian.

        The median difference is a change of brightness, and is subtracted. The result is None if
        too few samples are visible.
        """
        points, pixels, visible = pair.project(rays, plane)
        if visible.mean() < self.min_visible_fraction:
            return None
        x, y, depth = points[visible].T
        values, by_u, by_v = sample(fields, pixels[visible]).T
        camera = pair.camera
        translation = pair.before_from_now[:3, 3]
        # Derivative of the grey value by m . r, by which the point R r + t (m . r) moves
        slope = by_u * camera.fx_px * (translation[0] * depth - x * translation[2])
        slope += by_v * camera.fy_px * (translation[1] * depth - y * translation[2])
        jacobian = (slope / depth**2)[:, None] * rays[visible]
        difference = values - target[visible]
        return difference - np.median(difference), jacobian


@dataclass(frozen=True)
class RoadPair:
    """Two blurred images of the road and the motion between them."""

    before: FloatArray  # [H, W] float32
    now: FloatArray  # [H, W] float32
    before_from_now: FloatArray  # [4, 4]
    camera: Intrinsics

    def project(
        self,
        rays: FloatArray,  # [N, 3]
        planes: FloatArray,  # [..., 3]
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project the road into the camera before.

        Return its points [..., N, 3] over their depth in the camera now, their pixels [..., N, 2],
        and which are visible [..., N].
        """
        inverse_depth = planes @ rays.T
        translation = self.before_from_now[:3, 3]
        points = rays @ self.before_from_now[:3, :3].T
        points = points + inverse_depth[..., None] * translation
        pixels, depth = pinhole.project(points, self.camera)
        u, v = pixels[..., 0], pixels[..., 1]
        visible = (depth > 1e-3) & (u > 1) & (u < self.camera.width_px - 2)
        visible &= (v > 1) & (v < self.camera.height_px - 2)
        return points, pixels, visible


def _tilt_information(plane: FloatArray, tilt_rad: float) -> FloatArray:
    """Return the inverse covariance [3, 3] of a plane with an unknown height."""
    size2 = plane @ plane
    across = np.eye(3) - np.outer(plane, plane) / size2
    any_height = 1e-4 * np.eye(3)  # keeps it regular
    return (across / tilt_rad**2 + any_height) / size2


def level_plane(pitch_rad: float = 0.0, roll_rad: float = 0.0) -> FloatArray:
    """Return the plane m [3] at height 1 under a camera that looks up by the pitch.

    A positive roll turns the camera clockwise.
    """
    across = np.cos(pitch_rad)
    return np.array([across * np.sin(roll_rad), across * np.cos(roll_rad), -np.sin(pitch_rad)])


def sample(
    image: FloatArray,  # [H, W] or [H, W, C], float32
    pixels: FloatArray,  # [..., N, 2]
) -> FloatArray:
    """Return the values [..., N] or [..., N, C] of an image at pixels, bilinear."""
    num_pixels = pixels.shape[-2]  # OpenCV limits the columns of a map
    at = pixels.reshape(-1, num_pixels, 2).astype(np.float32)
    values = cv2.remap(image, at, None, cv2.INTER_LINEAR).astype(np.float64)
    return values.reshape(*pixels.shape[:-1], *image.shape[2:])


def _normalised(values: FloatArray, visible: BoolArray) -> FloatArray:
    """Return the visible values [..., N] with mean 0 and norm 1, zeros elsewhere."""
    count = np.maximum(visible.sum(axis=-1, keepdims=True), 1)
    mean = np.where(visible, values, 0.0).sum(axis=-1, keepdims=True) / count
    centred = np.where(visible, values - mean, 0.0)
    return centred / np.maximum(np.linalg.norm(centred, axis=-1, keepdims=True), 1e-3)

"""The road ahead as a plane, fitted by aligning two images of it.

A plane is the vector m = n / h [3] in the camera's frame: n its unit normal, pointing down, h the
camera's height, so that m . x = 1 for the points x of the plane. A ray r of the road hits it at
r / (m . r), and another camera observes it along R r + t (m . r), which is linear in m.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry.robust import geman_mcclure_weight
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.odometry.lens import Lens
from geovp_classic.types import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True)
class RoadAligner:
    """Direct alignment of two images of the road (Irani & Anandan 1999)."""

    # part of the road that is used, in camera heights
    min_distance: float = 2.5
    max_distance: float = 10.0
    half_width: float = 1.4
    max_samples: int = 1000
    min_visible_fraction: float = 0.5  # of the samples, in the other image
    # search: heights in lengths of the motion, and pitches around the expected one
    min_height: float = 0.15
    max_height: float = 40.0
    num_heights: int = 60
    pitches_deg: tuple[float, ...] = (0.0, -2.0, 2.0)
    sufficient_correlation: float = 0.85  # ends the search
    min_correlation: float = 0.5
    blur_px: float = 1.0  # of the images that are aligned
    grey_noise: float = 2.0  # standard deviation of grey values
    max_height_error: float = (
        0.05  # by the grey noise; above it the road has no texture
    )

    def samples(self, lens: Lens, normal: FloatArray) -> FloatArray:
        """Return pixels [N, 2] of the road ahead, evenly spread over the image.

        The road's unit normal [3] in the camera points down.
        """
        camera = lens.camera
        horizon = (1 / self.max_distance - normal[2]) / normal[1]  # on z = 1
        top = int(
            np.clip(
                camera.cy_px + camera.fy_px * horizon, 0, camera.height_px - 2
            )
        )
        rows, columns = np.mgrid[
            top : camera.height_px - 2, 2 : camera.width_px - 2
        ]
        pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
        rays = homogeneous(lens.rays(pixels))
        inverse_depth = np.maximum(rays @ normal, 1e-6)
        is_road = np.abs(rays[:, 0]) < self.half_width * inverse_depth
        is_road &= inverse_depth < 1 / self.min_distance
        is_road &= inverse_depth > 1 / self.max_distance
        road = pixels[is_road]
        stride = max(1, int(np.ceil(np.sqrt(len(road) / self.max_samples))))
        return road[(road % stride == 0).all(axis=1)].astype(np.float64)

    def correlation(
        self,
        before: FloatArray,  # [H, W] float32
        values: FloatArray,  # [N] grey values now
        before_from_now: FloatArray,  # [4, 4]
        lens: Lens,
        rays: FloatArray,  # [N, 3] of the values, z = 1
        planes: FloatArray,  # [..., 3] in the camera now
    ) -> FloatArray:
        """Return the normalised cross-correlations [...] of both images if the road is a plane.

        They are -1 where too little of the plane is visible in the other image.
        """
        _, pixels, visible = _project(lens, rays, before_from_now, planes)
        count = visible.sum(axis=-1)
        values_before = sample(before, pixels)
        a = _normalised(np.broadcast_to(values, visible.shape), visible)
        b = _normalised(values_before, visible)
        is_visible = count >= self.min_visible_fraction * len(rays)
        return np.where(is_visible, (a * b).sum(axis=-1), -1.0)

    def search(
        self,
        images: tuple[ByteArray, ByteArray],  # [H, W] each, before and now
        before_from_now: FloatArray,  # [4, 4]
        lens: Lens,
        pixels: FloatArray,  # [N, 2]
        pitch_rad: float,
        roll_rad: float,
    ) -> FloatArray | None:
        """Return the plane [3] with the largest correlation; None if it is low everywhere.

        The images are band-pass filtered, so that exposure does not matter.
        """
        before, now = (blur(grey, 1.5) - blur(grey, 6.0) for grey in images)
        values = sample(now, pixels)
        rays = homogeneous(lens.rays(pixels))
        heights = np.geomspace(
            self.min_height, self.max_height, self.num_heights
        )
        heights *= np.linalg.norm(before_from_now[:3, 3])
        best_plane = None
        best_correlation = self.min_correlation
        for offset_rad in np.radians(self.pitches_deg):
            planes = (
                level_plane(1.0, pitch_rad + offset_rad, roll_rad)
                / heights[:, None]
            )
            correlations = self.correlation(
                before, values, before_from_now, lens, rays, planes
            )
            best = int(correlations.argmax())
            if correlations[best] > best_correlation:
                best_plane = planes[best]
                best_correlation = float(correlations[best])
            if best_correlation > self.sufficient_correlation:
                break
        return best_plane

    def align(
        self,
        images: tuple[
            FloatArray, FloatArray
        ],  # [H, W] float32 each, before and now
        before_from_now: FloatArray,  # [4, 4]
        lens: Lens,
        pixels: FloatArray,  # [N, 2] of the second image
        prior: FloatArray,  # [3], the plane to start from
        prior_information: FloatArray,  # [3, 3], its inverse covariance
    ) -> FloatArray | None:
        """Return the plane [3] near the prior that aligns both images best.

        This is Gauss-Newton on the difference of grey values (Lucas & Kanade 1981), with
        Geman-McClure weights against other surfaces, and one offset for a change of brightness.
        The result is None if the road is not visible, has no texture, or looks different.
        """
        before, now = images
        target = sample(now, pixels)
        rays = homogeneous(lens.rays(pixels))
        slope_u = cv2.Scharr(before, cv2.CV_32F, 1, 0, scale=1 / 32)
        slope_v = cv2.Scharr(before, cv2.CV_32F, 0, 1, scale=1 / 32)
        fields = np.stack([before, slope_u, slope_v], axis=-1)
        translation = before_from_now[:3, 3]
        focal_px = (lens.camera.fx_px, lens.camera.fy_px)
        plane = prior
        for _ in range(6):
            points, pixels_before, visible = _project(
                lens, rays, before_from_now, plane
            )
            if visible.mean() < self.min_visible_fraction:
                return None
            x, y, depth = points[visible].T
            values, by_u, by_v = sample(fields, pixels_before[visible]).T
            # derivative of the grey value by m . r, without distortion
            slope = (
                by_u
                * focal_px[0]
                * (translation[0] * depth - x * translation[2])
            )
            slope += (
                by_v
                * focal_px[1]
                * (translation[1] * depth - y * translation[2])
            )
            jacobian = (slope / depth**2)[:, None] * rays[visible]
            difference = values - target[visible]
            difference -= np.median(difference)
            spread = max(
                self.grey_noise, 1.4826 * float(np.median(np.abs(difference)))
            )
            weight = geman_mcclure_weight(difference, 2 * spread) / spread**2
            jacobian -= (
                weight @ jacobian / weight.sum()
            )  # eliminates the offset
            information = jacobian.T * weight @ jacobian
            gradient = jacobian.T * weight @ difference + prior_information @ (
                plane - prior
            )
            step = -np.linalg.solve(information + prior_information, gradient)
            plane = plane + step
            if np.abs(step).max() < 5e-3 * np.linalg.norm(plane):
                break
        height_error = 1 / np.sqrt(
            max(float(plane @ information @ plane), 1e-12)
        )
        correlation = self.correlation(
            before, target, before_from_now, lens, rays, plane
        )
        if (
            height_error > self.max_height_error
            or correlation < self.min_correlation
        ):
            return None
        return plane


def level_plane(
    height: float, pitch_rad: float = 0.0, roll_rad: float = 0.0
) -> FloatArray:
    """Return the plane m [3] under a camera that looks up by the pitch.

    A positive roll turns the camera clockwise.
    """
    cos_pitch = np.cos(pitch_rad)
    normal = [
        cos_pitch * np.sin(roll_rad),
        cos_pitch * np.cos(roll_rad),
        -np.sin(pitch_rad),
    ]
    return np.array(normal) / height


def blur(grey: ByteArray, sigma_px: float) -> FloatArray:
    """Return the grey image [H, W] as float32, blurred."""
    return np.asarray(
        cv2.GaussianBlur(grey, (0, 0), sigma_px), dtype=np.float32
    )


def sample(
    image: FloatArray,  # [H, W] or [H, W, C], float32
    pixels: FloatArray,  # [..., N, 2]
) -> FloatArray:
    """Return the values [..., N] or [..., N, C] of an image at pixels, bilinear."""
    u, v = pixels.reshape(-1, 2).astype(np.float32).T
    values = np.asarray(
        cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.float64
    )
    return values.reshape(*pixels.shape[:-1], *image.shape[2:])


def _project(
    lens: Lens,
    rays: FloatArray,  # [N, 3]
    before_from_now: FloatArray,  # [4, 4]
    planes: FloatArray,  # [..., 3]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Project the road into the other camera.

    Return its points [..., N, 3] over their depth in this camera, their pixels [..., N, 2], and
    which are visible [..., N].
    """
    inverse_depth = planes @ rays.T
    points = (
        rays @ before_from_now[:3, :3].T
        + inverse_depth[..., None] * before_from_now[:3, 3]
    )
    in_front = points[..., 2] > 1e-3
    pixels = lens.pixels(
        points[..., :2] / np.where(in_front, points[..., 2], 1.0)[..., None]
    )
    last = (lens.camera.width_px - 2, lens.camera.height_px - 2)
    visible = in_front & ((pixels > 1) & (pixels < last)).all(axis=-1)
    return points, pixels, visible


def _normalised(values: FloatArray, visible: BoolArray) -> FloatArray:
    """Return the visible values [..., N] with mean 0 and norm 1, zeros elsewhere."""
    count = np.maximum(visible.sum(axis=-1, keepdims=True), 1)
    mean = np.where(visible, values, 0.0).sum(axis=-1, keepdims=True) / count
    centred = np.where(visible, values - mean, 0.0)
    return centred / np.maximum(
        np.linalg.norm(centred, axis=-1, keepdims=True), 1e-3
    )

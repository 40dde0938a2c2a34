"""The road ahead as a plane: aligning two images of it says how high the camera is above it.

A plane is the vector m = n / h [3] in the camera's frame: n its unit normal, pointing down, h the
camera's height, so that m . x = 1 for the points x of the plane. A ray r of the road then hits it
at r / (m . r), and is seen from another camera at R r + t (m . r), which is linear in m.
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from geovp_classic.geometry.robust import median
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.odometry.lens import Lens
from geovp_classic.types import ByteArray, FloatArray, IntArray, Intrinsics

NEAREST, FARTHEST, HALF_WIDTH = (
    2.5,
    10.0,
    1.4,
)  # the part of the road that is used, in camera heights
MAX_SAMPLES = 1000
NUM_ROUNDS = 6
MIN_VISIBLE_SHARE = 0.5  # of the samples, in the other image
GREY_NOISE = 2.0


@dataclass(frozen=True)
class RoadFit:
    """The plane by two images."""

    plane: FloatArray  # [3], m = n / h in the camera that the samples were taken from
    information: FloatArray  # [3, 3], inverse covariance of the plane
    correlation: float  # normalised cross-correlation of the two images of the road, 1 for the same


def level_plane(height: float, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> FloatArray:
    """The plane m [3] under a camera that looks `pitch_rad` above it and is rolled clockwise by
    `roll_rad`.
    """
    cos_p, sin_p = np.cos(pitch_rad), np.sin(pitch_rad)
    normal = np.array([cos_p * np.sin(roll_rad), cos_p * np.cos(roll_rad), -sin_p])
    return normal / height


def road_samples(
    lens: Lens,
    normal: FloatArray,  # [3], of the road in the camera, pointing down
) -> FloatArray:
    """Pixels [N, 2] that show the road right ahead, if it is free; evenly spread over the image."""
    camera = lens.camera
    highest = (1 / FARTHEST - normal[2] - HALF_WIDTH / NEAREST * abs(normal[0])) / normal[
        1
    ]  # on the plane z = 1
    top = int(np.clip(camera.cy_px + camera.fy_px * highest, 0, camera.height_px - 2))
    rows, columns = np.mgrid[top : camera.height_px - 2, 2 : camera.width_px - 2]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    rays = homogeneous(lens.rays(pixels))
    inverse_depth = np.maximum(rays @ normal, 1e-6)
    within = (inverse_depth < 1 / NEAREST) & (inverse_depth > 1 / FARTHEST)
    ahead = pixels[within & (np.abs(rays[:, 0]) < HALF_WIDTH * inverse_depth)]
    stride = max(1, int(np.ceil(np.sqrt(len(ahead) / MAX_SAMPLES))))
    return ahead[(ahead % stride == 0).all(axis=1)]


def correlation(
    before: FloatArray,  # [H, W] float32
    values: FloatArray,  # [N] grey values now
    before_from_now: FloatArray,  # [4, 4]
    lens: Lens,
    rays: FloatArray,  # [N, 3] of the values, z = 1
    plane: FloatArray,  # [3] in the camera now
) -> float:
    """Normalised cross-correlation of the road in both images, if it lies on this plane; -1 when it
    is not visible.
    """
    _, pixels_before, index = _project(lens, rays, before_from_now, plane)
    if len(index) < MIN_VISIBLE_SHARE * len(rays):
        return -1.0
    a, b = values[index].astype(np.float64), sample(before, pixels_before).astype(np.float64)
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 1e-6 else 0.0


def align(
    before: FloatArray,  # [H, W] float32
    now: FloatArray,  # [H, W] float32
    before_from_now: FloatArray,  # [4, 4]
    lens: Lens,
    pixels: FloatArray,  # [N, 2] of `now`
    prior: FloatArray,  # [3], the plane to start from
    prior_information: FloatArray,  # [3, 3], its inverse covariance
) -> RoadFit | None:
    """The plane near the prior that aligns both images of the road best; None when the road is not
    visible.

    Gauss-Newton on the difference of grey values (Lucas & Kanade 1981; the plane as parameter:
    Irani & Anandan 1999), with Geman-McClure weights against what is not road, and one offset for a
    change of brightness.
    """
    target, rays = sample(now, pixels), homogeneous(lens.rays(pixels))
    slopes = [
        cv2.Scharr(before, cv2.CV_32F, 1, 0, scale=1 / 32),
        cv2.Scharr(before, cv2.CV_32F, 0, 1, scale=1 / 32),
    ]
    fields = np.asarray(cv2.merge([before, *slopes]), dtype=np.float32)  # [H, W, 3]
    plane: FloatArray = prior
    information: FloatArray = np.zeros((3, 3))
    for _ in range(NUM_ROUNDS):
        points, pixels_before, index = _project(lens, rays, before_from_now, plane)
        if len(index) < MIN_VISIBLE_SHARE * len(pixels):
            return None
        by_plane = _pixel_jacobian(points, before_from_now[:3, 3], lens)
        values = sample(fields, pixels_before)
        jacobian = (values[:, 1] * by_plane[:, 0] + values[:, 2] * by_plane[:, 1])[:, None] * rays[
            index
        ]
        information, gradient = _normal_equations(values[:, 0] - target[index], jacobian)
        step = -np.linalg.solve(
            information + prior_information, gradient + prior_information @ (plane - prior)
        )
        plane = plane + step
        if np.abs(step).max() < 5e-3 * np.linalg.norm(plane):
            break
    return RoadFit(
        plane, information, correlation(before, target, before_from_now, lens, rays, plane)
    )


def road_window(
    pixels: FloatArray,  # [N, 2]
    camera: Intrinsics,
    margin_px: int = 24,
) -> tuple[slice, slice]:
    """The rows and columns of the image around the samples."""
    (left, top), (right, bottom) = pixels.min(axis=0).astype(int), pixels.max(axis=0).astype(int)
    rows = slice(max(0, top - margin_px), min(camera.height_px, bottom + margin_px))
    return rows, slice(max(0, left - margin_px), min(camera.width_px, right + margin_px))


def smoothed(grey: ByteArray, sigma_px: float) -> FloatArray:
    """The grey image [H, W] as float32, blurred."""
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma_px), dtype=np.float32)


def sample(
    image: FloatArray,  # [H, W] or [H, W, C], float32
    pixels: FloatArray,  # [N, 2]
) -> FloatArray:
    """Values [N] or [N, C] of an image at pixels, bilinear, float32."""
    u, v = pixels.astype(np.float32).T
    values = np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.float32)
    return values.reshape(len(pixels), *image.shape[2:])


def _project(
    lens: Lens,
    rays: FloatArray,  # [N, 3]
    before_from_now: FloatArray,  # [4, 4]
    plane: FloatArray,  # [3]
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The road's points in the other camera [M, 3], over their depth in this one, their pixels [M,
    2], and indices.
    """
    camera, count = lens.camera, len(rays)
    points, pixels, index = np.empty((count, 3)), np.empty((count, 2)), np.empty(count, np.int64)
    matrix = before_from_now[:3, :3] + np.outer(before_from_now[:3, 3], plane)
    focal, centre = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
    last = camera.width_px - 2.0, camera.height_px - 2.0
    count = _project_each(rays, matrix, focal, centre, lens.radial, last, points, pixels, index)
    return points[:count], pixels[:count], index[:count]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _project_each(
    rays: FloatArray,  # [N, 3]
    matrix: FloatArray,  # [3, 3]
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: float,
    last: tuple[float, float],  # pixels are to lie between 1 and this
    points: FloatArray,  # [N, 3], the first written
    pixels: FloatArray,  # [N, 2], the first written
    index: IntArray,  # [N], the first written
) -> int:
    """How many of the points are seen; `Lens.pixels` and matrix products on small arrays take six
    times as long.
    """
    count = 0
    for n in range(len(rays)):
        x, y, z = rays[n]
        point = points[count]
        for i in range(3):
            point[i] = matrix[i, 0] * x + matrix[i, 1] * y + matrix[i, 2] * z
        if not point[2] > 1e-3:
            continue
        ray_u, ray_v = point[0] / point[2], point[1] / point[2]
        u, v = ray_u, ray_v
        for _ in range(3 if radial != 0 else 0):
            stretch = 1 + radial * (u * u + v * v)
            u, v = ray_u / stretch, ray_v / stretch
        u, v = u * focal[0] + centre[0], v * focal[1] + centre[1]
        if u > 1 and v > 1 and u < last[0] and v < last[1]:
            pixels[count, 0], pixels[count, 1], index[count] = u, v, n
            count += 1
    return count


def _pixel_jacobian(points: FloatArray, translation: FloatArray, lens: Lens) -> FloatArray:
    """Derivatives [N, 2] by m . r of the pixels of points R r + t (m . r) [N, 3], distortion
    neglected.
    """
    depth = points[:, 2:]
    focal = (lens.camera.fx_px, lens.camera.fy_px)
    return focal * (translation[:2] * depth - points[:, :2] * translation[2]) / depth**2


def _normal_equations(
    difference: FloatArray,  # [N] grey values
    jacobian: FloatArray,  # [N, 3]
) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton's matrix [3, 3] and gradient [3], with robust weights and the brightness offset
    eliminated.
    """
    difference = difference.astype(np.float64)
    difference -= median(difference)
    spread = max(GREY_NOISE, 1.4826 * median(np.abs(difference)))
    weight = 1 / (1 + (difference / (2 * spread)) ** 2) ** 2
    jacobian = jacobian - weight @ jacobian / weight.sum()
    weighted = jacobian * weight[:, None] / spread**2
    return weighted.T @ jacobian, weighted.T @ difference

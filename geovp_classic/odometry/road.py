"""The road ahead as a plane: laying two images of it onto each other says how high the camera is above it.

A plane is the vector m = n / h [3] in the camera's frame: n its unit normal, pointing down, h the camera's height, so
that m . x = 1 for the points x of the plane. A ray r of the road then hits it at r / (m . r), and is seen from another
camera at R r + t (m . r), which is linear in m.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.odometry.lens import Lens, pixel
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

NEAREST, FARTHEST, HALF_WIDTH = 2.5, 10.0, 1.4  # the road that is looked at, in camera heights
MAX_SAMPLES = 1000
NUM_ROUNDS = 6
MIN_SHARE_SEEN = 0.5  # of the samples, in the other image
GREY_NOISE = 2.0


@dataclass(frozen=True)
class RoadFit:
    """What two images say about the plane."""

    plane: FloatArray  # [3], m = n / h in the camera that the samples were taken from
    information: FloatArray  # [3, 3], inverse covariance of the plane
    agreement: float  # normalised cross-correlation of the two images of the road, 1 for the same


def level_plane(height: float, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> FloatArray:
    """The plane m [3] under a camera that looks `pitch_rad` above it and is rolled clockwise by `roll_rad`."""
    cos_p, sin_p = np.cos(pitch_rad), np.sin(pitch_rad)
    normal = np.array([cos_p * np.sin(roll_rad), cos_p * np.cos(roll_rad), -sin_p])
    return normal / height


def road_samples(
    lens: Lens,
    normal: FloatArray,  # [3], of the road in the camera, pointing down
) -> FloatArray:
    """Pixels [N, 2] that show the road right ahead, if it is free; evenly spread over the image."""
    camera = lens.camera
    rows, columns = np.mgrid[max(0, int(camera.cy_px)) : camera.height_px - 2, 2 : camera.width_px - 2]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    ahead = pixels[_is_ahead(homogeneous(lens.rays(pixels)), normal)]
    stride = max(1, int(np.ceil(np.sqrt(len(ahead) / MAX_SAMPLES))))
    return ahead[(ahead % stride == 0).all(axis=1)]


def agreement(
    before: FloatArray,  # [H, W] float32
    now: FloatArray,  # [H, W] float32
    before_from_now: FloatArray,  # [4, 4]
    lens: Lens,
    pixels: FloatArray,  # [N, 2] of `now`
    plane: FloatArray,  # [3] in the camera `now`
) -> float:
    """Normalised cross-correlation of the road in both images, if it lies on this plane; -1 when out of sight."""
    there, index = _elsewhere(lens.rays(pixels), before_from_now, plane, *_numbers(lens))
    if len(index) < MIN_SHARE_SEEN * len(pixels):
        return -1.0
    return _correlation(_sample(now, pixels[index].astype(np.float32)), _sample(before, there))


def align(
    before: FloatArray,  # [H, W] float32
    now: FloatArray,  # [H, W] float32
    before_from_now: FloatArray,  # [4, 4]
    lens: Lens,
    pixels: FloatArray,  # [N, 2] of `now`
    plane: FloatArray,  # [3], where to start
    trust: FloatArray,  # [3, 3], inverse covariance of the start
) -> RoadFit | None:
    """The plane that makes both images of the road agree best, near a start; None when the road is out of sight.

    Gauss-Newton on the difference of grey values (Lucas & Kanade 1981; the plane as parameter: Irani & Anandan 1999),
    with Geman-McClure weights against what is not road, and one offset for a change of brightness.
    """
    rays, wanted = lens.rays(pixels), _sample(now, pixels.astype(np.float32))
    slopes = [cv2.Scharr(before, cv2.CV_32F, 1, 0, scale=1 / 32), cv2.Scharr(before, cv2.CV_32F, 0, 1, scale=1 / 32)]
    fields = np.asarray(cv2.merge([before, *slopes]), dtype=np.float32)  # [H, W, 3]
    start = plane
    information: FloatArray = np.zeros((3, 3))
    for _ in range(NUM_ROUNDS):
        there, index = _elsewhere(rays, before_from_now, plane, *_numbers(lens))
        if len(index) < MIN_SHARE_SEEN * len(pixels):
            return None
        speed = _speed(rays[index], before_from_now, plane, lens.camera.fx_px, lens.camera.fy_px)
        information, moment = _equations(rays[index], speed, _sample(fields, there), wanted[index])
        step = -np.linalg.solve(information + trust, moment + trust @ (plane - start))
        plane = plane + step
        if np.abs(step).max() < 1e-3 * np.linalg.norm(plane):
            break
    return RoadFit(plane, information, agreement(before, now, before_from_now, lens, pixels, plane))


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


def _is_ahead(rays: FloatArray, normal: FloatArray) -> BoolArray:
    below = rays @ normal
    depth = 1 / np.where(below > 1e-6, below, np.inf)
    inside: BoolArray = (depth > NEAREST) & (depth < FARTHEST) & (np.abs(rays[:, 0]) * depth < HALF_WIDTH)
    return inside


def _numbers(lens: Lens) -> tuple[tuple[float, float], tuple[float, float], float, tuple[int, int]]:
    """Focal lengths, principal point, `radial` and the image's size."""
    camera = lens.camera
    size_px = (camera.width_px, camera.height_px)
    return (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px), float(lens.radial), size_px


def _sample(
    image: FloatArray,  # [H, W] or [H, W, C], float32
    pixels: FloatArray,  # [N, 2], float32
) -> FloatArray:
    """Values [N] or [N, C] of an image between pixels, bilinear, float32."""
    values = np.asarray(cv2.remap(image, pixels[:, :1], pixels[:, 1:], cv2.INTER_LINEAR), dtype=np.float32)
    return values.reshape(len(pixels), *image.shape[2:])


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _elsewhere(
    rays: FloatArray,  # [N, 2]
    before_from_now: FloatArray,  # [4, 4]
    plane: FloatArray,  # [3]
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: float,
    size_px: tuple[int, int],
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Where the road's points on rays are seen by the other camera: pixels [M, 2] float32, and which are seen [M]."""
    there, index, count = np.empty((len(rays), 2), dtype=np.float32), np.empty(len(rays), dtype=np.int64), 0
    for n in range(len(rays)):
        x, y, z = _point(rays[n], before_from_now, plane)
        if not z > 1e-3:
            continue
        u, v = pixel(x / z, y / z, focal, centre, radial)
        if u > 1 and v > 1 and u < size_px[0] - 2 and v < size_px[1] - 2:
            there[count, 0], there[count, 1], index[count] = u, v, n
            count += 1
    return there[:count], index[:count]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _speed(
    rays: FloatArray,  # [N, 2]
    before_from_now: FloatArray,  # [4, 4]
    plane: FloatArray,  # [3]
    focal_x: float,
    focal_y: float,
) -> FloatArray:
    """Derivative [N, 2] of the pixels seen elsewhere by m . r."""
    speed = np.empty_like(rays)
    for n in range(len(rays)):
        x, y, z = _point(rays[n], before_from_now, plane)
        speed[n, 0] = focal_x * (before_from_now[0, 3] * z - x * before_from_now[2, 3]) / (z * z)
        speed[n, 1] = focal_y * (before_from_now[1, 3] * z - y * before_from_now[2, 3]) / (z * z)
    return speed


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _point(ray: FloatArray, pose: FloatArray, plane: FloatArray) -> tuple[float, float, float]:
    """The road's point on a ray (x, y) in the other camera, over its depth in this one."""
    below = ray[0] * plane[0] + ray[1] * plane[1] + plane[2]
    x = pose[0, 0] * ray[0] + pose[0, 1] * ray[1] + pose[0, 2] + below * pose[0, 3]
    y = pose[1, 0] * ray[0] + pose[1, 1] * ray[1] + pose[1, 2] + below * pose[1, 3]
    z = pose[2, 0] * ray[0] + pose[2, 1] * ray[1] + pose[2, 2] + below * pose[2, 3]
    return x, y, z


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _equations(
    rays: FloatArray,  # [N, 2]
    speed: FloatArray,  # [N, 2]
    values: FloatArray,  # [N, 3] of the other image: grey value and slopes
    wanted: FloatArray,  # [N]
) -> tuple[FloatArray, FloatArray]:
    """Second [3, 3] and first derivative [3] of half the weighted squared differences by the plane."""
    difference = values[:, 0].astype(np.float64) - wanted
    difference -= np.median(difference)
    spread = max(GREY_NOISE, 1.4826 * np.median(np.abs(difference)))
    weight, by_plane, total, mean = np.empty(len(rays)), np.empty((len(rays), 3)), 0.0, np.zeros(3)
    for n in range(len(rays)):
        weight[n] = 1 / (1 + (difference[n] / (2 * spread)) ** 2) ** 2
        along = values[n, 1] * speed[n, 0] + values[n, 2] * speed[n, 1]
        by_plane[n, 0], by_plane[n, 1], by_plane[n, 2] = along * rays[n, 0], along * rays[n, 1], along
        total += weight[n]
        mean += weight[n] * by_plane[n]
    information, moment = np.zeros((3, 3)), np.zeros(3)
    for n in range(len(rays)):
        for i in range(3):
            weighted = weight[n] * (by_plane[n, i] - mean[i] / total)
            moment[i] += weighted * difference[n]
            for j in range(3):
                information[i, j] += weighted * (by_plane[n, j] - mean[j] / total)
    return information / spread**2, moment / spread**2


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Normalised cross-correlation of values [N], 0 where one of them does not vary."""
    mean_a, mean_b = 0.0, 0.0
    for n in range(len(a)):
        mean_a += a[n] / len(a)
        mean_b += b[n] / len(a)
    square_a, square_b, mixed = 0.0, 0.0, 0.0
    for n in range(len(a)):
        square_a += (a[n] - mean_a) ** 2
        square_b += (b[n] - mean_b) ** 2
        mixed += (a[n] - mean_a) * (b[n] - mean_b)
    size = np.sqrt(square_a * square_b)
    return mixed / size if size > 1e-6 else 0.0

"""The road ahead as a plane: laying two pictures of it onto each other says how high the camera is above it.

A plane is the vector m = n / h [3] in the camera's frame: n its unit normal, pointing down, h the camera's height, so
that m . x = 1 for the points x of the plane. A ray r of the road then hits it at r / (m . r), and is seen from another
camera at R r + t (m . r), which is linear in m.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.poses.lens import Lens
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

NEAREST, FARTHEST, HALF_WIDTH = 2.5, 10.0, 1.4  # the road that is looked at, in camera heights
MAX_SAMPLES = 1000
NUM_ROUNDS = 6
MIN_SHARE_SEEN = 0.5  # of the samples, in the other picture
GREY_NOISE = 2.0


@dataclass(frozen=True)
class RoadFit:
    """What two pictures say about the plane."""

    plane: FloatArray  # [3], m = n / h in the camera that the samples were taken from
    information: FloatArray  # [3, 3], inverse covariance of the plane
    agreement: float  # normalised cross-correlation of the two pictures of the road, 1 for the same


def level_plane(height: float, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> FloatArray:
    """The plane m [3] under a camera that looks `pitch_rad` above it and is rolled clockwise by `roll_rad`."""
    cos_p, sin_p = np.cos(pitch_rad), np.sin(pitch_rad)
    normal = np.array([cos_p * np.sin(roll_rad), cos_p * np.cos(roll_rad), -sin_p])
    return normal / height


def road_samples(
    lens: Lens,
    normal: FloatArray,  # [3], of the road in the camera, pointing down
) -> FloatArray:
    """Pixels [N, 2] that show the road right ahead, if it is free; evenly spread over the picture."""
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
    """Normalised cross-correlation of the road in both pictures, if it lies on this plane; -1 when out of sight."""
    there, seen = _elsewhere(homogeneous(lens.rays(pixels)), before_from_now, lens, plane)
    if seen.mean() < MIN_SHARE_SEEN:
        return -1.0
    return _correlation(_sample(now, pixels[seen]), _sample(before, there[seen]))


def align(
    before: FloatArray,  # [H, W] float32
    now: FloatArray,  # [H, W] float32
    before_from_now: FloatArray,  # [4, 4]
    lens: Lens,
    pixels: FloatArray,  # [N, 2] of `now`
    plane: FloatArray,  # [3], where to start
    trust: FloatArray,  # [3, 3], inverse covariance of the start
) -> RoadFit | None:
    """The plane that makes both pictures of the road agree best, near a start; None when the road is out of sight.

    Gauss-Newton on the difference of grey values (Lucas & Kanade 1981; the plane as parameter: Irani & Anandan 1999),
    with Geman-McClure weights against what is not road, and one offset for a change of brightness.
    """
    rays, wanted = homogeneous(lens.rays(pixels)), _sample(now, pixels)
    slopes = [cv2.Scharr(before, cv2.CV_32F, 1, 0, scale=1 / 32), cv2.Scharr(before, cv2.CV_32F, 0, 1, scale=1 / 32)]
    fields = np.asarray(cv2.merge([before, *slopes]), dtype=np.float32)  # [H, W, 3]
    start, information = plane, np.zeros((3, 3))
    for _ in range(NUM_ROUNDS):
        there, seen = _elsewhere(rays, before_from_now, lens, plane)
        if seen.mean() < MIN_SHARE_SEEN:
            return None
        values = _sample(fields, there[seen])
        by_plane = (values[:, 1:] * _speed(rays[seen], before_from_now, lens, plane)).sum(axis=1)[:, None] * rays[seen]
        difference = values[:, 0] - wanted[seen]
        difference = difference - np.median(difference)
        spread = max(GREY_NOISE, 1.4826 * float(np.median(np.abs(difference))))
        weight = 1 / (1 + (difference / (2 * spread)) ** 2) ** 2
        by_plane = by_plane - weight @ by_plane / weight.sum()
        information = by_plane.T @ (weight[:, None] * by_plane) / spread**2
        moment = by_plane.T @ (weight * difference) / spread**2
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
    """The rows and columns of the picture around the samples."""
    (left, top), (right, bottom) = pixels.min(axis=0).astype(int), pixels.max(axis=0).astype(int)
    rows = slice(max(0, top - margin_px), min(camera.height_px, bottom + margin_px))
    return rows, slice(max(0, left - margin_px), min(camera.width_px, right + margin_px))


def smoothed(grey: ByteArray, sigma_px: float) -> FloatArray:
    """The grey picture [H, W] as float32, blurred."""
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma_px), dtype=np.float32)


def _is_ahead(rays: FloatArray, normal: FloatArray) -> BoolArray:
    below = rays @ normal
    depth = 1 / np.where(below > 1e-6, below, np.inf)
    inside: BoolArray = (depth > NEAREST) & (depth < FARTHEST) & (np.abs(rays[:, 0]) * depth < HALF_WIDTH)
    return inside


def _elsewhere(
    rays: FloatArray, before_from_now: FloatArray, lens: Lens, plane: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Where the road's points on rays [N, 3] are seen by the other camera: pixels [N, 2], and whether they are [N]."""
    points = rays @ before_from_now[:3, :3].T + (rays @ plane)[:, None] * before_from_now[:3, 3]
    front = points[:, 2] > 1e-3
    pixels = lens.pixels(points[:, :2] / np.where(front, points[:, 2], 1.0)[:, None])
    limit = (lens.camera.width_px - 2, lens.camera.height_px - 2)
    return pixels, front & (pixels > 1).all(axis=1) & (pixels < limit).all(axis=1)


def _speed(rays: FloatArray, before_from_now: FloatArray, lens: Lens, plane: FloatArray) -> FloatArray:
    """Derivative [N, 2] of the pixels seen elsewhere by m . r."""
    translation = before_from_now[:3, 3]
    points = rays @ before_from_now[:3, :3].T + (rays @ plane)[:, None] * translation
    across = translation[:2] * points[:, 2:] - points[:, :2] * translation[2]
    focal = np.array([lens.camera.fx_px, lens.camera.fy_px])
    speed: FloatArray = focal * across / points[:, 2:] ** 2
    return speed


def _sample(picture: FloatArray, pixels: FloatArray) -> FloatArray:
    """Values [N] or [N, C] of a picture [H, W] or [H, W, C] between pixels, bilinear."""
    at = pixels.astype(np.float32)
    values = np.asarray(cv2.remap(picture, at[:, :1], at[:, 1:], cv2.INTER_LINEAR), dtype=np.float64)
    return values.reshape(len(pixels), *picture.shape[2:])


def _correlation(a: FloatArray, b: FloatArray) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 1e-6 else 0.0

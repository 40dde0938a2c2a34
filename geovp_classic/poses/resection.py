"""Where a camera is that sees known points (resection, perspective-n-point), with wrong points among them."""

from __future__ import annotations

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray

INLIER = 5.0  # distance in standard deviations of the noise up to which a point agrees
MIN_SHARE_NEAR_GUESS = 0.6  # with fewer inliers than this from the guess, random samples are tried as well


def resect(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2] on the plane z = 1
    guess: FloatArray,  # cam_from_world [4, 4]
    noise: float,  # standard deviation of a ray's coordinates: pixels / focal length
    seed: int = 0,
) -> tuple[FloatArray, BoolArray]:
    """cam_from_world [4, 4] and the points that agree with it [N]; the guess and no inliers where there is no answer.

    Robust Gauss-Newton from the guess; when that convinces too few points, also from random samples (MAGSAC++ P3P).
    """
    if len(points) < 4:
        return guess, np.zeros(len(points), dtype=bool)
    best = polish(points, rays, guess, noise)
    if best[1].mean() >= MIN_SHARE_NEAR_GUESS:
        return best
    sampled = _from_samples(points, rays, INLIER * noise, seed)
    if sampled is not None:
        other = polish(points, rays, sampled, noise)
        if other[1].sum() > best[1].sum():
            return other
    return best


def polish(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2]
    cam_from_world: FloatArray,  # [4, 4]
    noise: float,
    num_rounds: int = 15,
) -> tuple[FloatArray, BoolArray]:
    """The pose with the smallest robust reprojection errors near the given one, and its inliers.

    Gauss-Newton with Cauchy weights whose kernel shrinks from the median error to the noise, by half or more a round.
    """
    kernel = np.inf
    for _ in range(num_rounds):
        cam = se3.transform(cam_from_world, points)
        front = cam[:, 2] > 1e-6
        inverse_depth = 1 / np.where(front, cam[:, 2], 1.0)
        seen = cam[:, :2] * inverse_depth[:, None]
        residual = seen - rays
        distance = np.where(front, np.linalg.norm(residual, axis=1), np.inf)
        kernel = max(noise, min(float(np.median(distance)), kernel / 2))
        weight = np.where(front, 1 / (1 + (distance / kernel) ** 2), 0.0)
        step, shift = _step(seen, inverse_depth, residual, weight)
        turn = np.asarray(cv2.Rodrigues(step[3:])[0], dtype=np.float64)
        cam_from_world = se3.compose(turn, step[:3]) @ cam_from_world
        if shift < noise / 50 and kernel == noise:
            break
    return cam_from_world, misses(points, rays, cam_from_world) < INLIER * noise


def misses(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [..., N, 2]
    cam_from_world: FloatArray,  # [..., 4, 4]
) -> FloatArray:
    """Distances [..., N] on z = 1 between rays and where points appear; inf for points behind, NaN for NaN."""
    cam = se3.transform(cam_from_world, points)
    front = cam[..., 2] > 1e-6
    difference = cam[..., :2] / np.where(front, cam[..., 2], 1.0)[..., None] - rays
    distance = np.sqrt((difference**2).sum(axis=-1))
    return np.where(~front & np.isfinite(distance), np.inf, distance)


def _step(
    seen: FloatArray, inverse_depth: FloatArray, residual: FloatArray, weight: FloatArray
) -> tuple[FloatArray, float]:
    """The translation and rotation [6] that lower the weighted squared residuals most, and the mean shift of rays."""
    x, y = seen.T
    zero = np.zeros_like(x)
    by_x = np.stack([inverse_depth, zero, -x * inverse_depth, -x * y, 1 + x * x, -y], axis=1)
    by_y = np.stack([zero, inverse_depth, -y * inverse_depth, -1 - y * y, x * y, x], axis=1)
    jacobian = np.concatenate([by_x, by_y])
    weighted = jacobian * np.concatenate([weight, weight])[:, None]
    normal, moment = weighted.T @ jacobian, weighted.T @ residual.T.ravel()
    damping = 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.eye(6)
    step = -np.linalg.solve(normal + damping, moment)
    if not np.isfinite(step).all():
        return np.zeros(6), 0.0
    return step, float(np.abs(jacobian @ step).mean())


def _from_samples(points: FloatArray, rays: FloatArray, threshold: float, seed: int) -> FloatArray | None:
    """A pose that many points agree with, by MAGSAC++ over random samples; None when there is none."""
    params = cv2.UsacParams()
    params.threshold, params.confidence, params.maxIterations = threshold, 0.999, 500
    params.score, params.randomGeneratorState, params.isParallel = cv2.SCORE_METHOD_MAGSAC, seed, False
    a, b = np.ascontiguousarray(points), np.ascontiguousarray(rays)
    try:
        found, _, turn, translation, _ = cv2.solvePnPRansac(a, b, np.eye(3), None, params=params)
    except cv2.error:  # degenerate samples only
        return None
    if not found or not (np.isfinite(turn).all() and np.isfinite(translation).all()):
        return None
    rotation = se3.exp(np.concatenate([np.zeros(3), np.ravel(turn)]))[:3, :3]
    return se3.compose(rotation, np.ravel(np.asarray(translation, dtype=np.float64)))

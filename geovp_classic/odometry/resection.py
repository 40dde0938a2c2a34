"""Where a camera is that sees known points (resection, perspective-n-point), with wrong points among them."""

from __future__ import annotations

import cv2
import numba
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
        normal, moment, kernel = _equations(points, rays, cam_from_world, kernel, noise)
        step = -np.linalg.solve(normal, moment)
        step = step if np.isfinite(step).all() else np.zeros(6)  # nothing tells
        turn = np.asarray(cv2.Rodrigues(step[3:])[0], dtype=np.float64)
        moved = se3.compose(turn, step[:3]) @ cam_from_world
        shift, cam_from_world = _mean_shift(points, cam_from_world, step), moved
        if shift < noise / 50 and kernel == noise:
            break
    return cam_from_world, misses(points, rays, cam_from_world) < INLIER * noise


def misses(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [..., N, 2]
    cam_from_world: FloatArray,  # [..., 4, 4]
) -> FloatArray:
    """Distances [..., N] on z = 1 between rays and where points appear; inf for points behind, NaN for NaN."""
    flat = np.ascontiguousarray(rays).reshape(-1, len(points), 2)
    return _misses(points, flat, cam_from_world.reshape(-1, 4, 4)).reshape(rays.shape[:-1])


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _misses(points: FloatArray, rays: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """See `misses`, with one leading axis: rays [K, N, 2], poses [K, 4, 4] to [K, N]."""
    distance = np.empty(rays.shape[:2])
    for k in range(len(rays)):
        for n in range(len(points)):
            x, y, _, front = _seen(points[n], cam_from_world[k])
            miss = np.sqrt((x - rays[k, n, 0]) ** 2 + (y - rays[k, n, 1]) ** 2)
            distance[k, n] = np.inf if not front and np.isfinite(miss) else miss
    return distance


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _equations(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2]
    cam_from_world: FloatArray,  # [4, 4]
    kernel: float,  # of the round before
    noise: float,
) -> tuple[FloatArray, FloatArray, float]:
    """Normal equations [6, 6], barely damped, and [6] of the weighted residuals by the pose, and the kernel."""
    distance = _misses(points, rays.reshape((1, -1, 2)), cam_from_world.reshape((1, 4, 4)))[0]
    kernel = max(noise, min(np.median(distance), kernel / 2))
    normal, moment, by_pose = np.zeros((6, 6)), np.zeros(6), np.empty((2, 6))
    for n in range(len(points)):
        x, y, inverse_depth, front = _seen(points[n], cam_from_world)
        if not front:
            continue
        _derivatives(x, y, inverse_depth, by_pose)
        weight = 1 / (1 + (distance[n] / kernel) ** 2)
        for axis in range(2):
            residual = x - rays[n, 0] if axis == 0 else y - rays[n, 1]
            for i in range(6):
                weighted = weight * by_pose[axis, i]
                moment[i] += weighted * residual
                for j in range(6):
                    normal[i, j] += weighted * by_pose[axis, j]
    for i in range(6):
        normal[i, i] += 1e-9 * normal[i, i] + 1e-12
    return normal, moment, kernel


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _mean_shift(points: FloatArray, cam_from_world: FloatArray, step: FloatArray) -> float:
    """How far a step [6] shifts the rays to the points [N, 3], in the mean over their coordinates."""
    total, by_pose = 0.0, np.empty((2, 6))
    for n in range(len(points)):
        x, y, inverse_depth, _ = _seen(points[n], cam_from_world)
        _derivatives(x, y, inverse_depth, by_pose)
        for axis in range(2):
            shift = 0.0
            for i in range(6):
                shift += by_pose[axis, i] * step[i]
            total += abs(shift)
    return total / (2 * len(points))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _seen(point: FloatArray, pose: FloatArray) -> tuple[float, float, float, bool]:
    """The point's ray (x, y), one over its depth, and whether it is in front; as if at depth 1 where it is not."""
    x = pose[0, 0] * point[0] + pose[0, 1] * point[1] + pose[0, 2] * point[2] + pose[0, 3]
    y = pose[1, 0] * point[0] + pose[1, 1] * point[1] + pose[1, 2] * point[2] + pose[1, 3]
    z = pose[2, 0] * point[0] + pose[2, 1] * point[1] + pose[2, 2] * point[2] + pose[2, 3]
    front = z > 1e-6
    inverse_depth = 1 / z if front else 1.0
    return x * inverse_depth, y * inverse_depth, inverse_depth, front


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _derivatives(x: float, y: float, inverse_depth: float, by_pose: FloatArray) -> None:
    """Of a ray by translation and rotation from the left, written into `by_pose` [2, 6]."""
    by_pose[0, 0], by_pose[0, 1], by_pose[0, 2] = inverse_depth, 0.0, -x * inverse_depth
    by_pose[0, 3], by_pose[0, 4], by_pose[0, 5] = -x * y, 1 + x * x, -y
    by_pose[1, 0], by_pose[1, 1], by_pose[1, 2] = 0.0, inverse_depth, -y * inverse_depth
    by_pose[1, 3], by_pose[1, 4], by_pose[1, 5] = -1 - y * y, x * y, x


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

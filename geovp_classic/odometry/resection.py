"""The pose of a camera that observes known points (resection, perspective-n-point), with outliers
among them.
"""

import cv2
import numba
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.robust import median
from geovp_classic.types import BoolArray, FloatArray

INLIER = 5.0  # largest error of an inlier, in standard deviations of the noise
MIN_INLIER_SHARE = (
    0.6  # with fewer inliers than this from the guess, random samples are tried as well
)


def resect(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2] on the plane z = 1
    guess: FloatArray,  # cam_from_world [4, 4]
    noise: float,  # standard deviation of a ray's coordinates: pixels / focal length
    seed: int = 0,
) -> tuple[FloatArray, BoolArray]:
    """cam_from_world [4, 4] and its inliers [N]; the guess and no inliers where there is no answer.

    Robust Gauss-Newton from the guess; when that has too few inliers, also from random samples
    (MAGSAC++ P3P).
    """
    if len(points) < 4:
        return guess, np.zeros(len(points), dtype=bool)
    best = refine_pose(points, rays, guess, noise)
    if best[1].mean() >= MIN_INLIER_SHARE:
        return best
    sampled = _from_samples(points, rays, INLIER * noise, seed)
    if sampled is not None:
        other = refine_pose(points, rays, sampled, noise)
        if other[1].sum() > best[1].sum():
            return other
    return best


def refine_pose(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2]
    cam_from_world: FloatArray,  # [4, 4]
    noise: float,
    num_rounds: int = 15,
) -> tuple[FloatArray, BoolArray]:
    """The pose with the smallest robust reprojection errors near the given one, and its inliers.

    Gauss-Newton with Cauchy weights whose kernel shrinks from the median error to the noise, by
    half or more a round. Several times as fast as pycolmap's `refine_absolute_pose`
    (benchmarks/performance/libraries.py).
    """
    kernel = np.inf
    for _ in range(num_rounds):
        normal, gradient, kernel = _normal_equations(points, rays, cam_from_world, kernel, noise)
        step = -np.linalg.solve(normal, gradient)
        step = step if np.isfinite(step).all() else np.zeros(6)  # no point constrains the pose
        rotation = np.asarray(cv2.Rodrigues(step[3:])[0], dtype=np.float64)
        cam_from_world = se3.compose(rotation, step[:3]) @ cam_from_world
        mean_shift = np.sqrt(step @ normal @ step / (2 * len(points)))
        if mean_shift < noise / 500 and kernel == noise:
            break
    return cam_from_world, reprojection_errors(points, rays, cam_from_world) < INLIER * noise


def reprojection_errors(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [..., N, 2]
    cam_from_world: FloatArray,  # [..., 4, 4]
) -> FloatArray:
    """Distances [..., N] on z = 1 between rays and projected points; inf for points behind, NaN for
    NaN.
    """
    points_cam = cam_from_world[..., :3, :3] @ points.T + cam_from_world[..., :3, 3:]  # [..., 3, N]
    x, y, z = points_cam[..., 0, :], points_cam[..., 1, :], points_cam[..., 2, :]
    in_front = z > 1e-6
    depth = np.where(in_front, z, 1.0)
    errors = np.sqrt((x / depth - rays[..., 0]) ** 2 + (y / depth - rays[..., 1]) ** 2)
    return np.where(in_front | np.isnan(errors), errors, np.inf)


def _normal_equations(
    points: FloatArray, rays: FloatArray, cam_from_world: FloatArray, kernel: float, noise: float
) -> tuple[FloatArray, FloatArray, float]:
    """Gauss-Newton's matrix [6, 6], barely damped, gradient [6] by translation and rotation, and
    the new kernel.
    """
    projected, errors = np.zeros((len(points), 3)), np.full(len(points), np.inf)
    _project(points, rays, cam_from_world, projected, errors)
    kernel = max(
        noise, min(median(errors), kernel / 2)
    )  # here, since a median takes long to compile
    normal, gradient, jacobian = np.zeros((6, 6)), np.zeros(6), np.zeros((2, 6))
    _add_to_normal_equations(projected, rays, errors, kernel, jacobian, normal, gradient)
    np.fill_diagonal(normal, (1 + 1e-9) * np.diag(normal) + 1e-12)
    return normal, gradient, kernel


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _project(
    points: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2]
    p: FloatArray,  # cam_from_world [4, 4]
    projected: FloatArray,  # [N, 3], written for points in front: x and y on z = 1, inverse depth
    errors: FloatArray,  # [N], written for points in front
) -> None:
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
        if depth > 1e-6:
            projected[n, 0] = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / depth
            projected[n, 1] = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / depth
            projected[n, 2] = 1 / depth
            errors[n] = np.hypot(projected[n, 0] - rays[n, 0], projected[n, 1] - rays[n, 1])


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add_to_normal_equations(
    projected: FloatArray,  # [N, 3]
    rays: FloatArray,  # [N, 2]
    errors: FloatArray,  # [N]
    kernel: float,
    jacobian: FloatArray,  # [2, 6], zeros, changed
    normal: FloatArray,  # [6, 6], added to
    gradient: FloatArray,  # [6] by translation and rotation, added to
) -> None:
    """Gauss-Newton's, with Cauchy weights."""
    for n in range(len(projected)):
        x, y, inverse_depth = projected[n, 0], projected[n, 1], projected[n, 2]
        jacobian[0, 0], jacobian[0, 2] = inverse_depth, -x * inverse_depth
        jacobian[1, 1], jacobian[1, 2] = inverse_depth, -y * inverse_depth
        jacobian[0, 3], jacobian[0, 4], jacobian[0, 5] = -x * y, 1 + x * x, -y
        jacobian[1, 3], jacobian[1, 4], jacobian[1, 5] = -1 - y * y, x * y, x
        weight = 1 / (1 + (errors[n] / kernel) ** 2)  # 0 behind the camera
        for axis in range(2):
            residual = projected[n, axis] - rays[n, axis]
            for i in range(6):
                weighted = weight * jacobian[axis, i]
                gradient[i] += weighted * residual
                for j in range(6):
                    normal[i, j] += weighted * jacobian[axis, j]


def _from_samples(
    points: FloatArray, rays: FloatArray, threshold: float, seed: int
) -> FloatArray | None:
    """A pose with many inliers, by MAGSAC++ over random samples; None when there is none."""
    params = cv2.UsacParams()
    params.threshold, params.confidence, params.maxIterations = threshold, 0.999, 500
    params.score, params.randomGeneratorState, params.isParallel = (
        cv2.SCORE_METHOD_MAGSAC,
        seed,
        False,
    )
    a, b = np.ascontiguousarray(points), np.ascontiguousarray(rays)
    try:
        found, _, rotation_vector, translation, _ = cv2.solvePnPRansac(
            a, b, np.eye(3), None, params=params
        )
    except cv2.error:  # degenerate samples only
        return None
    if not found or not (np.isfinite(rotation_vector).all() and np.isfinite(translation).all()):
        return None
    rotation = np.asarray(cv2.Rodrigues(rotation_vector)[0], dtype=np.float64)
    return se3.compose(rotation, np.ravel(np.asarray(translation, dtype=np.float64)))

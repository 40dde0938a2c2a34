"""How a camera moved between two images, from points seen in both; and how deep those points are.

Rays are [..., 2] = (x, y) on the plane z = 1 of the camera that saw them. The essential matrix maps a ray of camera a
to its epipolar line in camera b: E = [t]x R with b_from_a = (R, t).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numba
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray

MIN_POINTS = 8
SHARE_EXPLAINED = 0.7  # of the points, for "still" and "rotation"; the rest may be traffic
INLIER = 3.0  # distance from its epipolar line, in standard deviations of the noise, up to which a point agrees
MIN_INLIER_SHARE = 0.4
MIN_CHEIRALITY_SHARE = 0.6

Kind = Literal["unknown", "still", "rotation", "general"]


@dataclass(frozen=True)
class TwoView:
    """The motion between two images, as far as points tell."""

    kind: Kind
    b_from_a: FloatArray  # [4, 4]; the translation has length 1 when `kind` is "general", else 0
    inliers: BoolArray  # [N]; the points that agree
    parallax: float  # median shift on z = 1 that the rotation leaves unexplained


def two_view(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    noise: float,  # standard deviation of a ray's coordinates: pixels / focal length
    seed: int = 0,
) -> TwoView:
    """The simplest motion that explains the points: none, a rotation, or one with a translation of unknown length.

    "unknown" (the identity, no inliers) when there are too few points or no motion that most of them share.
    """
    if len(rays_a) < MIN_POINTS:
        return _unknown(len(rays_a))
    shift = np.linalg.norm(rays_b - rays_a, axis=1)
    if (shift < INLIER * noise).mean() >= SHARE_EXPLAINED:
        return TwoView("still", np.eye(4), shift < INLIER * noise, float(np.median(shift)))
    rotation = best_rotation(rays_a, rays_b, noise)
    shift = np.linalg.norm(rotate_rays(rotation, rays_a) - rays_b, axis=1)
    if (shift < INLIER * noise).mean() >= SHARE_EXPLAINED:
        b_from_a = se3.compose(rotation, np.zeros(3))
        return TwoView("rotation", b_from_a, shift < INLIER * noise, float(np.median(shift)))
    return _general(rays_a, rays_b, noise, seed)


def rotate_rays(rotation: FloatArray, rays: FloatArray) -> FloatArray:
    """Rays [N, 2] as a camera turned by `rotation` [3, 3] sees them; NaN when they leave its front."""
    turned = homogeneous(rays) @ rotation.T
    depth = np.where(turned[:, 2] > 1e-6, turned[:, 2], np.nan)
    return turned[:, :2] / depth[:, None]


def homogeneous(rays: FloatArray) -> FloatArray:
    """(x, y) [..., 2] as (x, y, 1) [..., 3]."""
    return np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)


def best_rotation(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    noise: float,
    num_rounds: int = 12,
) -> FloatArray:
    """b_from_a [3, 3] that turns most rays onto each other: Wahba's problem by SVD, reweighted (Geman-McClure).

    The kernel shrinks from the median residual to `noise`, so that a minority of wrong rays loses its say.
    """
    a, b = homogeneous(rays_a), homogeneous(rays_b)
    a, b = a / np.linalg.norm(a, axis=1, keepdims=True), b / np.linalg.norm(b, axis=1, keepdims=True)
    weight, rotation = np.ones(len(a)), np.eye(3)
    for _ in range(num_rounds):
        u, _, vt = np.linalg.svd((b * weight[:, None]).T @ a)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
        residual = np.linalg.norm(a @ rotation.T - b, axis=1)
        kernel = max(noise, float(np.median(residual)))
        weight = 1 / (1 + (residual / kernel) ** 2) ** 2
    return rotation


def sampson(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4]
) -> FloatArray:
    """First-order distance [N] on z = 1 of each pair from the epipolar geometry (Sampson; Hartley & Zisserman 11.4)."""
    essential = se3.cross_matrix(b_from_a[:3, 3]) @ b_from_a[:3, :3]
    a, b = homogeneous(rays_a), homogeneous(rays_b)
    line_b, line_a = a @ essential.T, b @ essential
    gradient = np.sqrt(line_a[:, 0] ** 2 + line_a[:, 1] ** 2 + line_b[:, 0] ** 2 + line_b[:, 1] ** 2)
    distance: FloatArray = (b * line_b).sum(axis=1) / np.maximum(gradient, 1e-12)
    return distance


def refine(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4], |t| = 1
    noise: float,
    num_rounds: int = 8,
    enough: float = 1e-8,  # a step below which no round follows
) -> FloatArray:
    """b_from_a with the smallest robust Sampson distances: Gauss-Newton over rotation and direction, Cauchy weights."""
    a, b = np.ascontiguousarray(rays_a), np.ascontiguousarray(rays_b)
    for _ in range(num_rounds):
        rotation, direction = b_from_a[:3, :3], b_from_a[:3, 3]
        across = np.linalg.svd(direction[None])[2][1:]  # [2, 3], two directions square to t
        normal, moment = _equations(a, b, b_from_a, across, noise)
        step = -np.linalg.solve(normal + 1e-9 * np.eye(5), moment)
        direction = direction + step[3:] @ across
        turn = se3.exp(np.concatenate([np.zeros(3), step[:3]]))[:3, :3]
        b_from_a = se3.compose(turn @ rotation, direction / np.linalg.norm(direction))
        if np.abs(step).max() < enough:
            break
    return b_from_a


@numba.njit(nogil=True, cache=True, error_model="numpy")
def essential_of(b_from_a: FloatArray) -> FloatArray:
    """E = [t]x R [3, 3]."""
    matrix = np.empty((3, 3))
    for i, k, m in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        for j in range(3):
            matrix[i, j] = b_from_a[k, 3] * b_from_a[m, j] - b_from_a[m, 3] * b_from_a[k, j]
    return matrix


@numba.njit(nogil=True, cache=True, error_model="numpy")
def product(matrix: FloatArray, x: float, y: float) -> tuple[float, float, float]:
    """The matrix [3, 3] times (x, y, 1); compiled, like `essential_of`, for the loops of others, too."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2],
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2],
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2],
    )


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _equations(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4]
    across: FloatArray,  # [2, 3]
    noise: float,
) -> tuple[FloatArray, FloatArray]:
    """Second [5, 5] and first derivative [5] of half the weighted squared distances, by rotation and direction."""
    r, e, t = b_from_a[:3, :3], essential_of(b_from_a), b_from_a[:3, 3]
    normal, moment, slope = np.zeros((5, 5)), np.zeros(5), np.empty(5)
    for n in range(len(rays_a)):
        ax, ay, bx, by = rays_a[n, 0], rays_a[n, 1], rays_b[n, 0], rays_b[n, 1]
        x, y, z = product(r, ax, ay)
        line_x, line_y, line_z = product(e, ax, ay)
        back_x, back_y = bx * e[0, 0] + by * e[1, 0] + e[2, 0], bx * e[0, 1] + by * e[1, 1] + e[2, 1]
        gradient = np.sqrt(line_x**2 + line_y**2 + back_x**2 + back_y**2) + 1e-12
        residual = (bx * line_x + by * line_y + line_z) / gradient
        # b . (t x (w x Ra)) = w . (Ra x (b x t)) and b . (dt x Ra) = dt . (Ra x b)
        u, v, w = by * t[2] - t[1], t[0] - bx * t[2], bx * t[1] - by * t[0]
        slope[0], slope[1], slope[2] = y * w - z * v, z * u - x * w, x * v - y * u
        u, v, w = y - z * by, z * bx - x, x * by - y * bx
        slope[3] = u * across[0, 0] + v * across[0, 1] + w * across[0, 2]
        slope[4] = u * across[1, 0] + v * across[1, 1] + w * across[1, 2]
        weight = 1 / (1 + (residual / noise) ** 2)
        for i in range(5):
            weighted = weight * slope[i] / gradient
            moment[i] += weighted * residual
            for j in range(5):
                normal[i, j] += weighted * slope[j] / gradient
    return normal, moment


def decompose(essential: FloatArray) -> FloatArray:
    """The four b_from_a [4, 4, 4] of an essential matrix, rotations proper, |t| = 1 (Hartley & Zisserman 9.14)."""
    u, _, vt = np.linalg.svd(essential)
    u, vt = u * np.sign(np.linalg.det(u)), vt * np.sign(np.linalg.det(vt))
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations = [u @ quarter @ vt, u @ quarter.T @ vt]
    return np.stack([se3.compose(r, sign * u[:, 2]) for r in rotations for sign in (1.0, -1.0)])


def depths(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4]
) -> tuple[FloatArray, FloatArray]:
    """z-depths [N] in a and in b of the points where two rays pass nearest; unbounded where they are parallel."""
    d, e = homogeneous(rays_a) @ b_from_a[:3, :3].T, homogeneous(rays_b)
    dd, ee, de = (d * d).sum(axis=1), (e * e).sum(axis=1), (d * e).sum(axis=1)
    dt, et = d @ b_from_a[:3, 3], e @ b_from_a[:3, 3]
    determinant = np.maximum(dd * ee - de**2, 1e-15)
    return (de * et - ee * dt) / determinant, (dd * et - de * dt) / determinant


def _general(rays_a: FloatArray, rays_b: FloatArray, noise: float, seed: int) -> TwoView:
    """MAGSAC++ essential matrix, cheirality by counting, then all inliers' say."""
    essential = _magsac(rays_a, rays_b, INLIER * noise, seed)
    if essential is None:
        return _unknown(len(rays_a))
    candidates = decompose(essential)
    fits = np.abs(sampson(rays_a, rays_b, candidates[0])) < INLIER * noise
    in_front = [_in_front(rays_a, rays_b, candidate, noise) & fits for candidate in candidates]
    best = max(range(4), key=lambda i: in_front[i].sum())
    if fits.mean() < MIN_INLIER_SHARE or in_front[best].sum() < max(MIN_POINTS, MIN_CHEIRALITY_SHARE * fits.sum()):
        return _unknown(len(rays_a))
    b_from_a = refine(rays_a[fits], rays_b[fits], candidates[best], noise)
    inliers = np.abs(sampson(rays_a, rays_b, b_from_a)) < INLIER * noise
    inliers &= _in_front(rays_a, rays_b, b_from_a, noise)
    shift = np.linalg.norm(rotate_rays(b_from_a[:3, :3], rays_a) - rays_b, axis=1)
    return TwoView("general", b_from_a, inliers, float(np.median(shift[inliers])) if inliers.any() else 0.0)


def _magsac(rays_a: FloatArray, rays_b: FloatArray, threshold: float, seed: int) -> FloatArray | None:
    """The essential matrix by MAGSAC++ (Barath 2020) with a random state of its own; None when there is none."""
    params = cv2.UsacParams()
    params.threshold, params.confidence, params.maxIterations = threshold, 0.9999, 1000
    params.score, params.loMethod = cv2.SCORE_METHOD_MAGSAC, cv2.LOCAL_OPTIM_SIGMA
    params.randomGeneratorState, params.isParallel = seed, False
    a, b, k = np.ascontiguousarray(rays_a), np.ascontiguousarray(rays_b), np.eye(3)
    try:
        essential, _ = cv2.findEssentialMat(a, b, k, k, None, None, params)
    except cv2.error:  # degenerate samples only
        return None
    if essential is None or essential.shape[0] < 3 or not np.isfinite(essential[:3]).all():
        return None
    return np.asarray(essential[:3], dtype=np.float64)


def _in_front(rays_a: FloatArray, rays_b: FloatArray, b_from_a: FloatArray, noise: float) -> BoolArray:
    """Points [N] in front of both cameras; rays that are parallel within the noise count as far, not as behind."""
    depth_a, depth_b = depths(rays_a, rays_b, b_from_a)
    parallel = np.linalg.norm(rotate_rays(b_from_a[:3, :3], rays_a) - rays_b, axis=1) < INLIER * noise
    in_front: BoolArray = parallel | ((depth_a > 0) & (depth_b > 0))
    return in_front


def _unknown(count: int) -> TwoView:
    return TwoView("unknown", np.eye(4), np.zeros(count, dtype=bool), 0.0)

"""The motion of a camera between two images, from points observed in both.

Rays are [..., 2] = (x, y) on the plane z = 1 of the camera that observes them. The essential matrix
maps a ray of camera a to its epipolar line in camera b: E = [t]x R with b_from_a = (R, t).
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.geometry import se3
from geovp_classic.geometry.robust import median
from geovp_classic.types import BoolArray, FloatArray

MIN_POINTS = 8
MIN_STATIC_SHARE = 0.7  # inliers needed for "still" and "rotation"; the rest may be moving objects
INLIER = 3.0  # largest distance of an inlier, in standard deviations of the noise
MIN_INLIER_SHARE = 0.4
MIN_CHEIRALITY_SHARE = 0.6

Kind = Literal["unknown", "still", "rotation", "general"]


@dataclass(frozen=True)
class TwoView:
    """The motion between two images."""

    kind: Kind
    b_from_a: FloatArray  # [4, 4]; the translation has length 1 when `kind` is "general", else 0
    inliers: BoolArray  # [N]
    parallax: float  # median shift on z = 1 after the rotation is taken out


def two_view(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    noise: float,  # standard deviation of a ray's coordinates: pixels / focal length
    seed: int = 0,
) -> TwoView:
    """The simplest motion that explains the points: none, a rotation, or one with a translation of
    unknown length.

    "unknown" (the identity, no inliers) when there are too few points or no motion that most of
    them share.
    """
    if len(rays_a) < MIN_POINTS:
        return _unknown(len(rays_a))
    shift = np.linalg.norm(rays_b - rays_a, axis=1)
    if (shift < INLIER * noise).mean() >= MIN_STATIC_SHARE:
        return TwoView("still", np.eye(4), shift < INLIER * noise, median(shift))
    rotation = best_rotation(rays_a, rays_b, noise)
    shift = np.linalg.norm(rotate_rays(rotation, rays_a) - rays_b, axis=1)
    if (shift < INLIER * noise).mean() >= MIN_STATIC_SHARE:
        b_from_a = se3.compose(rotation, np.zeros(3))
        return TwoView("rotation", b_from_a, shift < INLIER * noise, median(shift))
    return _general(rays_a, rays_b, noise, seed)


def rotate_rays(rotation: FloatArray, rays: FloatArray) -> FloatArray:
    """Rays [N, 2] after the rotation [3, 3] of their directions; NaN where they point backwards."""
    rotated = homogeneous(rays) @ rotation.T
    depth = np.where(rotated[:, 2] > 1e-6, rotated[:, 2], np.nan)
    return rotated[:, :2] / depth[:, None]


def homogeneous(rays: FloatArray) -> FloatArray:
    """(x, y) [..., 2] as (x, y, 1) [..., 3]."""
    return np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)


def best_rotation(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    noise: float,
    num_rounds: int = 12,
) -> FloatArray:
    """b_from_a [3, 3] that aligns most rays: Wahba's problem, reweighted (Geman-McClure).

    The kernel shrinks from the median residual to `noise`, so that a minority of outliers loses its
    weight.
    """
    a, b = homogeneous(rays_a), homogeneous(rays_b)
    a, b = (
        a / np.linalg.norm(a, axis=1, keepdims=True),
        b / np.linalg.norm(b, axis=1, keepdims=True),
    )
    weight, rotation = np.ones(len(a)), np.eye(3)
    for _ in range(num_rounds):
        rotation = np.asarray(Rotation.align_vectors(b, a, weight)[0].as_matrix())
        residual = np.linalg.norm(a @ rotation.T - b, axis=1)
        kernel = max(noise, median(residual))
        weight = 1 / (1 + (residual / kernel) ** 2) ** 2
    return rotation


@dataclass(frozen=True)
class SampsonTerms:
    """Sampson distances and what their derivatives are made of, for N pairs of rays."""

    distance: FloatArray  # [N] on z = 1, signed
    by_motion: FloatArray  # [N, 5], by a rotation vector of b and by steps along `tangent`
    gradient: (
        FloatArray  # [N], norm of the algebraic distance's derivatives by the four coordinates
    )
    line_a: FloatArray  # [N, 3], epipolar lines in a
    line_b: FloatArray  # [N, 3], epipolar lines in b
    tangent: FloatArray  # [2, 3], unit vectors orthogonal to the translation


def sampson_terms(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4]
) -> SampsonTerms:
    """First-order distances from the epipolar geometry (Sampson; Hartley & Zisserman 11.4) and
    their derivatives.
    """
    a, b, rotation, translation = (
        homogeneous(rays_a),
        homogeneous(rays_b),
        b_from_a[:3, :3],
        b_from_a[:3, 3],
    )
    rotated, essential = a @ rotation.T, se3.cross_matrix(translation) @ rotation
    line_b, line_a = a @ essential.T, b @ essential
    gradient = np.sqrt((line_a[:, :2] ** 2).sum(axis=1) + (line_b[:, :2] ** 2).sum(axis=1)) + 1e-12
    tangent = np.linalg.svd(translation[None])[2][1:]
    by_rotation = np.cross(
        rotated, np.cross(b, translation)
    )  # b . (t x (w x Ra)) = w . (Ra x (b x t))
    by_direction = np.cross(rotated, b) @ tangent.T  # b . (dt x Ra) = dt . (Ra x b)
    by_motion = np.concatenate([by_rotation, by_direction], axis=1) / gradient[:, None]
    return SampsonTerms(
        (b * line_b).sum(axis=1) / gradient, by_motion, gradient, line_a, line_b, tangent
    )


def refine(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4], |t| = 1
    noise: float,
    num_rounds: int = 8,
    min_step: float = 1e-8,  # a smaller step is the last one
) -> FloatArray:
    """b_from_a with the smallest robust Sampson distances: Gauss-Newton over rotation and
    direction, Cauchy weights.

    pycolmap's `refine_relative_pose` has no robust loss (benchmarks/performance/libraries.py).
    """
    for _ in range(num_rounds):
        terms = sampson_terms(rays_a, rays_b, b_from_a)
        weighted = terms.by_motion / (1 + (terms.distance / noise) ** 2)[:, None]
        step = -np.linalg.solve(
            weighted.T @ terms.by_motion + 1e-9 * np.eye(5), weighted.T @ terms.distance
        )
        direction = b_from_a[:3, 3] + step[3:] @ terms.tangent
        rotation = np.asarray(Rotation.from_rotvec(step[:3]).as_matrix()) @ b_from_a[:3, :3]
        b_from_a = se3.compose(rotation, direction / np.linalg.norm(direction))
        if np.abs(step).max() < min_step:
            break
    return b_from_a


def _general(rays_a: FloatArray, rays_b: FloatArray, noise: float, seed: int) -> TwoView:
    """MAGSAC++ essential matrix, the decomposition with most points in front, then refinement with
    all inliers.
    """
    essential = _magsac(rays_a, rays_b, INLIER * noise, seed)
    if essential is None:
        return _unknown(len(rays_a))
    *rotations, direction = (
        np.asarray(part, dtype=np.float64) for part in cv2.decomposeEssentialMat(essential)
    )
    candidates = [
        se3.compose(rotation, sign * direction[:, 0])
        for rotation in rotations
        for sign in (1.0, -1.0)
    ]
    fits = np.abs(sampson_terms(rays_a, rays_b, candidates[0]).distance) < INLIER * noise
    num_in_front = [
        (_in_front(rays_a, rays_b, candidate, noise) & fits).sum() for candidate in candidates
    ]
    best = int(np.argmax(num_in_front))
    if fits.mean() < MIN_INLIER_SHARE or num_in_front[best] < max(
        MIN_POINTS, MIN_CHEIRALITY_SHARE * fits.sum()
    ):
        return _unknown(len(rays_a))
    b_from_a = refine(rays_a[fits], rays_b[fits], candidates[best], noise)
    inliers = np.abs(sampson_terms(rays_a, rays_b, b_from_a).distance) < INLIER * noise
    inliers &= _in_front(rays_a, rays_b, b_from_a, noise)
    shift = np.linalg.norm(rotate_rays(b_from_a[:3, :3], rays_a) - rays_b, axis=1)
    return TwoView("general", b_from_a, inliers, median(shift[inliers]) if inliers.any() else 0.0)


def _magsac(
    rays_a: FloatArray, rays_b: FloatArray, threshold: float, seed: int
) -> FloatArray | None:
    """The essential matrix by MAGSAC++ (Barath 2020) with a random state of its own; None when
    there is none.
    """
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


def _in_front(
    rays_a: FloatArray, rays_b: FloatArray, b_from_a: FloatArray, noise: float
) -> BoolArray:
    """Points [N] in front of both cameras; rays that are parallel within the noise count as far,
    not as behind.
    """
    points = cv2.triangulatePoints(np.eye(3, 4), b_from_a[:3], rays_a.T, rays_b.T)  # [4, N]
    parallel = (
        np.linalg.norm(rotate_rays(b_from_a[:3, :3], rays_a) - rays_b, axis=1) < INLIER * noise
    )
    in_front: BoolArray = parallel | (
        (points[2] * points[3] > 0) & (b_from_a[2] @ points * points[3] > 0)
    )
    return in_front


def _unknown(count: int) -> TwoView:
    return TwoView("unknown", np.eye(4), np.zeros(count, dtype=bool), 0.0)

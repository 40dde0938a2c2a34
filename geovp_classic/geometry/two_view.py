"""The motion of a camera between two images, from points observed in both.

Rays are [..., 2] = (x, y) on the plane z = 1 of the camera that observes them. The essential matrix
maps a ray of camera a to its epipolar line in camera b: E = [t]x R with b_from_a = (R, t).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.geometry import alignment, se3
from geovp_classic.geometry.robust import geman_mcclure_weight, irls
from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class TwoView:
    """The motion between two images."""

    b_from_a: FloatArray  # [4, 4]; the translation has length 1, or 0 where none is visible
    inliers: BoolArray  # [N]
    parallax: float  # median shift of the inliers on z = 1, beyond any rotation

    @property
    def has_translation(self) -> bool:
        """Return whether the camera moved, by more than a rotation."""
        return bool(self.b_from_a[:3, 3].any())


@dataclass(frozen=True)
class TwoViewEstimator:
    """Selection of the simplest motion that explains the points of two images."""

    # As many as determine a linear solution (Hartley & Zisserman 2004, chapter 11); five determine
    # the motion itself.
    min_points: int = 8
    # Standard deviations of the noise, 99.7 % of normal distances from an epipolar line
    max_inlier_error: float = 3.0
    # Inliers of a motion without translation, which is preferred as the simplest. The others may be
    # moving objects.
    min_static_fraction: float = 0.7
    # Of a general motion, as in `Resection`
    min_inlier_fraction: float = 0.4
    # Of the inliers, in front of both cameras: a wrong motion has half of them there.
    min_in_front_fraction: float = 0.6
    # Random samples. Of five points among 40 % inliers, one in 100 is without outliers.
    num_samples: int = 1000
    # Sampling ends when no better motion was missed with this probability.
    sampling_confidence: float = 0.9999

    def estimate(
        self,
        rays_a: FloatArray,  # [N, 2]
        rays_b: FloatArray,  # [N, 2]
        noise: float,  # standard deviation of a ray's coordinates: pixels / focal length
    ) -> TwoView | None:
        """Return no motion, a rotation, or a general motion, whichever fits first.

        None with too few points, or if most of them share no motion.
        """
        if len(rays_a) < self.min_points:
            return None
        max_error = self.max_inlier_error * noise
        b_from_a = np.eye(4)
        for is_rotated in (False, True):
            if is_rotated:
                b_from_a[:3, :3] = best_rotation(rays_a, rays_b, noise)
            shift = parallax(b_from_a, rays_a, rays_b)
            fits = shift < max_error
            if fits.mean() >= self.min_static_fraction:
                return TwoView(b_from_a, fits, float(np.median(shift)))
        return self._general(rays_a, rays_b, noise)

    def _general(self, rays_a: FloatArray, rays_b: FloatArray, noise: float) -> TwoView | None:
        """Return the motion by MAGSAC++ (Barath et al. 2020), refined with all inliers."""
        max_error = self.max_inlier_error * noise
        a = np.ascontiguousarray(rays_a)
        b = np.ascontiguousarray(rays_b)
        try:
            essential, is_inlier = cv2.findEssentialMat(
                a,
                b,
                np.eye(3),
                cv2.USAC_MAGSAC,
                prob=self.sampling_confidence,
                threshold=max_error,
                maxIters=self.num_samples,
            )
        except cv2.error:  # all samples are degenerate
            return None
        if essential is None or essential.shape != (3, 3):
            return None
        # Of four motions with this essential matrix (Hartley & Zisserman 2004, 9.6.2), inliers vote
        # for the one with their points in front of both cameras, at any distance
        _, rotation, direction, *_ = cv2.recoverPose(
            essential, a, b, np.eye(3), distanceThresh=1e9, mask=is_inlier
        )
        b_from_a = se3.compose(rotation, direction[:, 0])
        # Refine with all inliers
        fits = np.abs(sampson_distances(rays_a, rays_b, b_from_a)[0]) < max_error
        if fits.mean() < self.min_inlier_fraction:
            return None
        b_from_a = refine(rays_a[fits], rays_b[fits], b_from_a, noise)
        # Inliers of the refined motion
        distance, _ = sampson_distances(rays_a, rays_b, b_from_a)
        shift = parallax(b_from_a, rays_a, rays_b)
        # Points behind a camera are outliers, unless their rays are parallel within the noise:
        # those meet in front or behind by chance
        in_front = are_in_front(rays_a, rays_b, b_from_a) | (shift < max_error)
        inliers = in_front & (np.abs(distance) < max_error)
        if inliers.sum() < max(self.min_points, self.min_in_front_fraction * fits.sum()):
            return None
        # Where points have about one depth, a translation and a rotation may cancel each other: all
        # points are then far from the motion's own rotation, and still show no parallax
        rotation = best_rotation(rays_a[inliers], rays_b[inliers], noise)
        b_from_a_rotated = se3.compose(rotation, np.zeros(3))
        shift = parallax(b_from_a_rotated, rays_a[inliers], rays_b[inliers])
        return TwoView(b_from_a, inliers, float(np.median(shift)))


def homogeneous(rays: FloatArray) -> FloatArray:
    """Return (x, y) [..., 2] as (x, y, 1) [..., 3]."""
    return np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)


def parallax(b_from_a: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> FloatArray:
    """Return how far rays [N, 2] are from the rotated ones on z = 1 [N]; NaN behind the camera."""
    rotated = homogeneous(rays_a) @ b_from_a[:3, :3].T
    depth = np.where(rotated[:, 2:] > 1e-6, rotated[:, 2:], np.nan)
    return np.linalg.norm(rotated[:, :2] / depth - rays_b, axis=1)


def are_in_front(rays_a: FloatArray, rays_b: FloatArray, b_from_a: FloatArray) -> BoolArray:
    """Return which rays [N, 2] meet in front of both cameras.

    Their depths p and q solve q b = p R a + t, hence p (Ra x b) = b x t and q (Ra x b) = Ra x t.
    """
    a = homogeneous(rays_a) @ b_from_a[:3, :3].T
    b = homogeneous(rays_b)
    across_t = se3.cross_matrix(b_from_a[:3, 3])  # v @ across_t is v x t
    normal = np.cross(a, b)
    depth_a = (b @ across_t * normal).sum(axis=1)
    depth_b = (a @ across_t * normal).sum(axis=1)
    return (depth_a > 0) & (depth_b > 0)


def best_rotation(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    noise: float,
    num_rounds: int = 12,
) -> FloatArray:
    """Return b_from_a [3, 3] that aligns most rays: Wahba's problem with Geman-McClure weights.

    The weights' scale shrinks from the median residual to `noise`.
    """
    a = homogeneous(rays_a)
    b = homogeneous(rays_b)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    weight: FloatArray = np.ones(len(a))
    for _ in range(num_rounds):
        rotation = alignment.rotation_between(a, b, weight)
        residual = np.linalg.norm(a @ rotation.T - b, axis=1)
        weight = geman_mcclure_weight(residual, max(noise, np.median(residual)))
    return rotation


def sampson_distances(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4]
) -> tuple[FloatArray, FloatArray]:
    """Return first-order distances from the epipolar geometry (Hartley & Zisserman, 11.4.3).

    These are signed distances [N] on z = 1, and their derivatives [N, 5] by a rotation vector of b
    and by steps along `tangents`.
    """
    a = homogeneous(rays_a)
    b = homogeneous(rays_b)
    rotation = b_from_a[:3, :3]
    translation = b_from_a[:3, 3]
    essential = se3.cross_matrix(translation) @ rotation
    line_a = b @ essential
    line_b = a @ essential.T
    normals = np.concatenate([line_a[:, :2], line_b[:, :2]], axis=1)
    gradient = np.linalg.norm(normals, axis=1) + 1e-12
    distance = (b * line_b).sum(axis=1) / gradient
    rotated = a @ rotation.T
    # b . (t x (w x Ra)) = w . (Ra x (b x t)) and b . (dt x Ra) = dt . (Ra x b)
    by_rotation = np.cross(rotated, b @ se3.cross_matrix(translation))
    by_direction = np.cross(rotated, b) @ tangents(translation).T
    by_motion = np.concatenate([by_rotation, by_direction], axis=1)
    return distance, by_motion / gradient[:, None]


def tangents(direction: FloatArray) -> FloatArray:
    """Return two unit vectors [2, 3] orthogonal to a direction [3] and to each other."""
    return np.linalg.svd(direction[None])[2][1:]


def refine(
    rays_a: FloatArray,  # [N, 2]
    rays_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4], |t| = 1
    scale: float,  # of the Cauchy weights, on z = 1
    num_rounds: int = 8,
) -> FloatArray:
    """Return b_from_a with the smallest robust Sampson distances, by IRLS.

    `refine_relative_pose` of pycolmap has no robust loss.
    """

    def linearise(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
        return sampson_distances(rays_a, rays_b, motion)

    def retract(motion: FloatArray, step: FloatArray) -> FloatArray:
        rotation = Rotation.from_rotvec(step[:3]).as_matrix() @ motion[:3, :3]
        direction = motion[:3, 3] + step[3:] @ tangents(motion[:3, 3])
        return se3.compose(rotation, direction / np.linalg.norm(direction))

    return irls(b_from_a, linearise, retract, scale, num_rounds=num_rounds)

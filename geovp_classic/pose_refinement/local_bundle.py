"""Local bundle adjustment (Triggs 2000) of poses and inverse depths of corners, with the given
poses as a prior.

Given poses are either right to within a standard deviation or far off. Their deviations therefore
count together by Cauchy's function: poses that agree with the images stay, and poses that
contradict them by pixels lose their prior. COLMAP has no such prior for rotations.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.robust import cauchy_weight
from geovp_classic.types import BoolArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class Corners:
    """Corners of the reference image, tracked through the other frames (the sources)."""

    rays: FloatArray  # [N, 3], z = 1, in the reference
    pixels: FloatArray  # [S, N, 2]
    is_visible: BoolArray  # [S, N]
    camera: Intrinsics

    def triangulate(
        self,
        poses: FloatArray,  # [S, 4, 4], source from reference
    ) -> FloatArray:
        """Return inverse depths q >= 0 [N] that solve (u, v) (a_z + q b_z) = (a + q b)_xy."""
        matrix = self.camera.matrix
        a = self.rays @ np.swapaxes(
            matrix @ poses[:, :3, :3], -1, -2
        )  # [S, N, 3]
        b = (poses[:, :3, 3] @ matrix.T)[:, None]  # [S, 1, 3]
        factor = (self.pixels * b[..., 2:] - b[..., :2]) * self.is_visible[
            ..., None
        ]
        target = a[..., :2] - self.pixels * a[..., 2:]
        numerator = (factor * target).sum(axis=(0, 2))
        denominator = (factor**2).sum(axis=(0, 2))
        return np.maximum(numerator / np.maximum(denominator, 1e-12), 0)

    def linearise(
        self, poses: FloatArray, inverse_depth: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return reprojection errors [S, N, 2] in pixels and their derivatives by the twists of the
        poses [S, N, 2, 6] and by the inverse depths [S, N, 2]; 0 for invisible corners.
        """
        positions = poses[:, None, :3, 3]  # [S, 1, 3]
        rotations = np.swapaxes(poses[:, :3, :3], -1, -2)
        points = (
            self.rays @ rotations + inverse_depth[:, None] * positions
        )  # [S, N, 3]
        is_valid = self.is_visible & (points[..., 2] > 1e-3)
        points = np.where(is_valid[..., None], points, [0.0, 0.0, 1.0])
        pixels, depth = pinhole.project(points, self.camera)
        errors = is_valid[..., None] * (pixels - self.pixels)
        by_point = np.zeros((*points.shape[:2], 2, 3))
        by_point[..., 0, 0] = self.camera.fx_px / depth
        by_point[..., 1, 1] = self.camera.fy_px / depth
        centre = [self.camera.cx_px, self.camera.cy_px]
        by_point[..., 2] = -(pixels - centre) / depth[..., None]
        by_point *= is_valid[..., None, None]
        by_translation = inverse_depth[:, None, None] * by_point
        by_rotation = -by_point @ se3.cross_matrix(points)
        by_twist = np.concatenate([by_translation, by_rotation], axis=-1)
        by_depth = (by_point @ positions[..., None])[..., 0]
        return errors, by_twist, by_depth


@dataclass(frozen=True)
class LocalBundle:
    """Iteratively reweighted Gauss-Newton with the inverse depths eliminated (Schur complement)."""

    error_scale_px: float = (
        0.5  # reprojection errors of this size have half the weight (Cauchy)
    )
    rotation_deviation_rad: float = (
        1.7e-4  # standard deviation of a given rotation
    )
    # Standard deviation of a given position, over its distance from the reference.
    position_deviation_fraction: float = 7e-4
    # Deviation of all given poses, in standard deviations, that halves their weight (Cauchy).
    prior_scale: float = 5.5
    num_rounds: int = 8
    min_step: float = 0.1  # standard deviations of the given poses; a smaller step is the last one
    damping: float = (
        1e-3  # of the inverse depths and poses, relative to their curvature
    )

    def adjust(
        self,
        corners: Corners,
        given: FloatArray,  # [S, 4, 4], source from reference
    ) -> FloatArray:
        """Return the adjusted poses [S, 4, 4]."""
        poses = given
        precision = self._precision(given)
        inverse_depth = corners.triangulate(given)
        for _ in range(self.num_rounds):
            errors, by_twist, by_depth = corners.linearise(poses, inverse_depth)
            scale = self.error_scale_px
            weights = (
                cauchy_weight(np.linalg.norm(errors, axis=-1), scale) / scale**2
            )
            weighted_twist = weights[..., None, None] * by_twist
            weighted_depth = weights[..., None] * by_depth

            # Normal equations of the poses, with the prior.
            deviation = precision * se3.log(
                poses @ se3.inverse(given)
            )  # [S, 6]
            prior_weight = 1 / (1 + (deviation**2).sum() / self.prior_scale**2)
            prior_hessian = prior_weight * precision[..., None] ** 2 * np.eye(6)
            prior_gradient = prior_weight * precision * deviation
            pose_hessian = np.einsum(
                "snki,snkj->sij", weighted_twist, by_twist, optimize=True
            )
            pose_hessian += prior_hessian
            pose_gradient = np.einsum("snki,snk->si", weighted_twist, errors)
            pose_gradient += prior_gradient

            # Normal equations of the inverse depths, and the mixed derivatives.
            depth_hessian = (weighted_depth * by_depth).sum(axis=(0, 2))
            depth_hessian = depth_hessian * (1 + self.damping) + 1e-12
            depth_gradient = (weighted_depth * errors).sum(axis=(0, 2))
            mixed = np.einsum("snki,snk->nsi", weighted_twist, by_depth)
            mixed = mixed.reshape(len(inverse_depth), -1)  # [N, 6 S]

            # The Schur complement of the inverse depths gives the steps of the poses.
            eliminated = mixed / depth_hessian[:, None]
            damped_hessian = pose_hessian * (1 + self.damping * np.eye(6))
            reduced_hessian = block_diag(*damped_hessian) - eliminated.T @ mixed
            reduced_gradient = (
                pose_gradient.ravel() - eliminated.T @ depth_gradient
            )
            twists = -np.linalg.solve(reduced_hessian, reduced_gradient)
            depth_step = -(depth_gradient + mixed @ twists) / depth_hessian

            twists = twists.reshape(-1, 6)
            poses = se3.exp(twists) @ poses
            inverse_depth = np.maximum(inverse_depth + depth_step, 0)
            if np.abs(twists * precision).max() < self.min_step:
                break
        return poses

    def _precision(self, given: FloatArray) -> FloatArray:
        """Return one over the standard deviations of the given poses [S, 6]."""
        distance = np.linalg.norm(given[:, :3, 3], axis=1)
        fraction = self.position_deviation_fraction
        deviation = np.full((len(given), 6), self.rotation_deviation_rad)
        deviation[:, :3] = (
            fraction * np.maximum(distance, fraction * distance.max())[:, None]
        )
        return 1 / deviation

"""Pose of a camera that observes known points, among outliers (resection, perspective-n-point)."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.robust import irls
from geovp_classic.odometry.triangulation import reprojection_errors
from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Resection:
    """Robust Gauss-Newton from a guess, and from random samples if that has few inliers."""

    # Standard deviations of the noise; a Rayleigh-distributed error exceeds it once in 3e5 points,
    # which leaves room for errors of the points themselves.
    max_inlier_error: float = 5.0
    # Inliers of the guess that make random samples unnecessary: more than half, so that another
    # pose has fewer, and a tenth more for points that are inliers of both.
    min_sampling_fraction: float = 0.6
    # Four times the three points that determine a pose, so that no chance fits them.
    min_inliers: int = 12
    # Moving objects may cover more than half of the points; a pose of fewer than 40 % is theirs.
    min_inlier_fraction: float = 0.4
    # Quantile of the errors that the scale of the weights starts at: of the inliers, even if they
    # are no more than `min_inlier_fraction`.
    scale_quantile: float = 0.3
    # Rounds of Gauss-Newton, for the scale to shrink from a wrong prediction: on 03[0, 60) of
    # KITTI, the median is about 10.
    max_rounds: int = 20
    # Largest entry of the last step, in standard deviations of the noise: with 60 points, the pose
    # itself is known to .1 of them
    min_step: float = 0.02
    # Random samples, for a sample of four points without outliers among 60 % outliers: in 500
    # samples there is none with a probability of 2e-6 (Fischler & Bolles 1981).
    num_samples: int = 500
    # Sampling ends when no better pose was missed with this probability.
    sampling_confidence: float = 0.999

    def resect(
        self,
        points: FloatArray,  # [N, 3]
        rays: FloatArray,  # [N, 2]
        guess: FloatArray,  # cam_from_world [4, 4]
        noise: float,  # standard deviation of a ray's coordinates: pixels / focal length
    ) -> tuple[FloatArray, BoolArray] | None:
        """Return cam_from_world [4, 4] and its inliers [N]; None if there are too few."""
        if len(points) < self.min_inliers:
            return None
        max_error = self.max_inlier_error * noise
        # Refine the guess
        pose = self.refine(points, rays, guess, noise)
        inliers = reprojection_errors(points, rays, pose) < max_error
        # Few inliers: the guess may be far off; refine the best of random samples instead
        if inliers.mean() < self.min_sampling_fraction:
            sampled = self._sample_pose(points, rays, max_error)
            if sampled is not None:
                other = self.refine(points, rays, sampled, noise)
                other_inliers = reprojection_errors(points, rays, other) < max_error
                if other_inliers.sum() > inliers.sum():
                    pose = other
                    inliers = other_inliers
        # Still few: the points share no pose
        if inliers.sum() < max(self.min_inliers, self.min_inlier_fraction * len(points)):
            return None
        return pose, inliers

    def refine(
        self,
        points: FloatArray,  # [N, 3]
        rays: FloatArray,  # [N, 2]
        cam_from_world: FloatArray,  # [4, 4]
        noise: float,
    ) -> FloatArray:
        """Return the pose with the smallest robust reprojection errors near the given one.

        The scale of the Cauchy weights shrinks from a low quantile of the errors to the noise. This
        takes half as long as `refine_absolute_pose` of pycolmap, which keeps the scale.
        """

        def linearise(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
            x, y, z = pose[:3, :3] @ points.T + pose[:3, 3:]
            inverse_depth = 1 / np.maximum(z, 1e-6)
            x *= inverse_depth
            y *= inverse_depth
            # Derivatives by a step (v, w), which moves a point X by v + w x X
            jacobian = np.zeros((2, 6, len(points)))
            jacobian[0, 0] = jacobian[1, 1] = inverse_depth
            jacobian[0, 2] = -x * inverse_depth
            jacobian[1, 2] = -y * inverse_depth
            jacobian[0, 3:] = -x * y, 1 + x * x, -y
            jacobian[1, 3:] = -1 - y * y, x * y, x
            residual = np.stack([x, y], axis=1) - rays
            return residual, jacobian.transpose(2, 0, 1)

        def retract(pose: FloatArray, step: FloatArray) -> FloatArray:
            rotation, _ = cv2.Rodrigues(step[3:])
            return se3.compose(rotation, step[:3]) @ pose

        def scale(errors: FloatArray) -> float:
            rank = int(self.scale_quantile * len(errors))
            return max(noise, float(np.partition(errors, rank)[rank]))

        return irls(
            cam_from_world,
            linearise,
            retract,
            scale,
            num_rounds=self.max_rounds,
            min_step=self.min_step * noise,
        )

    def _sample_pose(
        self, points: FloatArray, rays: FloatArray, max_error: float
    ) -> FloatArray | None:
        """Return a pose with many inliers by MAGSAC++ (Barath et al. 2020); None without one."""
        try:
            has_pose, rotation_vector, translation, _ = cv2.solvePnPRansac(
                np.ascontiguousarray(points),
                np.ascontiguousarray(rays),
                np.eye(3),
                None,
                iterationsCount=self.num_samples,
                reprojectionError=max_error,
                confidence=self.sampling_confidence,
                flags=cv2.USAC_MAGSAC,
            )
        except cv2.error:  # all samples are degenerate
            return None
        rotation, _ = cv2.Rodrigues(rotation_vector)
        pose = se3.compose(rotation, translation[:, 0])
        return pose if has_pose and np.isfinite(pose).all() else None

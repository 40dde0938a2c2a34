"""Radial distortion that rectification has left in the images, estimated in turns.

A third of a percent bends the paths of points across the image enough to change the scale by a
tenth in one street corner. Rectified KITTI images have some (Cvisic et al. 2021, "Recalibrating the
KITTI dataset camera setup for improved odometry accuracy").
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.robust import cauchy_weight
from geovp_classic.geometry.two_view import SampsonTerms, refine, sampson_terms
from geovp_classic.odometry.lens import undistort
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class RadialEstimate:
    """Normal distribution of `Lens.radial`, at first centred on an ideal lens."""

    mean: float = 0.0
    variance: float = (
        0.015**2
    )  # about the distortion left in rectified KITTI images
    min_turn_deg: float = 1.5  # between two keyframes; in less, distortion looks like tracking bias
    min_points: int = 50
    # of the Cauchy weights, in standard deviations of the noise
    scale: float = 3.0
    inflation: float = 2.0  # of the noise, for the points' common errors

    def updated(
        self,
        distorted_a: FloatArray,  # [N, 2]
        distorted_b: FloatArray,  # [N, 2]
        b_from_a: FloatArray,  # [4, 4], a first guess
        noise: float,  # standard deviation of a ray's coordinates
    ) -> RadialEstimate:
        """Return the estimate after two more images; the same one unless the camera turned."""
        length = np.linalg.norm(b_from_a[:3, 3])
        turn_deg = np.degrees(se3.rotation_angle_rad(b_from_a))
        if (
            len(distorted_a) < self.min_points
            or length < 1e-6
            or turn_deg < self.min_turn_deg
        ):
            return self
        motion = se3.compose(b_from_a[:3, :3], b_from_a[:3, 3] / length)
        a = undistort(distorted_a, self.mean)
        b = undistort(distorted_b, self.mean)
        motion = refine(a, b, motion, self.scale * noise, num_rounds=3)
        terms = sampson_terms(a, b, motion)
        by_radial = radial_derivative(distorted_a, distorted_b, terms)
        # Schur complement: what the motion explains as well is no information about the lens
        weight = (
            cauchy_weight(terms.distance, self.scale * noise)
            / (self.inflation * noise) ** 2
        )
        weighted = terms.by_motion.T * weight
        normal = weighted @ terms.by_motion
        explained = (
            terms.by_motion @ np.linalg.lstsq(normal, weighted @ by_radial)[0]
        )
        residual = by_radial - explained
        information = float(residual @ (weight * residual))
        variance = 1 / (1 / self.variance + information)
        gradient = float(residual @ (weight * terms.distance))
        return replace(
            self, mean=self.mean - variance * gradient, variance=variance
        )


def radial_derivative(
    distorted_a: FloatArray,  # [N, 2]
    distorted_b: FloatArray,  # [N, 2]
    terms: SampsonTerms,  # of the undistorted rays
) -> FloatArray:
    """Return the derivatives [N] of Sampson distances by `Lens.radial`.

    Distances are those of the distorted pixels, so that a smaller image is no better fit.
    """
    along = np.zeros(len(distorted_a))
    stretched = np.zeros(len(distorted_a))
    for rays, line in (
        (distorted_a, terms.line_a),
        (distorted_b, terms.line_b),
    ):
        radius2 = (rays**2).sum(axis=1)
        projection = (rays * line[:, :2]).sum(axis=1)
        along += radius2 * projection
        stretched += (
            radius2 * (line[:, :2] ** 2).sum(axis=1) + 2 * projection**2
        )
    return (
        along / terms.gradient - terms.distance * stretched / terms.gradient**2
    )

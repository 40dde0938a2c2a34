"""Estimate, while the camera turns, the radial distortion that rectification has left in its
images.

A third of a percent of it bends the paths of points that cross the image enough to change the scale
by a tenth in one street corner. Rectified KITTI images have some (Cvisic et al. 2021,
"Recalibrating the KITTI dataset camera setup for improved odometry accuracy").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import refine, sampson_terms
from geovp_classic.odometry.lens import undistorted
from geovp_classic.types import FloatArray

MIN_TURN_RAD = np.radians(
    1.5
)  # between two keyframes; without it, distortion looks like a bias of tracking
MIN_POINTS = 50
KERNEL = 3.0  # distances beyond this many standard deviations count less
INFLATION = 2.0  # of the standard deviation, for what the noise of single points does not explain


@dataclass(frozen=True)
class RadialEstimate:
    """A normal distribution of `Lens.radial`, at first centred on a perfect lens."""

    mean: float = 0.0
    variance: float = 0.015**2

    def updated(
        self,
        distorted_a: FloatArray,  # [N, 2] rays, not corrected
        distorted_b: FloatArray,  # [N, 2]
        b_from_a: FloatArray,  # [4, 4], roughly
        noise: float,
    ) -> RadialEstimate:
        """The estimate after two more images; the same one unless the camera turned and moved
        between them.
        """
        length = float(np.linalg.norm(b_from_a[:3, 3]))
        if (
            len(distorted_a) < MIN_POINTS
            or length < 1e-6
            or se3.rotation_angle_rad(b_from_a) < MIN_TURN_RAD
        ):
            return self
        b_from_a = se3.compose(b_from_a[:3, :3], b_from_a[:3, 3] / length)
        a, b = undistorted(distorted_a, self.mean), undistorted(distorted_b, self.mean)
        b_from_a = refine(a, b, b_from_a, KERNEL * noise, num_rounds=3, min_step=0.0)
        distance, by_motion, by_radial = linearised(distorted_a, distorted_b, b_from_a, self.mean)
        weight = 1 / (1 + (distance / (KERNEL * noise)) ** 2)
        # what the motion can explain as well is no information about the lens: Schur complement
        mixed = by_motion.T @ (weight * by_radial)
        explained = np.linalg.solve(
            (by_motion * weight[:, None]).T @ by_motion + 1e-9 * np.eye(5), mixed
        )
        alone = by_radial - by_motion @ explained
        scale = (INFLATION * noise) ** 2
        information = float(alone @ (weight * alone)) / scale
        variance = 1 / (1 / self.variance + information)
        return RadialEstimate(
            self.mean - variance * float(alone @ (weight * distance)) / scale, variance
        )


def linearised(
    distorted_a: FloatArray,  # [N, 2]
    distorted_b: FloatArray,  # [N, 2]
    b_from_a: FloatArray,  # [4, 4]
    radial: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sampson distances [N], their derivatives by rotation and direction [N, 5] and by `radial`
    [N].
    """
    terms = sampson_terms(
        undistorted(distorted_a, radial), undistorted(distorted_b, radial), b_from_a
    )
    by_radial, stretched = np.zeros(len(distorted_a)), np.zeros(len(distorted_a))
    for rays, line in ((distorted_a, terms.line_a[:, :2]), (distorted_b, terms.line_b[:, :2])):
        square, along = (rays**2).sum(axis=1), (rays * line).sum(axis=1)
        by_radial += square * along
        stretched += square * (line**2).sum(axis=1) + 2 * along**2
    by_radial /= terms.gradient
    # keeps a smaller image from passing for a better fit: distances are those of the distorted
    # pixels
    by_radial -= terms.distance * stretched / terms.gradient**2
    return terms.distance, terms.by_motion, by_radial

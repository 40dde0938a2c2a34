"""Learn, while the camera turns, what radial distortion the rectification of its images has left.

A third of a percent of it bends the paths of points that cross the image enough to change the unit of length by a
tenth in one street corner. Rectified KITTI images have some (Cvisic et al. 2021, "Recalibrating the KITTI dataset
camera setup for improved odometry accuracy").
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import essential_of, product, refine
from geovp_classic.types import FloatArray

MIN_TURN_RAD = np.radians(1.5)  # between two keyframes; straight drives cannot tell distortion from a bias of tracking
MIN_POINTS = 50
KERNEL = 3.0  # distances beyond so many standard deviations count less
INFLATION = 2.0  # of the standard deviation, for what the noise of single points does not explain


@dataclass(frozen=True)
class RadialEstimate:
    """What is believed of `Lens.radial`: a normal distribution, at first centred on a perfect lens."""

    mean: float = 0.0
    variance: float = 0.015**2

    def updated(
        self,
        seen_a: FloatArray,  # [N, 2] rays as seen, not corrected
        seen_b: FloatArray,  # [N, 2]
        b_from_a: FloatArray,  # [4, 4], roughly
        noise: float,
    ) -> RadialEstimate:
        """The belief after two more images; the same one unless the camera turned and moved between them."""
        length = float(np.linalg.norm(b_from_a[:3, 3]))
        if len(seen_a) < MIN_POINTS or length < 1e-6 or se3.rotation_angle_rad(b_from_a) < MIN_TURN_RAD:
            return self
        b_from_a = se3.compose(b_from_a[:3, :3], b_from_a[:3, 3] / length)
        a, b = (seen * (1 + self.mean * (seen**2).sum(axis=1))[:, None] for seen in (seen_a, seen_b))
        b_from_a = refine(a, b, b_from_a, KERNEL * noise, num_rounds=3, enough=0.0)
        residual, by_motion, by_radial, _ = _linearised(seen_a, seen_b, b_from_a, self.mean)
        weight = 1 / (1 + (residual / (KERNEL * noise)) ** 2)
        # what the motion can explain as well says nothing about the lens: Schur complement
        mixed = by_motion.T @ (weight * by_radial)
        explained = np.linalg.solve((by_motion * weight[:, None]).T @ by_motion + 1e-9 * np.eye(5), mixed)
        alone = by_radial - by_motion @ explained
        scale = (INFLATION * noise) ** 2
        information = float(alone @ (weight * alone)) / scale
        variance = 1 / (1 / self.variance + information)
        return RadialEstimate(self.mean - variance * float(alone @ (weight * residual)) / scale, variance)


def _linearised(
    seen_a: FloatArray, seen_b: FloatArray, b_from_a: FloatArray, radial: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sampson distances [N], their derivatives by rotation and direction [N, 5] and by `radial` [N], and the plane
    [2, 3] in which the direction moves.
    """
    across = np.linalg.svd(b_from_a[None, :3, 3])[2][1:]
    given = np.ascontiguousarray(seen_a), np.ascontiguousarray(seen_b), np.ascontiguousarray(b_from_a)
    return *_distances(*given, across, float(radial)), across


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _distances(
    seen_a: FloatArray, seen_b: FloatArray, b_from_a: FloatArray, across: FloatArray, radial: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """See `_linearised`."""
    e, r, t = essential_of(b_from_a), b_from_a[:3, :3], b_from_a[:3, 3]
    residual, by_motion, by_radial = np.empty(len(seen_a)), np.empty((len(seen_a), 5)), np.empty(len(seen_a))
    for n in range(len(seen_a)):
        square_a, square_b = seen_a[n, 0] ** 2 + seen_a[n, 1] ** 2, seen_b[n, 0] ** 2 + seen_b[n, 1] ** 2
        ax, ay = seen_a[n, 0] * (1 + radial * square_a), seen_a[n, 1] * (1 + radial * square_a)
        bx, by = seen_b[n, 0] * (1 + radial * square_b), seen_b[n, 1] * (1 + radial * square_b)
        (x, y, z), (line_x, line_y, line_z) = product(r, ax, ay), product(e, ax, ay)
        back_x, back_y, _ = product(e.T, bx, by)
        steep_a, steep_b = back_x**2 + back_y**2, line_x**2 + line_y**2
        gradient = np.sqrt(steep_a + steep_b) + 1e-12
        residual[n] = (bx * line_x + by * line_y + line_z) / gradient
        u, v, w = by * t[2] - t[1], t[0] - bx * t[2], bx * t[1] - by * t[0]
        by_motion[n, 0], by_motion[n, 1], by_motion[n, 2] = y * w - z * v, z * u - x * w, x * v - y * u
        u, v, w = y - z * by, z * bx - x, x * by - y * bx
        by_motion[n, 3] = u * across[0, 0] + v * across[0, 1] + w * across[0, 2]
        by_motion[n, 4] = u * across[1, 0] + v * across[1, 1] + w * across[1, 2]
        by_motion[n] /= gradient
        along_a = seen_a[n, 0] * back_x + seen_a[n, 1] * back_y
        along_b = seen_b[n, 0] * line_x + seen_b[n, 1] * line_y
        # the second term keeps a smaller image from passing for a better fit: distances are those of the pixels seen
        stretched = square_a * steep_a + 2 * along_a**2 + square_b * steep_b + 2 * along_b**2
        by_radial[n] = (square_a * along_a + square_b * along_b) / gradient - residual[n] * stretched / gradient**2
    return residual, by_motion, by_radial

"""Local bundle adjustment (Triggs 2000) of poses and inverse depths of corners, with the given
poses as a prior.

Given poses are either right to within a standard deviation or far off. So their deviations count
together by Cauchy's function: poses that agree with the images stay, and poses that contradict them
by pixels lose their prior. COLMAP has no such prior for rotations
(benchmarks/performance/libraries.py compares both).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

ROBUST_PX = 0.5  # errors of this size count half (Cauchy)
ROTATION_RAD = 1.7e-4  # standard deviation of a given rotation
SHIFT_SHARE = 7e-4  # and of a given position, of the distance from the reference
PRIOR_SCALE = 30.0  # scale of Cauchy's function of the squared deviation from the given poses
NUM_ROUNDS = 8
START_DAMPING = 1e-3
TOLERANCE = 1e-4  # relative decrease of the cost at which it stops
NEAR = 1e-3


@dataclass(frozen=True)
class Corners:
    """The observations: corners of the reference image in the other frames, and the given poses."""

    rays: FloatArray  # [N, 3], z = 1, in the reference
    pixels: FloatArray  # [S, N, 2]
    visible: BoolArray  # [S, N]
    camera: Intrinsics
    given: FloatArray  # [S, 4, 4], source from reference

    def deviation(self, poses: FloatArray) -> FloatArray:
        """Deviations of the poses from the given ones [S, 6], in standard deviations."""
        return se3.log(poses @ se3.inverse(self.given)) * self.precision

    @property
    def precision(self) -> FloatArray:
        """One over the standard deviations of the given poses [S, 6]."""
        distance = np.linalg.norm(self.given[:, :3, 3], axis=1)
        shift = SHIFT_SHARE * np.maximum(distance, SHIFT_SHARE * distance.max())
        return np.concatenate(
            [np.tile(1 / shift[:, None], 3), np.full((len(shift), 3), 1 / ROTATION_RAD)], axis=1
        )

    def cost(self, inverse_depth: FloatArray, poses: FloatArray, deviation: FloatArray) -> float:
        """The cost: Cauchy's function of the reprojection errors in units of ROBUST_PX, and of the
        deviation.
        """
        squared = (deviation**2).sum()
        return float(
            _robust_error(*self._observed, poses, inverse_depth)
            + PRIOR_SCALE * np.log1p(squared / PRIOR_SCALE)
        )

    def equations(
        self, inverse_depth: FloatArray, poses: FloatArray, deviation: FloatArray
    ) -> Equations:
        """The cost near the poses and inverse depths, as a quadratic function of their changes."""
        h_twist, g_twist, h_depth, g_depth, mixed = _equations(
            *self._observed, poses, inverse_depth
        )
        precision = self.precision
        prior_weight = 1 / (1 + (deviation**2).sum() / PRIOR_SCALE)
        h_twist += prior_weight * precision[:, :, None] ** 2 * np.eye(6)
        return Equations(
            h_twist, g_twist + prior_weight * precision * deviation, h_depth, g_depth, mixed
        )

    def triangulate(self) -> FloatArray:
        """Inverse depths [N] from the given poses: (u, v) (a_z + q b_z) = (a + q b)_xy solved for
        q, at least 0.
        """
        matrix = self.camera.matrix
        a = self.rays @ np.swapaxes(matrix @ self.given[:, :3, :3], -1, -2)  # [S, N, 3]
        b = (self.given[:, :3, 3] @ matrix.T)[:, None]
        factor = (self.pixels * b[..., 2:] - b[..., :2]) * self.visible[..., None]
        wanted = a[..., :2] - self.pixels * a[..., 2:]
        square = (factor**2).sum(axis=(0, 2))
        return np.maximum((factor * wanted).sum(axis=(0, 2)) / np.maximum(square, 1e-12), 0)

    @property
    def _observed(self) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        camera = self.camera
        return (
            self.rays,
            self.pixels,
            self.visible,
            np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]),
        )


@dataclass(frozen=True)
class Equations:
    """Second and first derivatives of half the cost by the poses' twists (from the left) and the
    inverse depths.
    """

    h_twist: FloatArray  # [S, 6, 6]
    g_twist: FloatArray  # [S, 6]
    h_depth: FloatArray  # [N]
    g_depth: FloatArray  # [N]
    mixed: FloatArray  # [N, S, 6]

    def solved(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Twists [S, 6] of the poses and changes [N] of the inverse depths; these are eliminated
        (Schur complement).
        """
        count = len(self.h_twist)
        h_depth, mixed = self.h_depth * (1 + damping) + 1e-12, self.mixed.reshape(-1, 6 * count)
        whole = -(mixed / h_depth[:, None]).T @ mixed
        for s, h_twist in enumerate(self.h_twist * (1 + damping * np.eye(6))):
            whole[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] += h_twist
        twists = np.linalg.solve(whole, mixed.T @ (self.g_depth / h_depth) - self.g_twist.ravel())
        return twists.reshape(count, 6), -(self.g_depth + mixed @ twists) / h_depth


def adjust(corners: Corners) -> FloatArray:
    """The poses [S, 4, 4] of least cost (Levenberg 1944, Marquardt 1963)."""
    poses, inverse_depth = corners.given, corners.triangulate()
    deviation = corners.deviation(poses)
    cost, damping = corners.cost(inverse_depth, poses, deviation), START_DAMPING
    equations = corners.equations(inverse_depth, poses, deviation)
    for _ in range(NUM_ROUNDS):
        twists, deeper = equations.solved(damping)
        trial_poses, trial_depth = se3.exp(twists) @ poses, np.maximum(inverse_depth + deeper, 0)
        deviation = corners.deviation(trial_poses)
        trial_cost = corners.cost(trial_depth, trial_poses, deviation)
        damping = damping / 5 if trial_cost < cost else damping * 10
        if trial_cost < cost:
            converged = cost - trial_cost < TOLERANCE * cost
            poses, inverse_depth, cost = trial_poses, trial_depth, trial_cost
            if converged:
                break
            equations = corners.equations(inverse_depth, poses, deviation)
    return poses


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _robust_error(
    rays: FloatArray,  # [N, 3]
    pixels: FloatArray,  # [S, N, 2]
    visible: BoolArray,  # [S, N]
    camera: FloatArray,  # [4]: fx, fy, cx, cy
    poses: FloatArray,  # [S, 4, 4]
    inverse_depth: FloatArray,  # [N]
) -> float:
    """The sum of Cauchy's function of the errors of all corners that are visible and in front."""
    total = 0.0
    for s in range(len(poses)):
        for n in range(len(rays)):
            x, y, z = _point(rays[n], poses[s], inverse_depth[n])
            if visible[s, n] and z > NEAR:
                off_u = (camera[0] * x / z + camera[2] - pixels[s, n, 0]) / ROBUST_PX
                off_v = (camera[1] * y / z + camera[3] - pixels[s, n, 1]) / ROBUST_PX
                total += np.log1p(off_u * off_u + off_v * off_v)
    return total


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _equations(
    rays: FloatArray,  # [N, 3]
    pixels: FloatArray,  # [S, N, 2]
    visible: BoolArray,  # [S, N]
    camera: FloatArray,  # [4]: fx, fy, cx, cy
    poses: FloatArray,  # [S, 4, 4]
    inverse_depth: FloatArray,  # [N]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """See `Equations`; without the prior."""
    count, num = len(poses), len(rays)
    h_twist, g_twist = np.zeros((count, 6, 6)), np.zeros((count, 6))
    h_depth, g_depth, mixed = np.zeros(num), np.zeros(num), np.zeros((num, count, 6))
    slope = np.empty(6)  # of an error by the pose's twist
    for s in range(count):
        for n in range(num):
            q = inverse_depth[n]
            x, y, z = _point(rays[n], poses[s], q)
            if not (visible[s, n] and z > NEAR):
                continue
            off_u = (camera[0] * x / z + camera[2] - pixels[s, n, 0]) / ROBUST_PX
            off_v = (camera[1] * y / z + camera[3] - pixels[s, n, 1]) / ROBUST_PX
            weight = 1 / (1 + off_u * off_u + off_v * off_v)
            for axis in range(2):
                off, focal, along = (off_u, camera[0], x) if axis == 0 else (off_v, camera[1], y)
                by_near, by_z = focal / ROBUST_PX / z, -focal / ROBUST_PX * along / (z * z)
                by_x, by_y = (by_near, 0.0) if axis == 0 else (0.0, by_near)
                slope[0], slope[1], slope[2] = q * by_x, q * by_y, q * by_z
                slope[3], slope[4], slope[5] = (
                    y * by_z - z * by_y,
                    z * by_x - x * by_z,
                    x * by_y - y * by_x,
                )
                by_depth = by_x * poses[s, 0, 3] + by_y * poses[s, 1, 3] + by_z * poses[s, 2, 3]
                h_depth[n] += weight * by_depth * by_depth
                g_depth[n] += weight * by_depth * off
                for i in range(6):
                    weighted = weight * slope[i]
                    g_twist[s, i] += weighted * off
                    mixed[n, s, i] += weighted * by_depth
                    for j in range(6):
                        h_twist[s, i, j] += weighted * slope[j]
    return h_twist, g_twist, h_depth, g_depth, mixed


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _point(ray: FloatArray, pose: FloatArray, inverse_depth: float) -> tuple[float, float, float]:
    """The corner in the other frame, over its depth in the reference."""
    x = pose[0, 0] * ray[0] + pose[0, 1] * ray[1] + pose[0, 2] * ray[2] + inverse_depth * pose[0, 3]
    y = pose[1, 0] * ray[0] + pose[1, 1] * ray[1] + pose[1, 2] * ray[2] + inverse_depth * pose[1, 3]
    z = pose[2, 0] * ray[0] + pose[2, 1] * ray[1] + pose[2, 2] * ray[2] + inverse_depth * pose[2, 3]
    return x, y, z

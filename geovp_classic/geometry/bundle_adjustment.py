"""Bundle adjustment (Triggs et al. 2000) of poses and points, with a prior of measured poses.

Iteratively reweighted Levenberg-Marquardt steps eliminate the points by a Schur complement.
Measured poses are either right to within a standard deviation or far off. Their deviations
therefore count together by Cauchy's function: poses that agree with the images stay, and poses that
contradict them by pixels lose their prior.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

INVERSE_DEPTHS = slice(3, 4)  # w of points (x, y, z, w) on known rays (x, y, z)


@dataclass(frozen=True)
class Bundle:
    """Cameras, homogeneous points (x, y, z, w) with w >= 0, and the pixels that show them."""

    cam_from_world: FloatArray  # [K, 4, 4]
    points: FloatArray  # [N, 4]; w = 0 is infinitely far
    pixels: FloatArray  # [K, N, 2]
    is_visible: BoolArray  # [K, N]
    camera: Intrinsics

    def with_inverse_depths(self) -> "Bundle":
        """Return the bundle with w >= 0 of each point that fits its pixels, given x, y and z.

        It solves (u, v) (a_z + w b_z) = (a + w b)_xy.
        """
        matrix = self.camera.matrix
        poses = self.cam_from_world
        rotations = np.swapaxes(matrix @ poses[:, :3, :3], -1, -2)
        a = self.points[:, :3] @ rotations  # [K, N, 3]
        b = (poses[:, :3, 3] @ matrix.T)[:, None]  # [K, 1, 3]
        factor = self.pixels * b[..., 2:] - b[..., :2]
        factor *= self.is_visible[..., None]
        target = a[..., :2] - self.pixels * a[..., 2:]
        numerator = (factor * target).sum(axis=(0, 2))
        denominator = (factor**2).sum(axis=(0, 2))
        points = self.points.copy()
        points[:, 3] = np.maximum(numerator / np.maximum(denominator, 1e-12), 0)
        return replace(self, points=points)

    def linearise(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return reprojection errors [K, N, 2] in pixels and their derivatives; 0 if invisible.

        The derivatives are by the twist of the camera from the left [K, N, 2, 6] and by the point
        [K, N, 2, 4].
        """
        poses = self.cam_from_world
        located = self.points @ np.swapaxes(poses[:, :3], -1, -2)  # [K, N, 3]
        is_valid = self.is_visible & (located[..., 2] > 1e-3)
        located = np.where(is_valid[..., None], located, [0.0, 0.0, 1.0])
        pixels, depth = pinhole.project(located, self.camera)
        valid = is_valid[..., None].astype(float)
        from_centre = pixels - [self.camera.cx_px, self.camera.cy_px]
        errors = np.where(is_valid[..., None], pixels - self.pixels, 0.0)

        by_location = np.zeros((*depth.shape, 2, 3))
        by_location[..., 0, 0] = self.camera.fx_px / depth
        by_location[..., 1, 1] = self.camera.fy_px / depth
        by_location[..., 2] = -from_centre / depth[..., None]
        by_location *= valid[..., None]
        by_camera = np.empty((*depth.shape, 2, 6))
        by_camera[..., :3] = self.points[:, 3, None, None] * by_location
        by_camera[..., 3:] = np.cross(located[..., None, :], by_location)
        rows = by_location.reshape(len(poses), -1, 3)  # [K, 2 N, 3]
        by_point = (rows @ poses[:, :3]).reshape(*depth.shape, 2, 4)
        return errors, by_camera, by_point

    def moved(
        self,
        camera_step: FloatArray,  # [K, 6]
        point_step: FloatArray,  # [N, D]
        coordinates: slice,
    ) -> "Bundle":
        """Return the bundle after a step of the cameras and of some coordinates of the points."""
        points = self.points.copy()
        points[:, coordinates] += point_step
        points[:, 3] = np.maximum(points[:, 3], 0)
        poses = se3.exp(camera_step) @ self.cam_from_world
        return replace(self, cam_from_world=poses, points=points)


@dataclass(frozen=True)
class PosePrior:
    """Measured poses, and how far they are trusted."""

    cam_from_world: FloatArray  # [K, 4, 4]
    precision: FloatArray  # [K, 6], one over the standard deviation of a twist from the left
    # Deviation of all poses, in standard deviations, that halves their weight (Cauchy).
    scale: float

    def linearise(
        self, cam_from_world: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return the curvature [K, 6], the gradient [K, 6] and the value of the prior's cost."""
        twists = se3.log(cam_from_world @ se3.inverse(self.cam_from_world))
        deviation = self.precision * twists
        square = (deviation**2).sum() / self.scale**2
        weighted_precision = self.precision / (1 + square)
        curvature = weighted_precision * self.precision
        gradient = weighted_precision * deviation
        return curvature, gradient, self.scale**2 * np.log1p(square)


@dataclass(frozen=True)
class BundleAdjustment:
    """Levenberg-Marquardt steps until the robust cost hardly decreases."""

    # Reprojection errors of this size have half the weight (Cauchy).
    error_scale_px: float = 0.5
    max_rounds: int = 8
    min_decrease: float = 1e-3  # of the cost, relative; less ends the rounds
    # Initial damping of the unknowns, relative to their curvature, and its change in a round
    # (Levenberg-Marquardt).
    damping: float = 1e-2
    damping_factor: float = 10.0

    def adjust(
        self,
        bundle: Bundle,
        coordinates: slice,  # of the points that are adjusted
        prior: PosePrior | None = None,
    ) -> Bundle:
        """Return the bundle of the lowest cost, with all poses adjusted."""
        best, lowest, damping = bundle, np.inf, self.damping
        for _ in range(self.max_rounds + 1):
            errors, by_camera, by_point = bundle.linearise()
            squares = (errors**2).sum(axis=-1) / self.error_scale_px**2
            cost = np.log1p(squares).sum()
            if prior is not None:
                curvature, gradient, prior_cost = prior.linearise(
                    bundle.cam_from_world
                )
                cost += prior_cost
            if cost < lowest:
                is_converged = lowest - cost < self.min_decrease * cost
                best, lowest = bundle, cost
                if is_converged:
                    break
                weights = 1 / (1 + squares) / self.error_scale_px**2
                normal = NormalEquations.of(
                    errors, by_camera, by_point[..., coordinates], weights
                )
                if prior is not None:
                    normal.add_prior(curvature, gradient)
                damping /= self.damping_factor
            else:
                damping *= self.damping_factor**2
            steps = normal.solve(damping)
            bundle = best.moved(*steps, coordinates)
        return best


@dataclass(frozen=True)
class NormalEquations:
    """Curvature and gradient of the cost by the cameras and the points."""

    cameras: FloatArray  # [K, 6, 6]
    camera_gradient: FloatArray  # [K, 6]
    points: FloatArray  # [N, D, D]
    point_gradient: FloatArray  # [N, D]
    mixed: FloatArray  # [N, D, K, 6]

    @classmethod
    def of(
        cls,
        errors: FloatArray,  # [K, N, 2]
        by_camera: FloatArray,  # [K, N, 2, 6]
        by_point: FloatArray,  # [K, N, 2, D]
        weights: FloatArray,  # [K, N]
    ) -> "NormalEquations":
        """Return the normal equations of weighted errors."""
        weights = weights[..., None, None]
        point = weights * by_point
        cameras = by_camera.reshape(len(by_camera), -1, 6)
        weighted = (weights * by_camera).reshape(cameras.shape)
        transposed = np.swapaxes(weighted, -1, -2)  # [K, 6, 2 N]
        camera_errors = errors.reshape(len(errors), -1, 1)
        return cls(
            cameras=transposed @ cameras,
            camera_gradient=(transposed @ camera_errors)[..., 0],
            points=np.einsum("knai,knaj->nij", point, by_point),
            point_gradient=np.einsum("knai,kna->ni", point, errors),
            mixed=np.einsum("knai,knaj->nikj", point, by_camera),
        )

    def add_prior(self, curvature: FloatArray, gradient: FloatArray) -> None:
        """Add the curvature [K, 6] and gradient [K, 6] of a prior of the poses."""
        twist = np.arange(6)
        self.cameras[:, twist, twist] += curvature
        self.camera_gradient[...] += gradient

    def solve(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Return the steps of the cameras [K, 6] and points [N, D]."""
        num_points, num_coordinates = self.point_gradient.shape
        mixed = self.mixed.reshape(num_points * num_coordinates, -1)
        by_point = mixed.reshape(num_points, num_coordinates, -1)
        inverse = np.linalg.inv(_damped(self.points, damping))
        eliminated = (inverse @ by_point).reshape(mixed.shape)

        curvature = block_diag(*_damped(self.cameras, damping))
        curvature -= eliminated.T @ mixed
        gradient = self.camera_gradient.ravel()
        gradient = gradient - eliminated.T @ self.point_gradient.ravel()
        step = -np.linalg.solve(curvature, gradient)

        point_gradient = self.point_gradient + by_point @ step
        point_step = -(inverse @ point_gradient[..., None])[..., 0]
        return step.reshape(-1, 6), point_step


def _damped(curvature: FloatArray, damping: float) -> FloatArray:
    """Return matrices [M, D, D] with a larger diagonal, which makes them regular."""
    identity = np.eye(curvature.shape[-1])
    return curvature * (1 + damping * identity) + 1e-12 * identity

"""Bundle adjustment (Triggs et al. 2000) of poses and inverse depths, with a prior of given poses.

Points lie on known rays of a reference camera, whose pose is fixed. Iteratively reweighted
Levenberg-Marquardt steps eliminate their inverse depths by a Schur complement. Given poses are
either right to within a standard deviation or far off. Their deviations therefore count together by
Cauchy's function: poses that agree with the images stay, and poses that contradict them by pixels
lose their prior.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class Bundle:
    """Cameras, points on rays of the reference, and the pixels that show them."""

    cam_from_world: FloatArray  # [K, 4, 4]
    rays: FloatArray  # [N, 3], z = 1, in the reference
    inverse_depths: FloatArray  # [N]; 0 is infinitely far
    pixels: FloatArray  # [K, N, 2]
    is_visible: BoolArray  # [K, N]
    camera: Intrinsics

    def with_inverse_depths(self) -> "Bundle":
        """Return the bundle with the inverse depth q >= 0 of each point that fits its pixels.

        It solves (u, v) (a_z + q b_z) = (a + q b)_xy.
        """
        matrix = self.camera.matrix
        poses = self.cam_from_world
        rotations = np.swapaxes(matrix @ poses[:, :3, :3], -1, -2)
        a = self.rays @ rotations  # [K, N, 3]
        b = (poses[:, :3, 3] @ matrix.T)[:, None]  # [K, 1, 3]
        factor = self.pixels * b[..., 2:] - b[..., :2]
        factor *= self.is_visible[..., None]
        target = a[..., :2] - self.pixels * a[..., 2:]
        numerator = (factor * target).sum(axis=(0, 2))
        denominator = np.maximum((factor**2).sum(axis=(0, 2)), 1e-12)
        inverse_depths = np.maximum(numerator / denominator, 0)
        return replace(self, inverse_depths=inverse_depths)

    def linearise(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return reprojection errors [K, N, 2] in pixels and their derivatives; 0 if invisible.

        The derivatives are by the twist of the camera from the left [K, N, 2, 6] and by the inverse
        depth [K, N, 2].
        """
        poses = self.cam_from_world
        inverse_depths = self.inverse_depths[:, None]
        translations = poses[:, None, :3, 3]  # [K, 1, 3]
        located = self.rays @ np.swapaxes(poses[:, :3, :3], -1, -2)
        located += inverse_depths * translations  # [K, N, 3]
        is_valid = self.is_visible & (located[..., 2] > 1e-3)
        located = np.where(is_valid[..., None], located, [0.0, 0.0, 1.0])
        pixels, depth = pinhole.project(located, self.camera)
        from_centre = pixels - [self.camera.cx_px, self.camera.cy_px]
        errors = np.where(is_valid[..., None], pixels - self.pixels, 0.0)

        by_location = np.zeros((*depth.shape, 2, 3))
        by_location[..., 0, 0] = self.camera.fx_px / depth
        by_location[..., 1, 1] = self.camera.fy_px / depth
        by_location[..., 2] = -from_centre / depth[..., None]
        by_location *= is_valid[..., None, None]
        by_camera = np.empty((*depth.shape, 2, 6))
        by_camera[..., :3] = inverse_depths[..., None] * by_location
        by_camera[..., 3:] = np.cross(located[..., None, :], by_location)
        by_depth = (by_location @ translations[..., None])[..., 0]
        return errors, by_camera, by_depth


@dataclass(frozen=True)
class PosePrior:
    """Given poses, and how far they are trusted."""

    cam_from_world: FloatArray  # [K, 4, 4]
    precision: FloatArray  # [K, 6], one over the standard deviation of a twist from the left
    # Deviation of all poses, in standard deviations, that halves their weight (Cauchy).
    scale: float

    def linearise(
        self, cam_from_world: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return the curvature [K, 6], the gradient [K, 6] and the value of the prior's cost."""
        given = se3.inverse(self.cam_from_world)
        deviation = self.precision * se3.log(cam_from_world @ given)
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

    def adjust(self, bundle: Bundle, prior: PosePrior) -> Bundle:
        """Return the bundle of the lowest cost."""
        best, lowest, damping = bundle, np.inf, self.damping
        for _ in range(self.max_rounds + 1):
            errors, by_camera, by_depth = bundle.linearise()
            squares = (errors**2).sum(axis=-1) / self.error_scale_px**2
            curvature, gradient, cost = prior.linearise(bundle.cam_from_world)
            cost += np.log1p(squares).sum()
            if cost < lowest:
                is_converged = lowest - cost < self.min_decrease * cost
                best, lowest = bundle, cost
                if is_converged:
                    break
                weights = 1 / (1 + squares) / self.error_scale_px**2
                system = (
                    errors,
                    by_camera,
                    by_depth,
                    weights,
                    curvature,
                    gradient,
                )
                damping /= self.damping_factor
            else:
                damping *= self.damping_factor**2
            camera_step, depth_step = damped_step(*system, damping)
            bundle = replace(
                best,
                cam_from_world=se3.exp(camera_step) @ best.cam_from_world,
                inverse_depths=np.maximum(best.inverse_depths + depth_step, 0),
            )
        return best


def damped_step(
    errors: FloatArray,  # [K, N, 2]
    by_camera: FloatArray,  # [K, N, 2, 6]
    by_depth: FloatArray,  # [K, N, 2]
    weights: FloatArray,  # [K, N]
    prior_curvature: FloatArray,  # [K, 6]
    prior_gradient: FloatArray,  # [K, 6]
    damping: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the steps of the cameras [K, 6] and the inverse depths [N] by the normal equations.

    A larger diagonal makes the equations regular.
    """
    num_cameras, num_points, *_ = errors.shape
    jacobian = by_camera.reshape(num_cameras, -1, 6)
    weighted = (weights[..., None, None] * by_camera).reshape(jacobian.shape)
    transposed = np.swapaxes(weighted, -1, -2)  # [K, 6, 2 N]
    gradients = (transposed @ errors.reshape(num_cameras, -1, 1))[..., 0]
    identity = np.eye(6)
    cameras = transposed @ jacobian + prior_curvature[..., None] * identity
    cameras = cameras * (1 + damping * identity) + 1e-12 * identity

    depth = weights[..., None] * by_depth
    curvatures = (depth * by_depth).sum(axis=(0, 2)) * (1 + damping) + 1e-12
    depth_gradients = (depth * errors).sum(axis=(0, 2))
    mixed = np.einsum("kna,knaj->nkj", depth, by_camera)
    mixed = mixed.reshape(num_points, -1)

    eliminated = (mixed / curvatures[:, None]).T
    step = -np.linalg.solve(
        block_diag(*cameras) - eliminated @ mixed,
        (gradients + prior_gradient).ravel() - eliminated @ depth_gradients,
    )
    depth_step = -(depth_gradients + mixed @ step) / curvatures
    return step.reshape(-1, 6), depth_step

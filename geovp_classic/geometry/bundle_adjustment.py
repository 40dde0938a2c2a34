"""Bundle adjustment of poses and points (Triggs et al. 2000), with a prior of the poses if wanted.

Iteratively reweighted Gauss-Newton: a Schur complement eliminates the points. The prior tells where
poses were measured. Measured poses are either right to within a standard deviation or far off.
Their deviations therefore count together by Cauchy's function: poses that agree with the images
stay, and poses that contradict them by pixels lose their prior.
"""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

INVERSE_DEPTHS = slice(3, 4)  # w of points (x, y, z, w) on known rays (x, y, z)
POSITIONS = slice(0, 3)  # of points (x, y, z, 1)
NUM_CAMERA = (
    7  # unknowns of a camera: a twist, and the logarithm of the focal length
)


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

        The derivatives are by the camera [K, N, 2, 7] (twist from the left, logarithm of the focal
        length) and by the point [K, N, 2, 4].
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
        by_camera = np.empty((*depth.shape, 2, NUM_CAMERA))
        by_camera[..., :3] = self.points[:, 3, None, None] * by_location
        by_camera[..., 3:6] = np.cross(located[..., None, :], by_location)
        by_camera[..., 6] = valid * from_centre
        rows = by_location.reshape(len(poses), -1, 3)  # [K, 2 N, 3]
        by_point = (rows @ poses[:, :3]).reshape(*depth.shape, 2, 4)
        return errors, by_camera, by_point

    def moved(
        self,
        camera_step: FloatArray,  # [K, 7]
        point_step: FloatArray,  # [N, D]
        coordinates: slice,
    ) -> "Bundle":
        """Return the bundle after a step of the cameras and of some coordinates of the points."""
        points = self.points.copy()
        points[:, coordinates] += point_step
        points[:, 3] = np.maximum(points[:, 3], 0)
        focal_ratio = np.exp(camera_step[0, 6])
        camera = replace(
            self.camera,
            fx_px=self.camera.fx_px * focal_ratio,
            fy_px=self.camera.fy_px * focal_ratio,
        )
        poses = se3.exp(camera_step[:, :6]) @ self.cam_from_world
        return replace(self, cam_from_world=poses, points=points, camera=camera)


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
        square = float((deviation**2).sum()) / self.scale**2
        weighted_precision = self.precision / (1 + square)
        curvature = weighted_precision * self.precision
        gradient = weighted_precision * deviation
        return curvature, gradient, self.scale**2 * np.log1p(square)


@dataclass(frozen=True)
class BundleAdjustment:
    """Gauss-Newton steps until the robust cost hardly decreases."""

    # Reprojection errors of this size have half the weight (Cauchy).
    error_scale_px: float = 0.5
    max_rounds: int = 8
    min_decrease: float = 1e-3  # of the cost, relative; less ends the rounds
    damping: float = 1e-5  # of the unknowns, relative to their curvature

    def adjust(
        self,
        bundle: Bundle,
        is_free: BoolArray,  # [K, 6], twists of poses that are adjusted
        coordinates: slice,  # of the points that are adjusted
        prior: PosePrior | None = None,
        use_focal: bool = False,
    ) -> Bundle:
        """Return the bundle of the lowest cost; the focal length stays unless `use_focal`."""
        camera_by_unknown = _camera_by_unknown(is_free, use_focal)
        best, lowest = bundle, np.inf
        for _ in range(self.max_rounds + 1):
            errors, by_camera, by_point = bundle.linearise()
            squares = (errors**2).sum(axis=-1) / self.error_scale_px**2
            cost = np.log1p(squares).sum()
            weights = 1 / (1 + squares) / self.error_scale_px**2
            normal = NormalEquations.of(
                errors, by_camera, by_point[..., coordinates], weights
            )
            if prior is not None:
                curvature, gradient, prior_cost = prior.linearise(
                    bundle.cam_from_world
                )
                cost += prior_cost
                normal.add_prior(curvature, gradient)
            if not cost < lowest:
                break
            is_converged = lowest - cost < self.min_decrease * cost
            best, lowest = bundle, cost
            if is_converged:
                break
            steps = normal.solve(camera_by_unknown, self.damping)
            bundle = bundle.moved(*steps, coordinates)
        return best


@dataclass(frozen=True)
class NormalEquations:
    """Curvature and gradient of the cost by the cameras and the points."""

    cameras: FloatArray  # [K, 7, 7]
    camera_gradient: FloatArray  # [K, 7]
    points: FloatArray  # [N, D, D]
    point_gradient: FloatArray  # [N, D]
    mixed: FloatArray  # [N, D, K, 7]

    @classmethod
    def of(
        cls,
        errors: FloatArray,  # [K, N, 2]
        by_camera: FloatArray,  # [K, N, 2, 7]
        by_point: FloatArray,  # [K, N, 2, D]
        weights: FloatArray,  # [K, N]
    ) -> "NormalEquations":
        """Return the normal equations of weighted errors."""
        weights = weights[..., None, None]
        point = weights * by_point
        cameras = by_camera.reshape(len(by_camera), -1, NUM_CAMERA)
        weighted = (weights * by_camera).reshape(cameras.shape)
        transposed = np.swapaxes(weighted, -1, -2)  # [K, 7, 2 N]
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
        self.camera_gradient[:, :6] += gradient

    def solve(
        self,
        camera_by_unknown: FloatArray,  # [7 K, U]
        damping: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the steps of the cameras [K, 7] and points [N, D]."""
        num_points, num_coordinates = self.point_gradient.shape
        num_cameras = len(self.cameras)
        mixed = self.mixed.reshape(-1, NUM_CAMERA * num_cameras)
        mixed = mixed @ camera_by_unknown  # [N D, U]
        by_point = mixed.reshape(num_points, num_coordinates, -1)
        inverse = np.linalg.inv(_damped(self.points, damping))
        eliminated = (inverse @ by_point).reshape(mixed.shape)

        camera_by_camera = camera_by_unknown.reshape(
            num_cameras, NUM_CAMERA, -1
        )
        cameras = _damped(self.cameras, damping) @ camera_by_camera
        curvature = camera_by_unknown.T @ cameras.reshape(
            camera_by_unknown.shape
        )
        curvature -= eliminated.T @ mixed
        gradient = camera_by_unknown.T @ self.camera_gradient.ravel()
        gradient -= eliminated.T @ self.point_gradient.ravel()
        step = -np.linalg.solve(curvature, gradient)

        point_gradient = self.point_gradient + by_point @ step
        point_step = -(inverse @ point_gradient[..., None])[..., 0]
        camera_step = (camera_by_unknown @ step).reshape(num_cameras, -1)
        return camera_step, point_step


def _damped(curvature: FloatArray, damping: float) -> FloatArray:
    """Return matrices [M, D, D] with a larger diagonal, which makes them regular."""
    identity = np.eye(curvature.shape[-1])
    return curvature * (1 + damping * identity) + 1e-12 * identity


def _camera_by_unknown(is_free: BoolArray, use_focal: bool) -> FloatArray:
    """Return the derivative [7 K, U] of the cameras by the unknowns that are adjusted."""
    num_cameras = len(is_free)
    columns = np.eye(NUM_CAMERA * num_cameras)
    columns = columns.reshape(-1, num_cameras, NUM_CAMERA)
    unknowns = columns[..., :6][:, is_free]
    if use_focal:
        focal = columns[:, :, 6].sum(axis=1, keepdims=True)
        unknowns = np.concatenate([unknowns, focal], axis=1)
    return unknowns

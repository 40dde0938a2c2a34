"""Velocity of an object on the road: first from optical flow, then by tracking through all frames.

A point p of the last frame was at R (p - v t) + c in the frame t seconds earlier, with R and c the
camera's own motion.
"""

import functools
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.dynamic_objects.posed_images import PosedImages
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import inside
from geovp_classic.geometry.robust import geman_mcclure_weight, irls
from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class VelocityEstimator:
    """Robust estimation of a constant velocity along the road."""

    outlier_ratio: float = (
        2.5  # scale of the flow's residuals over their median
    )
    stages: tuple[int, ...] = (
        3,
        6,
        9,
    )  # frames back that an object is tracked through
    rounds_per_stage: int = 3
    blur_px: float = 1.0  # of the images
    max_pixels: int = 400
    grey_scale: float = (
        8.0  # of Cauchy's weights: a grey difference of this size counts half
    )

    def from_flow(
        self,
        body: BoolArray,  # [H, W]
        depth: float,
        flow_pixels: FloatArray,  # [K, H, W, 2] in the earlier frames
        observed: PosedImages,
    ) -> FloatArray:
        """Return the velocity [3] that explains the flow of the body best, at one depth.

        With z the third coordinate of a point there, the equation x z - X = 0 is linear in v.
        """
        camera = observed.camera
        directions = along_road(observed.road.normal)
        points = depth * pinhole.rays(camera)[body]  # [N, 3]
        jacobians = []
        constants = []
        for pixels, step in zip(flow_pixels, observed.steps, strict=True):
            motion = observed.cam_from_last(step)
            rays = pinhole.unproject(pixels[body], np.ones(len(points)), camera)
            x = rays[:, :2]
            static = se3.transform(motion, points)
            shift = (
                observed.seconds(step) * motion[:3, :3] @ directions
            )  # [3, 2] per velocity
            jacobians.append(
                shift[None, :2] - x[..., None] * shift[2]
            )  # [N, 2, 2]
            constants.append(x * static[:, 2:] - static[:, :2])
        jacobian = np.concatenate(jacobians).reshape(-1, 2)
        constant = np.concatenate(constants).ravel()
        speeds = irls(
            np.zeros(2),
            lambda speeds: (jacobian @ speeds + constant, jacobian),
            np.add,
            scale=lambda residual: (
                self.outlier_ratio * float(np.median(np.abs(residual))) + 1e-12
            ),
            weight=geman_mcclure_weight,
        )
        return np.asarray(directions @ speeds)

    def track(
        self,
        velocity: FloatArray,  # [3], nearly right
        body: BoolArray,  # [H, W]
        depth: float,
        observed: PosedImages,
    ) -> FloatArray:
        """Return the velocity [3] of least photometric error (Lucas & Kanade 1981)."""
        rows, columns = np.nonzero(body)
        stride = -(-len(rows) // self.max_pixels)
        rows = rows[::stride]
        columns = columns[::stride]
        points = depth * pinhole.rays(observed.camera)[rows, columns]
        directions = along_road(observed.road.normal)
        images = [
            cv2.GaussianBlur(image, (0, 0), self.blur_px)
            for image in observed.images
        ]
        channels = [np.dstack([image, image_slopes(image)]) for image in images]
        greys = images[-1][rows, columns]

        def linearise(
            steps: range, velocity: FloatArray
        ) -> tuple[FloatArray, FloatArray]:
            residuals = []
            jacobians = []
            for step in steps:
                sampled, by_velocity = _sample(
                    channels[-1 - step], points, velocity, step, observed
                )
                residuals.append(
                    np.where(np.isfinite(sampled), sampled - greys, 0)
                )
                jacobians.append(by_velocity @ directions)
            return np.concatenate(residuals), np.concatenate(jacobians)

        for max_step in self.stages:
            steps = range(1, min(max_step, len(images) - 1) + 1)
            velocity = irls(
                velocity,
                functools.partial(linearise, steps),
                lambda velocity, step: velocity + directions @ step,
                self.grey_scale,
                num_rounds=self.rounds_per_stage,
            )
        return velocity


def along_road(normal: FloatArray) -> FloatArray:
    """Return two orthogonal directions [3, 2] along the road."""
    _, _, basis = np.linalg.svd(normal[None])
    return np.asarray(basis[1:].T)


def image_slopes(image: FloatArray) -> FloatArray:
    """Return the derivatives [H, W, 2] of a grey image along u and v."""
    along_u = cv2.Sobel(image, -1, 1, 0, scale=1 / 8)
    along_v = cv2.Sobel(image, -1, 0, 1, scale=1 / 8)
    return np.stack([along_u, along_v], axis=-1)


def _sample(
    channels: FloatArray,  # [H, W, 3], an earlier image and its slopes
    points: FloatArray,  # [N, 3] of the object, in the last camera's frame
    velocity: FloatArray,
    step: int,
    observed: PosedImages,
) -> tuple[FloatArray, FloatArray]:
    """Return the grey values [N] of moved points and their derivatives [N, 3] by the velocity.

    Outside of the image the grey values are NaN and the derivatives 0.
    """
    camera = observed.camera
    motion = observed.cam_from_last(step)
    seconds = observed.seconds(step)
    moved = se3.transform(motion, points - seconds * velocity)
    moved[:, 2] = np.maximum(moved[:, 2], 1e-3)
    pixels, _ = pinhole.project(moved, camera)
    is_shown = inside(pixels, camera)[:, None]
    u, v = pixels.T[:, None].astype(np.float32)
    sampled = cv2.remap(
        channels, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )[0]
    z = moved[:, 2:]
    by_xy = sampled[:, 1:] * [camera.fx_px, camera.fy_px] / z
    by_z = -(by_xy * moved[:, :2]).sum(axis=1, keepdims=True) / z
    by_point = np.hstack([by_xy, by_z])
    by_velocity = -seconds * by_point @ motion[:3, :3]
    greys = np.where(is_shown, sampled[:, :1], np.nan)
    return greys[:, 0], np.where(is_shown, by_velocity, 0)

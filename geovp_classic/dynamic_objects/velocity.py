"""The velocity of an object on the road: from optical flow first, then by tracking it through all
frames.

A point p of the last frame was at R (p - v t) + c in the frame t seconds earlier, with R and c the
camera's own motion.
"""

import cv2
import numpy as np

from geovp_classic.dynamic_objects import epipolar_residual
from geovp_classic.dynamic_objects.segmentation import Observations
from geovp_classic.geometry import pinhole
from geovp_classic.geometry.epipolar import IN_FRONT, inside
from geovp_classic.types import BoolArray, FloatArray

NUM_ROUNDS = 3
OUTLIER = 2.5  # times the median residual
STAGES = (3, 6, 9)  # frames before the last one that an object is followed through, near ones first
ROUNDS_PER_STAGE = 3
BLUR_PX = 1.0
MAX_PIXELS = 400
ROBUST_GREY = 8.0  # grey values; differences of this size count half
HOLD = 1e-6  # regularisation, relative to the normal equations


def along_road(normal: FloatArray) -> FloatArray:
    """Two directions [3, 2] along the road."""
    return np.asarray(np.linalg.svd(normal[None])[2][1:].T)


def from_flow(
    body: BoolArray,  # [H, W]
    depth: float,
    flow_pixels: FloatArray,  # [K, H, W, 2] in the earlier frames
    steps: tuple[int, ...],  # K
    observed: Observations,
) -> FloatArray:
    """The velocity [3] along the road that explains the flow of the body best, at one depth.

    With z the third coordinate of a point there, its pixel's equation x z - X = 0 is linear in v.
    """
    camera, directions = observed.camera, along_road(observed.road.normal)
    rays = pinhole.rays(camera)[body]
    rows, missing = [], []
    for place, step in zip(flow_pixels, steps, strict=True):
        other_from_last = epipolar_residual.cam_from_last(observed.past.world_from_cam, step)
        x = (place[body] - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px]
        point = depth * rays @ other_from_last[:3, :3].T + other_from_last[:3, 3]
        turned = observed.seconds(step) * other_from_last[:3, :3] @ directions  # [3, 2]
        rows.append(turned[None, :2] - x[..., None] * turned[2])  # [N, 2, 2]
        missing.append(point[:, :2] - x * point[:, 2:])
    return np.asarray(
        directions @ _robust(np.concatenate(rows).reshape(-1, 2), np.concatenate(missing).ravel())
    )


def _robust(rows: FloatArray, values: FloatArray) -> FloatArray:
    """Least squares with outliers removed."""
    kept = np.ones(len(rows), dtype=bool)
    solution: FloatArray = np.zeros(rows.shape[1])
    for _ in range(NUM_ROUNDS):
        solution = np.linalg.lstsq(rows[kept], values[kept], rcond=None)[0]
        residual = np.abs(rows @ solution - values)
        kept = residual <= OUTLIER * np.median(residual) + 1e-12
    return solution


def tracked(
    velocity: FloatArray,  # [3], nearly right
    body: BoolArray,  # [H, W]
    depth: float,
    observed: Observations,
) -> FloatArray:
    """The velocity [3] along the road of least photometric error in all frames (Lucas & Kanade
    1981).
    """
    rows, columns = np.nonzero(body)
    some = slice(None, None, -(-len(rows) // MAX_PIXELS))
    rows, columns = rows[some], columns[some]
    images = [cv2.GaussianBlur(image, (0, 0), BLUR_PX) for image in observed.images]
    slopes = [
        np.stack([cv2.Sobel(one, -1, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))], -1)
        for one in images
    ]
    points, directions = (
        depth * pinhole.rays(observed.camera)[rows, columns],
        along_road(observed.road.normal),
    )
    for farthest in STAGES:
        steps = range(1, min(farthest, len(images) - 1) + 1)
        for _ in range(ROUNDS_PER_STAGE):
            parts = [
                _equations(
                    velocity,
                    points,
                    images[-1][rows, columns],
                    (images[-1 - k], slopes[-1 - k]),
                    k,
                    observed,
                )
                for k in steps
            ]
            derivative, missing = (np.concatenate(part) for part in zip(*parts, strict=True))
            velocity = velocity + directions @ _weighted(derivative @ directions, missing)
    return velocity


def _equations(
    velocity: FloatArray,
    points: FloatArray,  # [N, 3] of the object, in the last camera's frame
    seen: FloatArray,  # [N] grey values of them in the last image
    earlier: tuple[FloatArray, FloatArray],  # image [H, W] and its slopes [H, W, 2]
    step: int,
    observed: Observations,
) -> tuple[FloatArray, FloatArray]:
    """Derivatives [N, 3] of the earlier image's grey values by the velocity, and residuals [N]; 0
    outside.
    """
    camera, other_from_last = (
        observed.camera,
        epipolar_residual.cam_from_last(observed.past.world_from_cam, step),
    )
    rotation, seconds = other_from_last[:3, :3], observed.seconds(step)
    moved = (points - seconds * velocity) @ rotation.T + other_from_last[:3, 3]
    moved[:, 2] = np.maximum(moved[:, 2], IN_FRONT)
    place, _ = pinhole.project(moved, camera)
    shown = inside(place, camera)
    u, v = place.T[:, None].astype(np.float32)
    grey, slope = (
        cv2.remap(one, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        for one in earlier
    )
    along = slope * [camera.fx_px, camera.fy_px] / moved[:, 2:]
    by_point = np.concatenate(
        [along, -(along * moved[:, :2]).sum(axis=1, keepdims=True) / moved[:, 2:]], axis=1
    )
    derivative = -seconds * by_point @ rotation
    return np.where(shown[:, None], derivative, 0), np.where(shown, seen - grey, 0)


def _weighted(rows: FloatArray, missing: FloatArray) -> FloatArray:
    """Least squares with Cauchy weights of scale ROBUST_GREY."""
    weight = 1 / (1 + (missing / ROBUST_GREY) ** 2)
    normal = (rows * weight[:, None]).T @ rows
    normal += (HOLD * np.trace(normal) + 1e-12) * np.eye(len(normal))
    return np.linalg.solve(normal, rows.T @ (weight * missing))

"""Masks of future pixels: observed before, never observed, or on moving objects.

They need exact depth: synthetic and RGB-D clips have it. Metrics use the masks, predictors do not
see them.
"""

import numpy as np
from scipy.ndimage import map_coordinates

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, Context, FloatArray, Intrinsics, Target


def strata(context: Context, target: Target, tolerance: float = 0.02) -> dict[str, BoolArray]:
    """Return masks [F, H, W] by name, {} for a clip without depth or without metric poses.

    "seen" is static, and its surface point was visible in an observed frame. "disoccluded" is
    static and visible in none: hidden, or outside the image. "static" and "moving" are the clip's
    marks; without them all pixels count as static. Pixels of unknown depth are neither seen nor
    disoccluded.

    A point is visible if its inverse depth in the observed frame equals the recorded one within the
    fraction `tolerance`. Sky is compared by direction. `context` needs all privileged inputs.
    """
    past = context.past
    future = target.trajectory
    if past is None or future is None or not (past.is_metric and future.is_metric):
        return {}
    if context.past_depths is None or target.depths is None:
        return {}
    # Pixels that can be compared: static, and of known depth
    observed = _inverse(context.past_depths)
    inverse_depths = _inverse(target.depths)
    moving = target.moving
    static = np.ones(inverse_depths.shape, bool) if moving is None else ~moving
    comparable = static & np.isfinite(inverse_depths)
    # A pixel is hidden until one of the observed frames shows its surface
    hidden = comparable.copy()
    rays = pinhole.rays(context.intrinsics)
    for step, world_from_cam in enumerate(future.world_from_cam):
        pending = hidden[step]
        past_from_cam = se3.inverse(past.world_from_cam) @ world_from_cam
        for cam_from_cam, image in zip(past_from_cam, observed, strict=True):
            pending[pending] = ~_is_visible(
                rays[pending],
                inverse_depths[step][pending],
                cam_from_cam,
                image,
                context.intrinsics,
                tolerance,
            )
    masks = {"seen": comparable & ~hidden, "disoccluded": hidden}
    if moving is not None:
        masks |= {"static": static, "moving": moving.copy()}
    return masks


def _is_visible(
    rays: FloatArray,  # [N, 3]
    inverse_depth: FloatArray,  # [N]
    past_from_cam: FloatArray,  # [4, 4]
    observed: FloatArray,  # [H, W], inverse depths, NaN where unknown
    camera: Intrinsics,
    tolerance: float,
) -> BoolArray:
    """Return whether surface points on rays are visible in an observed frame [N].

    On a plane, inverse depth is linear in the pixel: interpolation is exact, however steep the
    plane is. At edges it would mix two surfaces; there the nearest pixel decides.
    """
    # points times inverse depth, so that sky is a direction
    points = rays @ past_from_cam[:3, :3].T + inverse_depth[:, None] * past_from_cam[:3, 3]
    pixels, depth = pinhole.project(points, camera)
    pixels = np.nan_to_num(pixels, nan=-1e6)  # behind the camera
    inside = np.clip(pixels, -0.5, [camera.width_px - 0.5, camera.height_px - 0.5])
    is_inside = (inside == pixels).all(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(is_inside, inverse_depth / depth, np.nan)
    is_visible = np.zeros(len(rays), bool)
    for order in (0, 1):  # the nearest pixel, and linear interpolation
        recorded = map_coordinates(observed, inside.T[::-1], order=order, mode="nearest")
        is_visible |= np.abs(recorded - expected) <= tolerance * expected
    return is_visible


def _inverse(depths: FloatArray) -> FloatArray:
    """Return inverse depths, 0 for sky and NaN for unknown."""
    return 1 / np.where(depths > 0, depths, np.nan).astype(np.float64)

"""Masks of future pixels: observed before, never observed, or on moving objects.

Needs exact depth, so it serves synthetic and RGB-D clips. The masks are for metrics to be taken
over, never for predictors.
"""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, Context, FloatArray, Intrinsics, Target


def strata(context: Context, target: Target, tolerance: float = 0.02) -> dict[str, BoolArray]:
    """Masks [F, H, W] by name, {} for a clip without depth or without metric poses; `context` needs
    every grant.

    "seen": static, and the surface point was visible in at least one observed frame; "disoccluded":
    static and visible in none, be it hidden or outside the image; "static", "moving": as the clip
    marks things, absent where it marks nothing (then all counts as static). Pixels of unknown depth
    are neither seen nor disoccluded. Visible means: projected into the observed frame, its inverse
    depth is the recorded one within the fraction `tolerance`; sky (depth inf) is compared by
    direction alone.
    """
    past, future = context.past, target.trajectory
    if past is None or future is None or context.past_depths is None or target.depths is None:
        return {}
    if not (past.is_metric and future.is_metric):
        return {}
    observed, real = _inverse(context.past_depths), _inverse(target.depths)
    static = np.ones(real.shape, dtype=bool) if target.moving is None else ~target.moving
    comparable = static & np.isfinite(real)
    seen = np.zeros_like(static)
    for step in range(len(real)):
        past_from_cam = se3.inverse(past.world_from_cam) @ future.world_from_cam[step]
        seen[step] = _seen(
            real[step], comparable[step], past_from_cam, observed, context.intrinsics, tolerance
        )
    masks = {"seen": seen, "disoccluded": comparable & ~seen}
    return (
        masks
        if target.moving is None
        else {**masks, "static": static, "moving": np.array(target.moving)}
    )


def _seen(
    inverse_depth: FloatArray,  # [H, W]
    comparable: BoolArray,  # [H, W], the pixels to test
    past_from_cam: FloatArray,  # [P, 4, 4]
    observed: FloatArray,  # [P, H, W], inverse depths
    camera: Intrinsics,
    tolerance: float,
) -> BoolArray:
    """Where one future frame's surface points are visible in an observed frame [H, W]; the latest
    is tested first.
    """
    seen = np.zeros_like(comparable)
    pending = np.flatnonzero(comparable)
    directions, inverse = pinhole.rays(camera).reshape(-1, 3), inverse_depth.ravel()
    for step in reversed(range(len(observed))):
        rotation, translation = past_from_cam[step, :3, :3], past_from_cam[step, :3, 3]
        scaled = (
            directions[pending] @ rotation.T + inverse[pending, None] * translation
        )  # the point times inverse depth
        pixels, growth = pinhole.project(scaled, camera)
        expected = inverse[pending] / np.where(
            growth > 0, growth, np.nan
        )  # inverse depth from there; 0 stays 0
        visible = _matches(pixels, expected, observed[step], tolerance)
        seen.ravel()[pending[visible]] = True
        pending = pending[~visible]
    return seen


def _matches(
    pixels: FloatArray,  # [N, 2], NaN behind the camera
    expected: FloatArray,  # [N], inverse depths
    observed: FloatArray,  # [H, W], inverse depths, NaN where unknown
    tolerance: float,
) -> BoolArray:
    """Whether the recorded inverse depth at each pixel is the expected one [N].

    On a plane inverse depth is linear in the pixel, so interpolating it is exact however steep the
    plane; beside an edge that would mix two surfaces, and the nearest pixel decides.
    """
    height_px, width_px = observed.shape
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (u >= -0.5) & (u < width_px - 0.5) & (v >= -0.5) & (v < height_px - 0.5)
    u, v, wanted = u[inside], v[inside], expected[inside]
    nearest = observed[np.floor(v + 0.5).astype(np.intp), np.floor(u + 0.5).astype(np.intp)]
    slack = tolerance * wanted
    good = (np.abs(nearest - wanted) <= slack) | (
        np.abs(_bilinear(observed, u, v) - wanted) <= slack
    )
    matches = np.zeros(len(pixels), dtype=bool)
    matches[inside] = good
    return matches


def _bilinear(image: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """The image [H, W] at (u, v) [N]; beyond the outermost pixel centres the line through the last
    two goes on.
    """
    left = np.clip(np.floor(u).astype(np.intp), 0, image.shape[1] - 2)
    top = np.clip(np.floor(v).astype(np.intp), 0, image.shape[0] - 2)
    right_share, low_share = u - left, v - top
    upper = image[top, left] * (1 - right_share) + image[top, left + 1] * right_share
    lower = image[top + 1, left] * (1 - right_share) + image[top + 1, left + 1] * right_share
    return upper * (1 - low_share) + lower * low_share


def _inverse(depths: FloatArray) -> FloatArray:
    """Inverse depths, 0 for sky and NaN for unknown."""
    known = depths > 0
    return np.where(known, 1.0 / np.where(known, depths, 1.0).astype(np.float64), np.nan)

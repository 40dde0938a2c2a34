"""Which pixels of the last frame no standing thing on or above the road explains: two tests that must both fail.

A standing thing may lie at any distance from the road's surface to infinity. Where it appears in an earlier frame is
therefore a piece of its epipolar line (Hartley & Zisserman 2004, eq. 13.2); what is seen elsewhere moves by itself.
The pictures decide: at the best standing place they must match worse than at the place that optical flow found.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.abreast import abreast
from geovp_classic.depth.ground import HORIZON_HEIGHTS, Ground
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

WINDOW_PX = 5  # over which differences of grey values are averaged
EXPOSURE_STRIDE_PX = 4  # every fourth pixel votes on how exposure changed
EXPOSURE_ROUNDS = 3
GREY_NOISE = 4.0  # difference of grey values 0..255 that says nothing
SMOOTHING_PX = 5  # of the flow that the search begins with
BELOW_ROAD = 0.85  # a standing thing has at least this share of the road's inverse depth: the road isn't quite flat
IN_FRONT = 1e-3  # smallest z, relative to the ray


@dataclass(frozen=True)
class Unexplained:
    """How much better flow matches the pictures than anything standing, and where flow says that pixels came from."""

    strength: FloatArray  # [H, W], excess of the grey difference as a multiple of the flow's own; 0 = explained
    shift_px: FloatArray  # [H, W], from the best standing place to the place found
    places: FloatArray  # [K, H, W, 2] float32, pixels (u, v) in the earlier frames
    steps: tuple[int, ...]  # K, how many frames before the last one


def unexplained(
    pictures: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    inverse_depth: FloatArray,  # [H, W] of the last frame, as if all were standing
    ground: Ground | None,
    steps: tuple[int, ...],
) -> Unexplained:
    """The median over the earlier frames: one chance match or one hidden pixel decides nothing."""
    lowest = _road_limit(camera, ground)
    standing = np.maximum(inverse_depth, lowest).astype(np.float32)
    tests = abreast(lambda step: _against(step, pictures, camera, world_from_cam, standing, lowest), steps)
    strengths, shifts_px, places = (np.stack(maps) for maps in zip(*tests, strict=True))
    return Unexplained(np.median(strengths, axis=0), np.median(shifts_px, axis=0), places, steps)


def equally_exposed(
    pictures: FloatArray,  # [P, H, W]
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    inverse_depth: FloatArray,  # [H, W] of the last frame
    steps: tuple[int, ...],
) -> FloatArray:
    """The pictures with those `steps` before the last one brought to its gain and offset, as most of what stands says.

    One gain and one offset for a picture: whatever is done locally bleeds over the edges of things.
    """
    equal = pictures.copy()
    some = (slice(None, None, EXPOSURE_STRIDE_PX),) * 2
    grid = pinhole.pixel_grid(camera)[some]
    last = pictures[-1][some].ravel()

    def equalise(step: int) -> None:
        stood = _seen_at(*_epipolar(grid, camera, cam_from_last(world_from_cam, step)), inverse_depth[some])
        warped = _sampled(pictures[-1 - step], stood).ravel()
        kept = np.ones(len(last), dtype=bool)
        gain, offset = 1.0, 0.0
        for _ in range(EXPOSURE_ROUNDS):
            residual = np.abs(gain * warped + offset - last)
            kept = residual <= 2 * np.median(residual) + 1
            gain, offset = np.polyfit(warped[kept], last[kept], 1) if np.ptp(warped[kept]) > 1 else (1.0, 0.0)
        equal[-1 - step] = gain * pictures[-1 - step] + offset

    abreast(equalise, steps)
    return equal


def cam_from_last(world_from_cam: FloatArray, step: int) -> FloatArray:
    """[4, 4] of the camera `step` frames before the last one."""
    return np.asarray(se3.inverse(world_from_cam[-1 - step]) @ world_from_cam[-1])


def _road_limit(camera: Intrinsics, ground: Ground | None) -> FloatArray:
    """The least inverse depth [H, W] of things not below the road; 0 beyond the near road and without one."""
    if ground is None:
        return np.zeros((camera.height_px, camera.width_px), np.float32)
    road = ground.inverse_depth(camera)
    return np.where(road * ground.height > 1 / HORIZON_HEIGHTS, BELOW_ROAD * road, np.float32(0))


def _against(
    step: int,
    pictures: FloatArray,
    camera: Intrinsics,
    world_from_cam: FloatArray,
    standing: FloatArray,  # [H, W]
    lowest: FloatArray,  # [H, W]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strength and shift [H, W] and place [H, W, 2] by the frame `step` frames before the last one."""
    pair = pictures[[-1, -1 - step]]
    last, earlier = pair
    grid = pinhole.pixel_grid(camera).astype(np.float32)
    origin, epipole = _epipolar(grid, camera, cam_from_last(world_from_cam, step))
    stood = _seen_at(origin, epipole, standing)
    place, remaining = _flow(pair, grid, stood)
    nearest = _seen_at(origin, epipole, np.maximum(_triangulated(origin, epipole, place), lowest))
    excess = np.minimum(difference(last, earlier, stood), difference(last, earlier, nearest)) - remaining
    shift_px = np.minimum(*(np.linalg.norm(one - place, axis=-1) for one in (stood, nearest)))
    shown = inside(place, camera)
    return np.where(shown, excess / (remaining + GREY_NOISE), 0), np.where(shown, shift_px, 0), place


def _flow(pair: FloatArray, grid: FloatArray, stood: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the last picture's pixels are in the earlier one [H, W, 2], and the grey difference there [H, W].

    Dense inverse search (Kroeger 2016), once from rest and once from where all would be if it stood; the better counts.
    """
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    last, earlier = np.clip(pair, 0, 255).astype(np.uint8)
    start = [cv2.medianBlur(np.ascontiguousarray((stood - grid)[..., axis]), SMOOTHING_PX) for axis in (0, 1)]
    found = [grid + search.calc(last, earlier, first) for first in (np.zeros_like(grid), np.stack(start, axis=-1))]
    differences = [difference(pair[0], pair[1], place) for place in found]
    from_rest = differences[0] < differences[1]
    return np.where(from_rest[..., None], *found), np.minimum(*differences)


def difference(
    last: FloatArray,  # [H, W]
    earlier: FloatArray,  # [H, W]
    place: FloatArray,  # [H, W, 2] float32
    window_px: int = WINDOW_PX,
) -> FloatArray:
    """Mean absolute difference of grey values [H, W] between the last picture and the earlier one at the places."""
    return np.asarray(cv2.blur(np.abs(_sampled(earlier, place) - last), (window_px, window_px)))


def _sampled(picture: FloatArray, place: FloatArray) -> FloatArray:
    u, v = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
    return np.asarray(cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _triangulated(origin: FloatArray, epipole: FloatArray, place: FloatArray) -> FloatArray:
    """The inverse depth [H, W] whose place in the earlier frame is nearest: linear least squares."""
    along = epipole[:2] - place * epipole[2]
    missing = place * origin[..., 2:] - origin[..., :2]
    inverse_depth: FloatArray = (along * missing).sum(axis=-1) / ((along * along).sum(axis=-1) + 1e-3)
    return inverse_depth


def _seen_at(origin: FloatArray, epipole: FloatArray, inverse_depth: FloatArray) -> FloatArray:
    """Pixels [H, W, 2] float32 of the earlier frame where things of these inverse depths are."""
    points = origin + inverse_depth[..., None] * epipole
    return np.asarray(points[..., :2] / np.maximum(points[..., 2:], IN_FRONT), np.float32)


def _epipolar(
    grid: FloatArray,  # [H, W, 2], pixels of the last frame
    camera: Intrinsics,
    other_from_last: FloatArray,  # [4, 4]
) -> tuple[FloatArray, FloatArray]:
    """The other camera's picture of the ends at infinity of all rays [H, W, 3], and the epipole [3]; float32."""
    infinity = (camera.matrix @ other_from_last[:3, :3] @ np.linalg.inv(camera.matrix)).astype(np.float32)
    origin = grid.astype(np.float32) @ infinity[:, :2].T + infinity[:, 2]
    return origin, (camera.matrix @ other_from_last[:3, 3]).astype(np.float32)


def inside(place: FloatArray, camera: Intrinsics) -> BoolArray:
    """Which pixels [..., 2] lie in the picture."""
    u, v = place[..., 0], place[..., 1]
    within: BoolArray = (u >= 0) & (u <= camera.width_px - 1) & (v >= 0) & (v <= camera.height_px - 1)
    return within

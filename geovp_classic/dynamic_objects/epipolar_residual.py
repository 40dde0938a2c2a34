"""Which pixels of the last frame no standing thing on or above the road explains: two tests that must both fail.

A standing thing may lie at any distance from the road's surface to infinity. Where it appears in an earlier frame is
therefore a piece of its epipolar line (Hartley & Zisserman 2004, eq. 13.2); what is seen elsewhere moves by itself.
The images decide: at the best standing place they must match worse than at the place that optical flow found.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.geometry.ground_plane import HORIZON_HEIGHTS, Ground
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

WINDOW_PX = 5  # over which differences of grey values are averaged
EXPOSURE_STRIDE_PX = 4  # every fourth pixel votes on how exposure changed
EXPOSURE_ROUNDS = 3
GREY_NOISE = 4.0  # difference of grey values 0..255 that says nothing
SMOOTHING_PX = 5  # of the flow that the search begins with
BELOW_ROAD = 0.85  # a standing thing has at least this share of the road's inverse depth: the road isn't quite flat


@dataclass(frozen=True)
class Unexplained:
    """How much better flow matches the images than anything standing, and where flow says that pixels came from."""

    strength: FloatArray  # [H, W], excess of the grey difference as a multiple of the flow's own; 0 = explained
    shift_px: FloatArray  # [H, W], from the best standing place to the place found
    places: FloatArray  # [K, H, W, 2] float32, pixels (u, v) in the earlier frames
    steps: tuple[int, ...]  # K, how many frames before the last one


def unexplained(
    images: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    inverse_depth: FloatArray,  # [H, W] of the last frame, as if all were standing
    ground: Ground | None,
    steps: tuple[int, ...],
) -> Unexplained:
    """The median over the earlier frames: one chance match or one hidden pixel decides nothing."""
    lowest = _road_limit(camera, ground)
    standing = np.maximum(inverse_depth, lowest).astype(np.float32)
    tests = parallel_map(lambda step: _against(step, images, camera, world_from_cam, standing, lowest), steps)
    strengths, shifts_px, places = (np.stack(maps) for maps in zip(*tests, strict=True))
    return Unexplained(_medians(strengths), _medians(shifts_px), places, steps)


def equally_exposed(
    images: FloatArray,  # [P, H, W]
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    inverse_depth: FloatArray,  # [H, W] of the last frame
    steps: tuple[int, ...],
) -> FloatArray:
    """The images with those `steps` before the last one brought to its gain and offset, as most of what stands says.

    One gain and one offset for an image: whatever is done locally bleeds over the edges of things.
    """
    equal = images.copy()
    some = (slice(None, None, EXPOSURE_STRIDE_PX),) * 2
    last = images[-1][some].ravel()

    def equalise(step: int) -> None:
        between = Epipolar.of(camera, cam_from_last(world_from_cam, step))
        stood, _ = between.seen_at(inverse_depth[some], EXPOSURE_STRIDE_PX)
        warped = _sampled(images[-1 - step], stood).ravel()
        kept = np.ones(len(last), dtype=bool)
        gain, offset = 1.0, 0.0
        for _ in range(EXPOSURE_ROUNDS):
            residual = np.abs(gain * warped + offset - last)
            kept = residual <= 2 * np.median(residual) + 1
            gain, offset = _line(warped[kept], last[kept])
        equal[-1 - step] = gain * images[-1 - step] + offset

    parallel_map(equalise, steps)
    return equal


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope and offset of y over x by least squares; 1 and 0 where x is all the same."""
    if np.ptp(x) <= 1:
        return 1.0, 0.0
    x_mean, y_mean = x.mean(dtype=np.float64), y.mean(dtype=np.float64)
    away = x - x_mean
    slope = float(away @ (y - y_mean) / (away @ away))
    return slope, float(y_mean - slope * x_mean)


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
    images: FloatArray,
    camera: Intrinsics,
    world_from_cam: FloatArray,
    standing: FloatArray,  # [H, W]
    lowest: FloatArray,  # [H, W]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strength and shift [H, W] and place [H, W, 2] by the frame `step` frames before the last one."""
    pair = images[[-1, -1 - step]]
    last, earlier = pair
    between = Epipolar.of(camera, cam_from_last(world_from_cam, step))
    stood, _ = between.seen_at(standing)
    place, remaining = _flow(pair, pinhole.pixel_grid(camera).astype(np.float32), stood)
    nearest, _ = between.seen_at(np.maximum(between.triangulated(place), lowest))
    differences = difference(last, earlier, stood), difference(last, earlier, nearest)
    strength, shift_px = np.empty(standing.shape, np.float32), np.empty(standing.shape, np.float32)
    _compare((stood, nearest, place), differences, remaining, strength, shift_px)
    return strength, shift_px, place


def _flow(pair: FloatArray, grid: FloatArray, stood: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the last image's pixels are in the earlier one [H, W, 2], and the grey difference there [H, W].

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
    """Mean absolute difference of grey values [H, W] between the last image and the earlier one at the places."""
    return np.asarray(cv2.blur(np.abs(_sampled(earlier, place) - last), (window_px, window_px)))


def _sampled(image: FloatArray, place: FloatArray) -> FloatArray:
    u, v = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
    return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def inside(place: FloatArray, camera: Intrinsics) -> BoolArray:
    """Which pixels [..., 2] lie in the image."""
    u, v = place[..., 0], place[..., 1]
    within: BoolArray = (u >= 0) & (u <= camera.width_px - 1) & (v >= 0) & (v <= camera.height_px - 1)
    return within


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _compare(
    places: tuple[FloatArray, FloatArray, FloatArray],  # [H, W, 2] each: if it stood, standing and nearest, by flow
    differences: tuple[FloatArray, FloatArray],  # [H, W] of grey values, at the first two
    remaining: FloatArray,  # [H, W], at the third
    strength: FloatArray,  # [H, W], written
    shift_px: FloatArray,  # [H, W], written
) -> None:
    """Strength and shift; 0 where flow leads out of the image."""
    stood, nearest, found = places
    height, width = remaining.shape
    for row in range(height):
        for column in range(width):
            u, v = found[row, column, 0], found[row, column, 1]
            strength[row, column] = shift_px[row, column] = 0
            if u >= 0 and v >= 0 and u <= width - 1 and v <= height - 1:
                one_u, one_v = stood[row, column, 0] - u, stood[row, column, 1] - v
                other_u, other_v = nearest[row, column, 0] - u, nearest[row, column, 1] - v
                square = min(one_u * one_u + one_v * one_v, other_u * other_u + other_v * other_v)
                excess = min(differences[0][row, column], differences[1][row, column]) - remaining[row, column]
                strength[row, column] = excess / (remaining[row, column] + np.float32(GREY_NOISE))
                shift_px[row, column] = np.sqrt(square)


@numba.njit(nogil=True, cache=True)
def _medians(values: FloatArray) -> FloatArray:
    """The median [H, W] of [K, H, W]."""
    count, height, width = values.shape
    medians, ordered = np.empty((height, width), values.dtype), np.empty(count, values.dtype)
    for row in range(height):
        for column in range(width):
            for k in range(count):
                place = k
                while place > 0 and ordered[place - 1] > values[k, row, column]:
                    ordered[place] = ordered[place - 1]
                    place -= 1
                ordered[place] = values[k, row, column]
            medians[row, column] = (ordered[count // 2] + ordered[(count - 1) // 2]) / 2
    return medians

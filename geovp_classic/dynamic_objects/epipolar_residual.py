"""Evidence of motion: pixels of the last frame that no static point on or above the road explains.

A static point may lie at any distance from the road's surface to infinity. Where it appears in an
earlier frame is therefore a piece of its epipolar line (Hartley & Zisserman 2004, eq. 13.2); a
pixel that is found elsewhere moves by itself. The images decide: the best static correspondence
must match worse than the one of optical flow.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import Epipolar, inside
from geovp_classic.geometry.ground_plane import HORIZON_HEIGHTS, GroundPlane
from geovp_classic.parallel import parallel_map
from geovp_classic.types import FloatArray, Intrinsics

WINDOW_PX = 5  # over which differences of grey values are averaged
EXPOSURE_STRIDE_PX = 4  # every fourth pixel is used to estimate the change of exposure
EXPOSURE_ROUNDS = 3
GREY_NOISE = 4.0  # difference of grey values 0..255 that is noise
SMOOTHING_PX = 5  # of the flow that the search starts from
BELOW_ROAD = (
    0.85  # of the road's inverse depth, the least of a static point: the road is not quite flat
)


@dataclass(frozen=True)
class ResidualEvidence:
    """How much better flow matches the images than any static point, and the correspondences of the
    flow.
    """

    # [H, W], excess of the static grey difference over that of flow, relative to the latter
    strength: FloatArray
    shift_px: FloatArray  # [H, W], distance of the flow from the best static correspondence
    flow_pixels: FloatArray  # [K, H, W, 2] float32, pixels (u, v) in the earlier frames


def residual_evidence(
    images: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    inverse_depth: FloatArray,  # [H, W] of the last frame, estimated as if all were static
    ground: GroundPlane | None,
    steps: tuple[int, ...],
) -> ResidualEvidence:
    """The evidence as a median over the earlier frames, robust to single chance matches and
    occlusions.
    """
    lowest = _road_limit(camera, ground)
    static_depth = np.maximum(inverse_depth, lowest).astype(np.float32)
    tests = parallel_map(
        lambda step: _test_frame(step, images, camera, world_from_cam, static_depth, lowest), steps
    )
    strengths, shifts_px, flow_pixels = (np.stack(maps) for maps in zip(*tests, strict=True))
    return ResidualEvidence(_median(strengths), _median(shifts_px), flow_pixels)


def _median(maps: FloatArray) -> FloatArray:
    """The median [H, W] of maps [K, H, W], by a sorting network: numpy's takes ten times as long
    for so few.
    """
    ranked = list(maps)
    for end in range(len(ranked) - 1, 0, -1):
        for k in range(end):
            ranked[k : k + 2] = np.minimum(*ranked[k : k + 2]), np.maximum(*ranked[k : k + 2])
    return np.asarray((ranked[(len(ranked) - 1) // 2] + ranked[len(ranked) // 2]) / 2)


def equalise_exposure(
    images: FloatArray,  # [P, H, W]
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    inverse_depth: FloatArray,  # [H, W] of the last frame
    steps: tuple[int, ...],
) -> FloatArray:
    """The images with those `steps` before the last one brought to its gain and offset, fitted to
    static points.

    There is one gain and one offset for an image: local corrections would bleed over the edges of
    objects.
    """
    equal = images.copy()
    some = (slice(None, None, EXPOSURE_STRIDE_PX),) * 2
    last = images[-1][some].ravel()

    def equalise(step: int) -> None:
        between = Epipolar.of(camera, cam_from_last(world_from_cam, step))
        static_pixels, _ = between.project(inverse_depth[some], EXPOSURE_STRIDE_PX)
        warped = _sample(images[-1 - step], static_pixels).ravel()
        kept = np.ones(len(last), dtype=bool)
        gain, offset = 1.0, 0.0
        for _ in range(EXPOSURE_ROUNDS):
            residual = np.abs(gain * warped + offset - last)
            kept = residual <= 2 * np.median(residual) + 1
            gain, offset = _fit_line(warped[kept], last[kept])
        equal[-1 - step] = gain * images[-1 - step] + offset

    parallel_map(equalise, steps)
    return equal


def _fit_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
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


def _road_limit(camera: Intrinsics, ground: GroundPlane | None) -> FloatArray:
    """The least inverse depth [H, W] of points not below the road; 0 beyond the near road and
    without one.
    """
    if ground is None:
        return np.zeros((camera.height_px, camera.width_px), np.float32)
    road = ground.inverse_depth(camera)
    return np.where(road * ground.height > 1 / HORIZON_HEIGHTS, BELOW_ROAD * road, np.float32(0))


def _test_frame(
    step: int,
    images: FloatArray,
    camera: Intrinsics,
    world_from_cam: FloatArray,
    static_depth: FloatArray,  # [H, W]
    lowest: FloatArray,  # [H, W]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strength and shift [H, W], 0 where the flow leaves the earlier image, and the flow's pixels
    [H, W, 2].
    """
    pair = images[[-1, -1 - step]]
    last, earlier = pair
    between = Epipolar.of(camera, cam_from_last(world_from_cam, step))
    static_pixels, _ = between.project(static_depth)
    flow_pixels, flow_error = _flow(
        pair, pinhole.pixel_grid(camera).astype(np.float32), static_pixels
    )
    nearest_pixels, _ = between.project(np.maximum(between.triangulate(flow_pixels), lowest))
    candidates = static_pixels, nearest_pixels
    static_error = np.minimum(*(grey_difference(last, earlier, pixels) for pixels in candidates))
    shift_px = np.minimum(*(_length(pixels - flow_pixels) for pixels in candidates))
    visible = inside(flow_pixels, camera)
    strength = (static_error - flow_error) / (flow_error + np.float32(GREY_NOISE))
    return (
        np.where(visible, strength, np.float32(0)),
        np.where(visible, shift_px, np.float32(0)),
        flow_pixels,
    )


def _flow(
    pair: FloatArray, grid: FloatArray, static_pixels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where the last image's pixels are in the earlier one [H, W, 2], and the grey difference there
    [H, W].

    Dense inverse search (Kroeger 2016), from zero flow and from the flow of a static scene; the
    better counts.
    """
    last, earlier = np.clip(pair, 0, 255).astype(np.uint8)
    start = [
        cv2.medianBlur(np.ascontiguousarray((static_pixels - grid)[..., axis]), SMOOTHING_PX)
        for axis in (0, 1)
    ]

    def search(first: FloatArray) -> tuple[FloatArray, FloatArray]:
        place = grid + cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(
            last, earlier, first
        )
        return place, grey_difference(pair[0], pair[1], place)

    starts: list[FloatArray] = [np.zeros_like(grid), np.stack(start, axis=-1)]
    places, differences = zip(*parallel_map(search, starts), strict=True)
    from_rest = differences[0] < differences[1]
    return np.where(from_rest[..., None], *places), np.minimum(*differences)


def grey_difference(
    last: FloatArray,  # [H, W]
    earlier: FloatArray,  # [H, W]
    place: FloatArray,  # [H, W, 2] float32
    window_px: int = WINDOW_PX,
) -> FloatArray:
    """Mean absolute grey difference [H, W] between the last image and the earlier one at the pixels
    `place`.
    """
    return np.asarray(cv2.blur(np.abs(_sample(earlier, place) - last), (window_px, window_px)))


def _length(steps: FloatArray) -> FloatArray:
    return np.sqrt(steps[..., 0] ** 2 + steps[..., 1] ** 2)


def _sample(image: FloatArray, place: FloatArray) -> FloatArray:
    u, v = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
    return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

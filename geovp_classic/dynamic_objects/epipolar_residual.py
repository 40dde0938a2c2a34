"""Evidence of motion: pixels of the last frame that no static point on or above the road explains.

A static point may lie at any distance from the road's surface to infinity. Where it appears in an
earlier frame is therefore a piece of its epipolar line (Hartley & Zisserman 2004, eq. 13.2); a
pixel that is found elsewhere moves by itself. The images decide: the best static correspondence
must match worse than the one of optical flow.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.dynamic_objects.posed_images import (
    PosedImages,
    grey_difference,
)
from geovp_classic.geometry import pinhole
from geovp_classic.geometry.epipolar import Epipolar, inside
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True)
class EpipolarResidual:
    """Comparison of the best static correspondence with that of optical flow."""

    # Excess of the static grey difference over that of the flow, relative to the latter.
    min_strength: float = 0.7
    min_shift_px: float = 1.0  # of the flow from the static correspondence
    window_px: int = 5  # over which grey differences are averaged
    grey_noise: float = 4.0  # grey difference due to noise
    smoothing_px: int = 5  # of the static flow that the search starts from
    # A static point has at least this fraction of the road's inverse depth: roads are not flat.
    min_road_fraction: float = 0.85

    def evidence(self, observed: PosedImages) -> tuple[BoolArray, FloatArray]:
        """Return the pixels that move by themselves [H, W], and the optical flow.

        The median over earlier frames is robust to single chance matches. The flow is given as
        pixels (u, v) of the earlier frames [K, H, W, 2].
        """
        limit = self._road_limit(observed)
        tests = parallel_map(
            lambda step: self._test_frame(observed, step, limit), observed.steps
        )
        strengths, shifts_px, flow_pixels = (
            np.stack(maps) for maps in zip(*tests, strict=True)
        )
        is_strong = np.median(strengths, axis=0) > self.min_strength
        is_shifted = np.median(shifts_px, axis=0) > self.min_shift_px
        return is_strong & is_shifted, flow_pixels

    def _road_limit(self, observed: PosedImages) -> FloatArray:
        """Return the lowest inverse depth [H, W] of static points; 0 beyond the near road."""
        road = observed.road.inverse_depth(observed.camera)
        is_near = observed.road.is_near(road)
        return np.where(is_near, self.min_road_fraction * road, np.float32(0))

    def _test_frame(
        self, observed: PosedImages, step: int, limit: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return strength and shift [H, W] in one earlier frame, and the flow's pixels [H, W, 2].

        Strength and shift are 0 where the flow leaves the image.
        """
        last = observed.images[-1]
        earlier = observed.images[-1 - step]
        epipolar = Epipolar.of(observed.camera, observed.cam_from_last(step))
        static_pixels, _ = epipolar.project(
            np.maximum(observed.inverse_depth, limit)
        )
        flow_pixels = self._flow(observed, last, earlier, static_pixels)
        flow_difference = grey_difference(
            last, earlier, flow_pixels, self.window_px
        )
        nearest_depth = np.maximum(epipolar.triangulate(flow_pixels), limit)
        nearest_pixels, _ = epipolar.project(nearest_depth)
        static_difference = np.minimum(
            grey_difference(last, earlier, static_pixels, self.window_px),
            grey_difference(last, earlier, nearest_pixels, self.window_px),
        )
        shift_px = np.minimum(
            np.linalg.norm(static_pixels - flow_pixels, axis=-1),
            np.linalg.norm(nearest_pixels - flow_pixels, axis=-1),
        )
        excess = static_difference - flow_difference
        strength = excess / (flow_difference + np.float32(self.grey_noise))
        is_visible = inside(flow_pixels, observed.camera)
        strength = np.where(is_visible, strength, 0)
        shift_px = np.where(is_visible, shift_px, 0)
        return strength, shift_px, flow_pixels

    def _flow(
        self,
        observed: PosedImages,
        last: FloatArray,
        earlier: FloatArray,
        static: FloatArray,
    ) -> FloatArray:
        """Return correspondences [H, W, 2] of the last image in an earlier one.

        Dense inverse search (Kroeger 2016) starts from the flow of a static scene.
        """
        grid = pinhole.pixel_grid(observed.camera).astype(np.float32)
        start = [
            cv2.medianBlur(axis, self.smoothing_px)
            for axis in cv2.split(static - grid)
        ]
        search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        flow = search.calc(_bytes(last), _bytes(earlier), cv2.merge(start))
        return np.asarray(grid + flow, np.float32)


def _bytes(image: FloatArray) -> ByteArray:
    return np.clip(image, 0, 255).astype(np.uint8)

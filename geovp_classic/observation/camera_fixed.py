"""Camera-fixed pixels: hood, dashboard, pillar, time stamp, logo.

A textured pixel is fixed to the camera if it stays in place, to a thousandth of what the rest of
the image moves. Far scenery and edges along the motion seem to stay, too, but the camera's own
shake moves them by more; only a camera that never turns would show them like this. A region without
texture gives no evidence. It is camera-fixed only if pixels that are, and the border of the image,
enclose it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.geometry.optical_flow import dense_flow
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray


class _Edges(NamedTuple):
    """Edges of the mean image by cells, and their shifts over the frames."""

    strength: FloatArray  # [h, w], rms gradient across the edge, grey values per pixel
    shift_px: FloatArray  # [h, w], rms over the frames, across the edge
    pixel_strength: FloatArray  # [H, W], gradient
    pixel_change: FloatArray  # [H, W], standard deviation over the frames, grey values


@dataclass(frozen=True)
class CameraFixedDetection:
    """Detection of camera-fixed pixels in grey images; grey values are 0..255.

    Thresholds were chosen on videos of other cameras and on KITTI's train and val clips, where
    nothing may be found.
    """

    min_frames: int = 4
    max_width_px: int = 320  # wider images are reduced
    cell_px: int = 4  # evidence is gathered in windows of three by three cells
    # rms shift of an edge over the frames, as a fraction of the motion of the rest of the image
    max_shift_fraction: float = 0.001
    # the same of edges that continue an evident one
    max_continued_shift_fraction: float = 0.005
    # rms change of grey values over the gradient; larger for edges that are not the same ones
    max_noise_px: float = 0.4
    min_gradient: float = 1.5  # grey values per pixel, of a textured cell
    min_motion_px: float = 3.0  # of the rest of the image, from the first to the last frame
    # Quantile of the textured cells whose motion is that of the rest of the image. At most half of
    # them are fixed to the camera, so that this is the median of the others or more. Set by hand.
    motion_quantile: float = 0.75
    min_evident_fraction: float = 0.002  # of the cells, in each region
    max_still_change: float = 4.0  # grey values, standard deviation without texture
    max_fraction: float = 0.5  # of the image; where more stays in place, the camera does
    # of the outline of a region without texture that is evident or a border
    min_enclosed_fraction: float = 0.75

    def detect(
        self,
        greys: ByteArray,  # [P, H, W], usable frames
    ) -> BoolArray:
        """Return the mask [H, W] of camera-fixed pixels."""
        height, width = greys.shape[1:]
        nothing = np.zeros((height, width), bool)
        scale = min(1.0, self.max_width_px / width)
        size_px = round(width * scale), round(height * scale)
        if len(greys) < self.min_frames or min(size_px) < 8 * self.cell_px:
            return nothing
        if scale < 1:
            greys = np.stack(
                [cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA) for grey in greys]
            )

        edges = self._edges(greys)
        x, y = pinhole.gradient(greys[-1].astype(np.float32))
        is_textured = np.sqrt(self._windows(x * x + y * y)) > self.min_gradient
        if not is_textured.any():
            return nothing
        motion_px = float(np.quantile(self._motion(greys)[is_textured], self.motion_quantile))
        if motion_px < self.min_motion_px:
            return nothing

        # Textured edges stay in place.
        is_evident = edges.strength > self.min_gradient
        is_evident &= edges.shift_px < self.max_shift_fraction * motion_px

        # Weaker edges continue evident ones.
        is_still = edges.strength > self.min_gradient / 2
        is_still &= edges.shift_px < self.max_continued_shift_fraction * motion_px
        num_regions, regions = cv2.connectedComponents(is_still.astype(np.uint8))
        num_evident = np.bincount(regions[is_evident & is_still], minlength=num_regions)
        is_region = num_evident >= max(3, self.min_evident_fraction * regions.size)
        is_region[0] = False
        if not is_region.any():
            return nothing
        cells = is_region[regions]
        mask = self._pixels(edges, cells)
        if mask.mean() > self.max_fraction:
            return nothing
        return pinhole.resize_mask(mask, (width, height))

    def _edges(self, greys: ByteArray) -> _Edges:
        """Return the edges of the mean image and by how much each frame shows them elsewhere.

        The shift across an edge is the least-squares one (Lucas & Kanade 1981), with a free offset
        of brightness in each window.
        """
        frames = [cv2.GaussianBlur(grey, (3, 3), 0).astype(np.float32) for grey in greys]
        mean = np.mean(frames, axis=0)
        square_change = np.zeros_like(mean)
        for frame in frames:
            cv2.accumulateSquare(frame - mean, square_change)
        pixel_change = np.sqrt(square_change / len(frames))
        x, y = pinhole.gradient(mean)
        pixel_strength = cv2.magnitude(x, y)

        # Pixels that change, and their neighbours, show the scene and take no part.
        is_changing = pixel_change > self.max_still_change
        is_changing &= pixel_change > self.max_noise_px * pixel_strength
        near = cv2.dilate(is_changing.view(np.uint8), np.ones((3, 3), np.uint8))
        weights = 1 - near.astype(np.float32)
        num_same = self._windows(weights) + 1e-6
        x, y = x * weights, y * weights
        sum_x, sum_y = self._windows(x), self._windows(y)
        xx = self._windows(x * x) - sum_x**2 / num_same
        xy = self._windows(x * y) - sum_x * sum_y / num_same
        yy = self._windows(y * y) - sum_y**2 / num_same
        strength = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)  # larger eigenvalue
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        across = np.stack([np.cos(angle), np.sin(angle)])
        square_shift = np.zeros_like(strength)
        for frame in frames:
            change = (frame - mean) * weights
            mean_change = self._windows(change) / num_same
            moment = across[0] * (self._windows(x * change) - sum_x * mean_change)
            moment += across[1] * (self._windows(y * change) - sum_y * mean_change)
            square_shift += moment * moment
        floor = 1e-2  # grey values per pixel, squared
        return _Edges(
            np.sqrt(np.maximum(strength, 0)),
            np.sqrt(square_shift / len(frames)) / (strength + floor),
            pixel_strength,
            pixel_change,
        )

    def _windows(self, values: FloatArray) -> FloatArray:
        """Return the means [h, w] of windows of three by three cells."""
        height, width = values.shape
        size = width // self.cell_px, height // self.cell_px
        return cv2.blur(cv2.resize(values, size, interpolation=cv2.INTER_AREA), (3, 3))

    def _motion(self, greys: ByteArray) -> FloatArray:
        """Return the length [h, w] of the image motion over all frames, from a few pairs."""
        size_px = greys.shape[2] // 2, greys.shape[1] // 2
        half = [cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA) for grey in greys]
        preset = cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST
        steps = np.unique(np.linspace(0, len(greys) - 2, 4).round().astype(int))
        flows = [dense_flow(half[step], half[step + 1], preset) for step in steps]
        flow_px = 2 * (len(greys) - 1) * np.mean(flows, axis=0)
        cells = greys.shape[2] // self.cell_px, greys.shape[1] // self.cell_px
        return np.linalg.norm(cv2.resize(flow_px, cells, interpolation=cv2.INTER_AREA), axis=-1)

    def _pixels(self, edges: _Edges, cells: BoolArray) -> BoolArray:
        """Return the pixels [H, W] of camera-fixed cells, and of regions that they enclose."""
        shape = edges.pixel_change.shape
        is_inside = pinhole.resize_mask(cells, shape[::-1])
        is_edge = is_inside & (edges.pixel_strength > self.min_gradient)
        is_edge &= edges.pixel_change < self.max_noise_px * edges.pixel_strength
        mask = cv2.morphologyEx(is_edge.view(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5))) > 0

        # Regions without texture and change between camera-fixed edges and the border.
        is_plain = (edges.pixel_change < self.max_still_change) & ~mask
        is_plain &= edges.pixel_strength < 2 * self.min_gradient
        num_regions, regions = cv2.connectedComponents(is_plain.astype(np.uint8), connectivity=4)
        outline, evident = _outlines(regions, mask, num_regions)
        is_enclosed = evident >= self.min_enclosed_fraction * outline
        at_border = np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]])
        is_enclosed &= np.bincount(at_border, minlength=num_regions) > 0
        is_enclosed[0] = False
        mask |= is_enclosed[regions]
        closed = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        return self._without_holes(closed > 0, edges.pixel_change)

    def _without_holes(self, mask: BoolArray, pixel_change: FloatArray) -> BoolArray:
        """Return a mask [H, W] with the parts that it and the border enclose.

        They are smaller than the mask, and most of their pixels do not change: not the scene beside
        a pillar.
        """
        num_parts, parts, statistics, _ = cv2.connectedComponentsWithStats(
            (~mask).view(np.uint8), connectivity=4
        )
        area = statistics[:, cv2.CC_STAT_AREA]
        is_still = pixel_change < self.max_still_change
        num_still = np.bincount(parts.ravel(), weights=is_still.ravel(), minlength=num_parts)
        is_hole = (area < mask.sum()) & (num_still > area / 2)
        return is_hole[parts] | mask


def _outlines(regions: IntArray, mask: BoolArray, num_regions: int) -> tuple[IntArray, IntArray]:
    """Return the lengths of outlines [R] of regions [H, W], and of their parts at a mask."""
    # No pixel of the mask, and none outside of the image, is in a region
    padded = np.pad(regions, 1)
    closed = np.pad(mask, 1, constant_values=True)
    height, width = regions.shape
    outline, evident = np.zeros((2, num_regions), np.int64)
    for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
        neighbours = np.s_[row : row + height, column : column + width]
        outline += np.bincount(regions[padded[neighbours] != regions], minlength=num_regions)
        evident += np.bincount(regions[closed[neighbours]], minlength=num_regions)
    return outline, evident

"""Regions of the last frame that move on their own, such as a car ahead.

A region moves on its own if a constant motion of its own in the image explains the frames before
better than the static scene does, and the static scene explains it worse than the rest of the
image. Textured pixels show that; the region's motion as a whole then decides on the others around
it, along the edges of the image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.geometry.optical_flow import dense_flow
from geovp_classic.layers.region_motion import (
    EarlierFrame,
    RegionMotion,
    aligned,
    common_motion,
    pixels_of,
)
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Trajectory
from geovp_classic.types.layers import MovingPatch


class _Explanations(NamedTuple):
    """Mean differences [H, W] of the last frame from earlier ones, in grey values."""

    static: FloatArray
    moved: FloatArray
    contrast: FloatArray  # [H, W], standard deviation of windows of the last frame
    is_seen: BoolArray  # [H, W], in most of the earlier frames
    parallax_px: FloatArray  # largest distance between both explanations
    # [H, W, 2], own motion into the past, without the rotation of the camera
    motion_px_s: FloatArray


@dataclass(frozen=True)
class MovingRegions:
    """Detection of moving regions from dense flow, depth and poses; grey values are 0..255.

    Settings were chosen on videos of other cameras and on KITTI's train and val clips.
    """

    strides: tuple[int, ...] = (1, 2, 4, 6)  # usable frames back from the last one
    window_px: int = 7  # in which differences are averaged
    min_parallax_px: float = 2.0  # largest distance between a pixel's places in both explanations
    # Standard deviation of a textured window, and the part of it that the own motion may leave.
    min_contrast: float = 5.0
    max_own_ratio: float = 0.55
    # Of the image. In 178 clips of the videos and of KITTI's train and val, most smaller regions
    # were leaves, shadows and drops of rain.
    min_area_fraction: float = 0.003
    # Inverse depth over that of the ground: less lies below it, beyond the error of both
    max_below_ratio: float = 0.7
    min_isotropy: float = 0.1  # of the gradients of a region: 1 for corners, 0 for parallel edges
    # Mean difference that the static scene leaves in a region, over the median of the image.
    min_static_ratio: float = 2.0
    # Distance of the flow from a similarity, at the farthest frame; half of a region must keep it.
    max_misfit_px: float = 2.5
    # Of a region's larger side: how far around it pixels may belong to it. Set by hand.
    margin: float = 0.25
    # The outline, in grey values. Chosen on the synthetic street and by the look of cars in the
    # videos: half or twice of each changes precision and recall on the street by up to .06.
    max_difference: float = 15.0  # of a pixel from an earlier frame; more is no more evidence
    static_prior: float = 1.0  # without evidence a pixel is static
    smoothness: float = 400.0  # weight of the squared differences of neighbours' evidence
    edge_grey: float = 3.0  # difference of grey values at which the weight is 1 / e of that
    min_inverse_depth: float = 0.002  # over the mean step of the camera; farther ones count as this

    def detect(
        self,
        greys: ByteArray,  # [P, H, W]
        past: Trajectory,
        camera: Intrinsics,
        inverse_depth: FloatArray,  # [H, W], of the last frame
        ground: FloatArray | None = None,  # [H, W], inverse depth of the ground; 0 above it
    ) -> list[MovingPatch]:
        """Return the moving patches of the last frame, without overlap."""
        strides = [stride for stride in self.strides if stride < len(greys)]
        step_lengths = se3.step_lengths(past.world_from_cam)
        if len(strides) < 2 or not step_lengths.any():
            return []

        # No static surface lies below the ground. A car ahead at the camera's speed seems to: it
        # has no parallax.
        below = np.zeros(inverse_depth.shape, bool)
        static_depth = inverse_depth
        if ground is not None:
            below = inverse_depth < self.max_below_ratio * ground
            static_depth = np.maximum(inverse_depth, ground)
        earlier = [self._earlier(greys, past, camera, static_depth, stride) for stride in strides]
        explained = self._explain(greys[-1], earlier)

        candidates = self._candidates(explained, below)

        # Regions whose own motion explains the frames before. Parallel edges, such as a kerb, do
        # not show their motion along themselves (aperture problem).
        gradients = np.stack(pinhole.gradient(greys[-1]), axis=-1)
        num_regions, regions, statistics, _ = cv2.connectedComponentsWithStats(candidates)
        min_area = self.min_area_fraction * candidates.size
        nearest = self.min_inverse_depth / float(step_lengths.mean())
        is_taken = np.zeros(candidates.shape, bool)
        patches = []
        for region in range(1, num_regions):
            if statistics[region, cv2.CC_STAT_AREA] < min_area:
                continue
            mask = regions == region
            if not self._contradicts_scene(mask, explained, min_area):
                continue
            if self._isotropy(gradients, mask) < self.min_isotropy:
                continue
            motion = common_motion(
                mask, explained.motion_px_s, earlier[-1].elapsed_s, self.max_misfit_px
            )
            if motion is None:
                continue
            # The whole object that moves so; nothing, if its outline is better explained without.
            motion = aligned(motion, mask, greys[-1], earlier)
            mask = self._outlined(mask, motion, greys[-1], earlier) & ~is_taken
            if mask.sum() < min_area:
                continue
            is_taken |= mask
            motion = aligned(motion, mask, greys[-1], earlier)
            shown_depth = max(float(np.median(inverse_depth[mask])), nearest)
            patches.append(self._patch(mask, motion, shown_depth, past, camera, strides[-1]))
        return patches

    def _is_textured(self, explained: _Explanations) -> BoolArray:
        """Return which pixels [H, W] can tell a right explanation from a wrong one."""
        return (explained.contrast > self.min_contrast) & explained.is_seen

    def _candidates(self, explained: _Explanations, below: BoolArray) -> ByteArray:
        """Return where [H, W] the own motion explains more than the static scene: 1, else 0.

        Such pixels are textured, or lie below the ground.
        """
        is_textured = self._is_textured(explained)
        is_textured &= explained.moved < self.max_own_ratio * explained.contrast
        is_textured &= explained.parallax_px > self.min_parallax_px
        is_moving = (is_textured | below) & (explained.moved < explained.static)
        # Without gaps and specks
        square = np.ones((self.window_px, self.window_px), np.uint8)
        closed = cv2.morphologyEx(is_moving.view(np.uint8), cv2.MORPH_CLOSE, square)
        return np.asarray(cv2.morphologyEx(closed, cv2.MORPH_OPEN, square))

    @staticmethod
    def _isotropy(gradients: FloatArray, mask: BoolArray) -> float:
        """Return the ratio of the eigenvalues of a region's structure tensor."""
        smaller, larger = np.linalg.eigvalsh(gradients[mask].T @ gradients[mask])
        return float(smaller / max(larger, 1e-9))

    def _contradicts_scene(
        self, mask: BoolArray, explained: _Explanations, min_area: float
    ) -> bool:
        """Return whether the static scene explains a region much worse than the whole image.

        Where poses, depth or the light are uncertain, it leaves differences everywhere. Only pixels
        that were seen, and that the two explanations put at different places, tell them apart.
        """
        is_used = mask & explained.is_seen & (explained.parallax_px > self.min_parallax_px)
        is_textured = self._is_textured(explained)
        if is_used.sum() < min_area or not is_textured.any():
            return False
        typical = np.median(explained.static[is_textured])
        return bool(explained.static[is_used].mean() > self.min_static_ratio * typical)

    def _earlier(
        self,
        greys: ByteArray,
        past: Trajectory,
        camera: Intrinsics,
        inverse_depth: FloatArray,
        stride: int,
    ) -> EarlierFrame:
        """Return an earlier frame with the places of the static scene in it."""
        pose, last_pose = past.world_from_cam[[-1 - stride, -1]]
        earlier_from_last = se3.inverse(pose) @ last_pose
        rotation = camera.matrix @ earlier_from_last[:3, :3] @ np.linalg.inv(camera.matrix)
        static_px, ratio = Epipolar.of(camera, earlier_from_last, camera).project(inverse_depth)
        elapsed_s = float(past.times_s[-1] - past.times_s[-1 - stride])
        return EarlierFrame(greys[-1 - stride], elapsed_s, rotation, static_px, ratio > 0)

    def _explain(self, last: ByteArray, earlier: Sequence[EarlierFrame]) -> _Explanations:
        """Compare the last frame with earlier ones, by the static scene and by its own motion."""
        # What the rotation of the camera leaves of the flow is a constant motion in the image
        # (least squares).
        pixels = pixels_of(last)
        motion_px_s = np.zeros_like(pixels)
        for frame in earlier:
            flow = dense_flow(last, frame.image, cv2.DISOPTICAL_FLOW_PRESET_FAST)
            back = cv2.perspectiveTransform(pixels + flow, np.linalg.inv(frame.rotation))
            motion_px_s += np.float32(frame.elapsed_s) * (back - pixels)
        motion_px_s /= np.float32(sum(frame.elapsed_s**2 for frame in earlier))

        # Where each explanation finds the pixels in the earlier frames, and how they differ there.
        static, moved, num_seen, parallax_px = np.zeros((4, *last.shape), np.float32)
        for frame in earlier:
            moved_px = frame.moved_px(pixels, motion_px_s)
            is_seen = frame.is_in_front & frame.shows(frame.static_px) & frame.shows(moved_px)
            num_seen += is_seen
            static += self._differences(last, frame.image, frame.static_px) * is_seen
            moved += self._differences(last, frame.image, moved_px) * is_seen
            distance_px = cv2.magnitude(*cv2.split(frame.static_px - moved_px)) * is_seen
            parallax_px = np.maximum(parallax_px, distance_px)
        count = np.maximum(num_seen, 1)
        is_seen = num_seen > len(earlier) / 2
        contrast = self._contrast(last)
        return _Explanations(
            static / count, moved / count, contrast, is_seen, parallax_px, motion_px_s
        )

    def _outlined(
        self,
        mask: BoolArray,  # [H, W]
        motion: RegionMotion,
        last: ByteArray,
        earlier: Sequence[EarlierFrame],
    ) -> BoolArray:
        """Return the region [H, W] around a mask that moves with it.

        It consists of pixels that the motion explains better than the static scene does. Evidence
        spreads to pixels without any, up to the edges of the image (weighted least squares; Min et
        al. 2014).
        """
        rows, columns = np.nonzero(mask)
        margin = int(self.margin * max(np.ptp(rows), np.ptp(columns)))
        box = tuple(
            slice(max(places.min() - margin, 0), places.max() + margin + 1)
            for places in (rows, columns)
        )
        pixels = pixels_of(last)[box]
        motion_px_s = motion.at(pixels)
        evidence, num_seen = np.zeros((2, *pixels.shape[:2]), np.float32)
        for frame in earlier:
            static_px, moved_px = frame.static_px[box], frame.moved_px(pixels, motion_px_s)
            is_seen = frame.is_in_front[box] & frame.shows(static_px) & frame.shows(moved_px)
            num_seen += is_seen
            for places, sign in ((moved_px, 1), (static_px, -1)):
                difference = self._differences(last[box], frame.image, places)
                evidence += sign * np.minimum(difference, self.max_difference) * is_seen
        cost = self.static_prior + evidence / np.maximum(num_seen, 1)
        image = np.ascontiguousarray(last[box])
        smooth_cost = cv2.ximgproc.fastGlobalSmootherFilter(
            image, cost, self.smoothness, self.edge_grey
        )
        is_inside = smooth_cost < 0
        # The part of it that holds most of the mask.
        _, parts = cv2.connectedComponents(is_inside.view(np.uint8))
        in_part = np.bincount(parts[mask[box] & is_inside], minlength=1)
        outlined = np.zeros_like(mask)
        outlined[box] = is_inside & (parts == in_part.argmax())
        return outlined

    def _contrast(self, image: ByteArray) -> FloatArray:
        """Return the standard deviations [H, W] of windows of an image."""
        size = (self.window_px, self.window_px)
        mean = cv2.boxFilter(image, cv2.CV_32F, size)
        variance = cv2.sqrBoxFilter(image, cv2.CV_32F, size) - mean**2
        return np.asarray(np.sqrt(np.maximum(variance, 0)))

    def _differences(self, last: ByteArray, earlier: ByteArray, pixels: FloatArray) -> FloatArray:
        """Return the mean differences [H, W] of windows of the last frame from an earlier one."""
        warped = cv2.remap(earlier, pixels, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        difference = cv2.absdiff(last, warped).astype(np.float32)
        return np.asarray(cv2.blur(difference, (self.window_px, self.window_px)))

    @staticmethod
    def _patch(
        mask: BoolArray,
        motion: RegionMotion,
        inverse_depth: float,
        past: Trajectory,
        camera: Intrinsics,
        stride: int,
    ) -> MovingPatch:
        """Return a region with the velocity that explains its motion and growth at this depth."""
        seconds = float(past.times_s[-1] - past.times_s[-1 - stride])
        matrix = np.linalg.inv(camera.matrix)
        ray = matrix @ [*motion.middle, 1]
        earlier_ray = matrix @ [*(motion.middle + seconds * motion.shift_px_s), 1]
        depth = 1 / inverse_depth
        size = 1 + motion.growth_per_s * seconds
        earliest, last = past.world_from_cam[[-1 - stride, -1]]
        rotation = last[:3, :3]
        now = last[:3, 3] + rotation @ (depth * ray)
        before = earliest[:3, 3] + rotation @ (depth / size * earlier_ray)
        return MovingPatch(mask, inverse_depth, (now - before) / seconds)

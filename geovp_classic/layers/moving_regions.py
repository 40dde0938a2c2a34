"""Regions of the last frame that move on their own, such as a car ahead.

A region moves on its own if a constant motion of its own in the image explains the frames before
clearly better than the static scene does.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.geometry.optical_flow import dense_flow
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Trajectory
from geovp_classic.types.layers import MovingPatch


class _Explanations(NamedTuple):
    """Mean differences [H, W] of the last frame from earlier ones, in grey values."""

    static: FloatArray
    moved: FloatArray
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
    # The own motion must leave less than this part of the static scene's difference, and less by
    # this many grey values.
    max_difference_ratio: float = 0.6
    min_gain: float = 4.0
    min_parallax_px: float = 2.0
    # Standard deviation of a textured window, and the part of it that the own motion may leave.
    min_contrast: float = 5.0
    max_own_ratio: float = 0.55
    # Of the image. In 178 clips of the videos and of KITTI's train and val, most smaller regions
    # were leaves, shadows and drops of rain.
    min_area_fraction: float = 0.003
    # Inverse depth over that of the ground: less lies below it, beyond the error of both
    max_below_ratio: float = 0.7
    min_isotropy: float = 0.1  # of the gradients of a region: 1 for corners, 0 for parallel edges
    # Median distance of the flow from a translation and a scale, at the farthest frame.
    max_misfit_px: float = 2.5
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
        explained = self._explain(greys, past, camera, static_depth, strides)

        # Candidates: textured pixels that clearly move on their own ...
        is_moving = explained.moved < self.max_difference_ratio * explained.static
        is_moving &= explained.static - explained.moved > self.min_gain
        is_moving &= explained.parallax_px > self.min_parallax_px
        is_moving &= explained.is_seen
        contrast = self._contrast(greys[-1])
        is_moving &= contrast > self.min_contrast
        is_moving &= explained.moved < self.max_own_ratio * contrast
        # ... and pixels below the ground that do not fit it any better, without gaps and specks.
        is_moving |= below & (explained.moved < explained.static)
        square = np.ones((self.window_px, self.window_px), np.uint8)
        candidates = cv2.morphologyEx(is_moving.view(np.uint8), cv2.MORPH_CLOSE, square)
        candidates = cv2.morphologyEx(candidates, cv2.MORPH_OPEN, square)

        # Regions whose own motion explains the frames before. Parallel edges, such as a kerb, do
        # not show their motion along themselves (aperture problem).
        gradients = np.stack(
            [cv2.Sobel(greys[-1], cv2.CV_32F, dx, 1 - dx) for dx in (1, 0)], axis=-1
        )
        num_regions, regions, statistics, _ = cv2.connectedComponentsWithStats(candidates)
        min_area = self.min_area_fraction * candidates.size
        max_s = float(past.times_s[-1] - past.times_s[-1 - strides[-1]])
        nearest = self.min_inverse_depth / float(step_lengths.mean())
        patches = []
        for region in range(1, num_regions):
            if statistics[region, cv2.CC_STAT_AREA] < min_area:
                continue
            mask = regions == region
            if not self._moves(mask, explained, min_area):
                continue
            if self._isotropy(gradients, mask) < self.min_isotropy:
                continue
            shown_depth = max(float(np.median(inverse_depth[mask])), nearest)
            patch = self._patch(mask, explained.motion_px_s, shown_depth, past, camera, max_s)
            if patch is not None:
                patches.append(patch)
        return patches

    @staticmethod
    def _isotropy(gradients: FloatArray, mask: BoolArray) -> float:
        """Return the ratio of the eigenvalues of a region's structure tensor."""
        smaller, larger = np.linalg.eigvalsh(gradients[mask].T @ gradients[mask])
        return float(smaller / max(larger, 1e-9))

    def _moves(self, mask: BoolArray, explained: _Explanations, min_area: float) -> bool:
        """Return whether the own motion of a region explains what the static scene does not.

        Only pixels that were seen, and that the two put at different places, tell them apart.
        """
        is_used = mask & explained.is_seen & (explained.parallax_px > self.min_parallax_px)
        if is_used.sum() < min_area:
            return False
        static, moved = explained.static[is_used].mean(), explained.moved[is_used].mean()
        return bool(moved < self.max_difference_ratio * static and static - moved > self.min_gain)

    def _explain(
        self,
        greys: ByteArray,
        past: Trajectory,
        camera: Intrinsics,
        inverse_depth: FloatArray,
        strides: list[int],
    ) -> _Explanations:
        """Compare the last frame with earlier ones, by the static scene and by its own motion."""
        last = greys[-1]
        pixels = np.stack(np.meshgrid(*map(np.arange, last.shape[::-1])), axis=-1)
        pixels = pixels.astype(np.float32)

        # Where the rotation of the camera alone takes the pixels: K R K^-1. What is left of the
        # flow is a constant motion in the image (least squares).
        elapsed_s = [float(past.times_s[-1] - past.times_s[-1 - stride]) for stride in strides]
        rotated = [self._rotated(past, stride, camera) for stride in strides]
        motion_px_s = np.zeros((*last.shape, 2), np.float32)
        for stride, time_s, homography in zip(strides, elapsed_s, rotated, strict=True):
            earlier = greys[-1 - stride]
            matched = pixels + dense_flow(last, earlier, cv2.DISOPTICAL_FLOW_PRESET_FAST)
            back = cv2.perspectiveTransform(matched, np.linalg.inv(homography))
            motion_px_s += np.float32(time_s) * (back - pixels)
        motion_px_s /= np.float32(sum(time_s**2 for time_s in elapsed_s))

        # Where each explanation finds the pixels in the earlier frames, and how they differ there.
        static, moved_difference, num_seen, parallax_px = np.zeros((4, *last.shape), np.float32)
        for stride, time_s, homography in zip(strides, elapsed_s, rotated, strict=True):
            earlier = greys[-1 - stride]
            pose, last_pose = past.world_from_cam[[-1 - stride, -1]]
            earlier_from_last = se3.inverse(pose) @ last_pose
            projected, ratio = Epipolar.of(camera, earlier_from_last, camera).project(inverse_depth)
            moved = cv2.perspectiveTransform(pixels + np.float32(time_s) * motion_px_s, homography)
            is_seen = (ratio > 0) & _is_inside(projected, last.shape)
            is_seen &= _is_inside(moved, last.shape)
            num_seen += is_seen
            static += self._differences(last, earlier, projected) * is_seen
            moved_difference += self._differences(last, earlier, moved) * is_seen
            distance_px = cv2.magnitude(*cv2.split(projected - moved)) * is_seen
            parallax_px = np.maximum(parallax_px, distance_px)
        count = np.maximum(num_seen, 1)
        is_seen = num_seen > len(strides) / 2
        return _Explanations(
            static / count, moved_difference / count, is_seen, parallax_px, motion_px_s
        )

    def _rotated(self, past: Trajectory, stride: int, camera: Intrinsics) -> FloatArray:
        """Return the homography [3, 3] from the last frame to an earlier one, of far points."""
        earlier, last = past.world_from_cam[[-1 - stride, -1], :3, :3]
        return camera.matrix @ earlier.T @ last @ np.linalg.inv(camera.matrix)

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

    def _patch(
        self,
        mask: BoolArray,
        motion_px_s: FloatArray,  # [H, W, 2], into the past
        inverse_depth: float,
        past: Trajectory,
        camera: Intrinsics,
        max_s: float,
    ) -> MovingPatch | None:
        """Return a region as a patch; None unless it moves by a translation and a scale."""
        # The flow of the region as that of its middle and a scale.
        rows, columns = np.nonzero(mask)
        offsets = np.column_stack([columns, rows]).astype(np.float64)
        middle = offsets.mean(axis=0)
        offsets -= middle
        motions = motion_px_s[mask].astype(np.float64)
        shift_px_s = np.median(motions, axis=0)
        growth_per_s = ((motions - shift_px_s) * offsets).sum() / max((offsets**2).sum(), 1.0)
        misfits_px = max_s * np.linalg.norm(motions - shift_px_s - growth_per_s * offsets, axis=1)
        size = 1 + growth_per_s * max_s  # in the earliest frame over that in the last one
        if np.median(misfits_px) > self.max_misfit_px or not 0.3 < size < 3:
            return None

        # The velocity that explains the motion and the growth at this depth.
        matrix = np.linalg.inv(camera.matrix)
        ray = matrix @ [*middle, 1]
        earlier_ray = matrix @ [*(middle + max_s * shift_px_s), 1]
        depth = 1 / inverse_depth
        earliest = int(np.argmin(np.abs(past.times_s - (past.times_s[-1] - max_s))))
        rotation = past.world_from_cam[-1, :3, :3]
        now = past.world_from_cam[-1, :3, 3] + rotation @ (depth * ray)
        before = past.world_from_cam[earliest, :3, 3] + rotation @ (depth / size * earlier_ray)
        return MovingPatch(mask, inverse_depth, (now - before) / max_s)


def _is_inside(pixels: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    """Return which pixels [H, W, 2] lie in an image of a shape (H, W)."""
    height, width = shape
    return np.asarray(cv2.inRange(pixels, (0, 0), (width - 1, height - 1)) > 0)

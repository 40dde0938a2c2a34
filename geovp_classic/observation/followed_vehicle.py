"""Detection of a followed vehicle: right ahead, in nearly the same place of every frame.

To a reconstruction it is a surface that moves with the camera; nearby, most corners lie on it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True)
class FollowedVehicle:
    """The pixels of a followed vehicle and their motion."""

    mask: BoolArray  # [H, W] of the last frame, with a margin
    first_from_last: FloatArray  # [2, 3], similarity of its pixels

    def moved(self, image: ByteArray, fraction: float) -> ByteArray:
        """Move an image [H, W] or [H, W, 3] of the last frame a fraction of the way to the first.

        Negative fractions extrapolate. The vehicle scales by equal factors in equal times.
        """
        scale, shift = (
            complex(*self.first_from_last[:, column]) for column in (0, 2)
        )
        power = scale**fraction  # a complex number rotates and scales
        offset = shift * (fraction if scale == 1 else (power - 1) / (scale - 1))
        similarity = np.array(
            [
                [power.real, -power.imag, offset.real],
                [power.imag, power.real, offset.imag],
            ]
        )
        return np.asarray(
            cv2.warpAffine(image, similarity, image.shape[1::-1]), np.uint8
        )


@dataclass(frozen=True)
class FollowedVehicleDetector:
    """A similarity that fits low corners from the last frame to the first, while others move far.

    Lengths are fractions of the image's height, unless their names say width.
    """

    min_frames: int = 4
    min_corners: int = 10
    corner_quality: float = 0.001  # of the strongest corner
    corner_spacing: float = 1 / 40
    window_px: int = 11  # of Lucas-Kanade
    num_levels: tuple[int, int] = (2, 1)  # of its pyramid, forward and backward
    termination: tuple[int, float] = (10, 0.03)  # iterations, pixels
    top: float = 0.5  # below this row a street comes nearer
    max_error: float = 0.006  # of a corner on the vehicle
    scale_range: tuple[float, float] = (
        0.86,
        1.17,
    )  # from the last frame to the first
    max_shift_width: float = 0.06
    min_size: tuple[float, float] = (
        0.12,
        0.06,
    )  # of width and height, its low part
    max_corner_fraction: float = 0.75  # of all corners; the street has the rest
    min_inlier_fraction: float = 0.65  # of the corners within its outline
    creeping_distance: float = 0.05  # other corners move farther than this
    max_creeping_fraction: float = 0.35  # of the other corners that do not
    margin_width: float = 0.03  # around its corners

    def detect(
        self,
        greys: ByteArray,  # [P, H, W]
    ) -> FollowedVehicle | None:
        """Return the followed vehicle; None if there is none."""
        if len(greys) < self.min_frames:
            return None
        first, last = greys[0], greys[-1]
        height_px, width_px = last.shape
        top_px = self.top * height_px
        is_low = np.zeros(last.shape, np.uint8)
        is_low[round(top_px) :] = 1
        similarity = self._similarity(
            *self._track(last, first, is_low), height_px, width_px
        )
        if similarity is None:
            return None
        pixels, pixels_first = self._track(last, first, np.ones_like(is_low))
        error_px = _errors(pixels, pixels_first, similarity)
        is_inlier = error_px < self.max_error * height_px
        low = pixels[is_inlier & (pixels[:, 1] > top_px)]
        if not len(low):
            return None
        start, end = np.percentile(low, (5, 95), axis=0)
        half_width_px = (
            end[0] - start[0]
        ) / 2 + 2 * self.margin_width * width_px
        is_ahead = (
            np.abs(pixels[:, 0] - (start[0] + end[0]) / 2) <= half_width_px
        )
        mask = self._outline(pixels[is_inlier & is_ahead], last.shape)
        is_inside = mask[tuple(np.rint(pixels[:, ::-1]).astype(int).T)]
        is_creeping = error_px[~is_inside] < self.creeping_distance * height_px
        is_vehicle = (
            is_inlier[is_inside].mean() > self.min_inlier_fraction
            and (
                (end - start) > np.array(self.min_size) * (width_px, height_px)
            ).all()
            and is_inside.mean() < self.max_corner_fraction
            and is_creeping.mean() < self.max_creeping_fraction
        )
        return FollowedVehicle(mask, similarity) if is_vehicle else None

    def _track(
        self, last: ByteArray, first: ByteArray, where: ByteArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return corners [N, 2] of the last image and their pixels in the first, NaN if lost."""
        spacing_px = self.corner_spacing * len(last)
        corners = cv2.goodFeaturesToTrack(
            last, 0, self.corner_quality, spacing_px, mask=where
        )
        if corners is None:
            return np.zeros((0, 2)), np.zeros((0, 2))
        pixels = np.asarray(corners.reshape(-1, 2), np.float32)
        pixels_first, is_tracked, _ = track_points(
            (last, first),
            pixels,
            pixels,
            self.window_px,
            self.num_levels,
            self.termination,
        )
        return pixels, np.where(is_tracked[:, None], pixels_first, np.nan)

    def _similarity(
        self,
        pixels: FloatArray,
        pixels_first: FloatArray,
        height_px: int,
        width_px: int,
    ) -> FloatArray | None:
        """Fit a similarity [2, 3] (RANSAC); None for few corners, or if it moves or scales much."""
        is_tracked = np.isfinite(pixels_first[:, 0])
        max_error_px = self.max_error * height_px
        if is_tracked.sum() < self.min_corners:
            return None
        fitted = cv2.estimateAffinePartial2D(
            pixels[is_tracked],
            pixels_first[is_tracked],
            ransacReprojThreshold=max_error_px,
        )[0]
        if fitted is None:
            return None
        similarity = np.asarray(fitted, np.float64)
        centre = pixels[
            _errors(pixels, pixels_first, similarity) < max_error_px
        ].mean(axis=0)
        shift_px = np.linalg.norm(similarity @ [*centre, 1.0] - centre)
        min_scale, max_scale = self.scale_range
        is_near = min_scale < np.hypot(*similarity[:, 0]) < max_scale
        return (
            similarity
            if is_near and shift_px < self.max_shift_width * width_px
            else None
        )

    def _outline(self, pixels: FloatArray, shape: tuple[int, ...]) -> BoolArray:
        """Return the convex hull [H, W] of pixels [N, 2], with a margin."""
        hull = np.rint(cv2.convexHull(np.asarray(pixels, np.float32))).astype(
            np.int32
        )
        side_px = 2 * round(self.margin_width * shape[1]) + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side_px, side_px))
        filled = cv2.fillConvexPoly(np.zeros(shape, np.uint8), hull, 1)
        return cv2.dilate(filled, disc) > 0


def _errors(
    pixels: FloatArray, pixels_first: FloatArray, similarity: FloatArray
) -> FloatArray:
    """Return distances [N] in pixels from where the similarity maps corners; inf if lost."""
    mapped = pixels @ similarity[:, :2].T + similarity[:, 2]
    return np.nan_to_num(
        np.linalg.norm(mapped - pixels_first, axis=1), nan=np.inf
    )

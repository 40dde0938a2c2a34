"""A vehicle that is followed: right ahead, in nearly the same place of every frame.

To any reconstruction it is a surface that moves along, and once it is near, most corners of the
image are its own.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import BoolArray, ByteArray, FloatArray

LEAST_FRAMES, LEAST_CORNERS = 4, 10
QUALITY, SPACING = 0.001, 1 / 40  # of the strongest corner; of the image's height
WINDOW_PX, LEVELS, TERMINATION = 11, (2, 1), (10, 0.03)
LOW = 0.5  # of the image's height: below, a street comes nearer
TOLERANCE = 0.006  # of the image's height
SCALES, LARGEST_SHIFT = (0.86, 1.17), 0.06  # from the last frame to the first; of the image's width
LEAST_SIZE = (
    0.12,
    0.06,
)  # of the image's width and height: its low part, without a twentieth of the corners each way
MOST_CORNERS = 0.75  # of all; the street has the rest
OWN_SHARE = 0.65  # of the corners in its outline that move with it
NEAR, NEAR_SHARE = (
    0.05,
    0.35,
)  # of the image's height; share of other corners that stay so near when the camera creeps
MARGIN = 0.03  # of the image's width, around its corners


@dataclass(frozen=True)
class FollowedVehicle:
    """Where frames show a followed vehicle, and how it moves in them."""

    mask: BoolArray  # [H, W] of the last frame, with a margin
    first_from_last: FloatArray  # [2, 3], the similarity of its pixels

    def moved(self, image: ByteArray, share: float) -> ByteArray:
        """An image [H, W] or [H, W, 3] of the last frame, that share of the way to the first; below
        0, so far onwards.

        It grows or shrinks by the same factor in the same time.
        """
        scale, shift = (complex(*self.first_from_last[:, column]) for column in (0, 2))
        power = scale**share  # a complex number turns and scales
        offset = shift * (share if scale == 1 else (power - 1) / (scale - 1))
        similarity = np.array(
            [[power.real, -power.imag, offset.real], [power.imag, power.real, offset.imag]]
        )
        return np.asarray(cv2.warpAffine(image, similarity, image.shape[1::-1]), np.uint8)


def followed_vehicle(frames: ByteArray) -> FollowedVehicle | None:
    """The vehicle that the camera of frames [P, H, W, 3] follows; None where there is none.

    Low corners that a similarity takes from the last frame to the first, not much larger or
    smaller, while others go far or are lost, as those of a street do that the camera drives
    through.
    """
    size_px = np.array(frames.shape[2:0:-1])
    if len(frames) < LEAST_FRAMES:
        return None
    last, first = pinhole.grey8(frames[-1]), pinhole.grey8(frames[0])
    is_low = np.zeros(last.shape, np.uint8)
    is_low[round(LOW * size_px[1]) :] = 1
    similarity = _similarity(*_tracked(last, first, is_low), size_px)
    if similarity is None:
        return None
    pixels, there = _tracked(last, first, np.ones_like(is_low))
    error_px = _errors(pixels, there, similarity)
    own = error_px < TOLERANCE * size_px[1]
    low = pixels[own & (pixels[:, 1] > LOW * size_px[1])]
    if not len(low):
        return None
    start, end = np.percentile(low, (5, 95), axis=0)
    in_columns = (
        np.abs(pixels[:, 0] - (start[0] + end[0]) / 2)
        <= (end[0] - start[0]) / 2 + 2 * MARGIN * size_px[0]
    )
    mask = _outline(pixels[own & in_columns], last.shape)
    inside = mask[tuple(np.rint(pixels[:, ::-1]).astype(int).T)]
    is_rigid = own[inside].mean() > OWN_SHARE and ((end - start) > LEAST_SIZE * size_px).all()
    street_moves = (
        inside.mean() < MOST_CORNERS and (error_px[~inside] < NEAR * size_px[1]).mean() < NEAR_SHARE
    )
    return FollowedVehicle(mask, similarity) if is_rigid and street_moves else None


def _tracked(last: ByteArray, first: ByteArray, where: ByteArray) -> tuple[FloatArray, FloatArray]:
    """Corners [N, 2] of the last image, and where they were in the first one [N, 2]; NaN where they
    were not found.
    """
    corners = cv2.goodFeaturesToTrack(last, 0, QUALITY, SPACING * len(last), mask=where)
    if corners is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    pixels = np.asarray(corners.reshape(-1, 2), np.float32)
    there, found, _ = track_points((last, first), pixels, pixels, WINDOW_PX, LEVELS, TERMINATION)
    return pixels, np.where(found[:, None], there, np.nan)


def _similarity(pixels: FloatArray, there: FloatArray, size_px: FloatArray) -> FloatArray | None:
    """The similarity [2, 3] of most corners; None where there are few, and where it moves or
    resizes them much.
    """
    found, tolerance_px = np.isfinite(there[:, 0]), TOLERANCE * size_px[1]
    if found.sum() < LEAST_CORNERS:
        return None
    fitted = cv2.estimateAffinePartial2D(
        pixels[found], there[found], ransacReprojThreshold=tolerance_px
    )[0]
    if fitted is None:
        return None
    similarity = np.asarray(fitted, np.float64)
    centre = pixels[_errors(pixels, there, similarity) < tolerance_px].mean(axis=0)
    shift_px = np.linalg.norm(similarity @ [*centre, 1.0] - centre)
    is_near = (
        SCALES[0] < np.hypot(*similarity[:, 0]) < SCALES[1]
        and shift_px < LARGEST_SHIFT * size_px[0]
    )
    return similarity if is_near else None


def _errors(pixels: FloatArray, there: FloatArray, similarity: FloatArray) -> FloatArray:
    """Distances [N] in pixels of corners from where a similarity takes them; inf where they were
    not found.
    """
    error_px = np.linalg.norm(pixels @ similarity[:, :2].T + similarity[:, 2] - there, axis=1)
    return np.nan_to_num(error_px, nan=np.inf)


def _outline(pixels: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    """The convex hull [H, W] of pixels [N, 2], with a margin."""
    hull = np.rint(np.asarray(cv2.convexHull(np.asarray(pixels, np.float32)))).astype(np.int32)
    side_px = 2 * round(MARGIN * shape[1]) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side_px, side_px))
    return np.asarray(cv2.dilate(cv2.fillConvexPoly(np.zeros(shape, np.uint8), hull, 1), disc) > 0)

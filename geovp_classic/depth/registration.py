"""Poses that the pictures agree with: given poses, improved until tracked corners meet, in the unit they came in.

Recorded poses can be wrong by more than a pixel from one frame to the next (GPS and gyroscopes are smooth over
hundreds of metres, not over ten), and a plane sweep needs a quarter of one. Corners of one reference picture are
followed to the others (Lucas & Kanade 1981; there and back again), and poses and inverse depths of the corners are
adjusted together (bundle adjustment, Triggs 2000), held by the given poses where the corners say nothing: those alone
know how long a metre is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.adjustment import Corners, adjust
from geovp_classic.depth.matching import TALL_PX
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

MAX_CORNERS = 400  # in a square picture
MIDDLE = 1.6  # widths of the square; poses that fit corners farther out, too, fit what is shown less well
CORNER_QUALITY = 0.01
CORNER_SPACING = 0.025  # of the picture's height
WINDOW_PX = 15  # in pictures of up to TALL_PX rows; proportionally more in taller ones
RETURN_PX = 0.5  # a track is kept while following it back ends this near to where it came from
MIN_CORNERS = 30  # seen by at least one other frame; with fewer the given poses stay
DIRECTION_SHARE = 0.2  # of the longest distance from the reference; shorter ones have no sure direction
PERSISTENCE = 0.8  # of the directions' error that is expected of the future, too


@dataclass(frozen=True)
class Tracks:
    """Corners of a reference picture in all pictures."""

    pixels: FloatArray  # [P, N, 2]
    seen: BoolArray  # [P, N]


@dataclass(frozen=True)
class Registration:
    """Poses that fit the pictures, and how the given ones' directions of motion were turned against theirs."""

    world_from_cam: FloatArray  # [P, 4, 4]
    steering: FloatArray  # [3, 3], turns the given directions of motion, in the reference camera's frame


def registered(
    pictures: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
) -> Registration:
    """The poses after adjustment; that of the reference stays, and all do where too little is seen."""
    others = np.array([step for step in range(len(pictures)) if step != reference], dtype=int)
    source_from_reference = se3.inverse(world_from_cam[others]) @ world_from_cam[reference]
    if not (np.linalg.norm(source_from_reference[:, :3, 3], axis=1) > 0).any():
        return Registration(world_from_cam, np.eye(3))
    tracks = track(pictures, reference)
    kept = tracks.seen[others].any(axis=0)
    if kept.sum() < MIN_CORNERS:
        return Registration(world_from_cam, np.eye(3))
    rays = pinhole.unproject(tracks.pixels[reference, kept], np.ones(kept.sum()), camera)
    corners = Corners(rays, tracks.pixels[others][:, kept], tracks.seen[others][:, kept], camera, source_from_reference)
    reference_from_source = se3.inverse(adjust(corners))
    better = world_from_cam.copy()
    better[others] = world_from_cam[reference] @ reference_from_source
    return Registration(better, steering(se3.inverse(source_from_reference), reference_from_source))


def steering(
    given: FloatArray,  # [S, 4, 4], reference from source
    better: FloatArray,  # [S, 4, 4]
) -> FloatArray:
    """The rotation [3, 3] that the better directions of motion have against the given ones, as far as it will last.

    A recorded camera that looks a degree beside where it says it looks, or a height that drifts, turns every direction
    alike, the coming ones too.
    """
    was, now = given[:, :3, 3], better[:, :3, 3]
    length, length_now = np.linalg.norm(was, axis=1), np.linalg.norm(now, axis=1)
    sure = (length > DIRECTION_SHARE * length.max()) & (length_now > 0)
    if not sure.any():
        return np.eye(3)
    turns = np.cross(was[sure], now[sure]) / (length * length_now)[sure, None]
    return se3.exp(np.concatenate([np.zeros(3), PERSISTENCE * turns.mean(axis=0)]))[:3, :3]


def track(
    pictures: FloatArray,  # [P, H, W]
    reference: int,
) -> Tracks:
    """Corners in the middle of the reference picture, followed frame by frame, back and forth, until they are lost."""
    grey = [np.ascontiguousarray(picture.astype(np.uint8)) for picture in pictures]
    height, width = grey[reference].shape
    wideness = float(np.clip(width / height, 1, MIDDLE))
    margin = max(0, round((width - MIDDLE * height) / 2))
    middle = np.zeros((height, width), np.uint8)
    middle[:, margin : width - margin] = 255
    count, spacing_px = int(MAX_CORNERS * wideness), CORNER_SPACING * height
    corners = cv2.goodFeaturesToTrack(grey[reference], count, CORNER_QUALITY, spacing_px, mask=middle)
    start = np.zeros((0, 2), np.float32) if corners is None else np.asarray(corners, np.float32).reshape(-1, 2)
    pixels = np.tile(start, (len(pictures), 1, 1))
    seen = np.zeros(pixels.shape[:2], dtype=bool)
    seen[reference] = True
    for steps in (range(reference - 1, -1, -1), range(reference + 1, len(pictures))):
        before = reference
        for step in steps:
            pixels[step], seen[step] = _follow(grey[before], grey[step], pixels[before], seen[before])
            before = step
    return Tracks(pixels.astype(np.float64), seen)


def _follow(before: FloatArray, after: FloatArray, pixels: FloatArray, seen: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Where the seen ones of the pixels [N, 2] went, and which of them [N] are found back near where they came from."""
    if not seen.any():
        return pixels, seen
    side = int(WINDOW_PX * max(1, len(before) / TALL_PX)) | 1  # odd
    window, start = (side, side), pixels[seen]
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, start.copy(), winSize=window)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(
        after, before, there, start.copy(), winSize=window, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    close = np.linalg.norm(back - start, axis=-1) < RETURN_PX
    places, still = pixels.copy(), seen.copy()
    places[seen], still[seen] = there, close & (np.asarray(found)[:, 0] > 0) & (np.asarray(returned)[:, 0] > 0)
    return places, still

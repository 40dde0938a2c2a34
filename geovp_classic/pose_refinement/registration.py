"""Registration of given poses to the images: bundle adjustment of tracked corners, in the unit of
the given poses.

Recorded poses can be wrong by more than a pixel from one frame to the next (GPS and gyroscopes are
smooth over hundreds of metres, not over ten), and a plane sweep needs a quarter of one. Corners of
a reference image are tracked through the others (Lucas & Kanade 1981, with a forward-backward
check), and their inverse depths are adjusted together with the poses (Triggs 2000). The given poses
are the prior, which also fixes the scale.
"""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from geovp_classic import observation
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.pose_refinement.local_bundle import Corners, adjust
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    PrivilegedInput,
)

TALL_PX = 256  # rows of an image up to which windows keep their size
MAX_CORNERS = 400  # in a square image
MIDDLE = 1.6  # widths of the square; corners farther out make the fit within the square worse
CORNER_QUALITY = 0.01
CORNER_SPACING = 0.025  # of the image's height
WINDOW_PX = 15  # in images of up to TALL_PX rows; proportionally more in taller ones
RETURN_PX = 0.5  # largest forward-backward error of a track
MIN_CORNERS = 30  # visible in at least one other frame; with fewer the given poses stay
DIRECTION_SHARE = (
    0.2  # of the longest distance from the reference; shorter ones have no reliable direction
)
PERSISTENCE = 0.8  # share of the past error of the direction that is expected in the future


@dataclass(frozen=True)
class Registration:
    """Past poses adjusted to tracked corners; future ones are rotated as the past directions of
    motion were.

    The last observed pose is the reference and stays. Poses before the last `num_frames` move with
    the first of those.
    """

    frames: Literal["crop", "full"] = "crop"
    num_frames: int = 10

    def __post_init__(self) -> None:
        if self.num_frames < 2:
            raise BadData(f"registration: num_frames is {self.num_frames}, expected 2 or more")

    @property
    def needs(self) -> PrivilegedInput:
        """Nothing beyond the frames, or the uncropped ones."""
        return PrivilegedInput.FULL_FRAMES if self.frames == "full" else PrivilegedInput.NONE

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion with registered past poses, its futures turned about the last one."""
        stream = observation.stream(context.only(self.needs), self.frames)
        steps = np.flatnonzero(stream.is_usable)
        steps = steps[steps >= len(stream.is_usable) - self.num_frames]
        given, first = motion.past.world_from_cam, steps[0]
        images, kept = stream.greys[steps], steps
        found = registered(images, stream.intrinsics, given[kept], len(kept) - 1)
        past = given.copy()
        past[:first] = found.world_from_cam[0] @ se3.inverse(given[first]) @ given[:first]
        past[kept] = found.world_from_cam
        last_from_cam = se3.inverse(given[-1]) @ motion.futures
        futures = given[-1] @ se3.compose(
            last_from_cam[..., :3, :3], last_from_cam[..., :3, 3] @ found.direction_correction.T
        )
        return motion.refined(replace(motion.past, world_from_cam=past), futures)


@dataclass(frozen=True)
class Registered:
    """Poses that fit the images, and the correction of the given directions of motion."""

    world_from_cam: FloatArray  # [P, 4, 4]
    direction_correction: (
        FloatArray  # [3, 3] rotation of the given directions, in the reference camera's frame
    )


def registered(
    images: ByteArray | FloatArray,  # [P, H, W] grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
) -> Registered:
    """The poses after adjustment; that of the reference stays, and all do with too few corners."""
    others = np.array([step for step in range(len(images)) if step != reference], dtype=int)
    source_from_reference = se3.inverse(world_from_cam[others]) @ world_from_cam[reference]
    if not (np.linalg.norm(source_from_reference[:, :3, 3], axis=1) > 0).any():
        return Registered(world_from_cam, np.eye(3))
    pixels, visible = track(images, reference)
    kept = visible[others].any(axis=0)
    if kept.sum() < MIN_CORNERS:
        return Registered(world_from_cam, np.eye(3))
    rays = pinhole.unproject(pixels[reference, kept], np.ones(kept.sum()), camera)
    corners = Corners(
        rays, pixels[others][:, kept], visible[others][:, kept], camera, source_from_reference
    )
    reference_from_source = se3.inverse(adjust(corners))
    adjusted = world_from_cam.copy()
    adjusted[others] = world_from_cam[reference] @ reference_from_source
    return Registered(
        adjusted, direction_correction(se3.inverse(source_from_reference), reference_from_source)
    )


def unrefined(motion: Motion, name: str) -> Motion:
    """The motion of the pose source itself; Incompatible where nothing has been registered."""
    if motion.unrefined is None:
        raise Incompatible(
            f"{name} compares given with registered poses: put registration before it"
        )
    return motion.unrefined


def direction_correction(
    given: FloatArray,  # [S, 4, 4], reference from source
    adjusted: FloatArray,  # [S, 4, 4]
) -> FloatArray:
    """The rotation [3, 3] from the given to the adjusted directions of motion, times PERSISTENCE.

    A wrong mounting angle of the recorded camera, or a drifting height, rotates all directions
    alike, future ones too.
    """
    was, now = given[:, :3, 3], adjusted[:, :3, 3]
    length, length_now = np.linalg.norm(was, axis=1), np.linalg.norm(now, axis=1)
    reliable = (length > DIRECTION_SHARE * length.max()) & (length_now > 0)
    if not reliable.any():
        return np.eye(3)
    turns = np.cross(was[reliable], now[reliable]) / (length * length_now)[reliable, None]
    return se3.exp(np.concatenate([np.zeros(3), PERSISTENCE * turns.mean(axis=0)]))[:3, :3]


def track(
    images: ByteArray | FloatArray,  # [P, H, W]
    reference: int,
) -> tuple[FloatArray, BoolArray]:
    """Corners of the middle of the reference image: pixels [P, N, 2] in all images, and where they
    are visible [P, N].

    They are tracked from frame to frame, away from the reference both ways, until they are lost.
    """
    grey = [np.ascontiguousarray(image, dtype=np.uint8) for image in images]
    height, width = grey[reference].shape
    wideness = float(np.clip(width / height, 1, MIDDLE))
    margin = max(0, round((width - MIDDLE * height) / 2))
    middle = np.zeros((height, width), np.uint8)
    middle[:, margin : width - margin] = 255
    count, spacing_px = int(MAX_CORNERS * wideness), CORNER_SPACING * height
    corners = cv2.goodFeaturesToTrack(
        grey[reference], count, CORNER_QUALITY, spacing_px, mask=middle
    )
    start = (
        np.zeros((0, 2), np.float32)
        if corners is None
        else np.asarray(corners, np.float32).reshape(-1, 2)
    )
    pixels = np.tile(start, (len(images), 1, 1))
    visible = np.zeros(pixels.shape[:2], dtype=bool)
    visible[reference] = True
    window_px = int(WINDOW_PX * max(1, height / TALL_PX)) | 1  # odd
    for steps in (range(reference - 1, -1, -1), range(reference + 1, len(images))):
        before, motion = reference, None
        for step in steps:
            known, pixels[step] = visible[before], pixels[before]
            if known.any():
                pair, start = (grey[before], grey[step]), pixels[before][known]
                guess, levels = (start, 4) if motion is None else (start + motion[known], 2)
                pixels[step, known], visible[step, known], _ = track_points(
                    pair, start, guess, window_px, (levels, 1), max_return_px=RETURN_PX
                )
            before, motion = step, pixels[step] - pixels[before]
    return pixels.astype(np.float64), visible

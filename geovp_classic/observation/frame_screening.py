"""Observed frames that say nothing: without texture (a black or white one), the same as before, or
of another scene.
"""

import itertools

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.geometry.robust import median
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Trajectory

FLAT = 4.0  # standard deviation of the grey values below which a frame shows nothing
# mean difference of the grey values below which a frame is a repetition; noise and coding exceed it
SAME = 0.3
# the same of a camera that moves on: what stays the same after it is a repetition, not a stop
MOVING = 3.0
LEAST = 2  # frames that must remain
CUT_CHANGE = 1.25  # of the median change of the image, from which it may be a cut to another scene
# share of corners; with fewer found again it is one. In streets, also in turns, at least a half is
CUT_TRACKED = 0.2
CUT_HEIGHT_PX, CUT_CORNERS, CUT_WINDOW_PX = 96, (15, 80), 11  # of the images that are compared


def usable(frames: ByteArray) -> BoolArray:
    """Which frames [P, H, W, 3] say something; all where fewer than two would remain."""
    grey = [pinhole.grey8(frame) for frame in frames]
    kept = np.array([cv2.meanStdDev(image)[1].item() > FLAT for image in grey])
    shown = np.flatnonzero(kept)
    before = 0.0  # the last change of the image
    for a, b in itertools.pairwise(shown):
        change = cv2.norm(grey[a], grey[b], cv2.NORM_L1) / grey[a].size
        kept[b] = change >= SAME or before < MOVING
        before = change if change >= SAME else before
    shown = np.flatnonzero(kept)
    kept[shown[: _last_cut([grey[step] for step in shown])]] = False
    return kept if kept.sum() >= LEAST else np.ones(len(frames), dtype=bool)


def _last_cut(images: list[ByteArray]) -> int:
    """The first grey image [H, W] after the last cut to another scene; 0 where there is none.

    No image before a cut shows what the ones after it do, so that one bad image is none.
    """
    pairs = list(itertools.pairwise(range(len(images))))
    changes = np.array([cv2.norm(images[a], images[b], cv2.NORM_L1) for a, b in pairs])
    usual = median(changes) if pairs else 0.0
    for a, b in reversed(pairs[:-1]):
        if changes[a] > CUT_CHANGE * usual:
            others = [(a, b), (a, b + 1), (max(a - 1, 0), b)]
            if all(_found_again(images[one], images[other]) < CUT_TRACKED for one, other in others):
                return b
    return 0


def _found_again(before_grey: ByteArray, now_grey: ByteArray) -> float:
    """The share of an image's corners that are tracked to another one and back; 1 where it has too
    few.
    """
    (least, most), before, now = CUT_CORNERS, _normalised(before_grey), _normalised(now_grey)
    corners = cv2.goodFeaturesToTrack(before, most, 0.01, 5)
    if corners is None or len(corners) < least:
        return 1.0
    pixels = np.asarray(corners.reshape(-1, 2), np.float32)
    return float(track_points((before, now), pixels, pixels, CUT_WINDOW_PX)[1].mean())


def _normalised(grey: ByteArray) -> ByteArray:
    """A small image of a mean and a contrast that no exposure changes."""
    size_px = round(grey.shape[1] * CUT_HEIGHT_PX / len(grey)), CUT_HEIGHT_PX
    small = cv2.resize(grey.astype(np.float32), size_px, interpolation=cv2.INTER_AREA)
    return np.clip(
        128 + 48 * (small - small.mean()) / max(float(small.std()), 1e-3), 0, 255
    ).astype(np.uint8)


def screened(context: Context, past: Trajectory) -> tuple[Context, Trajectory]:
    """Context and past without the frames that are not `usable`."""
    kept = usable(context.frames)
    return (context, past) if kept.all() else (context.observed(kept), past[kept])


def bridged(
    world_from_cam: FloatArray,  # [P, 4, 4]
    times_s: FloatArray,  # [P]
    known: BoolArray,  # [P]
) -> FloatArray:
    """The poses, those not known between or beyond known ones at constant twist; as they are with
    fewer than two.
    """
    steps = np.flatnonzero(known)
    if len(steps) < 2:
        return world_from_cam
    after = np.clip(np.searchsorted(steps, np.arange(len(known))), 1, len(steps) - 1)
    a, b = steps[after - 1], steps[after]
    fraction = (times_s - times_s[a]) / (times_s[b] - times_s[a])
    poses = np.asarray(se3.interpolate(world_from_cam[a], world_from_cam[b], fraction))
    return np.where(known[:, None, None], world_from_cam, poses)

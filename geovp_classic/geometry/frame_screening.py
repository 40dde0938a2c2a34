"""Observed frames that say nothing: without texture (a black or white one), or the same as the frame before."""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Trajectory

FLAT = 4.0  # standard deviation of the grey values below which a frame shows nothing
SAME = 0.3  # mean difference of the grey values below which a frame is a repetition; noise and coding exceed it
MOVING = 3.0  # the same of a camera that moves on: what stays the same after it is a repetition, not a stop
LEAST = 2  # frames that must remain


def usable(frames: ByteArray) -> BoolArray:
    """Which frames [P, H, W, 3] say something; all where fewer than two would remain."""
    grey = [pinhole.grey(frame) for frame in frames]
    kept = np.array([float(np.std(image)) > FLAT for image in grey])
    shown = np.flatnonzero(kept)
    before = 0.0  # the last change of the image
    for a, b in itertools.pairwise(shown):
        change = cv2.norm(grey[a], grey[b], cv2.NORM_L1) / grey[a].size
        kept[b] = change >= SAME or before < MOVING
        before = change if change >= SAME else before
    return kept if kept.sum() >= LEAST else np.ones(len(frames), dtype=bool)


def screened(context: Context, past: Trajectory) -> tuple[Context, Trajectory]:
    """Context and past without the frames that are not `usable`."""
    kept = usable(context.frames)
    return (context, past) if kept.all() else (context.observed(kept), past[kept])


def bridged(
    world_from_cam: FloatArray,  # [P, 4, 4]
    times_s: FloatArray,  # [P]
    known: BoolArray,  # [P]
) -> FloatArray:
    """The poses, those not known between or beyond known ones at constant twist; as they are with fewer than two."""
    steps = np.flatnonzero(known)
    if len(steps) < 2:
        return world_from_cam
    after = np.clip(np.searchsorted(steps, np.arange(len(known))), 1, len(steps) - 1)
    a, b = steps[after - 1], steps[after]
    fraction = (times_s - times_s[a]) / (times_s[b] - times_s[a])
    poses = np.asarray(se3.interpolate(world_from_cam[a], world_from_cam[b], fraction))
    return np.where(known[:, None, None], world_from_cam, poses)

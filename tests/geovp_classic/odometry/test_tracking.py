"""Tracking image by image through a corridor whose poses are known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geovp_classic.odometry.tracking import Image, Tracker, TrackerSettings
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

Film = Callable[[FloatArray], tuple[ByteArray, FloatArray]]
SETTINGS = TrackerSettings()


def images_of(frames: ByteArray) -> list[Image]:
    greys = [frame[..., 0] for frame in frames]
    return [Image(grey, SETTINGS.corners.detect(grey), 0.1 * n) for n, grey in enumerate(greys)]


def test_tracking_continues_from_the_adjusted_pose(drive: Film, camera: Intrinsics) -> None:
    """No time passes until the blank image, so that it has the pose of the image before it."""
    frames, _ = drive(np.tile([0, 0, 0.3, 0, np.radians(0.6), 0], (4, 1)))
    keyframes = replace(SETTINGS.keyframes.for_clip(10), adjust_every=10)
    tracker = Tracker(replace(SETTINGS, keyframes=keyframes), camera)
    images = images_of(frames)
    for image in images:
        tracker.push(image)
    before = tracker.poses().world_from_cam[-1]
    tracker.adjust()
    tracker.push(Image(np.zeros_like(images[-1].grey), np.zeros((0, 2)), images[-1].time_s))
    adjusted, bridged = tracker.poses().world_from_cam[-2:]
    assert np.abs(adjusted - before).max() > 1e-4  # the adjustment did move it
    np.testing.assert_allclose(bridged, adjusted, atol=1e-12)

"""Tracking image by image through a corridor whose poses are known."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from geovp_classic.odometry.resection import Resection
from geovp_classic.odometry.tracking import Image, Tracker, TrackerSettings
from geovp_classic.types import BoolArray, ByteArray, FloatArray
from tests.geovp_classic.odometry.corridor import CAMERA, drive

SETTINGS = TrackerSettings()


def images_of(frames: ByteArray) -> list[Image]:
    greys = [frame[..., 0] for frame in frames]
    return [Image(grey, SETTINGS.corners.detect(grey), 0.1 * n) for n, grey in enumerate(greys)]


def test_tracking_continues_from_the_adjusted_pose() -> None:
    """No time passes until the blank image, so that it has the pose of the image before it."""
    frames, _ = drive(np.tile([0, 0, 0.3, 0, np.radians(0.6), 0], (4, 1)))
    keyframes = replace(SETTINGS.keyframes.for_clip(10), adjust_every=10)
    tracker = Tracker(replace(SETTINGS, keyframes=keyframes), CAMERA)
    images = images_of(frames)
    for image in images:
        tracker.push(image)
    before = tracker.poses().world_from_cam[-1]
    tracker.adjust()
    tracker.push(Image(np.zeros_like(images[-1].grey), np.zeros((0, 2)), images[-1].time_s))
    adjusted, bridged = tracker.poses().world_from_cam[-2:]
    assert np.abs(adjusted - before).max() > 1e-4  # the adjustment did move it
    np.testing.assert_allclose(bridged, adjusted, atol=1e-12)


@dataclass(frozen=True)
class Failing(Resection):
    """Resection that fails in some of its calls."""

    failing: tuple[int, ...] = ()
    calls: list[int] = field(default_factory=list)

    def resect(
        self, points: FloatArray, rays: FloatArray, guess: FloatArray, noise: float
    ) -> tuple[FloatArray, BoolArray] | None:
        """Return None in a call that fails, else the pose."""
        if len(points) >= self.min_inliers:
            self.calls.append(len(self.calls))
            if self.calls[-1] in self.failing:
                return None
        return super().resect(points, rays, guess, noise)


@pytest.mark.parametrize(("failing", "num_segments"), [((2,), 1), ((2, 3, 4, 5, 6), 2)])
def test_one_failed_resection_does_not_discard_the_map(
    failing: tuple[int, ...], num_segments: int
) -> None:
    """It takes five in a row; at the fifth, the tracker starts again."""
    frames, _ = drive(np.tile([0, 0, 0.3, 0, 0, 0], (11, 1)))
    tracker = Tracker(replace(SETTINGS, resection=Failing(failing=failing)), CAMERA)
    for image in images_of(frames):
        tracker.push(image)
    path = tracker.poses()
    assert len(np.unique(path.segments)) == num_segments
    assert (~path.tracked).sum() == len(failing)

"""Scale of an odometry through its segments, each of which has its own unit of length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from geovp_classic.geometry import planar, se3
from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray


@dataclass(frozen=True)
class TrackedImages:
    """Images along a path, in an arbitrary unit of length per segment."""

    numbers: IntArray  # [P], since the first image
    times_s: FloatArray  # [P]
    greys: list[ByteArray]  # P, [H, W] each; empty if the scale is measured elsewhere
    world_from_cam: FloatArray  # [P, 4, 4]
    tracked: BoolArray  # [P]
    segments: IntArray  # [P], numbers that increase

    @property
    def length(self) -> float:
        """Return the sum of the steps."""
        return float(se3.step_lengths(self.world_from_cam).sum())

    @property
    def pitch_rad(self) -> float:
        """Return the mean angle of the viewing axis above the direction of travel."""
        steps = se3.steps(self.world_from_cam)
        is_tracked = self.tracked[:-1] & self.tracked[1:]
        return planar.travel_pitch_rad(steps[is_tracked, :3, 3])

    @property
    def in_longest_segment(self) -> BoolArray:
        """Return which images [P] are in the segment with most, the last of equally long ones."""
        numbers, counts = np.unique(self.segments, return_counts=True)
        return self.segments == numbers[::-1][counts[::-1].argmax()]

    def select(self, mask: BoolArray) -> TrackedImages:
        """Return some of the images [P], which keep their numbers."""
        greys = [self.greys[index] for index in np.flatnonzero(mask)] if self.greys else []
        names = "numbers", "times_s", "world_from_cam", "tracked", "segments"
        return replace(self, greys=greys, **{name: getattr(self, name)[mask] for name in names})


class SegmentScale:
    """Estimate of the scale that is restarted where the unit of length changes."""

    def __init__(self, estimator: ScaleEstimator) -> None:
        self.estimator = estimator
        self._updates: list[tuple[int, int]] = []  # number of the second image, and its segment
        self._segment: int | None = None  # of the last update

    def update(
        self,
        number: int,  # of the second image
        segment: int,
        before: ByteArray,  # [H, W]
        now: ByteArray,  # [H, W]
        before_from_now: FloatArray,  # [4, 4]
    ) -> None:
        """Update the estimate with two images of one segment."""
        if self._segment is not None and segment != self._segment:
            self.estimator.restart()
        self._segment = segment
        self._updates.append((number, segment))
        self.estimator.update(before, now, before_from_now)

    def update_with(self, images: TrackedImages, before: int, now: int) -> None:
        """Update the estimate with two of the images if both were tracked in one segment."""
        segment = int(images.segments[now])
        are_tracked = images.tracked[before] and images.tracked[now]
        if not are_tracked or images.segments[before] != segment:
            return
        poses = images.world_from_cam
        before_from_now = se3.inverse(poses[before]) @ poses[now]
        greys = images.greys[before], images.greys[now]
        self.update(int(images.numbers[now]), segment, *greys, before_from_now)

    def finalize(self, localised: TrackedImages) -> None:
        """Finish the estimate after the last image.

        If nothing was measured, a speed may be assumed, which is that of the longest segment.
        """
        segment = localised.select(localised.in_longest_segment)
        duration_s = float(segment.times_s[-1] - segment.times_s[0])
        self.estimator.finalize(segment.length, duration_s)
        # Forget the updates that the estimator has forgotten, which are the first ones
        num_remembered = len(self.estimator.units)
        del self._updates[: len(self._updates) - num_remembered]

    def units(self, images: TrackedImages) -> FloatArray:
        """Return the metres per unit of the step to each image [P]; NaN in unmeasured segments.

        They are interpolated between updates of one segment. Images before the first update that
        the estimator remembers have the unit of that update.
        """
        units: FloatArray = np.full(len(images.numbers), np.nan)
        measured = self.estimator.units
        numbers, segments = np.array(self._updates, dtype=int).reshape(-1, 2).T
        for segment in np.unique(segments[np.isfinite(measured)]):
            is_here = (segments == segment) & np.isfinite(measured)
            to = images.segments == segment
            units[to] = np.interp(images.numbers[to], numbers[is_here], measured[is_here])
        return units


def joined(
    images: TrackedImages,  # P, each of them localised
    units: FloatArray,  # [P], metres per unit of the step to each image
) -> FloatArray:
    """Return the path [P, 4, 4] with all steps in metres.

    The step from one segment to the next has no unit of its own. Its length is that of the last
    step before it, at constant velocity.
    """
    steps = se3.steps(images.world_from_cam)
    steps[:, :3, 3] *= units[1:, None]
    is_joint = np.diff(images.segments) != 0
    inside = np.flatnonzero(~is_joint)
    elapsed_s = np.diff(images.times_s)
    for joint in np.flatnonzero(is_joint):
        steps[joint, :3, 3] = 0.0
        if len(inside):
            last = inside[max(int(np.searchsorted(inside, joint)) - 1, 0)]
            velocity_m_s = steps[last, :3, 3] / elapsed_s[last]
            steps[joint, :3, 3] = velocity_m_s * elapsed_s[joint]
    return np.stack(list(accumulate(steps, np.matmul, initial=images.world_from_cam[0])))

"""Odometry on short clips, each initialised anew: errors of the steps from frame to frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp_benchmarks.progress import Progress
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Odometry
from geovp_classic.types import BoolArray, Clip, FloatArray, PrivilegedInput

COLUMNS = ("frames", "clips", "tracked", "rotation (deg/frame)", "direction (deg)", "length (%)")
MIN_STEP_M = 0.05  # the direction of shorter steps is ill-defined


@dataclass(frozen=True)
class StepErrors:
    """Errors of the steps [N] of one clip, or of many clips joined."""

    tracked: BoolArray  # [N], of the frame that a step leads to
    rotation_deg: FloatArray  # [N]
    direction_deg: FloatArray  # [N], NaN for steps below MIN_STEP_M
    # [clips], estimated by true length of the path - 1; NaN without metres or motion
    length_percent: FloatArray

    @classmethod
    def joined(cls, clips: Sequence[StepErrors]) -> StepErrors:
        """The steps of all clips."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(*(np.concatenate([getattr(clip, name) for clip in clips]) for name in names))

    def row(self, frames: str) -> tuple[str, ...]:
        """Texts as COLUMNS: medians, of the length's absolute value."""
        medians = [
            f"{np.nanmedian(np.abs(errors)):.{digits}f}" if np.isfinite(errors).any() else "-"
            for errors, digits in (
                (self.rotation_deg, 4),
                (self.direction_deg, 2),
                (self.length_percent, 1),
            )
        ]
        return (frames, str(len(self.length_percent)), f"{self.tracked.mean():.1%}", *medians)


def measure(
    data: Mapping[str, Any],
    frames: Sequence[str],
    spec: Mapping[str, Any],
    num_past: int,
    progress: Progress,
) -> Iterator[tuple[str, StepErrors]]:
    """(stretch, errors) for each stretch, such as "03" or "03[180:360)", of a data set.

    `data` is its table with stride and size_px; a clip has one frame more than the past, its
    future.
    """
    odometry = registry.build("odometries", spec)
    with_full = bool(odometry.needs & PrivilegedInput.FULL_FRAMES)
    shared = {**data, "num_frames": num_past + 1, "with_full": with_full}
    for text in frames:
        dataset = registry.build("datasets", {**shared, "sequences": [text]})
        clips = []
        for index in range(len(dataset)):
            clips.append(errors(odometry, dataset[index], num_past))
            progress(index + 1, len(dataset))
        yield str(dataset.ranges[0]) if len(dataset.ranges) == 1 else text, StepErrors.joined(clips)


def errors(odometry: Odometry, clip: Clip, num_past: int) -> StepErrors:
    """The errors of one clip; Incompatible when it has no poses."""
    if clip.trajectory is None:
        raise Incompatible(
            f"{clip.name} has no real poses to compare with: choose a sequence that has"
        )
    context, _ = clip.split(num_past, odometry.needs)
    estimate, tracked = odometry.track(context)
    poses = clip.trajectory.world_from_cam[:num_past], estimate.world_from_cam
    truth, ours = (
        se3.inverse(path[:-1]) @ path[1:] for path in poses
    )  # before_from_now [P - 1, 4, 4]
    lengths, our_lengths = (np.linalg.norm(steps[:, :3, 3], axis=-1) for steps in (truth, ours))
    cosine = (truth[:, :3, 3] * ours[:, :3, 3]).sum(axis=-1) / np.maximum(
        lengths * our_lengths, 1e-12
    )
    direction_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    has_length = estimate.is_metric and clip.trajectory.is_metric and lengths.sum() > MIN_STEP_M
    return StepErrors(
        tracked[1:],
        np.degrees(se3.rotation_angle_rad(se3.inverse(truth) @ ours)),
        np.where(lengths > MIN_STEP_M, direction_deg, np.nan),
        np.array([100 * (our_lengths.sum() / lengths.sum() - 1) if has_length else np.nan]),
    )

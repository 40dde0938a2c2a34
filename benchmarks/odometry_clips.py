"""Short clips through an odometry, each from nothing: how far off its steps from image to image are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Odometry
from geovp_classic.types import BoolArray, Clip, FloatArray, Grant, Trajectory

COLUMNS = ("frames", "clips", "tracked", "rotation (deg/frame)", "direction (deg)", "length (%)")
MIN_STEP_M = 0.05  # shorter steps have no direction to speak of
Watch = Callable[[int, int], None]  # (clips done, clips in all)


@dataclass(frozen=True)
class Cut:
    """How clips are cut from a sequence."""

    num_past: int = 10
    stride: int = 5
    size_px: tuple[int, int] = (256, 256)
    camera: int | None = None


@dataclass(frozen=True)
class Steps:
    """Errors of the steps [N] of one clip, or of many clips joined."""

    tracked: BoolArray  # [N], of the image that a step leads to
    rotation_deg: FloatArray  # [N]
    direction_deg: FloatArray  # [N], NaN where the camera hardly moved
    length_percent: FloatArray  # [clips], estimated by true length of the path - 1; NaN without metres or motion

    def row(self, frames: str) -> tuple[str, ...]:
        """Texts as COLUMNS: medians, of the length's absolute value."""
        medians = [
            f"{np.nanmedian(np.abs(errors)):.{digits}f}" if np.isfinite(errors).any() else "-"
            for errors, digits in ((self.rotation_deg, 4), (self.direction_deg, 2), (self.length_percent, 1))
        ]
        return (frames, str(len(self.length_percent)), f"{self.tracked.mean():.1%}", *medians)


def measure(
    root: Path, frames: Sequence[str], spec: dict[str, Any] | str, cut: Cut, watch: Watch
) -> Iterator[tuple[str, Steps]]:
    """(stretch, errors) for each stretch, such as "03" or "03[180:360)", of a folder laid out as KITTI odometry."""
    odometry = registry.build("odometries", spec)
    for text in frames:
        dataset = registry.build("datasets", _dataset(root, text, cut, bool(odometry.needs & Grant.WIDE_FRAMES)))
        clips = []
        for index in range(len(dataset)):
            clips.append(errors(odometry, dataset[index], cut.num_past))
            watch(index + 1, len(dataset))
        yield str(dataset.ranges[0]), joined(clips)


def errors(odometry: Odometry, clip: Clip, num_past: int) -> Steps:
    """The errors of one clip; Incompatible when it has no poses."""
    if clip.trajectory is None:
        raise Incompatible(f"{clip.name} has no real poses to compare with: choose a sequence that has")
    context, _ = clip.split(num_past, odometry.needs)
    estimate, tracked = odometry.track(context)
    real, ours = _steps(clip.trajectory[:num_past]), _steps(estimate)
    lengths, our_lengths = (np.linalg.norm(steps[:, :3, 3], axis=-1) for steps in (real, ours))
    cosine = (real[:, :3, 3] * ours[:, :3, 3]).sum(axis=-1) / np.maximum(lengths * our_lengths, 1e-12)
    direction_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    has_length = estimate.is_metric and lengths.sum() > MIN_STEP_M
    return Steps(
        tracked[1:],
        np.degrees(se3.rotation_angle_rad(se3.inverse(real) @ ours)),
        np.where(lengths > MIN_STEP_M, direction_deg, np.nan),
        np.array([100 * (our_lengths.sum() / lengths.sum() - 1) if has_length else np.nan]),
    )


def joined(clips: Sequence[Steps]) -> Steps:
    """The steps of all clips."""
    return Steps(
        np.concatenate([clip.tracked for clip in clips]),
        np.concatenate([clip.rotation_deg for clip in clips]),
        np.concatenate([clip.direction_deg for clip in clips]),
        np.concatenate([clip.length_percent for clip in clips]),
    )


def _steps(trajectory: Trajectory) -> FloatArray:
    """Motion [T - 1, 4, 4] from image to image, before_from_now."""
    poses = trajectory.world_from_cam
    return se3.inverse(poses[:-1]) @ poses[1:]


def _dataset(root: Path, frames: str, cut: Cut, with_wide: bool) -> dict[str, Any]:
    spec: dict[str, Any] = {
        "name": "kitti",
        "root": root,
        "sequences": [frames],
        "num_frames": cut.num_past + 1,  # a clip has a future
        "stride": cut.stride,
        "size_px": list(cut.size_px),
        "with_wide": with_wide,
    }
    return spec if cut.camera is None else {**spec, "camera": cut.camera}

"""Accuracy of odometry: drift on whole sequences, and errors of steps on short clips."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.progress import Progress, tracked
from geovp_classic import registry
from geovp_classic.data import pose_files
from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Odometry
from geovp_classic.metrics import odometry as drift
from geovp_classic.types import BoolArray, Clip, FloatArray, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class TrackedSequence:
    """Estimated path of a sequence or a stretch of it."""

    frames: FrameRange
    estimate: Trajectory
    tracked: BoolArray  # [T]
    truth: Trajectory | None

    def drift(self) -> list[list[str]]:
        """Return a table of errors by alignment, with a head; empty without recorded poses."""
        if self.truth is None:
            return []
        names = ("t_rel (%)", "r_rel (deg/100m)", "ATE (m)", "RPE (m)", "RPE (deg)")
        table = [["alignment", *names]]
        for alignment in drift.ALIGNMENTS:
            texts = ["no metric scale"] * len(names)
            has_scale = self.estimate.is_metric and self.truth.is_metric
            if has_scale or alignment in ("scale", "sim3"):
                try:
                    texts = errors(drift.aligned(self.estimate, self.truth, alignment), self.truth)
                except BadData as error:
                    texts = [str(error)] * len(names)
            table.append([alignment, *texts])
        return table

    def write(self, folder: Path) -> list[Path]:
        """Write the path as KITTI and TUM files, which evo plots; return the files."""
        stem = f"{self.frames.sequence}-{self.frames.first:06d}-{self.frames.last:06d}"
        kitti, tum = folder / f"{stem}.kitti.txt", folder / f"{stem}.tum.txt"
        pose_files.write_kitti(kitti, self.estimate)
        pose_files.write_tum(tum, self.estimate)
        return [kitti, tum]


def errors(aligned: Trajectory, truth: Trajectory) -> list[str]:
    """Return the drift, and root mean squares of absolute and relative errors, as texts."""
    drifted = drift.kitti_drift(aligned, truth)
    relative = [f"{drifted.translation_percent:.2f}", f"{drifted.rotation_deg_per_100m:.3f}"]
    if drifted.num_segments == 0:
        relative = ["too short"] * 2
    rpe_m, rpe_deg = map(drift.root_mean_square, drift.relative_error(aligned, truth))
    ate_m = drift.root_mean_square(drift.absolute_error_m(aligned, truth))
    return [*relative, f"{ate_m:.2f}", f"{rpe_m:.4f}", f"{rpe_deg:.4f}"]


def track_sequences(
    data: Mapping[str, Any], frames: Sequence[str], spec: Mapping[str, Any], progress: Progress
) -> Iterator[TrackedSequence]:
    """Run an odometry over stretches such as "03" or "03[0:360)" of a data set."""
    odometry = registry.build("odometries", spec)
    if not hasattr(odometry, "track_sequence"):
        raise Incompatible(
            f"the odometry {registry.name_of(odometry)!r} works on clips only: choose a "
            "streaming one"
        )
    dataset = registry.build("datasets", {**data, "sequences": list(frames), "num_frames": 2})
    for stretch in dataset.ranges:
        recording = dataset.recordings[stretch.sequence]
        steps = range(stretch.first, stretch.last)
        images = map(recording.frames.read, tracked(steps, len(steps), progress))
        kept = slice(stretch.first, stretch.last)
        estimate, is_tracked = odometry.track_sequence(
            images, recording.times_s[kept], recording.intrinsics, recording.camera_height_m
        )
        truth = recording.trajectory
        yield TrackedSequence(stretch, estimate, is_tracked, None if truth is None else truth[kept])


def clip_table(
    data: Mapping[str, Any],  # with stride and size_px
    frames: Sequence[str],
    spec: Mapping[str, Any],
    num_past: int,
    progress: Progress,
) -> list[list[str]]:
    """Return the median errors of an odometry on clips, a row per stretch, with a head."""
    odometry = registry.build("odometries", spec)
    with_full = PrivilegedInput.FULL_FRAMES in odometry.needs
    shared = {**data, "num_frames": num_past + 1, "with_full": with_full}
    table = [
        ["frames", "clips", "tracked", "rotation (deg/frame)", "direction (deg)", "length (%)"]
    ]
    for stretch in frames:
        dataset = registry.build("datasets", {**shared, "sequences": [stretch]})
        numbers = tracked(range(len(dataset)), len(dataset), progress)
        clips = [step_errors(odometry, dataset[number], num_past) for number in numbers]
        is_tracked, *steps = map(np.concatenate, zip(*clips, strict=True))
        medians = []
        for values, digits in zip(steps, (4, 2, 1), strict=True):
            finite = values[np.isfinite(values)]
            medians.append(f"{np.median(finite):.{digits}f}" if len(finite) else "-")
        name = str(dataset.ranges[0]) if len(dataset.ranges) == 1 else stretch
        table.append([name, str(len(clips)), f"{is_tracked.mean():.1%}", *medians])
    return table


def step_errors(
    odometry: Odometry, clip: Clip, num_past: int, min_step_m: float = 0.05
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
    """Return tracked [N], rotation [N] and direction errors [N] in degrees, length error [1] in %.

    The direction of a step below `min_step_m` is NaN, and so is the length without metric scale.
    """
    if clip.trajectory is None:
        raise Incompatible(f"{clip.name} has no recorded poses: choose a sequence that has")
    context, _ = clip.split(num_past, odometry.needs)
    estimate, is_tracked = odometry.track(context)
    truth = clip.trajectory[:num_past]
    real, ours = (
        (se3.inverse(path.world_from_cam[:-1]) @ path.world_from_cam[1:])[:, :3, 3]
        for path in (truth, estimate)
    )
    real_length, length = (np.linalg.norm(steps, axis=-1) for steps in (real, ours))
    cosine = (real * ours).sum(axis=-1) / np.maximum(real_length * length, 1e-12)
    direction_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    length_percent = np.nan
    if estimate.is_metric and truth.is_metric and real_length.sum() > min_step_m:
        length_percent = 100 * abs(length.sum() / real_length.sum() - 1)
    return (
        is_tracked[1:],
        drift.relative_error(estimate, truth)[1],
        np.where(real_length > min_step_m, direction_deg, np.nan),
        np.array([length_percent]),
    )

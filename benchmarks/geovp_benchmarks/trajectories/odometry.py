"""Accuracy of odometry on whole sequences and on short clips."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp.progress import tracked
from geovp_classic import registry
from geovp_classic.data.recordings.windows import FrameRange
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.interfaces import SequenceOdometry
from geovp_classic.metrics import drift
from geovp_classic.types import BoolArray, PrivilegedInput, Trajectory

Spec = Mapping[str, Any]


@dataclass(frozen=True)
class TrackedPath:
    """Estimated path of a sequence, a stretch of it, or a clip."""

    estimate: Trajectory
    tracked: BoolArray  # [T]
    truth: Trajectory | None

    def errors(self, alignment: drift.Alignment) -> list[float]:
        """Return t_rel, r_rel, ATE, and RPE of position and rotation; NaN if undefined.

        Drift needs segments of 100 m. All need recorded poses and a scale that is known or fitted.
        """
        truth, estimate = self.truth, self.estimate
        is_scaled = alignment in ("scale", "sim3")
        with suppress(BadData):  # a stationary camera
            if truth is not None and (is_scaled or (estimate.is_metric and truth.is_metric)):
                aligned = drift.aligned(estimate, truth, alignment)
                drifted = drift.kitti_drift(aligned, truth)
                position_m = drift.absolute_error_m(aligned, truth)
                errors = position_m, *drift.relative_error(aligned, truth)
                return [
                    drifted.translation_percent,
                    drifted.rotation_deg_per_100m,
                    *map(drift.root_mean_square, errors),
                ]
        return [np.nan] * 5


def error_table(paths: Sequence[TrackedPath]) -> list[list[str]]:
    """Return the median errors over paths by alignment, with a head."""
    decimals = {"t_rel (%)": 2, "r_rel (deg/100m)": 3, "ATE (m)": 2, "RPE (m)": 4, "RPE (deg)": 4}
    table = [["alignment", *decimals]]
    for alignment in drift.ALIGNMENTS:
        errors = np.array([path.errors(alignment) for path in paths])
        medians = np.ma.median(np.ma.masked_invalid(errors), axis=0).filled(np.nan)
        pairs = zip(medians, decimals.values(), strict=True)
        texts = [f"{value:.{digits}f}" if np.isfinite(value) else "-" for value, digits in pairs]
        table.append([alignment, *texts])
    return table


def track_sequences(
    data: Spec, frames: Sequence[str], spec: Spec
) -> Iterator[tuple[FrameRange, TrackedPath]]:
    """Run an odometry over stretches such as "03" or "03[0:360)"; yield each with its path."""
    odometry = registry.build("odometries", spec)
    if not isinstance(odometry, SequenceOdometry):
        raise Incompatible(
            f"the odometry {registry.name_of(odometry)!r} works on clips only: give "
            "--clips N, or choose an odometry that tracks whole sequences"
        )
    dataset = registry.build("datasets", {**data, "sequences": list(frames), "num_frames": 2})
    for stretch in dataset.ranges:
        recording = dataset.recordings[stretch.sequence]
        steps = slice(stretch.first, stretch.last)
        numbers = range(len(recording.frames))[steps]
        images = map(recording.frames.read, tracked(numbers))
        estimate, is_tracked = odometry.track_sequence(
            images, recording.times_s[steps], recording.intrinsics, recording.camera_height_m
        )
        truth = recording.trajectory and recording.trajectory[steps]
        yield stretch, TrackedPath(estimate, is_tracked, truth)


def track_clips(
    data: Spec, frames: Sequence[str], spec: Spec, num_frames: int
) -> Iterator[tuple[str, list[TrackedPath]]]:
    """Run an odometry over all clips of each stretch; yield each stretch with its paths."""
    odometry = registry.build("odometries", spec)
    with_full = PrivilegedInput.FULL_FRAMES in odometry.needs
    shared = {**data, "num_frames": num_frames + 1, "with_full": with_full}
    for stretch in frames:
        dataset = registry.build("datasets", {**shared, "sequences": [stretch]})
        paths = []
        for number in tracked(range(len(dataset))):
            clip = dataset[number]
            estimate, is_tracked = odometry.track(clip.split(num_frames, odometry.needs)[0])
            truth = clip.trajectory and clip.trajectory[:num_frames]
            paths.append(TrackedPath(estimate, is_tracked, truth))
        yield ", ".join(map(str, dataset.ranges)), paths

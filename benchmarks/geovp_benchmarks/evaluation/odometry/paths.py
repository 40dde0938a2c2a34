"""Odometry on whole sequences: pose files, drift, and a plot of the path with the ground truth."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geovp_benchmarks.plots import style
from geovp_benchmarks.progress import Progress
from geovp_classic import registry
from geovp_classic.data import pose_files
from geovp_classic.data.atomic import atomic_write
from geovp_classic.data.windows import FrameRange, Recording
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.metrics import odometry as drift
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Trajectory

COLUMNS = ("alignment", "t_rel (%)", "r_rel (deg/100m)", "ATE (m)", "RPE (m)", "RPE (deg)")


@dataclass(frozen=True)
class Tracked:
    """One stretch of a sequence, with the odometry's path of it."""

    frames: FrameRange
    estimate: Trajectory
    tracked: BoolArray
    truth: Trajectory | None

    @property
    def name(self) -> str:
        """For files: the sequence, and its frames when they are not all of it."""
        return f"{self.frames.sequence}-{self.frames.first:06d}-{self.frames.last:06d}"

    def rows(self) -> list[tuple[str, ...]]:
        """One row of texts per alignment, as COLUMNS; none without real poses."""
        return (
            []
            if self.truth is None
            else [_row(self.estimate, self.truth, how) for how in drift.ALIGNMENTS]
        )


def track(
    data: Mapping[str, Any], frames: Sequence[str], spec: Mapping[str, Any], progress: Progress
) -> Iterator[Tracked]:
    """Run the odometry over stretches such as "03" or "03[0:360)" of a data set, given as its
    table.
    """
    odometry = registry.build("odometries", spec)
    if not hasattr(odometry, "track_sequence"):
        raise Incompatible(
            f"the odometry {registry.name_of(odometry)!r} works on clips only: choose a "
            "streaming one"
        )
    asked = {**data, "sequences": list(frames), "num_frames": 2}
    dataset = registry.build("datasets", asked)
    for stretch in dataset.ranges:
        recording = dataset.recordings[stretch.sequence]
        steps = slice(stretch.first, stretch.last)
        images = _images(recording, stretch, progress)
        times_s, height_m = recording.times_s[steps], recording.camera_height_m
        estimate, marks = odometry.track_sequence(images, times_s, recording.intrinsics, height_m)
        truth = None if recording.trajectory is None else recording.trajectory[steps]
        yield Tracked(stretch, estimate, marks, truth)


def _images(recording: Recording, frames: FrameRange, progress: Progress) -> Iterator[ByteArray]:
    assert frames.last is not None
    for number in range(frames.first, frames.last):
        yield recording.frames.read(number)
        progress(number + 1 - frames.first, frames.last - frames.first)


def write(tracked: Tracked, folder: Path) -> list[Path]:
    """Write the path as KITTI and TUM files and a figure of it with the ground truth; the files."""
    written = [
        folder / f"{tracked.name}{ending}" for ending in (".kitti.txt", ".tum.txt", ".png", ".svg")
    ]
    pose_files.write_kitti(written[0], tracked.estimate)
    pose_files.write_tum(written[1], tracked.estimate)
    for path in written[2:]:
        with atomic_write(path) as scratch:
            _draw(tracked, scratch, path.suffix.removeprefix("."))
    return written


def _row(estimate: Trajectory, truth: Trajectory, how: drift.Alignment) -> tuple[str, ...]:
    if not (estimate.is_metric and truth.is_metric) and how in ("origin", "se3"):
        return (how, *["no metric scale"] * (len(COLUMNS) - 1))
    try:
        aligned = drift.aligned(estimate, truth, how)
    except BadData as error:
        return (how, *[str(error)] * (len(COLUMNS) - 1))
    drifted = drift.kitti_drift(aligned, truth)
    step_m, step_deg = drift.relative_error(aligned, truth)
    return (
        how,
        _number(drifted.translation_percent, 2),
        _number(drifted.rotation_deg_per_100m, 3),
        _number(drift.root_mean_square(drift.absolute_error_m(aligned, truth)), 2),
        _number(drift.root_mean_square(step_m), 4),
        _number(drift.root_mean_square(step_deg), 4),
    )


def _number(value: float, digits: int) -> str:
    return "too short" if math.isnan(value) else f"{value:.{digits}f}"


def _draw(tracked: Tracked, file: Path, kind: str) -> None:
    """The path from above, in the first camera's x and z."""
    import matplotlib.style
    from matplotlib.figure import Figure

    with matplotlib.style.context(style.SHEET):
        figure = Figure(figsize=(6, 6), layout="constrained")
        axes = figure.subplots()
        estimate = tracked.estimate
        if tracked.truth is not None:
            estimate = drift.aligned(
                estimate, tracked.truth, "origin" if estimate.is_metric else "scale"
            )
            axes.plot(*_from_above(tracked.truth), "--", color="black", label="ground truth")
        axes.plot(*_from_above(estimate), "-", color="tab:blue", label="estimate")
        axes.set(
            xlabel="x (m)",
            ylabel="z (m)",
            title=f"{tracked.frames}: path from above",
            aspect="equal",
        )
        axes.legend()
        figure.savefig(file, format=kind, dpi=150)


def _from_above(path: Trajectory) -> FloatArray:
    return path.world_from_cam[:, [0, 2], 3].T

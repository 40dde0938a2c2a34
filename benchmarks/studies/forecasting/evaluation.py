"""The table of forecasters: every one on the same windows of pose files, one row each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.studies.forecasting.scores import Corruption, Scores, Window, measure
from geovp_classic.data import pose_files
from geovp_classic.errors import BadData
from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.forecasting.kalman import AccelerationKalman, TurnRateKalman, TurnRateUnscented
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

REGIONS = (0.5, 0.9)
TURNING_DEG = 15.0  # a window that truly turns more than this is one of the turning ones


def forecasters(coefficients: Path | None = None) -> dict[str, Forecaster]:
    """The rows of the table."""
    return {
        "hold": Hold(),
        "constant velocity": ConstantVelocity(),
        "constant twist": ConstantTurn(),
        "CTRV, extended": TurnRateKalman(),
        "CTRV, unscented": TurnRateUnscented(),
        "CTRA": AccelerationKalman("acceleration"),
        "CTRA, damped": AccelerationKalman("acceleration-damped"),
        "motion prior": MotionPrior(coefficients=coefficients),
    }


def read_sequences(folder: Path, names: Sequence[str]) -> dict[str, Trajectory]:
    """The trajectories folder/NN.txt with times folder/NN_times.txt; BadData says which file is wrong."""
    return {
        name: pose_files.read_trajectory(folder / f"{name}.txt", pose_files.read_times(folder / f"{name}_times.txt"))
        for name in names
    }


def read_windows(
    folder: Path, names: Sequence[str], num_past: int = 10, num_future: int = 20, stride: int = 5
) -> list[Window]:
    """All windows of the named sequences; BadData when there is none."""
    if min(num_past, num_future, stride) < 1:
        raise BadData(
            f"windows of {num_past} past and {num_future} future steps, every {stride}: expected at least one of each"
        )
    sequences = read_sequences(folder, names).values()
    windows = [window for trajectory in sequences for window in cut(trajectory, num_past, num_future, stride)]
    if not windows:
        raise BadData(f"{folder}: no sequence is as long as one window of {num_past + num_future} poses")
    return windows


def cut(trajectory: Trajectory, num_past: int = 10, num_future: int = 20, stride: int = 5) -> Iterator[Window]:
    """All windows of one sequence, whose starts are `stride` frames apart; none when it is too short."""
    for first in range(0, len(trajectory) - num_past - num_future + 1, stride):
        middle = first + num_past
        yield trajectory[first:middle], trajectory[middle : middle + num_future]


def evaluate(
    windows: Sequence[Window],
    rows: Mapping[str, Forecaster],
    corruption: Corruption | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Scores]:
    """Scores of every forecaster on the same windows; `progress` is called with the forecasts done and their total."""

    def counted(first: int) -> Iterator[Window]:
        for done, window in enumerate(windows, first + 1):
            yield window
            progress(done, len(rows) * len(windows))

    return {
        name: measure(forecaster, counted(number * len(windows)), corruption=corruption)
        for number, (name, forecaster) in enumerate(rows.items())
    }


def columns(scores: Scores) -> dict[str, float]:
    """One row's numbers; NaN where there is nothing to measure."""
    num_future = scores.position_m.shape[1]
    steps = [step for step in (1, 10, 20) if step <= num_future]
    row = {f"error @{step} m": float(scores.position_m[:, step - 1].mean()) for step in steps}
    row["ADE m"] = float(scores.position_m.mean())
    row["FDE m"] = float(scores.position_m[:, -1].mean())
    row[f"yaw @{num_future} deg"] = float(scores.yaw_deg[:, -1].mean())
    row["median"] = float(np.median(scores.yaw_deg[:, -1]))
    row["NLL nats"] = float(scores.negative_log_density.mean())
    row["energy m"] = float(scores.energy_m.mean())
    for region in REGIONS:
        row[f"in {region:.0%}"] = _share(scores.rank, region)
        row[f"in {region:.0%} @{num_future}"] = _share(scores.rank[:, -1], region)
    turning = np.abs(scores.turned_deg) > TURNING_DEG
    row["ADE m, turning"] = float(scores.position_m[turning].mean()) if turning.any() else np.nan
    row[f"yaw @{num_future} deg, turning"] = float(scores.yaw_deg[turning, -1].mean()) if turning.any() else np.nan
    return row


def as_lines(table: Mapping[str, Scores]) -> Iterator[str]:
    """The number of turning windows, and the table in Markdown."""
    rows = {name: columns(scores) for name, scores in table.items()}
    turned_deg = next(iter(table.values())).turned_deg
    heads = list(next(iter(rows.values())))
    yield f"turning: {(np.abs(turned_deg) > TURNING_DEG).sum()} windows, by more than {TURNING_DEG:g} degrees"
    yield "| forecaster | " + " | ".join(heads) + " |"
    yield "| --- |" + " ---: |" * len(heads)
    for name, row in rows.items():
        yield f"| {name} | " + " | ".join("-" if np.isnan(row[head]) else f"{row[head]:.3f}" for head in heads) + " |"


@dataclass(frozen=True)
class OdometryNoise:
    """Independent errors of every step of the past; the last pose stays.

    Lengths are off by a common factor, whose logarithm is normal; the true last position is the reference all the same.
    """

    position_m: float = 0.02
    rotation_deg: float = 0.05
    scale: float = 0.0  # standard deviation of the factor's logarithm
    seed: int = 0

    def __call__(self, past: Trajectory) -> Trajectory:
        """The past as an odometry of this noise gives it; the same windows get the same noise."""
        key = round(float(past.times_s[-1]) * 1e4) % 2**32
        rng = np.random.default_rng([self.seed, key])
        deviation = np.repeat([self.position_m, np.radians(self.rotation_deg)], 3)
        steps = se3.inverse(past.world_from_cam[:-1]) @ past.world_from_cam[1:]
        steps = steps @ se3.exp(deviation * rng.standard_normal((len(steps), 6)))
        steps[:, :3, 3] *= np.exp(self.scale * rng.standard_normal())
        poses = [past.world_from_cam[-1]]
        for step in steps[::-1]:
            poses.append(poses[-1] @ se3.inverse(step))
        return Trajectory(np.stack(poses[::-1]), past.times_s, past.is_metric)


def _share(rank: FloatArray, region: float) -> float:
    return float("nan") if np.isnan(rank).any() else float((rank <= region).mean())

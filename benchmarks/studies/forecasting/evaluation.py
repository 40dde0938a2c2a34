"""The table of forecasters: accuracy and calibration of every one on the same windows of pose files.

Errors are taken on the x-z plane of the last observed camera: (x, z, yaw_rad) of the true and the forecast cameras.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

from geovp_benchmarks.progress import Progress, no_progress
from geovp_classic.data import pose_files
from geovp_classic.errors import BadData
from geovp_classic.forecasting.body_motion import over_plane
from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.forecasting.kalman import AccelerationKalman, TurnRateKalman, TurnRateUnscented
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar, se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

REGIONS = (0.5, 0.9)
TURNING_DEG = 15.0  # a window that truly turns more than this is one of the turning ones
Window = tuple[Trajectory, Trajectory]  # past and future of a piece of one sequence
Corruption = Callable[[Trajectory], Trajectory]  # of the past, before the forecaster sees it


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
    windows: list[Window],
    rows: Mapping[str, Forecaster],
    corruption: Corruption | None = None,
    progress: Progress = no_progress,
) -> dict[str, Scores]:
    """Scores of every forecaster on the same windows; `progress` is called with the forecasts done and their total."""
    done = itertools.count(1)

    def counted() -> Iterator[Window]:
        for window in windows:
            yield window
            progress(next(done), len(rows) * len(windows))

    return {name: measure(forecaster, counted(), corruption=corruption) for name, forecaster in rows.items()}


@dataclass(frozen=True)
class Scores:
    """One row per window; NaN for a forecaster without a distribution."""

    position_m: FloatArray  # [N, F]
    yaw_deg: FloatArray  # [N, F]
    negative_log_density: FloatArray  # [N, F], nats per square metre and radian
    rank: FloatArray  # [N, F]: the truth is in the region of a probability when its rank is at most that
    energy_m: FloatArray  # [N], energy score of whole paths in the plane, averaged over steps
    turned_deg: FloatArray  # [N], true change of heading until the last step
    body: FloatArray  # [N, F, 3], errors of height (m), pitch and roll (degrees) over the plane


def measure(
    forecaster: Forecaster, windows: Iterable[Window], num_samples: int = 100, corruption: Corruption | None = None
) -> Scores:
    """Scores of all windows."""
    rows = [_row(forecaster, window, num_samples, corruption) for window in windows]
    return Scores(*(np.stack(column) for column in zip(*rows, strict=True)))


def energy_score(
    samples: FloatArray,  # [S, F, 2]
    truth: FloatArray,  # [F, 2]
) -> float:
    """E|X - y| - E|X - X'| / 2 with |.| the mean distance over the steps (Gneiting and Raftery 2007, eq. 21).

    The second mean is over pairs of different samples, so that it does not shrink with few of them; one sample gives
    the plain mean distance.
    """
    distance = float(np.linalg.norm(samples - truth, axis=-1).mean())
    if len(samples) == 1:
        return distance
    return distance - 0.5 * float(np.mean([pdist(samples[:, step]).mean() for step in range(samples.shape[1])]))


def highest_density_rank(
    forecast: PlanarForecast, states: FloatArray, num_samples: int = 400, seed: int = 0
) -> FloatArray:
    """Share [F] of the forecast's own samples that are likelier than the true state [F, 3] (Hyndman 1996).

    For a Gaussian, "rank at most 0.9" is the 90 % ellipsoid; for a mixture the region may be in pieces.
    """
    truth = forecast.log_density(states[None])[0]
    return np.asarray((forecast.log_density(forecast.sample(num_samples, seed)) > truth).mean(0))


def columns(scores: Scores) -> dict[str, float]:
    """One row's numbers; NaN where there is nothing to measure."""
    num_future = scores.position_m.shape[1]
    steps = [step for step in (1, 10, 20) if step <= num_future]
    row = {f"error @{step} m": float(scores.position_m[:, step - 1].mean()) for step in steps}
    row["ADE m"] = float(scores.position_m.mean())
    row["FDE m"] = float(scores.position_m[:, -1].mean())
    row[f"yaw @{num_future} deg"] = float(scores.yaw_deg[:, -1].mean())
    row["median"] = float(np.median(scores.yaw_deg[:, -1]))
    for number, (name, unit) in enumerate((("height", "m"), ("pitch", "deg"), ("roll", "deg"))):
        row[f"{name} @1 {unit}"] = float(scores.body[:, 0, number].mean())
        row[f"{name} {unit}"] = float(scores.body[..., number].mean())
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


def as_json(table: Mapping[str, Scores], sequences: Sequence[str]) -> str:
    """The same numbers, null for what cannot be measured."""
    rows = {name: columns(scores) for name, scores in table.items()}
    known = {name: {key: None if np.isnan(x) else x for key, x in row.items()} for name, row in rows.items()}
    turned_deg = next(iter(table.values())).turned_deg
    turning = int((np.abs(turned_deg) > TURNING_DEG).sum())
    about = {"sequences": list(sequences), "windows": len(turned_deg), "turning_windows": turning}
    return json.dumps({**about, "forecasters": known}, indent=2)


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


def _row(
    forecaster: Forecaster, window: Window, num_samples: int, corruption: Corruption | None
) -> tuple[FloatArray, ...]:
    (past, future), reference = window, window[0].world_from_cam[-1]
    past = past if corruption is None else corruption(past)
    truth = _planar(future.world_from_cam, reference)
    centre = forecaster.forecast(past, future.times_s)[0]
    error = _planar(centre, reference) - truth
    yaw_deg = np.degrees(np.abs((error[:, 2] + np.pi) % (2 * np.pi) - np.pi))
    body = np.abs(over_plane(centre, window[0]) - over_plane(future.world_from_cam, window[0]))
    body[:, 1:] = np.degrees(body[:, 1:])
    position_m, turned_deg = np.linalg.norm(error[:, :2], axis=-1), np.degrees(np.unwrap(truth[:, 2])[-1:])[0]
    if not isinstance(forecaster, TurnRateKalman | MotionPrior):
        unknown = np.full(len(future), np.nan)
        return position_m, yaw_deg, unknown, unknown, np.array(position_m.mean()), turned_deg, body
    forecast = forecaster.distribution(past, future.times_s)
    states = forecast.states_of(future.world_from_cam)
    samples = _planar(forecaster.forecast(past, future.times_s, num_samples), reference)[..., :2]
    negative_log_density, rank = -forecast.log_density(states[None])[0], highest_density_rank(forecast, states)
    return (
        position_m,
        yaw_deg,
        negative_log_density,
        rank,
        np.array(energy_score(samples, truth[:, :2])),
        turned_deg,
        body,
    )


def _planar(world_from_cam: FloatArray, world_from_reference: FloatArray) -> FloatArray:
    return planar.reduce(world_from_cam, world_from_reference, planar.level_vehicle_from_cam())

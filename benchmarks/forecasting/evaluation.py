"""The table of forecasters: every one on the same windows of pose files, one row each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.forecasting import windows
from benchmarks.forecasting.scores import Scores, Spoil, measure
from benchmarks.forecasting.watching import Watch, unwatched
from benchmarks.forecasting.windows import Cut, Window
from geovp_classic.errors import BadData
from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.forecasting.kalman import AccelerationKalman, TurnRateKalman, TurnRateUnscented
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

REGIONS = (0.5, 0.9)
TURNING_DEG = 15.0  # a window that truly turns more than this is one of the turning ones


def contestants(coefficients: Path | None = None) -> dict[str, Forecaster]:
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


def read_windows(folder: Path, names: Sequence[str], cut: Cut) -> list[Window]:
    """All windows of the named sequences; BadData when there is none."""
    cuts = [
        window for trajectory in windows.read(folder, names).values() for window in windows.windows(trajectory, cut)
    ]
    if not cuts:
        raise BadData(f"{folder}: no sequence is as long as one window of {cut.num_past + cut.num_future} poses")
    return cuts


def evaluate(
    cuts: Sequence[Window],
    forecasters: Mapping[str, Forecaster],
    spoil: Spoil | None = None,
    watch: Watch = unwatched,
) -> dict[str, Scores]:
    """Scores of every forecaster on the same windows; `watch` is told how many of all are done."""
    total = len(forecasters) * len(cuts)

    def watched(first: int) -> Iterator[Window]:
        for done, window in enumerate(cuts, first + 1):
            yield window
            watch(done, total)

    return {
        name: measure(forecaster, watched(number * len(cuts)), spoil=spoil)
        for number, (name, forecaster) in enumerate(forecasters.items())
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
    row["ADE m, turning"] = float(scores.position_m[turning].mean()) if turning.any() else float("nan")
    row[f"yaw @{num_future} deg, turning"] = float(scores.yaw_deg[turning, -1].mean()) if turning.any() else np.nan
    return row


def as_lines(table: Mapping[str, Scores]) -> Iterable[str]:
    """How many windows turn, and the table in Markdown."""
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
    """Every step of the past measured with independent errors; the last pose is the one that stays.

    Lengths are off by a common factor, whose logarithm is normal; the true last position is the reference all the same.
    """

    position_m: float = 0.02
    rotation_deg: float = 0.05
    seed: int = 0
    scale: float = 0.0  # standard deviation of the factor's logarithm

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


def odometry_noise(times: float, scale_error: float) -> OdometryNoise | None:
    """The usual noise so many times, with a scale error; None for neither."""
    usual = OdometryNoise()
    noise = OdometryNoise(usual.position_m * times, usual.rotation_deg * times, scale=scale_error)
    return noise if times > 0 or scale_error > 0 else None


def _share(rank: FloatArray, region: float) -> float:
    return float("nan") if np.isnan(rank).any() else float((rank <= region).mean())

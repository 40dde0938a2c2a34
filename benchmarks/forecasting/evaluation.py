"""The table of forecasters: every one on the same windows of pose files, one row each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.forecasting import windows
from benchmarks.forecasting.scores import Scores, Spoil, measure
from benchmarks.forecasting.windows import Cut
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.poses.forecast import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.poses.motion_prior import MotionPrior
from geovp_classic.poses.turn_rate import AccelerationKalman, TurnRateKalman, TurnRateUnscented
from geovp_classic.types import FloatArray, Trajectory

REGIONS = (0.5, 0.9)


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


def evaluate(
    folder: Path,
    names: Sequence[str],
    forecasters: Mapping[str, Forecaster],
    cut: Cut,
    spoil: Spoil | None = None,
) -> dict[str, Scores]:
    """Scores of every forecaster on all windows of the named sequences."""
    cuts = [
        window for trajectory in windows.read(folder, names).values() for window in windows.windows(trajectory, cut)
    ]
    if not cuts:
        raise BadData(f"{folder}: no sequence is as long as one window of {cut.num_past + cut.num_future} poses")
    return {name: measure(forecaster, cuts, spoil=spoil) for name, forecaster in forecasters.items()}


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
    return row


def as_lines(table: Mapping[str, Scores]) -> Iterable[str]:
    """The table in Markdown."""
    rows = {name: columns(scores) for name, scores in table.items()}
    heads = list(next(iter(rows.values())))
    yield "| forecaster | " + " | ".join(heads) + " |"
    yield "| --- |" + " ---: |" * len(heads)
    for name, row in rows.items():
        yield f"| {name} | " + " | ".join("-" if np.isnan(row[head]) else f"{row[head]:.3f}" for head in heads) + " |"


@dataclass(frozen=True)
class OdometryNoise:
    """Every step of the past measured with independent errors; the last pose is the one that stays."""

    position_m: float = 0.02
    rotation_deg: float = 0.05
    seed: int = 0

    def __call__(self, past: Trajectory) -> Trajectory:
        """The past as an odometry of this noise gives it; the same windows get the same noise."""
        key = round(float(past.times_s[-1]) * 1e4) % 2**32
        rng = np.random.default_rng([self.seed, key])
        deviation = np.repeat([self.position_m, np.radians(self.rotation_deg)], 3)
        steps = se3.inverse(past.world_from_cam[:-1]) @ past.world_from_cam[1:]
        steps = steps @ se3.exp(deviation * rng.standard_normal((len(steps), 6)))
        poses = [past.world_from_cam[-1]]
        for step in steps[::-1]:
            poses.append(poses[-1] @ se3.inverse(step))
        return Trajectory(np.stack(poses[::-1]), past.times_s, past.is_metric)


def _share(rank: FloatArray, region: float) -> float:
    return float("nan") if np.isnan(rank).any() else float((rank <= region).mean())

"""The table of forecasters: accuracy and calibration of every one on the same windows of pose
files.

Errors are taken on the x-z plane of the last observed camera: (x, z, yaw_rad) of the true and the
forecast cameras.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
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
        "CTRA": AccelerationKalman(constants="acceleration"),
        "CTRA, damped": AccelerationKalman(),
        "motion prior": MotionPrior(coefficients=coefficients),
    }


def read_sequences(folder: Path, names: Sequence[str]) -> dict[str, Trajectory]:
    """The trajectories folder/NN.txt with their times; BadData says which file is wrong.

    Times are those of folder/NN_times.txt or, as KITTI odometry has them, of
    folder/../sequences/NN/times.txt.
    """
    found = {}
    for name in names:
        beside, of_images = (
            folder / f"{name}_times.txt",
            folder.parent / "sequences" / name / "times.txt",
        )
        times_s = pose_files.read_times(
            of_images if of_images.exists() and not beside.exists() else beside
        )
        found[name] = pose_files.read_trajectory(folder / f"{name}.txt", times_s)
    return found


def read_windows(
    folder: Path, names: Sequence[str], num_past: int = 10, num_future: int = 20, stride: int = 5
) -> list[Window]:
    """All windows of the named sequences; BadData when there is none."""
    if min(num_past, num_future, stride) < 1:
        raise BadData(
            f"windows of {num_past} past and {num_future} future steps, every {stride}: "
            "expected at least one of each"
        )
    sequences = read_sequences(folder, names).values()
    windows = [
        window
        for trajectory in sequences
        for window in cut(trajectory, num_past, num_future, stride)
    ]
    if not windows:
        raise BadData(
            f"{folder}: no sequence is as long as one window of {num_past + num_future} poses"
        )
    return windows


def cut(
    trajectory: Trajectory, num_past: int = 10, num_future: int = 20, stride: int = 5
) -> Iterator[Window]:
    """All windows of one sequence, whose starts are `stride` frames apart; none when it is too
    short.
    """
    for first in range(0, len(trajectory) - num_past - num_future + 1, stride):
        middle = first + num_past
        yield trajectory[first:middle], trajectory[middle : middle + num_future]


def evaluate(
    windows: list[Window],
    rows: Mapping[str, Forecaster],
    corruption: Corruption | None = None,
    progress: Progress = no_progress,
) -> dict[str, Scores]:
    """Scores of every forecaster on the same windows; `progress` is called with the forecasts done
    and their total.
    """
    done = itertools.count(1)

    def counted() -> Iterator[Window]:
        for window in windows:
            yield window
            progress(next(done), len(rows) * len(windows))

    return {
        name: measure(forecaster, counted(), corruption=corruption)
        for name, forecaster in rows.items()
    }


@dataclass(frozen=True)
class Scores:
    """One row per window; NaN for a forecaster without a distribution."""

    position_m: FloatArray  # [N, F]
    yaw_deg: FloatArray  # [N, F]
    negative_log_density: FloatArray  # [N, F], nats per square metre and radian
    # [N, F]: the truth is in the region of a probability when its rank is at most that
    rank: FloatArray
    energy_m: FloatArray  # [N], energy score of whole paths in the plane, averaged over steps
    turned_deg: FloatArray  # [N], true change of heading until the last step
    body: FloatArray  # [N, F, 3], errors of height (m), pitch and roll (degrees) over the plane
    # [N, F, 4], as `rank`: of height, pitch and roll, and of all six components together
    body_rank: FloatArray
    body_energy: (
        FloatArray  # [N, 3], energy score of one component (m, degrees), averaged over steps
    )


def measure(
    forecaster: Forecaster,
    windows: Iterable[Window],
    num_samples: int = 100,
    corruption: Corruption | None = None,
) -> Scores:
    """Scores of all windows."""
    rows = [_row(forecaster, window, num_samples, corruption) for window in windows]
    return Scores(
        **{
            field.name: np.stack([getattr(row, field.name) for row in rows])
            for field in fields(Scores)
        }
    )


def energy_score(
    samples: FloatArray,  # [S, F, C]
    truth: FloatArray,  # [F, C]
) -> float:
    """E|X - y| - E|X - X'| / 2 with |.| the mean distance over the steps (Gneiting and Raftery
    2007, eq. 21).

    The second mean is over pairs of different samples, so that it does not shrink with few of them;
    one sample gives the plain mean distance.
    """
    distance = float(np.linalg.norm(samples - truth, axis=-1).mean())
    if len(samples) == 1:
        return distance
    return distance - 0.5 * float(
        np.mean([pdist(samples[:, step]).mean() for step in range(samples.shape[1])])
    )


def highest_density_ranks(
    forecast: PlanarForecast,
    states: FloatArray,  # [F, 3], on the plane
    body: FloatArray,  # [F, 3], over it
    num_samples: int = 400,
    seed: int = 0,
) -> FloatArray:
    """Share [F, 2] of the forecast's own samples that are likelier than the truth (Hyndman 1996),
    planar and whole.

    For a Gaussian, "rank at most 0.9" is the 90 % ellipsoid; for a mixture the region may be in
    pieces. NaN in place of the whole where the forecast says nothing of heave, pitch and roll.
    """
    truth, drawn = (
        forecast.log_density(states[None])[0],
        forecast.log_density(forecast.sample(num_samples, seed)),
    )
    plane = (drawn > truth).mean(0)
    if forecast.body is None:
        return np.stack([plane, np.full(len(plane), np.nan)], axis=1)
    whole = truth + forecast.body.log_density(body[None])[0]
    drawn += forecast.body.log_density(forecast.body.sample(num_samples, seed))
    return np.stack([plane, (drawn > whole).mean(0)], axis=1)


@dataclass(frozen=True)
class OdometryNoise:
    """Independent errors of every step of the past; the last pose stays.

    Lengths are off by a common factor, whose logarithm is normal; the true last position is the
    reference all the same.
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


def _row(
    forecaster: Forecaster, window: Window, num_samples: int, corruption: Corruption | None
) -> Scores:
    """The scores of one window, without the axis of the windows."""
    (past, future), reference = window, window[0].world_from_cam[-1]
    past = past if corruption is None else corruption(past)
    truth = _planar(future.world_from_cam, reference)
    centre = forecaster.forecast(past, future.times_s)[0]
    error = _planar(centre, reference) - truth
    yaw_deg = np.degrees(np.abs((error[:, 2] + np.pi) % (2 * np.pi) - np.pi))
    body_truth = over_plane(future.world_from_cam, window[0])
    body = np.abs(over_plane(centre, window[0]) - body_truth)
    body[:, 1:] = np.degrees(body[:, 1:])
    position_m, turned_deg = (
        np.linalg.norm(error[:, :2], axis=-1),
        np.degrees(np.unwrap(truth[:, 2])[-1:])[0],
    )
    errors = {"position_m": position_m, "yaw_deg": yaw_deg, "turned_deg": turned_deg, "body": body}
    nothing = np.full(len(future), np.nan)
    if not isinstance(forecaster, TurnRateKalman | MotionPrior):
        spread = {
            "negative_log_density": nothing,
            "rank": nothing,
            "energy_m": np.array(position_m.mean()),
        }
        return Scores(
            **errors,
            **spread,
            body_rank=np.tile(nothing[:, None], 4),
            body_energy=np.full(3, np.nan),
        )
    forecast = forecaster.distribution(past, future.times_s)
    states = forecast.states_of(future.world_from_cam)
    samples = _planar(forecaster.forecast(past, future.times_s, num_samples), reference)[..., :2]
    ranks = highest_density_ranks(forecast, states, body_truth)
    body_rank, body_energy = np.tile(nothing[:, None], 4), np.full(3, np.nan)
    if forecast.body is not None:
        body_rank = np.column_stack([forecast.body.ranks(body_truth), ranks[:, 1]])
        drawn = forecast.body.sample(num_samples, seed=0)
        energies = [energy_score(drawn[..., [one]], body_truth[:, [one]]) for one in range(3)]
        body_energy = np.array(energies) * [1, *np.degrees([1, 1])]
    return Scores(
        **errors,
        negative_log_density=-forecast.log_density(states[None])[0],
        rank=ranks[:, 0],
        energy_m=np.array(energy_score(samples, truth[:, :2])),
        body_rank=body_rank,
        body_energy=body_energy,
    )


def _planar(world_from_cam: FloatArray, world_from_reference: FloatArray) -> FloatArray:
    return planar.reduce(world_from_cam, world_from_reference, planar.level_vehicle_from_cam())

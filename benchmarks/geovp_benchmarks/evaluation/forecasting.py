"""Accuracy and calibration of forecasters on windows of pose files.

Errors of position and yaw are taken on the x-z plane of the last observed camera, those of height,
pitch and roll over the plane of the past motion.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.tables.formats import grid
from geovp_classic.data import pose_files
from geovp_classic.errors import BadData
from geovp_classic.forecasting.body_motion import over_plane
from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.forecasting.kalman import AccelerationKalman, TurnRateKalman, TurnRateUnscented
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.representative import Representative
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar, se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

Window = tuple[Trajectory, Trajectory]  # past and future
Scores = Mapping[str, FloatArray]  # [N] by name


def forecasters(coefficients: Path | None = None) -> dict[str, Forecaster]:
    """Return the compared forecasters; the motion prior has these coefficients, if given."""
    prior = MotionPrior(coefficients=coefficients)
    return {
        "hold": Hold(),
        "constant velocity": ConstantVelocity(),
        "constant twist": ConstantTurn(),
        "CTRV, extended": TurnRateKalman(),
        "CTRV, unscented": TurnRateUnscented(),
        "CTRA": AccelerationKalman(constants="acceleration"),
        "CTRA, damped": AccelerationKalman(),
        "motion prior": prior,
        "motion prior, representative": Representative(prior),
    }


def read_sequences(folder: Path, names: Sequence[str]) -> dict[str, Trajectory]:
    """Return the trajectories folder/NN.txt; raise BadData for a wrong file.

    Times are those of folder/NN_times.txt or of folder/../sequences/NN/times.txt.
    """
    sequences = {}
    for name in names:
        times = folder / f"{name}_times.txt"
        times_of_images = folder.parent / "sequences" / name / "times.txt"
        if times_of_images.exists() and not times.exists():
            times = times_of_images
        times_s = pose_files.read_times(times)
        sequences[name] = pose_files.read_trajectory(folder / f"{name}.txt", times_s)
    return sequences


def read_windows(
    folder: Path, names: Sequence[str], num_past: int = 10, num_future: int = 20, stride: int = 5
) -> list[Window]:
    """Return all windows of the named sequences; raise BadData if there is none."""
    windows = []
    for trajectory in read_sequences(folder, names).values():
        for first in range(0, len(trajectory) - num_past - num_future + 1, stride):
            window = trajectory[first : first + num_past + num_future]
            windows.append((window[:num_past], window[num_past:]))
    if not windows:
        raise BadData(
            f"{folder}: no sequence is as long as one window of {num_past + num_future} poses"
        )
    return windows


def evaluate(
    windows: Sequence[Window],
    compared: Mapping[str, Forecaster],
    progress: Progress,
    regions: Sequence[float] = (0.5, 0.9),
) -> dict[str, Scores]:
    """Return the scores of each forecaster on the same windows."""
    pairs = [(name, window) for name in compared for window in windows]
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in compared}
    for name, window in tracked(pairs, len(pairs), progress):
        rows[name].append(window_scores(compared[name], *window, regions))
    return {
        name: {key: np.array([row[key] for row in each]) for key in each[0]}
        for name, each in rows.items()
    }


def window_scores(
    forecaster: Forecaster,
    past: Trajectory,
    future: Trajectory,
    regions: Sequence[float] = (0.5, 0.9),  # probabilities
    num_samples: int = 100,
) -> dict[str, float]:
    """Return the scores of one window, averaged over steps or at a step "@k".

    "best of N" is the minimum over the first N samples. "in 90%" is the fraction of true states
    inside the region of that probability.
    """

    def states(world_from_cam: FloatArray) -> FloatArray:
        level = planar.level_vehicle_from_cam()
        return planar.reduce(world_from_cam, past.world_from_cam[-1], level)

    truth = states(future.world_from_cam)
    body_truth = over_plane(future.world_from_cam, past)
    samples = forecaster.forecast(past, future.times_s, num_samples)
    centre = forecaster.forecast(past, future.times_s)[0]
    x_m, z_m, yaw_rad = (states(centre) - truth).T
    height_m, pitch_rad, roll_rad = np.abs(over_plane(centre, past) - body_truth).T
    errors = {
        "position m": np.hypot(x_m, z_m),
        "yaw deg": np.degrees(np.abs((yaw_rad + np.pi) % (2 * np.pi) - np.pi)),
        "height m": height_m,
        "pitch deg": np.degrees(pitch_rad),
        "roll deg": np.degrees(roll_rad),
    }
    last = len(future)
    scores = {"ADE m": errors["position m"].mean(), "FDE m": errors["position m"][-1]}
    for name, error in errors.items():
        scores[name] = error.mean()
        scores.update({f"{name} @{k}": error[k - 1] for k in (1, 10, last) if k <= last})
    scores["turned deg"] = np.degrees(np.unwrap(truth[:, 2])[-1])
    if (samples != samples[0]).any():
        distances_m = np.linalg.norm((states(samples) - truth)[..., :2], axis=-1).mean(axis=1)
        rotations_rad = se3.rotation_angle_rad(se3.inverse(future.world_from_cam) @ samples)
        rotations_deg = np.degrees(rotations_rad).mean(axis=1)
        for count in (5, 10, 20):
            scores[f"ADE m, best of {count}"] = distances_m[:count].min()
            scores[f"rotation deg, best of {count}"] = rotations_deg[:count].min()
    if isinstance(forecaster, TurnRateKalman | MotionPrior):
        forecast = forecaster.distribution(past, future.times_s)
        own = forecast.states_of(future.world_from_cam)
        scores["NLL nats"] = -forecast.log_density(own[None]).mean()
        for name, ranks in highest_density_ranks(forecast, own, body_truth).items():
            for region in regions:
                scores[f"{name} in {region:.0%}"] = (ranks <= region).mean()
                scores[f"{name} in {region:.0%} @{last}"] = float(ranks[-1] <= region)
    return scores


def highest_density_ranks(
    forecast: PlanarForecast,
    states: FloatArray,  # [F, 3], true ones on the plane
    body: FloatArray,  # [F, 3], over it
    num_samples: int = 400,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """Return the probabilities [F] of the smallest regions that hold the truth (Hyndman 1996).

    Those of (x, z, yaw) and of all six components are fractions of samples that are likelier.
    """
    density = forecast.log_density(states[None])[0]
    densities = forecast.log_density(forecast.sample(num_samples, seed))
    ranks = {"x, z, yaw": (densities > density).mean(axis=0)}
    if forecast.body is not None:
        ranks.update(zip(("height", "pitch", "roll"), forecast.body.ranks(body).T, strict=True))
        density = density + forecast.body.log_density(body[None])[0]
        densities += forecast.body.log_density(forecast.body.sample(num_samples, seed))
        ranks["all six"] = (densities > density).mean(axis=0)
    return ranks


def summary(scores: Scores, turning_deg: float = 15.0) -> dict[str, float]:
    """Return the means over windows, the median of the last yaw, and means over turning windows."""
    averages = {name: float(values.mean()) for name, values in scores.items()}
    *_, yaw = (name for name in scores if name.startswith("yaw deg @"))
    averages[f"{yaw}, median"] = float(np.median(scores[yaw]))
    is_turning = np.abs(scores["turned deg"]) > turning_deg
    if is_turning.any():
        for name in ("ADE m", yaw):
            label = f"{name}, {is_turning.sum()} turning windows"
            averages[label] = float(scores[name][is_turning].mean())
    return averages


def lines(table: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return summaries by forecaster as a Markdown table with a column per forecaster."""
    names = dict.fromkeys(name for averages in table.values() for name in averages)
    rows = [
        [name, *(f"{row[name]:.3f}" if name in row else "-" for row in table.values())]
        for name in names
    ]
    return grid([["", *table], *rows])

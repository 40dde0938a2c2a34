"""Accuracy and calibration of forecasters on windows of pose files.

Errors of position and yaw are taken on the x-z plane of the last observed camera, those of height,
pitch and roll over the plane of the past motion.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geovp.progress import tracked
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.forecasting.body_motion import over_plane
from geovp_classic.forecasting.planar_forecaster import PlanarForecast, PlanarForecaster
from geovp_classic.geometry import planar, se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

Window = tuple[Trajectory, Trajectory]  # past and future


def read_sequences(folder: Path, names: Sequence[str]) -> dict[str, Trajectory]:
    """Return the named trajectories folder/NN.txt, or all; BadData for a missing or wrong file.

    Times are those of folder/NN_times.txt or of folder/../sequences/NN/times.txt.
    """
    stems = sorted(path.stem for path in folder.glob("*.txt"))
    sequences = {}
    for name in names or [stem for stem in stems if not stem.endswith("_times")]:
        if not (folder / f"{name}.txt").is_file():
            raise BadData(f"{folder} holds no {name}.txt: name existing pose files by --sequences")
        times = folder / f"{name}_times.txt"
        if not times.exists():
            times = folder.parent / "sequences" / name / "times.txt"
        times_s = pose_files.read_times(times)
        sequences[name] = pose_files.read_trajectory(folder / f"{name}.txt", times_s)
    return sequences


def read_windows(
    folder: Path, names: Sequence[str], num_past: int = 10, num_future: int = 20, stride: int = 5
) -> list[Window]:
    """Return all windows of the named sequences; raise BadData if there is none."""
    length = num_past + num_future
    windows = []
    for trajectory in read_sequences(folder, names).values():
        for first in range(0, len(trajectory) - length + 1, stride):
            window = trajectory[first : first + length]
            windows.append((window[:num_past], window[num_past:]))
    if not windows:
        raise BadData(f"{folder}: no pose file NN.txt is as long as one window of {length} poses")
    return windows


def evaluate(
    windows: Sequence[Window], forecaster: Forecaster, turning_deg: float = 15.0
) -> dict[str, float]:
    """Return the mean scores of a forecaster, those of ADE and yaw also over turning windows.

    15 degrees in two seconds are more than a bend of a main road.
    """
    results = [window_scores(forecaster, *window) for window in tracked(windows)]
    # A forecaster that selects another one may draw samples in some windows only
    names = [name for name in results[0] if all(name in each for each in results)]
    scores = {name: np.array([each[name] for each in results]) for name in names}
    is_turning = np.abs(scores.pop("turned deg")) > turning_deg
    means = {name: float(values.mean()) for name, values in scores.items()}
    if is_turning.any():
        for name in ("ADE m", "yaw deg"):
            label = f"{name}, {is_turning.sum()} turning windows"
            means[label] = float(scores[name][is_turning].mean())
    return means


def window_scores(
    forecaster: Forecaster, past: Trajectory, future: Trajectory, num_samples: int = 100
) -> dict[str, float]:
    """Return the scores of one window, averaged over steps or at a step "@k".

    "best of N" is the minimum over the first N samples. "in 90%" is the fraction of true states
    inside the region of that probability.
    """
    last = len(future)
    poses = future.world_from_cam
    centre = forecaster.forecast(past, future.times_s)
    samples = forecaster.forecast(past, future.times_s, num_samples)
    # Errors of the central forecast on the plane and over it.
    truth = states(poses, past)
    error = np.abs(states(centre[0], past) - truth)
    position_m = np.hypot(error[:, 0], error[:, 1])
    error[:, [2, 4, 5]] = np.degrees(error[:, [2, 4, 5]])
    error[:, 2] = np.minimum(error[:, 2], 360 - error[:, 2])
    scores = {"ADE m": position_m.mean(), "FDE m": position_m[-1]}
    names = ("across m", "along m", "yaw deg", "height m", "pitch deg", "roll deg")
    for name, values in zip(names, error.T, strict=True):
        scores |= {name: values.mean(), f"{name} @1": values[0], f"{name} @{last}": values[-1]}
    scores["turned deg"] = np.degrees(np.unwrap(truth[:, 2])[-1])
    # The best of several samples.
    if (samples != samples[0]).any():
        offsets_m = (samples - poses)[..., :3, 3] @ past.world_from_cam[-1, :3, :3]
        distances_m = np.linalg.norm(offsets_m[..., [0, 2]], axis=-1).mean(axis=1)
        angles_rad = se3.rotation_angle_rad(se3.inverse(poses) @ samples).mean(axis=1)
        for count in (5, 10, 20):
            scores[f"ADE m, best of {count}"] = distances_m[:count].min()
            scores[f"rotation deg, best of {count}"] = np.degrees(angles_rad[:count].min())
    # Calibration of a distribution: its density, and the fraction of states inside its regions.
    if isinstance(forecaster, PlanarForecaster):
        forecast = forecaster.distribution(past, future.times_s)
        on_plane = forecast.states_of(poses)
        scores["NLL nats"] = -forecast.log_density(on_plane[None]).mean()
        for name, ranks in highest_density_ranks(forecast, on_plane, truth[:, 3:]).items():
            for region in (0.5, 0.9):  # probabilities
                is_inside = ranks <= region
                label = f"{name} in {region:.0%}"
                scores |= {label: is_inside.mean(), f"{label} @{last}": float(is_inside[-1])}
    return scores


def states(world_from_cam: FloatArray, past: Trajectory) -> FloatArray:
    """Return (x, z, yaw, height, pitch, roll) [F, 6] of poses [F, 4, 4], in metres and radians."""
    level = planar.level_vehicle_from_cam()
    on_plane = planar.reduce(world_from_cam, past.world_from_cam[-1], level)
    return np.hstack([on_plane, over_plane(world_from_cam, past)])


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

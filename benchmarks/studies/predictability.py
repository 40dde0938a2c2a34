"""Predictability of the camera's motion from its past poses, by component and horizon.

The study predicts how the motion deviates from constant turn rate and velocity with constant
height, pitch and roll. It prints the fraction of the mean square deviation that is explained, with
95 % intervals. Ridge regressions are fitted to the other sequences, mirrored and not; the shipped
motion prior is used as it is. Windows that a car cannot have driven are left out.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from geovp_benchmarks.analysis.intervals import Interval, interval
from geovp_benchmarks.cli.options import add
from geovp_benchmarks.evaluation.forecasting import read_sequences
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.tables.formats import grid
from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import over_plane
from geovp_classic.forecasting.constant import ConstantTurn
from geovp_classic.forecasting.motion_network import MIRRORED_TWIST, past_features
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import planar
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.types import FloatArray, Trajectory
from studies.fitting.windows import STEP_S, drivable_steps

COMPONENTS = ("along", "across", "height", "pitch", "roll", "yaw")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the pose files and the sequences."""
    add(parser, "poses", "FOLDER", "Folder of NN.txt, with times in NN_times.txt or ../sequences.")
    test = ("03", "05", "06", "07", "10")
    text = f"Sequences that are predicted. Default: {' '.join(test)}."
    add(parser, "--sequences", "NN", text, test, nargs="+")
    sequences = [f"{number:02}" for number in range(11)]
    text = "Sequences to fit to, except for the predicted one. Default: 00 to 10."
    add(parser, "--fit", "NN", text, sequences, nargs="+")
    add(parser, "--stride", "N", "Frames between the starts of two windows. Default: 4.", 4)


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield a table of the deviations and a table of what is explained of them."""
    study = Predictability()
    sequences = read_sequences(args.poses, list(dict.fromkeys([*args.sequences, *args.fit])))
    windows = study.windows(sequences, args.stride, progress)
    is_tested = np.isin(windows.sequences, args.sequences)
    names = windows.sequences[is_tested]
    truth = windows.truth[is_tested]
    heads = [str(step) for step in study.horizons]
    yield f"{len(truth)} windows of {', '.join(args.sequences)}"
    yield ""
    lines = [["root mean square deviation", *heads]]
    for number, component in enumerate(COMPONENTS):
        unit, factor = ("cm", 100.0) if number < 3 else ("deg", float(np.degrees(1.0)))
        sizes = factor * np.sqrt((truth[..., number] ** 2).mean(axis=0))
        lines.append([f"{component} ({unit})", *(f"{size:.3g}" for size in sizes)])
    yield from grid(lines)
    predictions = {
        name: ridge.held_out(windows, args.sequences)[is_tested]
        for name, ridge in study.learners.items()
    }
    predictions["shipped motion prior"] = windows.prior[is_tested]
    yield ""
    lines = [["explained (%), 95 % interval", *heads]]
    for number, component in enumerate(COMPONENTS):
        for name, predicted in predictions.items():
            fractions = [
                explained_fraction(truth[:, step, number], predicted[:, step, number], names)
                for step in range(len(study.horizons))
            ]
            lines.append([f"{component}: {name}", *map(percent, fractions)])
    yield from grid(lines)


@dataclass(frozen=True)
class Windows:
    """Past motion of N windows and deviations at H horizons, in metres and radians."""

    sequences: npt.NDArray[np.str_]  # [N]
    twists: FloatArray  # [N, P, 6], per second
    truth: FloatArray  # [N, H, 6]
    prior: FloatArray  # [N, H, 6], forecast of the shipped motion prior


@dataclass(frozen=True)
class Ridge:
    """Ridge regression of deviations on past twists and their changes."""

    num_steps: int  # of the past
    penalty: float  # per window

    def held_out(self, windows: Windows, names: list[str]) -> FloatArray:
        """Return deviations [N, H, 6] of the named sequences, each fitted to all others."""
        mirrored = np.array([1.0, -1.0, 1.0, 1.0, -1.0, -1.0])  # deviation
        predicted = np.full(windows.truth.shape, np.nan)
        for name in names:
            is_tested = windows.sequences == name
            truth = windows.truth[~is_tested]
            scale = np.sqrt((truth**2).mean(axis=0)) + 1e-9
            target = np.clip(truth / scale, -5, 5)
            twists = windows.twists[~is_tested]
            both_twists = np.concatenate([twists, twists * MIRRORED_TWIST])
            both_targets = np.concatenate([target, target * mirrored])
            unseen = windows.twists[is_tested]
            predicted[is_tested] = scale * self.fit(both_twists, both_targets, unseen)
        return predicted

    def fit(self, twists: FloatArray, target: FloatArray, unseen: FloatArray) -> FloatArray:
        """Fit to twists [M, P, 6] and a target [M, H, 6]; return the predictions for others."""
        features, new_features = (
            past_features(values[:, -self.num_steps :]) for values in (twists, unseen)
        )
        mean, deviation = features.mean(axis=0), features.std(axis=0) + 1e-6
        inputs, new_inputs = (
            np.clip((values - mean) / deviation, -8, 8) for values in (features, new_features)
        )
        normal_matrix = inputs.T @ inputs + self.penalty * len(inputs) * np.eye(inputs.shape[1])
        weights = np.linalg.solve(normal_matrix, inputs.T @ target.reshape(len(inputs), -1))
        return np.asarray(new_inputs @ weights).reshape(len(unseen), *target.shape[1:])


@dataclass(frozen=True)
class Predictability:
    """Windows of 3 s of past motion, and the learners that predict from it."""

    horizons: tuple[int, ...] = (1, 5, 10, 15, 20)
    num_steps: int = 29  # of the past
    num_observed: int = 10  # poses that forecasters see
    # penalties were selected on 00, 02, 08, 09, 01 and 04
    learners: Mapping[str, Ridge] = field(
        default_factory=lambda: {"linear, 0.9 s": Ridge(9, 0.03), "linear, 3 s": Ridge(29, 0.1)}
    )

    @single_threaded_blas
    def windows(
        self, sequences: Mapping[str, Trajectory], stride: int, progress: Progress
    ) -> Windows:
        """Return all windows that a car can have driven; raise BadData if there is none."""
        names = []
        rows = []
        for name, recorded in tracked(sequences.items(), len(sequences), progress):
            is_drivable = drivable_steps(recorded)
            for last in range(self.num_steps + 1, len(recorded) - self.horizons[-1], stride):
                first = last - self.num_steps - 1
                if is_drivable[first : last + self.horizons[-1]].all():
                    names.append(name)
                    rows.append(self._window(recorded, first, last))
        if not rows:
            raise BadData(
                f"no window of 5 s that a car can have driven in {', '.join(sequences)}: give "
                "longer poses"
            )
        return Windows(np.array(names), *map(np.stack, zip(*rows, strict=True)))

    def _window(self, recorded: Trajectory, first: int, last: int) -> tuple[FloatArray, ...]:
        """Return the fields of Windows but for the name, without the axis of the windows."""
        past = recorded[first : last + 1]
        observed = past[-self.num_observed :]
        future = last + np.array(self.horizons)
        times_s = recorded.times_s[future]
        base = planar_states(ConstantTurn().forecast(past, times_s)[0], observed)
        truth = deviations(recorded.world_from_cam[future], observed, base)
        prior = deviations(MotionPrior().forecast(observed, times_s)[0], observed, base)
        return past_motion.twists_per_s(past, STEP_S, self.num_steps), truth, prior


def planar_states(world_from_cam: FloatArray, observed: Trajectory) -> FloatArray:
    """Return (x, z, yaw) [H, 3] on the vehicle's plane at the last observed camera."""
    plane = past_motion.vehicle_from_cam(observed)
    return planar.reduce(world_from_cam, observed.world_from_cam[-1], plane)


def deviations(
    world_from_cam: FloatArray,  # [H, 4, 4]
    observed: Trajectory,
    base: FloatArray,  # [H, 3], planar states
) -> FloatArray:
    """Return COMPONENTS [H, 6] relative to the planar states and the last height, pitch, roll."""
    x, z, yaw = (planar_states(world_from_cam, observed) - base).T
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    body = over_plane(world_from_cam, observed)
    yaw = (yaw + np.pi) % (2 * np.pi) - np.pi
    return np.column_stack([sin * x + cos * z, cos * x - sin * z, body, yaw])


def explained_fraction(
    truth: FloatArray,  # [N]
    predicted: FloatArray,  # [N]
    sequences: npt.NDArray[np.str_],  # [N]
) -> Interval:
    """Return 1 - mean (truth - predicted)^2 / mean truth^2; below 0 a prediction harms.

    The interval is that of the ratio, linearised around its value (delta method).
    """
    error = (truth - predicted) ** 2
    square = truth**2
    mean_square = max(float(square.mean()), 1e-30)
    ratio = float(error.mean()) / mean_square
    linearised = 1 - ratio + (ratio * square - error) / mean_square
    return interval(linearised, sequences, bounds=(-np.inf, 1.0))


def percent(fraction: Interval) -> str:
    """Format a fraction with its interval in per cent."""
    mean, low, high = (100 * value for value in (fraction.mean, fraction.low, fraction.high))
    return f"{mean:z.0f} [{low:z.0f}, {high:z.0f}]"

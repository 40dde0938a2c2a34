"""How much of the deviations a learner explains on a sequence that it was not fitted to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geovp_benchmarks.analysis.intervals import Interval, interval
from geovp_benchmarks.progress import Progress
from geovp_classic.forecasting import motion_network
from geovp_classic.forecasting.motion_network import MIRRORED_TWIST
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.types import FloatArray
from studies.foreseeable.windows import LONG_STEPS, MIRRORED, SHORT_STEPS, Windows

FARTHEST = 5.0  # root mean squares of a deviation that a learner is fitted to
Answer = Callable[[FloatArray], FloatArray]  # deviations [N, H, 6] after twists [N, P, 6]


@dataclass(frozen=True)
class Ridge:
    """Linear in the past twists and their changes; `weight` is the regularisation per window."""

    num_steps: int = SHORT_STEPS
    weight: float = 0.03

    def fit(self, twists: FloatArray, truth: FloatArray) -> Answer:
        """By pasts [N, P, 6] and deviations [N, H, 6] in root mean squares."""
        features = _features(twists, self.num_steps)
        mean = features.mean(axis=0)
        deviation = features.std(axis=0) + 1e-6

        def inputs(new: FloatArray) -> FloatArray:
            return np.clip((new - mean) / deviation, -8.0, 8.0)

        own = inputs(features)
        matrix = own.T @ own + self.weight * len(own) * np.eye(own.shape[1])
        factors = np.linalg.solve(matrix, own.T @ truth.reshape(len(own), -1))
        return lambda new: (inputs(_features(new, self.num_steps)) @ factors).reshape(
            len(new), *truth.shape[1:]
        )


@dataclass(frozen=True)
class SmallNetwork:
    """An ensemble of small perceptrons, least squares."""

    num_steps: int = SHORT_STEPS
    num_members: int = 4
    width: int = 48
    epochs: float = 30.0
    seed: int = 0

    def fit(self, twists: FloatArray, truth: FloatArray) -> Answer:
        """By pasts [N, P, 6] and deviations [N, H, 6] in root mean squares."""
        from studies.fitting.motion_prior import Ensemble  # needs torch

        features = _features(twists, self.num_steps)
        targets = truth.reshape(len(truth), -1)
        ensemble = Ensemble(
            self.num_members,
            self.width,
            num_steps=max(10, int(self.epochs * len(features) / 256)),
            weight_decay=0.05,
            dropout=0.2,
            limit=4.0,
            seed=self.seed,
        )
        network = ensemble.fit(
            features, targets, targets.shape[1], lambda outputs, target: (outputs - target) ** 2
        )
        return lambda new: (
            network(_features(new, self.num_steps)).mean(axis=0).reshape(len(new), *truth.shape[1:])
        )


@single_threaded_blas
def held_out(
    learner: Ridge | SmallNetwork, windows: Windows, names: Sequence[str], progress: Progress
) -> FloatArray:
    """Deviations [N, H, 6] of the windows of the named sequences, each by all other sequences; NaN
    elsewhere.

    Left and right are alike: the learner is fitted to both and asked for both.
    """
    answers = np.full(windows.truth.shape, np.nan)
    for number, name in enumerate(names):
        progress(number, len(names))
        own = windows.sequences == name
        others = windows[~own]
        scale = np.sqrt((others.truth**2).mean(axis=0)) + 1e-9
        truth = np.clip(others.truth / scale, -FARTHEST, FARTHEST)
        both = np.concatenate([others.twists, others.twists * MIRRORED_TWIST])
        answer = learner.fit(both, np.concatenate([truth, truth * MIRRORED]))
        twists = windows.twists[own]
        answers[own] = 0.5 * (answer(twists) + answer(twists * MIRRORED_TWIST) * MIRRORED) * scale
    progress(len(names), len(names))
    return answers


def explained(
    truth: FloatArray,  # [N]
    answer: FloatArray,  # [N]
    sequences: npt.NDArray[np.generic],  # [N]
) -> Interval:
    """The share of the truth's mean square that an answer removes: 1 - mean (y - a)^2 / mean y^2;
    below 0 it harms.

    The interval is that of the ratio, linearised around its value (delta method).
    """
    error, size = (truth - answer) ** 2, truth**2
    total = float(size.mean())
    if total == 0:
        return interval(np.full(len(truth), np.nan), sequences)
    left = float(error.mean()) / total
    return interval(1 - left + (left * size - error) / total, sequences, bounds=(-np.inf, 1.0))


def _features(twists: FloatArray, num_steps: int) -> FloatArray:
    """[N, num_steps * 6]: changes from step to step, and the last twist."""
    return motion_network.past_features(twists[:, -num_steps:])


LEARNERS: Mapping[str, Ridge | SmallNetwork] = {
    "linear, 0.9 s": Ridge(),
    "linear, 3 s": Ridge(LONG_STEPS, weight=0.1),
    "network, 0.9 s": SmallNetwork(),
    "network, 3 s": SmallNetwork(LONG_STEPS),
}

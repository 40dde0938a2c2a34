"""Fit of the body motion: a robust ridge regression, and the scale of its residuals."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from geovp_benchmarks.fitting.plausibility import Drivability
from geovp_benchmarks.fitting.training_windows import (
    STEP_S,
    Augmentation,
    Grid,
    TrainingWindows,
)
from geovp_classic.forecasting.body_motion import Coefficients, changes, over_plane
from geovp_classic.forecasting.motion_network import MIRRORED_TWIST
from geovp_classic.types import FloatArray, Trajectory

MIRRORED_BODY = np.array([1.0, 1.0, -1.0])  # heave, pitch, roll


@dataclass(frozen=True)
class BodyMotionFit:
    """Settings of the fit."""

    grid: Grid = field(default_factory=lambda: Grid(num_future=20))
    noise: Augmentation = field(default_factory=Augmentation)
    noise_level: float = 0.5  # of an odometry, added to the past twists
    ridge: float = 3e-3  # per window
    num_rounds: int = 8  # of iteratively reweighted least squares
    min_residual_ratio: float = 0.3  # to the median; smaller residuals do not weigh more
    inner: float = 0.5  # probabilities of the two intervals that are calibrated
    outer: float = 0.9
    degree_choices: FloatArray = field(default_factory=lambda: np.geomspace(1.5, 60, 400))

    def fit(
        self,
        sequences: Mapping[str, Trajectory],
        others: Mapping[str, Trajectory],
        seed: int = 0,
    ) -> Coefficients:
        """Return the coefficients of the least absolute error on recordings and mirror images.

        The sequences in `others` are used only to fit the scale of the residuals.
        """
        windows = TrainingWindows.concatenated(
            self.grid.windows(sequence, over_plane) for sequence in sequences.values()
        )
        rng = np.random.default_rng(seed)
        noise = self.noise.noise_per_s * rng.standard_normal(windows.twists.shape)
        twists = windows.twists + self.noise_level * noise
        twists = np.concatenate([twists, twists * MIRRORED_TWIST])
        states = np.concatenate([windows.states, windows.states * MIRRORED_BODY])
        targets = states.reshape(len(states), -1)
        num_outputs = targets.shape[1]
        fitted = Coefficients(
            step_s=STEP_S,
            scale=np.sqrt((changes(twists) ** 2).mean(axis=0)) + 1e-6,
            weights=np.zeros((twists[0].size, num_outputs)),
            spread=np.zeros((5, num_outputs)),
            degrees=np.ones(3),
        )
        features = fitted.features(twists)
        weights = [self._least_absolute(features, target) for target in targets.T]
        fitted = replace(fitted, weights=np.stack(weights, axis=1))
        return self._with_spread(fitted, [*sequences.values(), *others.values()])

    def _least_absolute(
        self,
        features: FloatArray,  # [N, in]
        target: FloatArray,  # [N]
    ) -> FloatArray:
        """Return the weights [in] of a ridge regression with the least absolute error."""
        penalty = self.ridge * len(target) * np.eye(features.shape[1])
        sample_weight = np.ones(len(target))
        for _ in range(self.num_rounds):
            weighted = features * sample_weight[:, None]
            solution = np.linalg.solve(weighted.T @ features + penalty, weighted.T @ target)
            residual = np.abs(target - features @ solution)
            min_residual = self.min_residual_ratio * np.median(residual) + 1e-12
            sample_weight = 1 / np.maximum(residual, min_residual)
            sample_weight /= sample_weight.mean()
        return np.asarray(solution)

    def _with_spread(
        self,
        fitted: Coefficients,
        sequences: list[Trajectory],
    ) -> Coefficients:
        """Fit Student's t so that both intervals have their coverage; sequences weigh equally."""
        features = []
        residuals = []
        for sequence in sequences:
            usable = Drivability().steps(sequence)
            windows = self.grid.windows(sequence, over_plane, usable)
            if len(windows):
                residual = np.abs(windows.states - fitted.means(windows.twists))
                residuals.append(residual.reshape(len(windows), -1))
                features.append(fitted.motion_features(windows.twists))
        inputs = np.concatenate(features)
        log_residuals = np.log(np.concatenate(residuals) + 1e-5)
        spread = np.linalg.lstsq(inputs, log_residuals)[0]
        white = [
            residual / np.exp(feature @ spread)
            for residual, feature in zip(residuals, features, strict=True)
        ]
        inner = np.mean([np.quantile(part, self.inner, axis=0) for part in white], axis=0)
        outer = np.mean([np.quantile(part, self.outer, axis=0) for part in white], axis=0)
        log_ratio = np.log(outer / inner).reshape(-1, 3).mean(axis=0)  # larger for heavier tails
        inner_of_t = stats.t.ppf(0.5 + self.inner / 2, self.degree_choices)
        outer_of_t = stats.t.ppf(0.5 + self.outer / 2, self.degree_choices)
        difference = np.log(outer_of_t / inner_of_t)[:, None] - log_ratio
        best = np.abs(difference).argmin(axis=0)
        spread[0] += np.log(outer.reshape(-1, 3) / outer_of_t[best]).reshape(-1)
        return replace(fitted, spread=spread, degrees=self.degree_choices[best])


def packed(coefficients: Coefficients) -> dict[str, FloatArray]:
    """Return the arrays of a file, as `body_motion.load` reads them."""
    names = ("scale", "weights", "spread", "degrees")
    arrays = {name: getattr(coefficients, name).astype(np.float32) for name in names}
    return {"step_s": np.array(coefficients.step_s), **arrays}

"""Fit of the body motion: a ridge regression, and Student's t for its residuals."""

import numpy as np
from scipy import stats

from geovp_classic.forecasting.body_motion import changes, motion_features
from geovp_classic.types import FloatArray
from studies.fitting.windows import STEP_S, Windows, augmented, joined


def fit(windows: Windows, ridge: float = 3e-3) -> dict[str, FloatArray]:
    """Fit weights to pasts with and without odometry noise, and the residual to clean pasts.

    Return the arrays of a file, as `geovp_classic.forecasting.body_motion.load` reads them.
    """
    clean, _ = windows
    twists, states = joined([windows, augmented(windows, np.random.default_rng(0))])
    targets = states[..., 3:].reshape(len(states), -1)  # heave, pitch and roll of each step
    scale = np.sqrt((changes(twists) ** 2).mean(axis=0)) + 1e-6
    features = np.clip(changes(twists) / scale, -4.0, 4.0)
    penalty = ridge * len(features) * np.eye(features.shape[1])
    weights = np.linalg.solve(features.T @ features + penalty, features.T @ targets)
    residuals = (targets - features @ weights)[: len(clean)]
    motion = motion_features(clean)
    spread = np.linalg.lstsq(motion, np.log(np.abs(residuals) + 1e-5))[0]
    white = residuals / np.exp(motion @ spread)
    # Degrees of freedom, location and scale of each axis.
    fits = np.array([stats.t.fit(white[::10, axis::3], floc=0) for axis in range(3)])
    spread[0] += np.log(np.tile(fits[:, 2], states.shape[1]))
    return {
        "step_s": np.array(STEP_S),
        "scale": scale,
        "weights": weights,
        "spread": spread,
        "degrees": fits[:, 0],
    }

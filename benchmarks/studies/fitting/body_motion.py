"""Fit of the body motion: a ridge regression, and Student's t for its residuals."""

import numpy as np
from scipy import stats

from geovp_classic.forecasting.body_motion import changes, motion_features
from geovp_classic.types import FloatArray
from studies.fitting.windows import STEP_S, Windows, augmented


def fit(windows: Windows, ridge: float = 3e-3) -> dict[str, FloatArray]:
    """Fit weights to pasts with odometry noise, and the residual to clean pasts.

    Return the arrays of a file, as `geovp_classic.forecasting.body_motion.load` reads them.
    """
    noisy, states = augmented(windows, np.random.default_rng(0))
    scale = np.sqrt((changes(noisy) ** 2).mean(axis=0)) + 1e-6

    def features(twists: FloatArray) -> FloatArray:
        return np.clip(changes(twists) / scale, -4.0, 4.0)

    def body(states: FloatArray) -> FloatArray:
        return states[..., 3:].reshape(len(states), -1)  # heave, pitch and roll of each step

    inputs = features(noisy)
    penalty = ridge * len(inputs) * np.eye(inputs.shape[1])
    weights = np.linalg.solve(inputs.T @ inputs + penalty, inputs.T @ body(states))
    twists, states = windows
    residuals = body(states) - features(twists) @ weights
    motion = motion_features(twists)
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

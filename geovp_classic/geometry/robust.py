"""Robust estimation: one iteratively reweighted Gauss-Newton (Holland & Welsch 1977)."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from geovp_classic.types import FloatArray

State = TypeVar("State")


def cauchy_weight(residual: FloatArray, scale: float) -> FloatArray:
    """Return the weights of Cauchy's function; one half where |residual| is the scale."""
    return 1 / (1 + (residual / scale) ** 2)


def geman_mcclure_weight(residual: FloatArray, scale: float) -> FloatArray:
    """Return the weights of Geman and McClure's function; one quarter at the scale."""
    return 1 / (1 + (residual / scale) ** 2) ** 2


def irls(
    start: State,
    # residuals [N] or [N, D] and their jacobian [N, K] or [N, D, K]
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
    # a state and a step [K] -> the next state
    retract: Callable[[State, FloatArray], State],
    # of the residuals, or how to get it from them
    scale: float | Callable[[FloatArray], float],
    num_rounds: int = 10,
    min_step: float = 1e-8,
) -> State:
    """Minimise a robust sum of squared residuals by iteratively reweighted Gauss-Newton.

    A residual vector of D numbers is weighted by its norm. A step whose largest entry is below
    `min_step` is the last one.

    Full steps are taken even where they increase the cost: `scale` may shrink from round to round,
    and long steps at first are how a fit leaves outliers behind. Halving steps until Cauchy's cost
    falls made poses worse: the path of 03[75, 85) of KITTI, 2.33 m of a turn, was .76 m long and
    not 1.82 m, and the absolute error on 06[0, 51) was .39 m and not .37 m.
    """
    state = start
    for _ in range(num_rounds):
        # Weights by the norms of the residuals
        residual, jacobian = linearise(state)
        size = residual if residual.ndim == 1 else np.linalg.norm(residual, axis=1)
        current_scale = scale(size) if callable(scale) else scale
        num_unknowns = jacobian.shape[-1]
        weights = cauchy_weight(size, current_scale)
        weights = np.repeat(weights, residual.size // len(weights))[:, None]
        # Weighted normal equations, J' W J step = -J' W r; the damping keeps them solvable
        jacobian = jacobian.reshape(-1, num_unknowns)
        weighted = (jacobian * weights).T
        normal = weighted @ jacobian + 1e-9 * np.eye(num_unknowns)
        step = -np.linalg.solve(normal, weighted @ residual.ravel())
        state = retract(state, step)
        if np.abs(step).max() < min_step:
            break
    return state

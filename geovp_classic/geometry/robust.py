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
    max_halvings: int = 8,
) -> State:
    """Minimise a robust sum of squared residuals by iteratively reweighted Gauss-Newton.

    A residual vector of D numbers is weighted by its norm. A step that increases Cauchy's cost is
    halved, at most `max_halvings` times, and then rejected. The iteration ends there, or after a
    step whose largest entry is below `min_step`.
    """
    state = start
    residual, jacobian = linearise(state)
    for _ in range(num_rounds):
        # Weighted normal equations, J' W J step = -J' W r
        size = _norms(residual)
        current_scale = scale(size) if callable(scale) else scale
        num_unknowns = jacobian.shape[-1]
        weights = cauchy_weight(size, current_scale)
        weights = np.repeat(weights, residual.size // len(weights))[:, None]
        jacobian = jacobian.reshape(-1, num_unknowns)
        weighted = (jacobian * weights).T
        # the damping only keeps a singular system solvable
        normal = weighted @ jacobian + 1e-9 * np.eye(num_unknowns)
        step = -np.linalg.solve(normal, weighted @ residual.ravel())
        # Halve the step until the cost falls (backtracking, Nocedal & Wright 2006, section 3.1)
        max_cost = _cauchy_cost(size, current_scale)
        for _ in range(max_halvings + 1):
            candidate = retract(state, step)
            residual, jacobian = linearise(candidate)
            if _cauchy_cost(_norms(residual), current_scale) <= max_cost:
                break
            step = step / 2
        else:
            return state
        state = candidate
        if np.abs(step).max() < min_step:
            break
    return state


def _norms(residual: FloatArray) -> FloatArray:
    """Return the absolute values [N] of residuals [N], or the norms [N] of vectors [N, D]."""
    return np.abs(residual) if residual.ndim == 1 else np.linalg.norm(residual, axis=1)


def _cauchy_cost(size: FloatArray, scale: float) -> float:
    """Return the sum of Cauchy's function, whose weights are those of `cauchy_weight`."""
    return float(np.log1p((size / scale) ** 2).sum())

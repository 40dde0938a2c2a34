"""Points from their observations by several cameras with known poses."""

from __future__ import annotations

import numpy as np

from geovp_classic.types import FloatArray

DAMPING = 3e-15  # of the normal equations' trace, so that parallel rays raise no error


def triangulate(
    rays: FloatArray,  # [V, N, 2]; NaN where a view does not observe the point
    cam_from_world: FloatArray,  # [V, 4, 4]
    num_rounds: int = 3,
) -> FloatArray:
    """Points [N, 3] with the least squared distances on z = 1: linear, reweighted by depth (Hartley & Sturm 1997).

    NaN for points with fewer than two observations or without a unique solution. All points at once: pycolmap's
    `triangulate_multi_view_point` takes one (benchmarks/performance/libraries.py).
    """
    rotation, translation = cam_from_world[:, :3, :3], cam_from_world[:, :3, 3]
    observed = np.isfinite(rays[..., 0]).T  # [N, V]
    rays = np.where(observed[..., None], rays.transpose(1, 0, 2), 0.0)
    rows = rotation[:, :2] - rays[..., None] * rotation[:, 2:]  # [N, V, 2, 3]
    right = rays * translation[:, 2:] - translation[:, :2]  # [N, V, 2]
    system = np.concatenate([rows, right[..., None]], axis=-1)
    points, weight = np.zeros((len(rays), 3)), observed.astype(np.float64)
    for _ in range(num_rounds):
        weighted = (system * weight[..., None, None]).reshape(len(rays), -1, 4)
        normal = weighted.transpose(0, 2, 1) @ weighted  # [N, 4, 4], the right side last
        damping = DAMPING * np.trace(normal[:, :3, :3], axis1=1, axis2=2) + 1e-300
        points = np.linalg.solve(normal[:, :3, :3] + damping[:, None, None] * np.eye(3), normal[:, :3, 3:])[..., 0]
        weight = observed / np.maximum(np.abs(points @ rotation[:, 2].T + translation[:, 2]), 1e-6)
    placed = (observed.sum(axis=1) >= 2) & np.isfinite(points).all(axis=1)
    return np.where(placed[:, None], points, np.nan)

"""Points from their observations by several cameras with known poses."""

import numba
import numpy as np

from geovp_classic.types import FloatArray


def triangulate(
    rays: FloatArray,  # [V, N, 2]; NaN where a view does not observe the point
    cam_from_world: FloatArray,  # [V, 4, 4]
    num_rounds: int = 3,
) -> FloatArray:
    """Points [N, 3] with the least squared distances on z = 1: linear, reweighted by depth (Hartley
    & Sturm 1997).

    NaN for points with fewer than two observations or without a finite solution. Several times as
    fast as pycolmap's `triangulate_multi_view_point`, which takes one point
    (benchmarks/performance/libraries.py).
    """
    points = np.full((rays.shape[1], 3), np.nan)
    given = np.ascontiguousarray(rays), np.ascontiguousarray(cam_from_world)
    _triangulate(*given, num_rounds, np.empty((3, 4)), points)
    return points


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _triangulate(
    rays: FloatArray,
    cam_from_world: FloatArray,
    num_rounds: int,
    system: FloatArray,  # [3, 4], changed: normal equations, their right side last
    points: FloatArray,  # [N, 3], written where there is a solution
) -> None:
    num_views, num_points, _ = rays.shape
    for n in range(num_points):
        count = 0
        for v in range(num_views):
            count += np.isfinite(rays[v, n, 0])
        if count < 2:
            continue
        x, y, z, weight = 0.0, 0.0, 0.0, 1.0
        for iteration in range(num_rounds):
            for i in range(12):
                system[i // 4, i % 4] = 0.0
            for v in range(num_views):
                p = cam_from_world[v]
                if np.isfinite(rays[v, n, 0]):
                    depth = x * p[2, 0] + y * p[2, 1] + z * p[2, 2] + p[2, 3]
                    weight = 1 / max(abs(depth), 1e-6) if iteration else 1.0
                    _add_observation(system, p, rays[v, n], weight * weight)
            x, y, z = _solve(system)
        if np.isfinite(x) and np.isfinite(y) and np.isfinite(z):
            points[n, 0], points[n, 1], points[n, 2] = x, y, z


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add_observation(system: FloatArray, pose: FloatArray, ray: FloatArray, weight: float) -> None:
    """Add one observation to the normal equations [3, 4]."""
    for axis in range(2):
        right = ray[axis] * pose[2, 3] - pose[axis, 3]
        for i in range(3):
            weighted = weight * (pose[axis, i] - ray[axis] * pose[2, i])
            for j in range(3):
                system[i, j] += weighted * (pose[axis, j] - ray[axis] * pose[2, j])
            system[i, 3] += weighted * right


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _solve(system: FloatArray) -> tuple[float, float, float]:
    """The solution of three normal equations [3, 4], barely damped, by elimination in place.

    Of matrices without negative eigenvalues the diagonal's own pivots are stable (Golub & Van Loan
    2013, 4.2).
    """
    damping = 1e-15 * (system[0, 0] + system[1, 1] + system[2, 2]) + 1e-300
    for i in range(3):
        system[i, i] += damping
    for i in range(3):
        for k in range(i + 1, 3):
            factor = system[k, i] / system[i, i]
            for j in range(i + 1, 4):
                system[k, j] -= factor * system[i, j]
    z = system[2, 3] / system[2, 2]
    y = (system[1, 3] - system[1, 2] * z) / system[1, 1]
    return (system[0, 3] - system[0, 1] * y - system[0, 2] * z) / system[0, 0], y, z

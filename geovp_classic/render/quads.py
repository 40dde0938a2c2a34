"""The compiled part of drawing patches: every patch of a cloud as a flat quadrilateral in a z-buffer, view by view.

Where a pixel (u, v) with inverse depth q is seen is linear before the division by z, so that a patch is its middle and
two steps, and most patches that show nothing are known from these without looking at their corners.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.types import FloatArray

IndexArray = npt.NDArray[np.int32]
Corner = tuple[float, float, float]  # x and y in pixels, inverse depth
Quad = tuple[Corner, Corner, Corner, Corner]
Columns = tuple[Corner, Corner, Corner, Corner]
Homogeneous = tuple[float, float, float, float]  # x, y, z and inverse depth, before division by z
Spread = tuple[Homogeneous, Homogeneous, Homogeneous]

NOTHING = -1
HALF_PX = 0.52  # of the square a pixel stands for; the little more closes cracks on curved surfaces
NEAR_SHARE = 1e-3  # of a ray's length: a patch that comes nearer to the camera's plane is not drawn
EDGE_PX2 = 1e-6  # tolerance of the inside test: patches that share an edge leave no crack


@numba.njit(cache=True, parallel=True)
def draw_views(
    pixels: FloatArray,
    inverse_depth: FloatArray,
    slope: FloatArray,
    source: IndexArray,
    a: FloatArray,
    b: FloatArray,
    drawn: FloatArray,
    winner: IndexArray,
) -> None:
    """Draw patches into inverse depths [F, H, W] and the numbers of the nearest ones; see `surface.draw`."""
    for f in numba.prange(len(a)):
        _draw_view(pixels, inverse_depth, slope, source, a[f], b[f], drawn[f], winner[f])


@numba.njit(cache=True)
def _draw_view(
    pixels: FloatArray,
    inverse_depth: FloatArray,
    slope: FloatArray,
    source: IndexArray,
    a: FloatArray,
    b: FloatArray,
    drawn: FloatArray,
    winner: IndexArray,
) -> None:
    height, width = drawn.shape
    current, to_view = 0, _columns(a[0], b[0])
    for n in range(len(pixels)):
        if source[n] != current:
            current = source[n]
            to_view = _columns(a[current], b[current])
        spread = _spread(pixels[n, 0], pixels[n, 1], inverse_depth[n], slope[n, 0], slope[n, 1], to_view)
        if not _misses(spread, width, height):
            _fill_quad(_corners(spread), n, drawn, winner)


@numba.njit(cache=True)
def _columns(a: FloatArray, b: FloatArray) -> Columns:
    """What a step along u, along v, the origin and inverse depth add to the homogeneous pixel of the view."""
    return (
        (a[0, 0], a[1, 0], a[2, 0]),
        (a[0, 1], a[1, 1], a[2, 1]),
        (a[0, 2], a[1, 2], a[2, 2]),
        (b[0], b[1], b[2]),
    )


@numba.njit(cache=True, fastmath=True)
def _spread(u: float, v: float, inverse_depth: float, slope_u: float, slope_v: float, to_view: Columns) -> Spread:
    """The patch's middle in the view and the steps across half of it, homogeneous; its last number is inverse depth.

    A slope that would lead behind infinity is made flatter.
    """
    along_u, along_v, origin, shift = to_view
    q_u, q_v = HALF_PX * slope_u, HALF_PX * slope_v
    if abs(q_u) + abs(q_v) > inverse_depth:
        flatter = inverse_depth / (abs(q_u) + abs(q_v))
        q_u, q_v = q_u * flatter, q_v * flatter
    x = along_u[0] * u + along_v[0] * v + origin[0] + inverse_depth * shift[0]
    y = along_u[1] * u + along_v[1] * v + origin[1] + inverse_depth * shift[1]
    z = along_u[2] * u + along_v[2] * v + origin[2] + inverse_depth * shift[2]
    h = HALF_PX
    step_u = (h * along_u[0] + q_u * shift[0], h * along_u[1] + q_u * shift[1], h * along_u[2] + q_u * shift[2], q_u)
    step_v = (h * along_v[0] + q_v * shift[0], h * along_v[1] + q_v * shift[1], h * along_v[2] + q_v * shift[2], q_v)
    return (x, y, z, float(inverse_depth)), step_u, step_v


@numba.njit(cache=True, fastmath=True)
def _misses(spread: Spread, width: int, height: int) -> bool:
    """Whether a patch surely holds no pixel's centre of the view, or comes too near to the camera's plane.

    With m the middle and d, e the steps, a corner m +- d +- e is seen within (|d_x - x d_z| + |e_x - x e_z|) /
    (m_z - |d_z| - |e_z|) of the middle's x, and so for y. This spares most patches the work on their corners; all
    lengths are multiplied by both denominators, which spares those outside the view the division.
    """
    middle, d, e = spread
    nearest = middle[2] - abs(d[2]) - abs(e[2])
    if nearest < NEAR_SHARE:
        return True
    scale = middle[2] * nearest
    x, reach_x = middle[0] * nearest, _reach(0, spread) + EDGE_PX2 * scale
    if x + reach_x < 0 or x - reach_x > (width - 1) * scale:
        return True
    y, reach_y = middle[1] * nearest, _reach(1, spread) + EDGE_PX2 * scale
    if y + reach_y < 0 or y - reach_y > (height - 1) * scale:
        return True
    share = 1 / scale
    x, reach_x, y, reach_y = x * share, reach_x * share, y * share, reach_y * share
    return bool(np.floor(x + reach_x) < x - reach_x or np.floor(y + reach_y) < y - reach_y)


@numba.njit(cache=True, fastmath=True)
def _reach(axis: int, spread: Spread) -> float:
    middle, d, e = spread
    m, z = middle[axis], middle[2]
    return abs(d[axis] * z - m * d[2]) + abs(e[axis] * z - m * e[2])


@numba.njit(cache=True, fastmath=True)
def _corners(spread: Spread) -> Quad:
    """The four corners of a patch in the view, in order around it."""
    return _corner(spread, -1, -1), _corner(spread, 1, -1), _corner(spread, 1, 1), _corner(spread, -1, 1)


@numba.njit(cache=True, fastmath=True)
def _corner(spread: Spread, i: int, j: int) -> Corner:
    m, d, e = spread
    share = 1 / (m[2] + i * d[2] + j * e[2])
    return (
        (m[0] + i * d[0] + j * e[0]) * share,
        (m[1] + i * d[1] + j * e[1]) * share,
        (m[3] + i * d[3] + j * e[3]) * share,
    )


@numba.njit(cache=True, fastmath=True)
def _fill_quad(quad: Quad, number: int, drawn: FloatArray, winner: IndexArray) -> None:
    """Draw one patch where it is nearer than what is there; its inverse depth is linear in the picture."""
    (x0, y0, q0), (x1, y1, q1), (x2, y2, q2), (x3, y3, q3) = quad
    height, width = drawn.shape
    left, right = max(np.ceil(min(x0, x1, x2, x3)), 0.0), min(np.floor(max(x0, x1, x2, x3)), width - 1.0)
    top, bottom = max(np.ceil(min(y0, y1, y2, y3)), 0.0), min(np.floor(max(y0, y1, y2, y3)), height - 1.0)
    if not (left <= right and top <= bottom):
        return
    ua, va, ub, vb = x1 - x0, y1 - y0, x3 - x0, y3 - y0
    area = ua * vb - ub * va
    slope_x = slope_y = 0.0
    if abs(area) > EDGE_PX2:
        slope_x = ((q1 - q0) * vb - (q3 - q0) * va) / area
        slope_y = ((q3 - q0) * ua - (q1 - q0) * ub) / area
    nearest, farthest = max(q0, q1, q2, q3), min(q0, q1, q2, q3)
    for row in range(int(top), int(bottom) + 1):
        for column in range(int(left), int(right) + 1):
            here = min(max(q0 + slope_x * (column - x0) + slope_y * (row - y0), farthest), nearest)
            if here > drawn[row, column] and _inside(quad, column, row):
                drawn[row, column] = here
                winner[row, column] = number


@numba.njit(cache=True, fastmath=True)
def _inside(quad: Quad, column: int, row: int) -> bool:
    """Whether a pixel's centre lies in a convex quadrilateral, edges included, whichever way round it goes."""
    first, second, third, fourth = quad
    sides = (
        _side(first, second, column, row),
        _side(second, third, column, row),
        _side(third, fourth, column, row),
        _side(fourth, first, column, row),
    )
    return bool(min(sides) >= -EDGE_PX2 or max(sides) <= EDGE_PX2)


@numba.njit(cache=True, fastmath=True)
def _side(start: Corner, end: Corner, column: int, row: int) -> float:
    """On which side of an edge a pixel's centre lies, by the sign of an area."""
    return (end[0] - start[0]) * (row - start[1]) - (end[1] - start[1]) * (column - start[0])

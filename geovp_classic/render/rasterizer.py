"""The compiled part of drawing patches: every patch of a cloud as a flat quadrilateral in a z-buffer, view by view.

Where a pixel (u, v) with inverse depth q is seen is linear before the division by z, so that a patch is its middle m
and two steps d and e to the middles of its sides. The ray p = (x, y, 1) of a pixel meets its plane at m + s d + t e,
with s = p . (e x m) / p . (d x e) and t = p . (m x d) / p . (d x e) by Cramer's rule: all that decides is linear in the
image (homogeneous edge functions, Olano & Greer 1997). Each block of patches is first planned in one loop without
branches, which the processor does for many patches at once, in pixels counted from the patch, so that single precision
is enough.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.types import FloatArray

IndexArray = npt.NDArray[np.int32]
Number = np.floating[Any]
Vector = tuple[Number, Number, Number]
Columns = tuple[Vector, Vector, Vector, Vector]

NOTHING = -1
HALF_PX = 0.52  # of the square a pixel stands for; the little more closes cracks on curved surfaces
NEAR_SHARE = 1e-3  # of a ray's length: a patch that comes nearer to the camera's plane is not drawn
EDGE = np.float32(1 + 1e-4)  # tolerance of the inside test, of half a patch: shared edges leave no crack
EDGE_PX = np.float32(1e-5)  # and of the box around it

BLOCK = 512  # patches that are planned at a time
ROW = BLOCK + 16  # numbers between two rows of a plan: a power of two would put all rows in one place of the cache
# Rows of a plan: the box in pixels from the base pixel, the base, p . (d x e), p . (e x m) and p . (m x d) as factors
# of (x, y, 1), the inverse depth likewise, and its smallest and largest.
LEFT, RIGHT, TOP, BOTTOM, BASE_X, BASE_Y, WHOLE, ALONG_D, ALONG_E, DEPTH, FARTHEST, NEAREST, NUM_ROWS = (
    ROW * row for row in (0, 1, 2, 3, 4, 5, 6, 9, 12, 15, 18, 19, 20)
)
_HALF, _NEAR = np.float32(HALF_PX), np.float32(NEAR_SHARE)
_ZERO, _ONE, _TINY = np.float32(0), np.float32(1), np.float32(1e-30)


@numba.njit(cache=True, parallel=True)
def draw_views(
    patches: FloatArray,  # [5, N] float32: u, v, inverse depth, its slopes along u and v
    source: IndexArray,  # [N], fastest where patches of one source follow each other
    a: FloatArray,  # [F, sources, 3, 3] float32
    b: FloatArray,  # [F, sources, 3] float32
    drawn: FloatArray,
    winner: IndexArray,
) -> None:
    """Draw patches into inverse depths [F, H, W] and the numbers of the nearest ones; see `surface.draw`."""
    for f in numba.prange(len(a)):
        _draw_view(patches, source, a[f], b[f], drawn[f], winner[f])


@numba.njit(cache=True)
def _draw_view(
    patches: FloatArray, source: IndexArray, a: FloatArray, b: FloatArray, drawn: FloatArray, winner: IndexArray
) -> None:
    plan, kept = np.empty(NUM_ROWS, np.float32), np.empty(BLOCK + 1, np.int32)
    last = np.float32(drawn.shape[1] - 1), np.float32(drawn.shape[0] - 1)
    us, vs, inverse_depths, slopes_u, slopes_v = patches[0], patches[1], patches[2], patches[3], patches[4]
    start = 0
    while start < len(source):
        here, end = source[start], start + 1
        while end < min(len(source), start + BLOCK) and source[end] == here:
            end += 1
        u, v, inverse_depth = us[start:end], vs[start:end], inverse_depths[start:end]
        to_view = _columns(a[here], b[here])
        _plan(u, v, inverse_depth, slopes_u[start:end], slopes_v[start:end], to_view, last, plan)
        count = 0
        for n in range(end - start):
            kept[count] = n
            count += int((plan[LEFT + n] <= plan[RIGHT + n]) & (plan[TOP + n] <= plan[BOTTOM + n]))
        for n in kept[:count]:
            _fill(plan, n, start + n, drawn, winner)
        start = end


@numba.njit(cache=True)
def _columns(a: FloatArray, b: FloatArray) -> Columns:
    """What a step along u, along v, the origin and inverse depth add to the homogeneous pixel of the view."""
    return (
        (a[0, 0], a[1, 0], a[2, 0]),
        (a[0, 1], a[1, 1], a[2, 1]),
        (a[0, 2], a[1, 2], a[2, 2]),
        (b[0], b[1], b[2]),
    )


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _plan(
    us: FloatArray,
    vs: FloatArray,
    inverse_depths: FloatArray,
    slopes_u: FloatArray,
    slopes_v: FloatArray,
    to_view: Columns,
    last: tuple[Number, Number],  # column and row of the view
    plan: FloatArray,  # written
) -> None:
    """What `_fill` needs of each patch; the box is empty for one that shows nothing or comes too near to the camera.

    A slope that would lead behind infinity is made flatter.
    """
    along_u, along_v, origin, shift = to_view
    for n in range(len(us)):
        u, v, q = us[n], vs[n], inverse_depths[n]
        q_d, q_e = _HALF * slopes_u[n], _HALF * slopes_v[n]
        flatter = min(_ONE, q / max(abs(q_d) + abs(q_e), _TINY))
        q_d, q_e = q_d * flatter, q_e * flatter
        m_x, d_x, e_x = _seen(along_u[0], along_v[0], origin[0], shift[0], u, v, q, q_d, q_e)
        m_y, d_y, e_y = _seen(along_u[1], along_v[1], origin[1], shift[1], u, v, q, q_d, q_e)
        m_z, d_z, e_z = _seen(along_u[2], along_v[2], origin[2], shift[2], u, v, q, q_d, q_e)
        is_before = m_z - abs(d_z) - abs(e_z) >= _NEAR
        m_z, d_z, e_z = m_z if is_before else _ONE, d_z if is_before else _ZERO, e_z if is_before else _ZERO

        base_x, base_y = np.floor(m_x / m_z), np.floor(m_y / m_z)
        m_x, d_x, e_x = m_x - base_x * m_z, d_x - base_x * d_z, e_x - base_x * e_z
        m_y, d_y, e_y = m_y - base_y * m_z, d_y - base_y * d_z, e_y - base_y * e_z
        shares = _ONE / (m_z - d_z - e_z), _ONE / (m_z + d_z - e_z), _ONE / (m_z - d_z + e_z), _ONE / (m_z + d_z + e_z)
        left, right = _span(m_x, d_x, e_x, shares)
        top, bottom = _span(m_y, d_y, e_y, shares)
        plan[LEFT + n] = max(-np.floor(EDGE_PX - left), -base_x)
        plan[RIGHT + n] = min(np.floor(right + EDGE_PX), last[0] - base_x if is_before else -base_x - _ONE)
        plan[TOP + n] = max(-np.floor(EDGE_PX - top), -base_y)
        plan[BOTTOM + n] = min(np.floor(bottom + EDGE_PX), last[1] - base_y)
        plan[BASE_X + n], plan[BASE_Y + n] = base_x, base_y
        plan[FARTHEST + n], plan[NEAREST + n] = _span(q, q_d, q_e, shares)

        m, d, e = (m_x, m_y, m_z), (d_x, d_y, d_z), (e_x, e_y, e_z)
        whole, along_d, along_e = _cross(d, e), _cross(e, m), _cross(m, d)
        volume = m_x * whole[0] + m_y * whole[1] + m_z * whole[2]
        share = _ONE / volume if volume != _ZERO else _ZERO  # zero when seen from the side
        _note(plan, WHOLE + n, whole)
        _note(plan, ALONG_D + n, along_d)
        _note(plan, ALONG_E + n, along_e)
        plan[DEPTH + n] = (q * whole[0] + q_d * along_d[0] + q_e * along_e[0]) * share
        plan[DEPTH + ROW + n] = (q * whole[1] + q_d * along_d[1] + q_e * along_e[1]) * share
        plan[DEPTH + 2 * ROW + n] = (q * whole[2] + q_d * along_d[2] + q_e * along_e[2]) * share


@numba.njit(cache=True, fastmath=True)
def _seen(
    along_u: Number,
    along_v: Number,
    origin: Number,
    shift: Number,
    u: Number,
    v: Number,
    q: Number,
    q_d: Number,
    q_e: Number,
) -> Vector:
    """One homogeneous coordinate of the middle and of the two steps."""
    middle = along_u * u + along_v * v + origin + q * shift
    return middle, _HALF * along_u + q_d * shift, _HALF * along_v + q_e * shift


@numba.njit(cache=True, fastmath=True)
def _span(
    middle: Number,
    d: Number,
    e: Number,
    shares: tuple[Number, Number, Number, Number],  # 1 / z of the corners -d -e, +d -e, -d +e, +d +e
) -> tuple[Number, Number]:
    """The smallest and largest value at the corners."""
    first, second = (middle - d - e) * shares[0], (middle + d - e) * shares[1]
    third, fourth = (middle - d + e) * shares[2], (middle + d + e) * shares[3]
    return min(min(first, second), min(third, fourth)), max(max(first, second), max(third, fourth))


@numba.njit(cache=True)
def _note(plan: FloatArray, start: int, factors: Vector) -> None:
    plan[start], plan[start + ROW], plan[start + 2 * ROW] = factors


@numba.njit(cache=True, fastmath=True)
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, fastmath=True)
def _fill(plan: FloatArray, n: int, number: int, drawn: FloatArray, winner: IndexArray) -> None:
    """Draw the patch of the plan where it is nearer than what is there."""
    base_x, base_y = int(plan[BASE_X + n]), int(plan[BASE_Y + n])
    whole, along_d, along_e = _factors(plan, WHOLE + n), _factors(plan, ALONG_D + n), _factors(plan, ALONG_E + n)
    depth, farthest, nearest = _factors(plan, DEPTH + n), plan[FARTHEST + n], plan[NEAREST + n]
    for i in range(int(plan[TOP + n]), int(plan[BOTTOM + n]) + 1):
        for j in range(int(plan[LEFT + n]), int(plan[RIGHT + n]) + 1):
            x, y, row, column = np.float32(j), np.float32(i), base_y + i, base_x + j
            here = min(max(_at(depth, x, y), farthest), nearest)
            limit = EDGE * abs(_at(whole, x, y))
            if here > drawn[row, column] and abs(_at(along_d, x, y)) <= limit and abs(_at(along_e, x, y)) <= limit:
                drawn[row, column] = here
                winner[row, column] = number


@numba.njit(cache=True)
def _factors(plan: FloatArray, start: int) -> Vector:
    return plan[start], plan[start + ROW], plan[start + 2 * ROW]


@numba.njit(cache=True, fastmath=True)
def _at(factors: Vector, x: Number, y: Number) -> Number:
    return factors[0] * x + factors[1] * y + factors[2]

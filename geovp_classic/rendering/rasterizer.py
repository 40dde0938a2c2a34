"""The compiled rasteriser: every patch of a cloud as a flat quadrilateral in a z-buffer, view by
view.

The projection of a pixel (u, v) with inverse depth q is linear before the division by z, so a patch
is its middle m and two steps d and e to the middles of its sides. The ray p = (x, y, 1) of a pixel
meets its plane at m + s d + t e, with s = p . (e x m) / p . (d x e) and t = p . (m x d) / p . (d x
e) by Cramer's rule: all edge tests are linear in the image (homogeneous edge functions, Olano &
Greer 1997). Each block of patches is set up in one loop without branches, which the compiler
vectorises, in pixels relative to the patch, so that single precision is enough.
"""

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.parallel import SAME_BITS, parallel_map
from geovp_classic.types import FloatArray

IndexArray = npt.NDArray[np.int32]
Number = np.floating[Any]
Vector = tuple[Number, Number, Number]

NO_INDEX = -1
HALF_PX = 0.52  # of the square a pixel stands for; the margin closes cracks on curved surfaces
NEAR_SHARE = 1e-3  # of a ray's length: a patch nearer to the camera's plane is not rasterised
EDGE = np.float32(
    1 + 1e-4
)  # tolerance of the inside test, of half a patch: shared edges leave no crack
EDGE_PX = np.float32(1e-5)  # and of the box around it

BLOCK = 512  # patches that are set up at a time
ROW = (
    BLOCK + 16
)  # numbers between two rows of a setup: with a power of two all rows would share cache lines
# Rows of a setup: the box in pixels from the base pixel, the base, then p . (d x e), p . (e x m), p
# . (m x d) and the
# inverse depth as coefficients of (x, y, 1), and its smallest and largest value.
(
    LEFT,
    RIGHT,
    TOP,
    BOTTOM,
    BASE_X,
    BASE_Y,
    DET,
    ALONG_D,
    ALONG_E,
    DEPTH,
    FARTHEST,
    NEAREST,
    NUM_ROWS,
) = (ROW * row for row in (0, 1, 2, 3, 4, 5, 6, 9, 12, 15, 18, 19, 20))
_NEAR = np.float32(NEAR_SHARE)
_ZERO, _ONE, _TINY = np.float32(0), np.float32(1), np.float32(1e-30)


def rasterise_views(
    patches: FloatArray,  # [5, N] float32: u, v, inverse depth, its slopes along u and v
    source: IndexArray,  # [N], fastest where patches of one source follow each other
    a: FloatArray,  # [F, sources, 3, 3] float32
    b: FloatArray,  # [F, sources, 3] float32
    half_px: float,  # half the side of a patch in its source
    z_buffer: FloatArray,
    winner: IndexArray,
) -> None:
    """Rasterise patches into z-buffers [F, H, W] of inverse depth and the numbers of the nearest
    ones.
    """

    def rasterise(f: int) -> None:
        buffers = np.empty(NUM_ROWS, np.float32), np.empty(BLOCK + 1, np.int32)
        _rasterise_view(
            patches, source, a[f], b[f], np.float32(half_px), *buffers, z_buffer[f], winner[f]
        )

    parallel_map(rasterise, range(len(a)))


@numba.njit(nogil=True, cache=True)
def _rasterise_view(
    patches: FloatArray,
    source: IndexArray,
    a: FloatArray,
    b: FloatArray,
    half_px: np.float32,
    setup: FloatArray,  # [NUM_ROWS], changed
    kept: IndexArray,  # [BLOCK + 1], changed
    z_buffer: FloatArray,
    winner: IndexArray,
) -> None:
    last = np.float32(z_buffer.shape[1] - 1), np.float32(z_buffer.shape[0] - 1)
    start = int(np.int64(0))  # a plain 0 is a type of its own, and all would be compiled twice
    while start < len(source):
        value, end = source[start], start + 1
        while end < min(len(source), start + BLOCK) and source[end] == value:
            end += 1
        _set_up(patches, start, end, a[value], b[value], half_px, last, setup)
        count = 0
        for n in range(end - start):
            kept[count] = n
            count += int(
                (setup[LEFT + n] <= setup[RIGHT + n]) & (setup[TOP + n] <= setup[BOTTOM + n])
            )
        for k in range(count):
            _rasterise_patch(setup, kept[k], start + kept[k], z_buffer, winner)
        start = end


@numba.njit(cache=True, fastmath=SAME_BITS, error_model="numpy")
def _set_up(
    patches: FloatArray,
    start: int,
    end: int,
    a: FloatArray,  # [3, 3]
    b: FloatArray,  # [3]
    half_px: np.float32,
    last: tuple[Number, Number],  # column and row of the view
    setup: FloatArray,  # written
) -> None:
    """Set up `_rasterise_patch`; the box is empty for patches outside the view or too near to the
    camera.

    A slope that would lead beyond infinity is made flatter.
    """
    # What u, v, 1 and inverse depth add to the homogeneous pixel of the view
    along_u, along_v = (a[0, 0], a[1, 0], a[2, 0]), (a[0, 1], a[1, 1], a[2, 1])
    origin, shift = (a[0, 2], a[1, 2], a[2, 2]), (b[0], b[1], b[2])
    us, vs, inverse_depths = patches[0, start:end], patches[1, start:end], patches[2, start:end]
    slopes_u, slopes_v = patches[3, start:end], patches[4, start:end]
    for n in range(len(us)):
        u, v, q = us[n], vs[n], inverse_depths[n]
        q_d, q_e = half_px * slopes_u[n], half_px * slopes_v[n]
        flatter = min(_ONE, q / max(abs(q_d) + abs(q_e), _TINY))
        q_d, q_e = q_d * flatter, q_e * flatter
        m_x, d_x, e_x = _homogeneous(
            along_u[0], along_v[0], origin[0], shift[0], half_px, u, v, q, q_d, q_e
        )
        m_y, d_y, e_y = _homogeneous(
            along_u[1], along_v[1], origin[1], shift[1], half_px, u, v, q, q_d, q_e
        )
        m_z, d_z, e_z = _homogeneous(
            along_u[2], along_v[2], origin[2], shift[2], half_px, u, v, q, q_d, q_e
        )
        is_in_front = m_z - abs(d_z) - abs(e_z) >= _NEAR
        m_z, d_z, e_z = (
            m_z if is_in_front else _ONE,
            d_z if is_in_front else _ZERO,
            e_z if is_in_front else _ZERO,
        )

        base_x, base_y = np.floor(m_x / m_z), np.floor(m_y / m_z)
        m_x, d_x, e_x = m_x - base_x * m_z, d_x - base_x * d_z, e_x - base_x * e_z
        m_y, d_y, e_y = m_y - base_y * m_z, d_y - base_y * d_z, e_y - base_y * e_z
        per_z = (
            _ONE / (m_z - d_z - e_z),
            _ONE / (m_z + d_z - e_z),
            _ONE / (m_z - d_z + e_z),
            _ONE / (m_z + d_z + e_z),
        )
        left, right = _bounds(m_x, d_x, e_x, per_z)
        top, bottom = _bounds(m_y, d_y, e_y, per_z)
        setup[LEFT + n] = max(-np.floor(EDGE_PX - left), -base_x)
        setup[RIGHT + n] = min(
            np.floor(right + EDGE_PX), last[0] - base_x if is_in_front else -base_x - _ONE
        )
        setup[TOP + n] = max(-np.floor(EDGE_PX - top), -base_y)
        setup[BOTTOM + n] = min(np.floor(bottom + EDGE_PX), last[1] - base_y)
        setup[BASE_X + n], setup[BASE_Y + n] = base_x, base_y
        setup[FARTHEST + n], setup[NEAREST + n] = _bounds(q, q_d, q_e, per_z)

        m, d, e = (m_x, m_y, m_z), (d_x, d_y, d_z), (e_x, e_y, e_z)
        det, along_d, along_e = _cross(d, e), _cross(e, m), _cross(m, d)
        volume = m_x * det[0] + m_y * det[1] + m_z * det[2]
        share = _ONE / volume if volume != _ZERO else _ZERO  # zero when seen from the side
        _store(setup, DET + n, det)
        _store(setup, ALONG_D + n, along_d)
        _store(setup, ALONG_E + n, along_e)
        setup[DEPTH + n] = (q * det[0] + q_d * along_d[0] + q_e * along_e[0]) * share
        setup[DEPTH + ROW + n] = (q * det[1] + q_d * along_d[1] + q_e * along_e[1]) * share
        setup[DEPTH + 2 * ROW + n] = (q * det[2] + q_d * along_d[2] + q_e * along_e[2]) * share


@numba.njit(cache=True, fastmath=SAME_BITS)
def _homogeneous(
    along_u: Number,
    along_v: Number,
    origin: Number,
    shift: Number,
    half_px: Number,
    u: Number,
    v: Number,
    q: Number,
    q_d: Number,
    q_e: Number,
) -> Vector:
    """One homogeneous coordinate of the middle and of the two steps."""
    middle = along_u * u + along_v * v + origin + q * shift
    return middle, half_px * along_u + q_d * shift, half_px * along_v + q_e * shift


@numba.njit(cache=True, fastmath=SAME_BITS)
def _bounds(
    middle: Number,
    d: Number,
    e: Number,
    per_z: tuple[Number, Number, Number, Number],  # 1 / z of the corners -d -e, +d -e, -d +e, +d +e
) -> tuple[Number, Number]:
    """The smallest and largest value at the corners."""
    first, second = (middle - d - e) * per_z[0], (middle + d - e) * per_z[1]
    third, fourth = (middle - d + e) * per_z[2], (middle + d + e) * per_z[3]
    return min(min(first, second), min(third, fourth)), max(max(first, second), max(third, fourth))


@numba.njit(cache=True)
def _store(setup: FloatArray, start: int, coefficients: Vector) -> None:
    setup[start], setup[start + ROW], setup[start + 2 * ROW] = coefficients


@numba.njit(cache=True, fastmath=SAME_BITS)
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, fastmath=SAME_BITS)
def _rasterise_patch(
    setup: FloatArray, n: int, number: int, z_buffer: FloatArray, winner: IndexArray
) -> None:
    """Write the patch where it is nearer than the z-buffer."""
    base_x, base_y = int(setup[BASE_X + n]), int(setup[BASE_Y + n])
    det, along_d, along_e = (
        _load(setup, DET + n),
        _load(setup, ALONG_D + n),
        _load(setup, ALONG_E + n),
    )
    depth, farthest, nearest = _load(setup, DEPTH + n), setup[FARTHEST + n], setup[NEAREST + n]
    for i in range(int(setup[TOP + n]), int(setup[BOTTOM + n]) + 1):
        for j in range(int(setup[LEFT + n]), int(setup[RIGHT + n]) + 1):
            x, y, row, column = np.float32(j), np.float32(i), base_y + i, base_x + j
            value = min(max(_at(depth, x, y), farthest), nearest)
            limit = EDGE * abs(_at(det, x, y))
            if (
                value > z_buffer[row, column]
                and abs(_at(along_d, x, y)) <= limit
                and abs(_at(along_e, x, y)) <= limit
            ):
                z_buffer[row, column] = value
                winner[row, column] = number


@numba.njit(cache=True)
def _load(setup: FloatArray, start: int) -> Vector:
    return setup[start], setup[start + ROW], setup[start + 2 * ROW]


@numba.njit(cache=True, fastmath=SAME_BITS)
def _at(coefficients: Vector, x: Number, y: Number) -> Number:
    return coefficients[0] * x + coefficients[1] * y + coefficients[2]

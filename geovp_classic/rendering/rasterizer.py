"""Compiled z-buffer rasteriser of small flat patches (Olano & Greer 1997).

A patch consists of the homogeneous points m + s d + t e with |s| <= 1 and |t| <= 1: its middle m,
and the steps d and e to the middles of its sides. With pixels (x, y) counted from the projected
middle, m = (0, 0, z), and Cramer's rule gives s and t where the ray of a pixel meets the patch.
"""

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.types import FloatArray

IndexArray = npt.NDArray[np.int32]
Vector = tuple[np.float32, np.float32, np.float32]

NO_INDEX = -1
# Of s and t; the tolerance lets shared edges leave no crack.
MAX_S = np.float32(1.0001)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def rasterise_view(
    patches: tuple[FloatArray | IndexArray, ...],  # fields of `Patches`
    to_view: FloatArray,  # [S, 3, 4], from (u, v, 1, inverse depth) to homogeneous pixels
    half_px: np.float32,  # half the side of a patch in its source
    z_buffer: FloatArray,  # [H, W], inverse depth; written
    winner: IndexArray,  # [H, W], number of the nearest patch; written
) -> None:
    """Rasterise patches into the z-buffer of one view.

    A slope that would lead beyond infinity is made flatter.
    """
    # Of a ray's length; patches nearer to the camera are not rasterised.
    min_z = np.float32(1e-3)
    height, width = z_buffer.shape
    pixels, inverse_depth, slope, source = patches
    for n in range(len(source)):
        k = source[n]
        u = pixels[n, 0]
        v = pixels[n, 1]
        q = inverse_depth[n]
        q_d = half_px * slope[n, 0]
        q_e = half_px * slope[n, 1]
        steepness = abs(q_d) + abs(q_e)
        if steepness > q:
            q_d *= q / steepness
            q_e *= q / steepness

        # What u, v, 1 and q add to the homogeneous pixel of the view.
        x_u, x_v, x_1, x_q = to_view[k, 0]
        y_u, y_v, y_1, y_q = to_view[k, 1]
        z_u, z_v, z_1, z_q = to_view[k, 2]

        z = z_u * u + z_v * v + z_1 + z_q * q
        d_z = z_u * half_px + z_q * q_d
        e_z = z_v * half_px + z_q * q_e
        nearest_z = z - abs(d_z) - abs(e_z)
        if nearest_z < min_z:
            continue

        # The middle in the view, and the steps relative to it.
        x = (x_u * u + x_v * v + x_1 + x_q * q) / z
        y = (y_u * u + y_v * v + y_1 + y_q * q) / z
        d_x = x_u * half_px + x_q * q_d - x * d_z
        d_y = y_u * half_px + y_q * q_d - y * d_z
        e_x = x_v * half_px + x_q * q_e - x * e_z
        e_y = y_v * half_px + y_q * q_e - y * e_z

        # Most patches of uncropped frames lie outside the view.
        radius_x = MAX_S * (abs(d_x) + abs(e_x)) / nearest_z
        radius_y = MAX_S * (abs(d_y) + abs(e_y)) / nearest_z
        is_outside_x = x + radius_x < 0 or x - radius_x > width - 1
        if is_outside_x or y + radius_y < 0 or y - radius_y > height - 1:
            continue

        d = (d_x, d_y, d_z)
        e = (e_x, e_y, e_z)
        _draw_patch(n, (x, y, z), d, e, (q, q_d, q_e), z_buffer, winner)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _draw_patch(
    number: int,
    middle: Vector,  # pixel (x, y) and z
    d: Vector,  # steps to the middles of the sides, relative to the middle's pixel
    e: Vector,
    inverse_depth: Vector,  # of the middle, and its changes along d and e
    z_buffer: FloatArray,  # [H, W]; written
    winner: IndexArray,  # [H, W]; written
) -> None:
    """Write a patch to the pixels in which it is nearer than all before it."""
    height, width = z_buffer.shape
    x, y, z = middle
    q, q_d, q_e = inverse_depth
    # How far the corners reach beyond the middle, in pixels.
    left = right = top = bottom = np.float32(0)
    for corner in range(4):
        s = np.float32(1 - 2 * (corner % 2))
        t = np.float32(1 - 2 * (corner // 2))
        per_z = MAX_S / (z + s * d[2] + t * e[2])
        corner_x = (s * d[0] + t * e[0]) * per_z
        corner_y = (s * d[1] + t * e[1]) * per_z
        left = min(left, corner_x)
        right = max(right, corner_x)
        top = min(top, corner_y)
        bottom = max(bottom, corner_y)
    first_column = int(max(np.ceil(x + left), 0))
    last_column = int(min(np.floor(x + right), width - 1))
    first_row = int(max(np.ceil(y + top), 0))
    last_row = int(min(np.floor(y + bottom), height - 1))

    # The cross product of d and e.
    normal_x = d[1] * e[2] - d[2] * e[1]
    normal_y = d[2] * e[0] - d[0] * e[2]
    normal_z = d[0] * e[1] - d[1] * e[0]
    # On a plane, inverse depth is linear in the pixels of the view.
    q_middle = q / z
    per_normal = 1 / (z * normal_z)
    q_x = per_normal * (q * normal_x + z * (q_d * e[1] - q_e * d[1]))
    q_y = per_normal * (q * normal_y + z * (q_e * d[0] - q_d * e[0]))
    max_s_per_z = MAX_S / z
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            i = np.float32(column) - x
            j = np.float32(row) - y
            scale = normal_x * i + normal_y * j + normal_z
            limit = max_s_per_z * abs(scale)
            value = q_middle + q_x * i + q_y * j
            is_nearer = value > z_buffer[row, column]
            is_inside_s = abs(e[1] * i - e[0] * j) <= limit
            is_inside_t = abs(d[0] * j - d[1] * i) <= limit
            if is_nearer & is_inside_s & is_inside_t:
                z_buffer[row, column] = value
                winner[row, column] = number

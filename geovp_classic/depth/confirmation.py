"""Whether another frame's depth says the same as one frame's own: what two frames see alike is rarely wrong."""

from __future__ import annotations

import numba
import numpy as np

from geovp_classic.types import FloatArray, Intrinsics

FAR_SHARE = 0.01  # of the nearest things' inverse depth (their 99th percentile): below it, far is far
_HALF, _ONE = np.float32(0.5), np.float32(1)


def agreement(
    inverse_depth: FloatArray,  # [H, W], of the frame in question
    camera: Intrinsics,
    witness: FloatArray,  # [H', W'] float32, inverse depth of another frame
    witness_camera: Intrinsics,
    witness_from_cam: FloatArray,  # [4, 4]
    tolerance: float,
) -> FloatArray:
    """How well [H, W] another frame's depth confirms this one's: 1 when equal, exp(-1/2) at `tolerance`, 0 unseen.

    Differences are relative to the larger inverse depth.
    """
    infinity = witness_camera.matrix @ witness_from_cam[:3, :3] @ np.linalg.inv(camera.matrix)
    epipole = witness_camera.matrix @ witness_from_cam[:3, 3]
    floor = np.float32(FAR_SHARE * np.quantile(witness, 0.99) + 1e-12)
    own, other = (np.ascontiguousarray(one, dtype=np.float32) for one in (inverse_depth, witness))
    confirmed = np.zeros(own.shape, np.float32)
    _confirm(
        infinity.astype(np.float32), epipole.astype(np.float32), own, other, floor, np.float32(tolerance), confirmed
    )
    return confirmed


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _confirm(
    a: FloatArray,  # [3, 3] float32, K' R inv(K)
    b: FloatArray,  # [3] float32, K' t
    inverse_depth: FloatArray,  # [H, W]
    witness: FloatArray,  # [H', W']
    floor: np.float32,
    tolerance: np.float32,
    confirmed: FloatArray,  # [H, W], written where the witness sees
) -> None:
    """The outermost pixels of the witness count as far as their borders."""
    last_u, last_v = np.float32(witness.shape[1] - 1), np.float32(witness.shape[0] - 1)
    for row in range(inverse_depth.shape[0]):
        v = np.float32(row)
        for column in range(inverse_depth.shape[1]):
            u, q = np.float32(column), inverse_depth[row, column]
            z = a[2, 0] * u + a[2, 1] * v + a[2, 2] + q * b[2]
            if not z > 0:
                continue
            x = (a[0, 0] * u + a[0, 1] * v + a[0, 2] + q * b[0]) / z
            y = (a[1, 0] * u + a[1, 1] * v + a[1, 2] + q * b[1]) / z
            if x >= -_HALF and y >= -_HALF and x <= last_u + _HALF and y <= last_v + _HALF:
                found, there = _between(witness, x, y), q / z
                off = abs(found - there) / max(max(found, there), floor) / tolerance
                confirmed[row, column] = np.exp(-_HALF * off * off)


@numba.njit(nogil=True, cache=True)
def _between(values: FloatArray, x: np.float32, y: np.float32) -> np.float32:
    """The value [H, W] at (x, y), bilinear; the border's outside."""
    x = min(max(x, np.float32(0)), np.float32(values.shape[1] - 1))
    y = min(max(y, np.float32(0)), np.float32(values.shape[0] - 1))
    column, row = min(int(x), max(values.shape[1] - 2, 0)), min(int(y), max(values.shape[0] - 2, 0))
    right, below = min(column + 1, values.shape[1] - 1), min(row + 1, values.shape[0] - 1)
    part_u, part_v = x - np.float32(column), y - np.float32(row)
    upper = values[row, column] + part_u * (values[row, right] - values[row, column])
    lower = values[below, column] + part_u * (values[below, right] - values[below, column])
    return upper + part_v * (lower - upper)

"""Depth finer than a sweep's hypotheses: one step of least squares against all other frames (Lucas & Kanade 1981).

Along its epipolar line a pixel has a single unknown. Its neighbours say together where it should have been seen; their
images are compared without brightness and contrast, as in the sweep, and what fits nowhere has little say.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.parallel import parallel_map
from geovp_classic.types import FloatArray, Intrinsics

WINDOW_PX = 5  # over which brightness and contrast are taken out
NOISE_DEVIATION = 2.0  # of grey values 0..255; flatter windows have no contrast
TOGETHER_PX = 2.0  # standard deviation of the neighbourhood that moves together
MISFIT = 0.5  # in units of contrast, at which a pixel's say falls to a half
STIFFNESS = 0.5  # of the depth found before, in squared contrasts per pixel
LARGEST_STEP_PX = 0.5  # in the frame that sees the most parallax
LEAST_PARALLAX = 0.5  # of the image's median; with less, near the epipole, a pixel is as stiff as with so much

_EDGE_PX = np.float32(1)
_ZERO, _HALF, _ONE, _TINY = np.float32(0), np.float32(0.5), np.float32(1), np.float32(1e-12)
_IN_FRONT = np.float32(1e-6)  # smallest z, relative to the ray


def refined(
    inverse_depth: FloatArray,  # [H, W] float32 of the reference frame
    images: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
) -> FloatArray:
    """The inverse depth [H, W] moved by at most LARGEST_STEP_PX to where the images agree better, never negative."""
    others = [step for step in range(len(images)) if step != reference]
    plain = np.stack(parallel_map(lambda step: _without_exposure(images[step]), (reference, *others)))
    other_from_cam = se3.inverse(world_from_cam[others]) @ world_from_cam[reference]
    infinity_from_pixel = camera.matrix @ other_from_cam[:, :3, :3] @ np.linalg.inv(camera.matrix)
    epipoles = other_from_cam[:, :3, 3] @ camera.matrix.T
    maps = infinity_from_pixel.astype(np.float32), epipoles.astype(np.float32)
    q = np.ascontiguousarray(inverse_depth, dtype=np.float32)
    assert all(np.isfinite(one).all() for one in (*maps, q)), "a NaN would read outside the image"
    pull, grip, speed = _compared(q, plain[0], plain[1:], *maps)
    wanted, firm = (np.asarray(cv2.GaussianBlur(one, (0, 0), TOGETHER_PX)) for one in (pull, grip))
    if not (speed > 0).any():
        return q
    stiff = np.maximum(speed, LEAST_PARALLAX * np.median(speed[speed > 0]))
    step = wanted / (firm + STIFFNESS * stiff * stiff + _TINY)
    most = LARGEST_STEP_PX / stiff
    return np.where(speed > 0, np.maximum(q + np.clip(step, -most, most), 0), q).astype(np.float32)


def _without_exposure(image: FloatArray) -> FloatArray:
    window = (WINDOW_PX, WINDOW_PX)
    mean = np.asarray(cv2.boxFilter(image, -1, window))
    variance = np.maximum(cv2.boxFilter(image * image, -1, window) - mean * mean, 0)
    return ((image - mean) / np.sqrt(variance + NOISE_DEVIATION**2)).astype(np.float32)


@numba.njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def _compared(
    q: FloatArray,  # [H, W]
    own: FloatArray,  # [H, W]
    others: FloatArray,  # [S, H, W]
    infinity_from_pixel: FloatArray,  # [S, 3, 3]
    epipoles: FloatArray,  # [S, 3]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The normal equation of every pixel: slope x difference and slope^2, summed over the frames that see it [H, W].

    Third the parallax [H, W] in pixels per unit of inverse depth in the frame where it is largest; 0 where none sees.
    """
    pull, grip, speed = np.zeros(q.shape, np.float32), np.zeros(q.shape, np.float32), np.zeros(q.shape, np.float32)
    width = q.shape[1]
    for row in numba.prange(len(q)):
        aim, read = np.empty((6, width), np.float32), np.empty((2, width), np.float32)
        for s in range(len(others)):
            start = infinity_from_pixel[s, :, 1] * np.float32(row) + infinity_from_pixel[s, :, 2]
            _aim(q[row], others[s].shape, infinity_from_pixel[s, :, 0], start, epipoles[s], aim)
            for end in range(2):
                _read(others[s].reshape(-1), width, aim[2 * end], aim[2 * end + 1], read[end])
            _add(own[row], read, aim[4], aim[5], pull[row], grip[row])
            for x in range(width):
                speed[row, x] = max(speed[row, x], aim[5, x] * aim[4, x])
    return pull, grip, speed


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _aim(
    q: FloatArray,  # [W]
    shape: tuple[int, int],
    slope: FloatArray,  # [3]
    start: FloatArray,  # [3]
    epipole: FloatArray,  # [3]
    aim: FloatArray,  # [6, W], written: u and v half a pixel behind, u and v half a pixel ahead, parallax, 1 where seen
) -> None:
    """Places along the epipolar lines; what the frame does not see is moved to its border."""
    last_u, last_v = np.float32(shape[1] - 1) - _EDGE_PX, np.float32(shape[0] - 1) - _EDGE_PX
    for x in range(len(q)):
        c = np.float32(x)
        scale = _ONE / max(slope[2] * c + start[2] + q[x] * epipole[2], _IN_FRONT)
        u = (slope[0] * c + start[0] + q[x] * epipole[0]) * scale
        v = (slope[1] * c + start[1] + q[x] * epipole[1]) * scale
        u_in, v_in = min(max(u, _EDGE_PX), last_u), min(max(v, _EDGE_PX), last_v)
        along_u, along_v = (epipole[0] - u_in * epipole[2]) * scale, (epipole[1] - v_in * epipole[2]) * scale
        parallax = np.sqrt(along_u * along_u + along_v * along_v)
        half = _HALF / max(parallax, _TINY)
        aim[0, x], aim[1, x] = u_in - half * along_u, v_in - half * along_v
        aim[2, x], aim[3, x] = u_in + half * along_u, v_in + half * along_v
        aim[4, x] = parallax
        aim[5, x] = _ONE if abs(u - u_in) + abs(v - v_in) <= 0 else _ZERO


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _read(flat: FloatArray, width: int, u: FloatArray, v: FloatArray, read: FloatArray) -> None:
    for x in range(len(u)):
        column, row = np.int32(u[x]), np.int32(v[x])
        part_u, part_v = u[x] - np.float32(column), v[x] - np.float32(row)
        above = np.uint64(row * np.int32(width) + column)  # unsigned, so that no negative index is looked for
        below = above + np.uint64(width)
        upper = flat[above] + part_u * (flat[above + np.uint64(1)] - flat[above])
        lower = flat[below] + part_u * (flat[below + np.uint64(1)] - flat[below])
        read[x] = upper + part_v * (lower - upper)


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _add(
    own: FloatArray,  # [W]
    read: FloatArray,  # [2, W]
    parallax: FloatArray,  # [W]
    seen: FloatArray,  # [W]
    pull: FloatArray,  # [W], added to
    grip: FloatArray,  # [W], added to
) -> None:
    for x in range(len(own)):
        difference, slope = own[x] - _HALF * (read[0, x] + read[1, x]), (read[1, x] - read[0, x]) * parallax[x]
        misfit = difference * np.float32(1 / MISFIT)
        say = seen[x] / (_ONE + misfit * misfit)
        pull[x] += say * slope * difference
        grip[x] += say * slope * slope

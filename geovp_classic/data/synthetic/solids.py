"""Painted boxes and ellipsoids, and rays that meet them.

Each solid fills its unit box: local coordinates are 0 to 1 from left to right, from top to foot and
from rear to front. A taper narrows a box towards its top.
"""

from typing import NamedTuple

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray


class Solids(NamedTuple):
    """Solids with the textures of the surfaces across x, y and z."""

    world_from_local: FloatArray  # [K, 4, 4], affine
    taper: FloatArray  # [K, 6], left, right, 0, 0, rear, front; by how much the top is narrower
    is_round: BoolArray  # [K]
    textures: IntArray  # [K, 3]
    tints: FloatArray  # [K, 3, 3], (surfaces) x (red, green, blue)

    def moved(self, world_from_object: FloatArray) -> "Solids":
        """Return the solids moved by a transform [4, 4]."""
        moved = world_from_object @ self.world_from_local
        return self._replace(world_from_local=moved)


def joined(parts: list[Solids]) -> Solids:
    """Return all solids in the given order."""
    return Solids(*map(np.concatenate, zip(*parts, strict=True)))


class RayCaster:
    """Solids in a hierarchy of bounding boxes (Kay & Kajiya 1986).

    The hierarchy is a complete binary tree without pointers: node i has the children 2 i + 1 and
    2 i + 2, and each leaf holds one solid.
    """

    def __init__(self, solids: Solids) -> None:
        """Sort the solids into leaves; nodes are halved along their longest side."""
        self.solids = solids
        self.local_from_world = np.linalg.inv(solids.world_from_local)[:, :3]
        unit = np.indices((2, 2, 2)).reshape(3, 8)
        corners = solids.world_from_local[:, :3, :3] @ unit
        corners += solids.world_from_local[:, :3, 3:]
        bounds = np.stack([corners.min(axis=2), corners.max(axis=2)], axis=1)

        num_leaves = 1 << (len(bounds) - 1).bit_length()
        order = np.arange(num_leaves)[None] * len(bounds) // num_leaves
        while len(order) < num_leaves:
            middle = bounds.sum(axis=1)[order]  # [nodes, solids, 3]
            axis = np.ptp(middle, axis=1).argmax(axis=-1)
            along = np.take_along_axis(middle, axis[:, None, None], axis=2)
            halves = np.argpartition(along[..., 0], order.shape[1] // 2)
            order = np.take_along_axis(order, halves, axis=1)
            order = order.reshape(2 * len(order), -1)
        self.order = order.ravel()
        levels = [bounds[self.order]]
        while len(levels[0]) > 1:
            low, high = levels[0].reshape(-1, 2, 2, 3).transpose(2, 1, 0, 3)
            pair = [np.minimum(*low), np.maximum(*high)]
            levels.insert(0, np.stack(pair, axis=1))
        self.boxes = np.concatenate(levels)  # [2 * leaves - 1, 2, 3]

    def cast(
        self,
        origins: FloatArray,  # [N, 3] or [3]
        directions: FloatArray,  # [N, 3] or [3]
    ) -> tuple[FloatArray, IntArray, IntArray]:
        """Return the nearest hits of rays.

        These are lengths [N] in ray directions (inf: nothing), solids [N] (-1: none) and faces [N]
        (left, right, top, foot, rear, front; 0 of ellipsoids).
        """
        rays = np.broadcast_arrays(origins, directions)
        solids = self.solids
        frames = self.local_from_world
        return _cast(
            self.boxes,
            self.order,
            frames,
            solids.taper,
            solids.is_round,
            *map(np.ascontiguousarray, rays),
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cast(boxes, order, frames, taper, is_round, origins, directions):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Search depth first; skip boxes behind the nearest hit."""
    stack = np.empty(64, np.int64)  # one node per level of the tree
    lengths = np.full(len(origins), np.inf)
    solids = np.full(len(origins), -1)
    faces = np.zeros(len(origins), np.int64)
    start = np.empty(3)
    step = np.empty(3)
    inverses = 1 / directions
    for ray in range(len(origins)):
        stack[0] = 0
        count = 1
        while count > 0:
            count -= 1
            node = stack[count]
            to_box = _to_bounds(boxes[node], origins[ray], inverses[ray])
            leaf = node + 1 - len(order)
            if to_box >= lengths[ray]:
                continue
            if leaf < 0:
                stack[count] = 2 * node + 1
                stack[count + 1] = 2 * node + 2
                count += 2
                continue
            solid = order[leaf]
            for axis in range(3):
                row = frames[solid, axis]
                start[axis] = _dot(row, origins[ray]) + row[3]
                step[axis] = _dot(row, directions[ray])
            if is_round[solid]:
                length, face = _to_ball(start, step)
            else:
                length, face = _to_box(taper[solid], start, step)
            if length < lengths[ray]:
                lengths[ray] = length
                solids[ray] = solid
                faces[ray] = face
    return lengths, solids, faces


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_bounds(box, origin, inverse):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a ray enters a bounding box, inf if it misses it."""
    entry = 0.0
    exit_ = np.inf
    for axis in range(3):
        a = (box[0, axis] - origin[axis]) * inverse[axis]
        b = (box[1, axis] - origin[axis]) * inverse[axis]
        entry = max(entry, min(a, b))
        exit_ = min(exit_, max(a, b))
    return entry if entry <= exit_ else np.inf


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_ball(start, step):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a local ray enters the ball in the unit box, inf if never or if inside."""
    start -= 0.5
    a = _dot(step, step)
    b = _dot(step, start)
    c = _dot(start, start) - 0.25
    root = b * b - a * c
    if root < 0 or b > 0 or c < 0:
        return np.inf, 0
    return (-b - np.sqrt(root)) / a, 0


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_box(taper, start, step):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a local ray enters a tapered box, and through which face; inf if never."""
    entry = 0.0
    exit_ = np.inf
    entered = -1
    for face in range(6):
        axis = face // 2
        sign = 2 * (face % 2) - 1
        height = sign * start[axis] - face % 2 + taper[face] * (1 - start[1])
        slope = sign * step[axis] - taper[face] * step[1]
        length = -height / slope
        if slope < 0 and length > entry:
            entry = length
            entered = face
        elif slope > 0:
            exit_ = min(exit_, length)
        elif slope == 0 and height > 0:
            exit_ = -1.0
    return (entry if entered >= 0 and entry < exit_ else np.inf), entered


@numba.njit(cache=True, inline="always", error_model="numpy")
def _dot(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

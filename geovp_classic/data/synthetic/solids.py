"""Painted boxes and ellipsoids, and rays that meet them.

Each solid fills its unit box: local coordinates are 0 to 1 from left to right, from top to foot and
from rear to front. A taper narrows a box towards its top.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray

kernel = numba.njit(cache=True, nogil=True, error_model="numpy")


class Solids(NamedTuple):
    """Solids with the textures of the surfaces across x, y and z."""

    world_from_local: FloatArray  # [K, 4, 4], affine
    taper: FloatArray  # [K, 4], at left, right, rear and front of the top
    is_round: BoolArray  # [K], ellipsoids
    textures: IntArray  # [K, 3]
    tints: FloatArray  # [K, 3, 3], (surfaces) x (red, green, blue)

    def moved(self, world_from_object: FloatArray) -> "Solids":
        """Return the solids moved by a transform [4, 4]."""
        moved = world_from_object @ self.world_from_local
        return self._replace(world_from_local=moved)


def joined(solids: Sequence[Solids]) -> Solids:
    """Return all solids in the given order."""
    return Solids(*map(np.concatenate, zip(*solids, strict=True)))


class RayCaster:
    """Solids in a hierarchy of bounding boxes (Kay & Kajiya 1986).

    The hierarchy is a complete binary tree over the solids, sorted by squares of 20 m. Node i has
    the children 2 i and 2 i + 1, and each leaf holds one solid.
    """

    def __init__(self, solids: Solids) -> None:
        self.solids = solids
        # local and outward; left, right, top, foot, rear, front
        self.planes = np.zeros((len(solids.taper), 6, 4))
        self.planes[:, range(6), [0, 0, 1, 1, 2, 2]] = [-1.0, 1.0] * 3
        self.planes[:, 1::2, 3] = -1.0
        sides = [0, 1, 4, 5]
        self.planes[:, sides, 1] = -solids.taper
        self.planes[:, sides, 3] += solids.taper
        self.local_from_world = np.linalg.inv(solids.world_from_local)[:, :3]
        axes = solids.world_from_local[:, :3, :3]
        corners = axes @ np.indices((2, 2, 2)).reshape(3, 8)
        corners += solids.world_from_local[:, :3, 3:]
        bounds = np.stack([corners.min(axis=2), -corners.max(axis=2)], axis=1)
        order = np.lexsort(solids.world_from_local[:, [0, 2], 3].T // 20)
        num_leaves = 1 << (len(order) - 1).bit_length()
        self.leaves = order[np.arange(num_leaves) * len(order) // num_leaves]
        levels = [bounds[self.leaves]]
        while len(levels[0]) > 1:
            levels.insert(0, np.minimum(levels[0][::2], levels[0][1::2]))
        self.bounds = np.concatenate([levels[0], *levels])  # [nodes, 2, 3]

    def cast(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, IntArray, IntArray]:
        """Return the nearest hits of rays; origins and directions are [N, 3] or [3].

        These are lengths [N] in ray directions (inf: nothing), solids [N] (-1: none) and faces [N]
        (0 of ellipsoids).
        """
        rays = np.broadcast_arrays(origins, directions)
        rays = tuple(map(np.ascontiguousarray, rays))
        tree = (self.bounds, self.leaves, self.local_from_world)
        return _cast(*tree, self.planes, self.solids.is_round, *rays)


@kernel
def _cast(bounds, leaves, frames, planes, is_round, origins, directions):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Search depth first; skip boxes behind the nearest hit."""
    lengths = np.full(len(origins), np.inf)
    solids = np.full(len(origins), -1)
    faces = np.zeros(len(origins), np.int64)
    start = np.empty(3)
    step = np.empty(3)
    inverses = 1 / directions
    for ray in range(len(origins)):
        node = 1
        while node > 0:
            to_bounds = _to_bounds(bounds[node], origins[ray], inverses[ray])
            is_near = to_bounds < lengths[ray]
            if is_near and node < len(leaves):
                node *= 2
                continue
            if is_near:
                solid = leaves[node - len(leaves)]
                for axis in range(3):
                    row = frames[solid, axis]
                    start[axis] = _dot(row, origins[ray]) + row[3]
                    step[axis] = _dot(row, directions[ray])
                if is_round[solid]:
                    hit = _to_ball(start, step), solid, 0
                else:
                    length, face = _to_box(planes[solid], start, step)
                    hit = length, solid, face
                if hit[0] < lengths[ray]:
                    lengths[ray], solids[ray], faces[ray] = hit
            while node % 2 == 1:  # both children are done
                node //= 2
            node += node > 0
    return lengths, solids, faces


@kernel
def _to_bounds(bounds, origin, inverse):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a ray enters a bounding box (low, -high), inf if it misses it."""
    entry = 0.0
    exit_ = np.inf
    for axis in range(3):
        a = (bounds[0, axis] - origin[axis]) * inverse[axis]
        b = (-bounds[1, axis] - origin[axis]) * inverse[axis]
        entry = max(entry, min(a, b))
        exit_ = min(exit_, max(a, b))
    return entry if entry <= exit_ else np.inf


@kernel
def _to_ball(start, step):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a local ray enters the ball; inf if never or if inside."""
    start -= 0.5
    a = _dot(step, step)
    b = _dot(step, start)
    c = _dot(start, start) - 0.25
    root = b * b - a * c
    if root < 0 or b > 0 or c < 0:
        return np.inf
    return (-b - np.sqrt(root)) / a


@kernel
def _to_box(planes, start, step):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a local ray enters a tapered box, and through which face; inf if never."""
    entry = 0.0
    exit_ = np.inf
    entered = -1
    for face in range(6):
        height = _dot(planes[face], start) + planes[face, 3]
        slope = _dot(planes[face], step)
        length = -height / slope
        if slope < 0 and length > entry:
            entry = length
            entered = face
        elif slope > 0:
            exit_ = min(exit_, length)
        elif slope == 0 and height > 0:
            exit_ = -1.0
    return (entry if entered >= 0 and entry < exit_ else np.inf), entered


@kernel
def _dot(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

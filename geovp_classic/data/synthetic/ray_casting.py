"""Rays against triangles, in a hierarchy of boxes (Kay & Kajiya 1986) that halves them along its
longest side.

The hierarchy is a complete binary tree without pointers: node i has the children 2 i + 1 and 2 i +
2.
"""

from dataclasses import dataclass
from typing import Self

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray

LEAF_TRIANGLES = 4
DEEPEST = 64  # levels of a tree
TINY = np.float32(1e-20)  # stands for a zero component of a direction
BOX_MARGIN = np.float32(1 + 1e-6)  # boxes are met in single precision
EDGE = 1e-9  # so that no ray passes between two triangles that share an edge


@dataclass(frozen=True)
class TriangleTree:
    """Triangles in leaves of `LEAF_TRIANGLES`, and the boxes of all nodes."""

    # [leaves * LEAF_TRIANGLES, 3, 3] float32, leaf by leaf; the last triangle repeats
    corners: FloatArray
    order: IntArray  # [leaves * LEAF_TRIANGLES], which triangle each one was
    boxes: FloatArray  # [2 * leaves - 1, 2, 3], lowest and highest corner; the leaves come last

    @classmethod
    def of(cls, corners: FloatArray) -> Self:  # [N, 3, 3]
        """The tree of one triangle or more."""
        leaves = 1 << (-(-len(corners) // LEAF_TRIANGLES) - 1).bit_length()
        filled = np.minimum(np.arange(leaves * LEAF_TRIANGLES), len(corners) - 1)
        order = filled[_halved(corners.mean(axis=1)[filled], leaves)]
        sorted_corners = np.ascontiguousarray(corners[order], dtype=np.float32)
        grouped = sorted_corners.reshape(leaves, -1, 3)
        levels = [np.stack([grouped.min(axis=1), grouped.max(axis=1)], axis=1)]
        while len(levels[0]) > 1:
            low, high = levels[0][:, 0].reshape(-1, 2, 3), levels[0][:, 1].reshape(-1, 2, 3)
            levels.insert(0, np.stack([low.min(axis=1), high.max(axis=1)], axis=1))
        return cls(sorted_corners, order, np.concatenate(levels))

    def cast(self, origins: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
        """How many directions [N] away the rays [N, 3] first hit something (inf: never), and which
        triangle (-1).
        """
        lengths, triangles = self._search(origins, directions, 0.0)
        return lengths, np.where(triangles < 0, -1, self.order[triangles])

    def blocks(self, origins: FloatArray, directions: FloatArray) -> BoolArray:
        """Whether the rays [N, 3] hit anything [N]; the search ends at the first triangle, not the
        nearest.
        """
        return self._search(origins, directions, np.inf)[1] >= 0

    def _search(
        self, origins: FloatArray, directions: FloatArray, near_enough: float
    ) -> tuple[FloatArray, IntArray]:
        lengths, triangles = np.full(len(origins), np.inf, np.float32), np.full(len(origins), -1)
        inverses = np.float32(1.0) / np.where(directions == 0, TINY, directions)
        _cast(
            self.corners, self.boxes, origins, directions, inverses, near_enough, lengths, triangles
        )
        return lengths, triangles


def _halved(points: FloatArray, leaves: int) -> IntArray:
    """The order of points [N, 3] that puts those of a leaf together; every node's points are halved
    at the median.
    """
    order: IntArray = np.arange(len(points))
    nodes = 1
    while nodes < leaves:
        grouped = points[order].reshape(nodes, -1, 3)
        axis = np.argmax(np.ptp(grouped, axis=1), axis=1)
        along = np.take_along_axis(grouped, axis[:, None, None], axis=2)[..., 0]
        halves = np.argpartition(along, along.shape[1] // 2, axis=1)
        order = np.take_along_axis(order.reshape(nodes, -1), halves, axis=1).ravel()
        nodes *= 2
    return order


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cast(corners, boxes, origins, directions, inverses, near_enough, lengths, triangles):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Depth first, the nearer child first; boxes behind what was hit are left out.

    A hit nearer than `near_enough` ends the search of its ray.
    """
    num_inner = len(boxes) // 2
    waiting, entries = np.empty(DEEPEST, np.int64), np.empty(DEEPEST, np.float32)
    for ray in range(len(origins)):
        eye, way, inverse = origins[ray], directions[ray], inverses[ray]
        waiting[0], entries[0], count = 0, 0.0, 1
        nearest = np.inf
        while count and nearest >= near_enough:
            count -= 1
            node = waiting[count]
            if entries[count] >= nearest:
                continue
            if node >= num_inner:
                first = (node - num_inner) * LEAF_TRIANGLES
                for i in range(first, first + LEAF_TRIANGLES):
                    length = _to_triangle(corners, i, eye, way)
                    if length < nearest:
                        nearest, triangles[ray] = length, i
                continue
            left, right = (
                _to_box(boxes, 2 * node + 1, eye, inverse),
                _to_box(boxes, 2 * node + 2, eye, inverse),
            )
            for child in range(2):
                is_left = (left > right) == (child == 0)
                entry = left if is_left else right
                if entry < nearest:
                    waiting[count], entries[count] = 2 * node + (1 if is_left else 2), entry
                    count += 1
        lengths[ray] = nearest


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_box(boxes, node, eye, inverse):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Where a ray of inverse direction enters a box, inf when it misses it (slabs, Kay & Kajiya
    1986).
    """
    enters, leaves = np.float32(0.0), np.float32(np.inf)
    for axis in range(3):
        a = (boxes[node, 0, axis] - eye[axis]) * inverse[axis]
        b = (boxes[node, 1, axis] - eye[axis]) * inverse[axis]
        near, far = (a, b) if a < b else (b, a)
        enters, leaves = near if near > enters else enters, far if far < leaves else leaves
    return enters if enters <= leaves * BOX_MARGIN else np.float32(np.inf)


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_triangle(corners, i, eye, way):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Where a ray meets a triangle from either side, inf when it misses it (Moeller & Trumbore
    1997).
    """
    ax, ay, az = (
        np.float64(corners[i, 0, 0]),
        np.float64(corners[i, 0, 1]),
        np.float64(corners[i, 0, 2]),
    )
    bx, by, bz = corners[i, 1, 0] - ax, corners[i, 1, 1] - ay, corners[i, 1, 2] - az
    cx, cy, cz = corners[i, 2, 0] - ax, corners[i, 2, 1] - ay, corners[i, 2, 2] - az
    px, py, pz = way[1] * cz - way[2] * cy, way[2] * cx - way[0] * cz, way[0] * cy - way[1] * cx
    volume = bx * px + by * py + bz * pz
    if volume == 0.0:
        return np.inf
    sx, sy, sz = eye[0] - ax, eye[1] - ay, eye[2] - az
    u = (sx * px + sy * py + sz * pz) / volume
    qx, qy, qz = sy * bz - sz * by, sz * bx - sx * bz, sx * by - sy * bx
    v = (way[0] * qx + way[1] * qy + way[2] * qz) / volume
    length = (cx * qx + cy * qy + cz * qz) / volume
    return length if u >= -EDGE and v >= -EDGE and u + v <= 1 + EDGE and length > 0 else np.inf

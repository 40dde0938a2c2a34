"""Rays against triangles, in a hierarchy of bounding boxes (Kay & Kajiya 1986).

The hierarchy is a complete binary tree without pointers: node i has the children 2 i + 1 and
2 i + 2. Each leaf holds `TRIANGLES_PER_LEAF` triangles.
"""

from typing import NamedTuple

import numba
import numpy as np

from geovp_classic.data.synthetic.mesh import TriangleMesh
from geovp_classic.types import BoolArray, FloatArray, IntArray

TRIANGLES_PER_LEAF = 4


class Hits(NamedTuple):
    """Surface points that rays hit, and the footprint of a pixel there.

    A footprint is a parallelogram in the plane of the triangle: the steps to the points that the
    next pixels to the right and below see.
    """

    points: FloatArray  # [N, 3]
    normal: FloatArray  # [N, 3], towards the eye
    uv: FloatArray  # [N, 2], in tiles
    uv_steps: FloatArray  # [N, 2, 2], (right, down) x (u, v)
    sizes_m: FloatArray  # [N, 2], lengths of the steps
    ambient: FloatArray  # [N], fraction of the ambient light that arrives
    texture: IntArray  # [N]
    tint: FloatArray  # [N, 3]


class RayCaster:
    """A mesh with the bounding boxes and the barycentric coordinates that rays need."""

    def __init__(self, mesh: TriangleMesh) -> None:
        """Sort the triangles of a mesh into leaves."""
        num_leaves = 1
        while num_leaves * TRIANGLES_PER_LEAF < len(mesh.corners):
            num_leaves *= 2
        order = _leaf_order(mesh.corners.mean(axis=1), num_leaves)
        self.mesh = mesh.selected(order)
        self.boxes = _bounding_boxes(self.mesh.corners, num_leaves)
        self.bary_from_world = _bary_from_world(self.mesh.corners)
        # u, v and ambient light as affine functions of the place
        values = np.concatenate(
            [self.mesh.uv, self.mesh.ambient[..., None]], axis=-1
        )
        edges = values[:, 1:] - values[:, :1]
        self.values_from_world = (
            edges.swapaxes(1, 2) @ self.bary_from_world[:, :2]
        )  # [N, 3, 4]
        self.values_from_world[..., 3] += values[:, 0]

    def cast(
        self,
        origins: FloatArray,  # [N, 3] or [3]
        directions: FloatArray,  # [N, 3] or [3]
        stops_early: bool = False,
    ) -> tuple[FloatArray, IntArray]:
        """Return how many directions away rays first hit (inf: never), and the triangles (-1).

        With `stops_early`, the first triangle found ends the search; it need not be the nearest.
        """
        origins, directions = np.broadcast_arrays(origins, directions)
        return _cast(
            self.boxes,
            self.bary_from_world,
            np.ascontiguousarray(origins),
            np.ascontiguousarray(directions),
            stops_early,
        )

    def is_blocked(self, points: FloatArray, to_light: FloatArray) -> BoolArray:
        """Return whether a triangle lies between points [N, 3] and a distant light [3]."""
        _, triangles = self.cast(points, to_light, stops_early=True)
        return triangles >= 0

    def hits(
        self,
        eye: FloatArray,  # [3]
        rays: FloatArray,  # [N, 3]
        lengths: FloatArray,  # [N]
        triangles: IntArray,  # [N]
        pixel_steps: FloatArray,  # [2, 3], to the rays of the next pixels to the right and below
    ) -> Hits:
        """Return the surface points of rays from the eye whose lengths `cast` measured."""
        normal = self.bary_from_world[triangles, 2, :3]
        facing = np.einsum("nj,nj->n", normal, rays)[:, None]
        points = eye + lengths[:, None] * rays
        along = normal @ pixel_steps.T / facing  # [N, 2]
        steps = lengths[:, None, None] * (
            pixel_steps - along[..., None] * rays[:, None]
        )
        values_from_world = self.values_from_world[triangles]
        values = np.einsum("nkj,nj->nk", values_from_world[..., :3], points)
        values += values_from_world[..., 3]
        return Hits(
            points,
            normal=np.where(facing > 0, -normal, normal),
            uv=values[:, :2],
            uv_steps=np.einsum(
                "nkj,nsj->nsk", values_from_world[:, :2, :3], steps
            ),
            sizes_m=np.linalg.norm(steps, axis=-1),
            ambient=values[:, 2],
            texture=self.mesh.texture[triangles],
            tint=self.mesh.tint[triangles],
        )


def _leaf_order(points: FloatArray, num_leaves: int) -> IntArray:
    """Return the order of points [N, 3] that puts those of a leaf together.

    Each node's points are halved at the median along the longest side of their bounding box. The
    last point repeats until all leaves are full.
    """
    slots = np.arange(num_leaves * TRIANGLES_PER_LEAF)
    order = np.minimum(slots, len(points) - 1)
    num_nodes = 1
    while num_nodes < num_leaves:
        grouped = points[order].reshape(num_nodes, -1, 3)
        axis = np.ptp(grouped, axis=1).argmax(axis=-1)
        along = np.take_along_axis(grouped, axis[:, None, None], axis=2)[..., 0]
        halves = np.argpartition(along, along.shape[1] // 2, axis=1)
        order = np.take_along_axis(order.reshape(num_nodes, -1), halves, axis=1)
        num_nodes *= 2
    return order.ravel()


def _bounding_boxes(corners: FloatArray, num_leaves: int) -> FloatArray:
    """Return the lowest and highest corner of all nodes [2 * leaves - 1, 2, 3], the root first."""
    leaves = corners.reshape(num_leaves, -1, 3)
    level = np.stack([leaves.min(axis=1), leaves.max(axis=1)], axis=1)
    levels = [level]
    while len(level) > 1:
        children = level.reshape(-1, 2, 2, 3)  # (left, right) x (low, high)
        low = children[:, :, 0].min(axis=1)
        high = children[:, :, 1].max(axis=1)
        level = np.stack([low, high], axis=1)
        levels.append(level)
    return np.concatenate(levels[::-1])


def _bary_from_world(corners: FloatArray) -> FloatArray:
    """Return [N, 3, 4]: barycentric coordinates of b and c, and the height above the plane abc.

    A triangle without area has coordinates NaN, so that no ray hits it.
    """
    origin = corners[:, 0]
    b = corners[:, 1] - origin
    c = corners[:, 2] - origin
    normal = np.cross(b, c)
    square = (normal**2).sum(axis=-1, keepdims=True)
    rows = [np.cross(c, normal), np.cross(normal, b), normal * np.sqrt(square)]
    with np.errstate(invalid="ignore"):
        rotation = np.stack(rows, axis=1) / square[:, None]
    offset = -rotation @ origin[..., None]
    return np.concatenate([rotation, offset], axis=-1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cast(boxes, bary_from_world, origins, directions, stops_early):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Search depth first, the nearer child first; skip boxes behind the nearest hit."""
    num_inner = len(boxes) // 2
    stack = np.empty(64, np.int64)  # one node per level of the tree
    lengths = np.full(len(origins), np.inf)
    triangles = np.full(len(origins), -1)
    inverses = 1 / directions
    for ray in range(len(origins)):
        origin = origins[ray]
        direction = directions[ray]
        inverse = inverses[ray]
        nearest = np.inf
        stack[0] = 0
        count = 1
        while count > 0:
            count -= 1
            node = stack[count]
            if node >= num_inner:
                first = (node - num_inner) * TRIANGLES_PER_LEAF
                for triangle in range(first, first + TRIANGLES_PER_LEAF):
                    length = _to_triangle(
                        bary_from_world[triangle], origin, direction
                    )
                    if length < nearest:
                        nearest = length
                        triangles[ray] = triangle
                if stops_early and nearest < np.inf:
                    break
                continue
            near = 2 * node + 1
            far = near + 1
            to_near = _to_box(boxes[near], origin, inverse)
            to_far = _to_box(boxes[far], origin, inverse)
            if to_far < to_near:
                near, far = far, near
                to_near, to_far = to_far, to_near
            if to_far < nearest:
                stack[count] = far
                count += 1
            if to_near < nearest:
                stack[count] = near
                count += 1
        lengths[ray] = nearest
    return lengths, triangles


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_box(box, origin, inverse):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a ray enters a box, inf if it misses it (slabs, Kay & Kajiya 1986)."""
    entry = 0.0
    exit_ = np.inf
    for axis in range(3):
        a = (box[0, axis] - origin[axis]) * inverse[axis]
        b = (box[1, axis] - origin[axis]) * inverse[axis]
        entry = max(entry, min(a, b))
        exit_ = min(exit_, max(a, b))
    return entry if entry <= exit_ else np.inf


@numba.njit(cache=True, inline="always", error_model="numpy")
def _to_triangle(matrix, origin, direction):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return where a ray meets a triangle from either side, inf if it misses it.

    The margin of 1e-9 closes the gaps between triangles that share an edge.
    """
    height = _dot(matrix[2], origin) + matrix[2, 3]
    length = -height / _dot(matrix[2], direction)
    u = (
        _dot(matrix[0], origin)
        + matrix[0, 3]
        + length * _dot(matrix[0], direction)
    )
    v = (
        _dot(matrix[1], origin)
        + matrix[1, 3]
        + length * _dot(matrix[1], direction)
    )
    is_inside = u >= -1e-9 and v >= -1e-9 and u + v <= 1 + 1e-9
    return length if is_inside and length > 0 else np.inf


@numba.njit(cache=True, inline="always", error_model="numpy")
def _dot(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

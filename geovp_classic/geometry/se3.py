"""Rigid motions as 4x4 matrices: exponential, logarithm, inverse, interpolation; every function takes leading axes.

A twist is [..., 6] = (v, w): translational part first, rotation vector in radians last; `exp` is the matrix exponential
of [[w]x v; 0 0] (Barfoot 2017, State Estimation for Robotics, section 7.1).
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray

ORTHONORMAL = 1e-12  # entries of R R' - I up to which a matrix is a rotation but for rounding
SMALL_ANGLE_RAD = 1e-3  # below it, Taylor series to fourth order are exact in float64


def inverse(b_from_a: FloatArray) -> FloatArray:
    """a_from_b: [..., 4, 4] -> [..., 4, 4], without solving: (R', -R't)."""
    return _inverses(_flat(b_from_a, 4, 4)).reshape(b_from_a.shape)


def compose(
    rotation: FloatArray,  # [..., 3, 3]
    translation: FloatArray,  # [..., 3]
) -> FloatArray:
    """The 4x4 matrices of rotations and translations; leading axes broadcast."""
    rotation, translation = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    lead = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    b_from_a = np.zeros((*lead, 4, 4))
    b_from_a[..., :3, :3], b_from_a[..., :3, 3], b_from_a[..., 3, 3] = rotation, translation, 1.0
    return b_from_a


def transform(
    b_from_a: FloatArray,  # [..., 4, 4]
    points_a: FloatArray,  # [..., N, 3]
) -> FloatArray:
    """points_b [..., N, 3]."""
    return points_a @ np.swapaxes(b_from_a[..., :3, :3], -1, -2) + b_from_a[..., None, :3, 3]


def exp(twist: FloatArray) -> FloatArray:
    """Twists [..., 6] to rigid motions [..., 4, 4]."""
    twist = np.asarray(twist, dtype=np.float64)
    return _exponentials(_flat(twist, 6)).reshape(*twist.shape[:-1], 4, 4)


def log(b_from_a: FloatArray) -> FloatArray:
    """Rigid motions [..., 4, 4] to twists [..., 6]; rotation angles in [0, pi]."""
    b_from_a = np.asarray(b_from_a, dtype=np.float64)
    rotation_vector = _rotation_vector(b_from_a[..., :3, :3])
    translational = np.linalg.solve(_left_jacobian(rotation_vector), b_from_a[..., :3, 3:])[..., 0]
    return np.concatenate([translational, rotation_vector], axis=-1)


def interpolate(
    world_from_a: FloatArray,  # [..., 4, 4]
    world_from_b: FloatArray,  # [..., 4, 4]
    fraction: FloatArray | float,  # [...]; 0 gives a, 1 gives b, outside extrapolates the same screw motion
) -> FloatArray:
    """Constant-twist motion from a to b."""
    twist = log(inverse(world_from_a) @ world_from_b)
    return world_from_a @ exp(np.asarray(fraction)[..., None] * twist)


def turn(
    c_from_a: FloatArray,  # [..., 4, 4]
    c_from_b: FloatArray,  # [..., 4, 4]
) -> FloatArray:
    """The rotation vectors [..., 3], in c, that turn the first rotations into the second ones."""
    return _rotation_vector(c_from_b[..., :3, :3] @ np.swapaxes(c_from_a[..., :3, :3], -1, -2))


def turned(
    c_from_a: FloatArray,  # [..., 4, 4]
    rotation_vector: FloatArray,  # [..., 3], in c
) -> FloatArray:
    """The same positions with their rotations turned."""
    return compose(_rotation_matrix(rotation_vector) @ c_from_a[..., :3, :3], c_from_a[..., :3, 3])


def rotation_angle_rad(b_from_a: FloatArray) -> FloatArray:
    """The angle of the rotation part [...], right near 0 and near pi."""
    angle_rad: FloatArray = np.linalg.norm(_rotation_vector(b_from_a[..., :3, :3]), axis=-1)
    return angle_rad


def orthonormalised(b_from_a: FloatArray, tolerance: float = 1e-4) -> FloatArray:
    """The nearest rigid motion (polar decomposition), for numbers read from text; BadData when not near one.

    `tolerance` bounds the largest entry of R R' - I.
    """
    rotation = b_from_a[..., :3, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max()
    if not defect < tolerance or not (np.linalg.det(rotation) > 0).all():
        raise BadData(f"a rotation matrix is off by {defect:.2g}, expected orthonormal rows within {tolerance}")
    u, _, vt = np.linalg.svd(rotation)
    return compose(u @ vt, b_from_a[..., :3, 3])


def _rotation_matrix(rotation_vector: FloatArray) -> FloatArray:
    return _rotation_matrices(_flat(rotation_vector, 3)).reshape(*rotation_vector.shape[:-1], 3, 3)


def _rotation_vector(rotation: FloatArray) -> FloatArray:
    vectors, certain = _rotation_vectors(_flat(rotation, 3, 3))
    if not certain:
        vectors = np.asarray(Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec())
    return vectors.reshape(*rotation.shape[:-2], 3)


def _left_jacobian(rotation_vector: FloatArray) -> FloatArray:
    return _left_jacobians(_flat(rotation_vector, 3)).reshape(*rotation_vector.shape[:-1], 3, 3)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """[v]x with [v]x u = v x u: [..., 3] -> [..., 3, 3]."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)


def _flat(array: FloatArray, *shape: int) -> FloatArray:
    """All leading axes as one [N, ...]."""
    return np.ascontiguousarray(array, dtype=np.float64).reshape(-1, *shape)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _inverses(b_from_a: FloatArray) -> FloatArray:
    """See `inverse`; [N, 4, 4]."""
    a_from_b = np.zeros_like(b_from_a)
    for n in range(len(b_from_a)):
        a_from_b[n, 3, 3] = 1.0
        for i in range(3):
            for j in range(3):
                a_from_b[n, i, j] = b_from_a[n, j, i]
                a_from_b[n, i, 3] -= b_from_a[n, j, i] * b_from_a[n, j, 3]
    return a_from_b


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _exponentials(twists: FloatArray) -> FloatArray:
    """See `exp`; [N, 6] to [N, 4, 4]."""
    rotations, jacobians = _rotation_matrices(twists[:, 3:]), _left_jacobians(twists[:, 3:])
    motions = np.zeros((len(twists), 4, 4))
    for n in range(len(twists)):
        motions[n, 3, 3] = 1.0
        for i in range(3):
            for j in range(3):
                motions[n, i, j] = rotations[n, i, j]
                motions[n, i, 3] += jacobians[n, i, j] * twists[n, j]
    return motions


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _rotation_matrices(vectors: FloatArray) -> FloatArray:
    """Rotation vectors [N, 3] to matrices [N, 3, 3], by way of unit quaternions (x, y, z, w)."""
    rotations = np.empty((len(vectors), 3, 3))
    for n in range(len(vectors)):
        angle_rad = np.sqrt(vectors[n, 0] ** 2 + vectors[n, 1] ** 2 + vectors[n, 2] ** 2)
        square = angle_rad * angle_rad
        small = angle_rad <= SMALL_ANGLE_RAD
        scale = 0.5 - square / 48 + square * square / 3840 if small else np.sin(angle_rad / 2) / angle_rad
        x, y, z, w = scale * vectors[n, 0], scale * vectors[n, 1], scale * vectors[n, 2], np.cos(angle_rad / 2)
        rotation = rotations[n]
        rotation[0, 0], rotation[1, 1] = x * x - y * y - z * z + w * w, -x * x + y * y - z * z + w * w
        rotation[2, 2] = -x * x - y * y + z * z + w * w
        rotation[0, 1], rotation[1, 0] = 2 * (x * y - z * w), 2 * (x * y + z * w)
        rotation[0, 2], rotation[2, 0] = 2 * (x * z + y * w), 2 * (x * z - y * w)
        rotation[1, 2], rotation[2, 1] = 2 * (y * z - x * w), 2 * (y * z + x * w)
    return rotations


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _rotation_vectors(rotations: FloatArray) -> tuple[FloatArray, bool]:
    """Vectors [N, 3] of matrices [N, 3, 3]; False unless all are orthonormal, to rounding, and turn by 0 to 120 deg."""
    vectors = np.empty((len(rotations), 3))
    for n in range(len(rotations)):
        r = rotations[n]
        trace = r[0, 0] + r[1, 1] + r[2, 2]
        for i in range(3):
            for j in range(3):
                product = r[i, 0] * r[j, 0] + r[i, 1] * r[j, 1] + r[i, 2] * r[j, 2]
                if not abs(product - (i == j)) < ORTHONORMAL:
                    return vectors, False
        if not (trace > 0 and np.linalg.det(r) > 0):
            return vectors, False
        x, y, z, w = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + trace  # quaternion, any length
        size = np.sqrt(x * x + y * y + z * z + w * w)
        sine, cosine = np.sqrt(x * x + y * y + z * z) / size, w / size
        angle_rad = 2 * np.arctan2(sine, cosine)
        square = angle_rad * angle_rad
        small = angle_rad <= SMALL_ANGLE_RAD
        scale = 2 + square / 12 + 7 * square * square / 2880 if small else angle_rad / np.sin(angle_rad / 2)
        vectors[n, 0], vectors[n, 1], vectors[n, 2] = scale * x / size, scale * y / size, scale * z / size
    return vectors, True


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _left_jacobians(vectors: FloatArray) -> FloatArray:
    """V [N, 3, 3] with exp(v, w) = (R, V v): I + (1 - cos a) / a^2 [w]x + (a - sin a) / a^3 [w]x^2."""
    jacobians = np.empty((len(vectors), 3, 3))
    for n in range(len(vectors)):
        x, y, z = vectors[n, 0], vectors[n, 1], vectors[n, 2]
        square = x * x + y * y + z * z
        angle_rad = np.sqrt(square)
        if angle_rad < SMALL_ANGLE_RAD:
            first, second = 0.5 - square / 24, 1 / 6 - square / 120
        else:
            first, second = (1 - np.cos(angle_rad)) / angle_rad**2, (angle_rad - np.sin(angle_rad)) / angle_rad**3
        v = jacobians[n]
        v[0, 0], v[1, 1], v[2, 2] = (
            1 - second * (y * y + z * z),
            1 - second * (x * x + z * z),
            1 - second * (x * x + y * y),
        )
        v[0, 1], v[1, 0] = second * x * y - first * z, second * x * y + first * z
        v[0, 2], v[2, 0] = second * x * z + first * y, second * x * z - first * y
        v[1, 2], v[2, 1] = second * y * z - first * x, second * y * z + first * x
    return jacobians

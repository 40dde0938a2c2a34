"""Rigid motions as 4x4 matrices: exponential, logarithm, inverse, interpolation; every function
takes leading axes.

A twist is [..., 6] = (v, w): translational part first, rotation vector in radians last; `exp` is
the matrix exponential of [[w]x v; 0 0] (Barfoot 2017, State Estimation for Robotics, section 7.1).
"""

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray

SMALL_ANGLE_RAD = 1e-3  # below it, Taylor series to fourth order are exact in float64


def inverse(b_from_a: FloatArray) -> FloatArray:
    """a_from_b: [..., 4, 4] -> [..., 4, 4], without solving: (R', -R't)."""
    rotation = np.swapaxes(b_from_a[..., :3, :3], -1, -2)
    return compose(rotation, -(rotation @ b_from_a[..., :3, 3:])[..., 0])


def compose(
    rotation: FloatArray,  # [..., 3, 3]
    translation: FloatArray,  # [..., 3]
) -> FloatArray:
    """The 4x4 matrices of rotations and translations; leading axes broadcast."""
    rotation, translation = (
        np.asarray(rotation, dtype=np.float64),
        np.asarray(translation, dtype=np.float64),
    )
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
    translational, rotation_vector = twist[..., :3], twist[..., 3:]
    rotation = _rotation_matrix(rotation_vector)
    return compose(rotation, (_left_jacobian(rotation_vector) @ translational[..., None])[..., 0])


def log(b_from_a: FloatArray) -> FloatArray:
    """Rigid motions [..., 4, 4] to twists [..., 6]; rotation angles in [0, pi]."""
    b_from_a = np.asarray(b_from_a, dtype=np.float64)
    rotation_vector = _rotation_vector(b_from_a[..., :3, :3])
    translational = np.linalg.solve(_left_jacobian(rotation_vector), b_from_a[..., :3, 3:])[..., 0]
    return np.concatenate([translational, rotation_vector], axis=-1)


def interpolate(
    world_from_a: FloatArray,  # [..., 4, 4]
    world_from_b: FloatArray,  # [..., 4, 4]
    fraction: FloatArray
    | float,  # [...]; 0 gives a, 1 gives b, outside extrapolates the same screw motion
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
    """The angle of the rotation part R [...], right near 0 and near pi: R - R' has its sine, the
    trace its cosine.
    """
    rotation = b_from_a[..., :3, :3]
    twice_sine = np.linalg.norm(rotation - np.swapaxes(rotation, -1, -2), axis=(-2, -1)) / np.sqrt(
        2
    )
    return np.asarray(np.arctan2(twice_sine, np.trace(rotation, axis1=-2, axis2=-1) - 1))


def orthonormalised(b_from_a: FloatArray, tolerance: float = 1e-4) -> FloatArray:
    """The nearest rigid motion (polar decomposition), for numbers read from text; BadData when not
    near one.

    `tolerance` bounds the largest entry of R R' - I.
    """
    rotation = b_from_a[..., :3, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max()
    if not defect < tolerance or not (np.linalg.det(rotation) > 0).all():
        raise BadData(
            f"a rotation matrix is off by {defect:.2g}, expected orthonormal rows within "
            f"{tolerance}"
        )
    u, _, vt = np.linalg.svd(rotation)
    return compose(u @ vt, b_from_a[..., :3, 3])


def _rotation_matrix(rotation_vector: FloatArray) -> FloatArray:
    flat = Rotation.from_rotvec(
        np.array(rotation_vector).reshape(-1, 3)
    ).as_matrix()  # a copy: SciPy 1.15 wants to write
    return np.asarray(flat).reshape(*rotation_vector.shape[:-1], 3, 3)


def _rotation_vector(rotation: FloatArray) -> FloatArray:
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat).reshape(*rotation.shape[:-2], 3)


def _left_jacobian(rotation_vector: FloatArray) -> FloatArray:
    """V with exp(v, w) = (R, V v): I + (1 - cos a) / a^2 [w]x + (a - sin a) / a^3 [w]x^2."""
    angle_rad = np.linalg.norm(rotation_vector, axis=-1)[..., None, None]
    small = angle_rad < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle_rad)
    square = angle_rad**2
    first = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    cross = cross_matrix(rotation_vector)
    return np.eye(3) + first * cross + second * (cross @ cross)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """[v]x with [v]x u = v x u: [..., 3] -> [..., 3, 3]."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(
        *vector.shape[:-1], 3, 3
    )

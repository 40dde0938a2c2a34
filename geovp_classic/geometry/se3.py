"""Rigid motions as 4x4 matrices: exponential, logarithm, inverse, interpolation; every function takes leading axes.

A twist is [..., 6] = (v, w): translational part first, rotation vector in radians last; `exp` is the matrix exponential
of [[w]x v; 0 0] (Barfoot 2017, State Estimation for Robotics, section 7.1).
"""

from __future__ import annotations

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, FloatArray

SMALL_ANGLE_RAD = 1e-3  # below it, Taylor series to second order are exact in float64


def inverse(b_from_a: FloatArray) -> FloatArray:
    """a_from_b: [..., 4, 4] -> [..., 4, 4], without solving: (R', -R't)."""
    a_from_b, rotation = np.zeros(b_from_a.shape), np.swapaxes(b_from_a[..., :3, :3], -1, -2)
    a_from_b[..., :3, :3], a_from_b[..., 3, 3] = rotation, 1.0
    a_from_b[..., :3, 3:] = -(rotation @ b_from_a[..., :3, 3:])
    return a_from_b


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
    translational, rotation_vector = twist[..., :3], twist[..., 3:]
    angle_rad, safe, small = _angles(rotation_vector)
    cross = cross_matrix(rotation_vector)
    square = cross @ cross
    first = np.where(small, 0.5 - angle_rad**2 / 24, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6 - angle_rad**2 / 120, (safe - np.sin(safe)) / safe**3)
    # Rodrigues' formula, and the left Jacobian I + (1 - cos a) / a^2 [w]x + (a - sin a) / a^3 [w]x^2
    rotation = np.eye(3) + (1 - angle_rad**2 * second) * cross + first * square
    jacobian = np.eye(3) + first * cross + second * square
    return compose(rotation, (jacobian @ translational[..., None])[..., 0])


def log(b_from_a: FloatArray) -> FloatArray:
    """Rigid motions [..., 4, 4] to twists [..., 6]; rotation angles in [0, pi]."""
    b_from_a = np.asarray(b_from_a, dtype=np.float64)
    rotation_vector, shift = _rotation_vector(b_from_a[..., :3, :3]), b_from_a[..., :3, 3:]
    angle_rad, safe, small = _angles(rotation_vector)
    second = np.where(small, 1 / 12 + angle_rad**2 / 720, (1 - safe / 2 / np.tan(safe / 2)) / safe**2)
    cross = cross_matrix(rotation_vector)
    translational = (np.eye(3) - cross / 2 + second * (cross @ cross)) @ shift  # by the inverse left Jacobian
    return np.concatenate([translational[..., 0], rotation_vector], axis=-1)


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
    rotation = exp(np.concatenate([np.zeros_like(rotation_vector), rotation_vector], axis=-1))[..., :3, :3]
    return compose(rotation @ c_from_a[..., :3, :3], c_from_a[..., :3, 3])


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


def _rotation_vector(rotation: FloatArray) -> FloatArray:
    """By way of the unit quaternion: the row of 4 q q' with the largest diagonal entry (Shepperd 1978)."""
    flat = rotation.reshape(-1, 3, 3)
    across = flat.swapaxes(1, 2)
    products, trace = np.empty((len(flat), 4, 4)), flat[:, 0, 0] + flat[:, 1, 1] + flat[:, 2, 2]
    products[:, 1:, 1:] = flat + across + (1 - trace)[:, None, None] * np.eye(3)
    products[:, 0, 0] = 1 + trace
    products[:, 0, 1:] = products[:, 1:, 0] = (flat - across)[:, (2, 0, 1), (1, 2, 0)]
    quaternion = products[np.arange(len(flat)), products.diagonal(axis1=1, axis2=2).argmax(axis=1)]
    cosine, sines = np.abs(quaternion[:, :1]), quaternion[:, 1:] * np.where(quaternion[:, :1] < 0, -1.0, 1.0)
    sine = np.sqrt((sines**2).sum(axis=1, keepdims=True))  # with the shorter way round
    return (sines * 2 * np.arctan2(sine, cosine) / np.where(sine > 0, sine, 1.0)).reshape(rotation.shape[:-1])


def _angles(rotation_vector: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Angles [..., 1, 1], the same with 1 in place of small ones, and which are small."""
    angle_rad = np.linalg.norm(rotation_vector, axis=-1)[..., None, None]
    small = angle_rad < SMALL_ANGLE_RAD
    return angle_rad, np.where(small, 1.0, angle_rad), small


def cross_matrix(vector: FloatArray) -> FloatArray:
    """[v]x with [v]x u = v x u: [..., 3] -> [..., 3, 3]."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)

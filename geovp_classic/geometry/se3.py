"""Rigid motions as 4x4 matrices; all functions take leading axes.

A twist is [..., 6] = (v, w): translational part first, rotation vector in radians last. `exp` is
the matrix exponential of [[w]x v; 0 0] (Barfoot 2017, State Estimation for Robotics, section 7.1).
"""

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray
from geovp_classic.types.arrays import rotation_defect

# [e]x of the three axes e, the generators of rotations, as rows of nine entries
GENERATORS = -np.cross(np.eye(3)[:, None], np.eye(3)).reshape(3, 9)


def inverse(b_from_a: FloatArray) -> FloatArray:
    """Return a_from_b [..., 4, 4] as (R', -R't)."""
    rotation = np.swapaxes(b_from_a[..., :3, :3], -1, -2)
    translation = -(rotation @ b_from_a[..., :3, 3:])[..., 0]
    return compose(rotation, translation)


def compose(
    rotation: FloatArray,  # [..., 3, 3]
    translation: FloatArray,  # [..., 3]
) -> FloatArray:
    """Return the 4x4 matrices of rotations and translations; leading axes broadcast."""
    lead = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    b_from_a = np.zeros((*lead, 4, 4))
    b_from_a[..., :3, :3] = rotation
    b_from_a[..., :3, 3] = translation
    b_from_a[..., 3, 3] = 1.0
    return b_from_a


def transform(
    b_from_a: FloatArray,  # [..., 4, 4]
    points_a: FloatArray,  # [..., N, 3]
) -> FloatArray:
    """Return points_b [..., N, 3]."""
    rotation = b_from_a[..., :3, :3]
    return points_a @ np.swapaxes(rotation, -1, -2) + b_from_a[..., None, :3, 3]


def exp(twist: FloatArray) -> FloatArray:
    """Return the rigid motions [..., 4, 4] of twists [..., 6]."""
    rotation_vector = twist[..., 3:]
    translation = (_left_jacobian(rotation_vector) @ twist[..., :3, None])[..., 0]
    flat = np.array(rotation_vector).reshape(-1, 3)  # SciPy 1.15 writes to it
    rotation = Rotation.from_rotvec(flat).as_matrix()
    return compose(rotation.reshape(*rotation_vector.shape, 3), translation)


def log(b_from_a: FloatArray) -> FloatArray:
    """Return the twists [..., 6] of rigid motions [..., 4, 4]; angles are in [0, pi]."""
    rotation = b_from_a[..., :3, :3]
    vectors = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    rotation_vector = vectors.reshape(*rotation.shape[:-2], 3)
    jacobian = _left_jacobian(rotation_vector)
    translational = np.linalg.solve(jacobian, b_from_a[..., :3, 3:])[..., 0]
    return np.concatenate([translational, rotation_vector], axis=-1)


def steps(world_from_cam: FloatArray) -> FloatArray:
    """Return the motions before_from_now [T - 1, 4, 4] between consecutive poses [T, 4, 4]."""
    return inverse(world_from_cam[:-1]) @ world_from_cam[1:]


def step_lengths(world_from_cam: FloatArray) -> FloatArray:
    """Return the distances [T - 1] between consecutive poses [T, 4, 4]."""
    return np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=1)


def interpolate(
    world_from_cam: FloatArray,  # [T, 4, 4], T >= 2
    times_s: FloatArray,  # [T], increasing
    at_s: FloatArray,  # [N]
) -> FloatArray:
    """Return poses [N, 4, 4] at other times, on the screw motions between given poses.

    The first and the last screw motion extrapolate.
    """
    after = np.clip(np.searchsorted(times_s, at_s), 1, len(times_s) - 1)
    before = after - 1
    fraction = (at_s - times_s[before]) / (times_s[after] - times_s[before])
    step = log(inverse(world_from_cam[before]) @ world_from_cam[after])
    return world_from_cam[before] @ exp(fraction[:, None] * step)


def rotation_angle_rad(b_from_a: FloatArray) -> FloatArray:
    """Return the rotation angles [...] in [0, pi]."""
    rotation = b_from_a[..., :3, :3]
    # R - R' is 2 sin(angle) [axis]x, with the norm sqrt(8) sin(angle); tr R is 1 + 2 cos(angle)
    antisymmetric = rotation - np.swapaxes(rotation, -1, -2)
    sine = np.linalg.norm(antisymmetric, axis=(-2, -1)) / np.sqrt(8)
    cosine = (np.trace(rotation, axis1=-2, axis2=-1) - 1) / 2
    return np.arctan2(sine, cosine)


def orthonormalised(
    b_from_a: FloatArray,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Return the nearest rigid motion (polar decomposition) of rounded matrices [..., 4, 4].

    Raise BadData if an entry of R R' - I exceeds the tolerance, or if R is a reflection.
    """
    rotation = b_from_a[..., :3, :3]
    defect = rotation_defect(rotation).max()
    is_near = defect < tolerance  # False for NaN
    if is_near and not (np.linalg.det(rotation) > 0).all():
        raise BadData(
            "a rotation matrix is a mirror, as of left-handed axes (determinant -1): negate one "
            "axis of world and camera"
        )
    if not is_near:
        raise BadData(
            f"a rotation matrix is off by {defect:.2g}, expected orthonormal rows within "
            f"{tolerance}"
        )
    u, _, vt = np.linalg.svd(rotation)
    return compose(u @ vt, b_from_a[..., :3, 3])


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Return [v]x [..., 3, 3] of vectors [..., 3], with [v]x u = v x u."""
    return (vector @ GENERATORS).reshape(*vector.shape, 3)


def _left_jacobian(rotation_vector: FloatArray) -> FloatArray:
    """Return V [..., 3, 3] with exp(v, w) = (R, V v) (Barfoot 2017, eq. 7.37)."""
    angle_rad = np.linalg.norm(rotation_vector, axis=-1)[..., None]
    axis = rotation_vector / np.maximum(angle_rad, np.finfo(float).tiny)  # 0 without rotation
    sine_ratio = np.sinc(angle_rad / np.pi)[..., None]  # sin(a) / a
    cosine_ratio = 0.5 * angle_rad * np.sinc(angle_rad / (2 * np.pi)) ** 2  # (1 - cos(a)) / a
    outer = axis[..., :, None] * axis[..., None, :]
    along_axis = sine_ratio * np.eye(3) + (1 - sine_ratio) * outer
    return along_axis + cross_matrix(cosine_ratio * axis)

"""Alignment of point sets by a rigid or similarity transform."""

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


def umeyama(
    points_a: FloatArray,  # [N, 3]
    points_b: FloatArray,  # [N, 3]
    *,
    with_scale: bool,
) -> tuple[float, FloatArray]:
    """Return scale s and b_from_a [4, 4] that minimise |b - (s R a + t)|^2 (Umeyama 1991).

    The scale is 1 unless `with_scale`. The rotation about a line of collinear points is arbitrary.
    Raise BadData for fewer than three points, or if all points coincide.
    """
    if points_a.shape != points_b.shape or len(points_a) < 3:
        raise BadData(
            f"alignment of {points_a.shape} with {points_b.shape} points, expected two [N, 3] "
            "with N >= 3"
        )
    mean_a = points_a.mean(axis=0)
    mean_b = points_b.mean(axis=0)
    centred_a = points_a - mean_a
    centred_b = points_b - mean_b
    if not np.ptp(points_a, axis=0).any():
        raise BadData("alignment of points that all coincide: the camera must have moved")
    # The rotation does not depend on the scale, nor both on the translation
    rotation = rotation_between(centred_a, centred_b)
    scale = 1.0
    if with_scale:
        scale = (centred_b * (centred_a @ rotation.T)).sum() / (centred_a**2).sum()
    return scale, se3.compose(rotation, mean_b - scale * rotation @ mean_a)


def rotation_between(
    vectors_a: FloatArray,  # [N, 3]
    vectors_b: FloatArray,  # [N, 3]
    weight: FloatArray | float = 1.0,  # [N]
) -> FloatArray:
    """Return R [3, 3] that minimises the weighted sum of |b - R a|^2 (Wahba 1965).

    This is Kabsch's solution (1976), in a seventh of the time of SciPy's `align_vectors`.
    """
    u, _, vt = np.linalg.svd(vectors_b.T * weight @ vectors_a)
    u[:, 2] *= np.linalg.det(u @ vt)  # a rotation, not a reflection
    return u @ vt

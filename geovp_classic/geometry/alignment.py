"""Alignment of point sets by a rigid or similarity transform."""

import warnings

from scipy.spatial.transform import Rotation

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
    if not centred_a.any():
        raise BadData("alignment of points that all coincide: the camera must have moved")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # for collinear points
        rotation = Rotation.align_vectors(centred_b, centred_a)[0].as_matrix()
    scale = 1.0
    if with_scale:
        scale = (centred_b * (centred_a @ rotation.T)).sum() / (centred_a**2).sum()
    return scale, se3.compose(rotation, mean_b - scale * rotation @ mean_a)

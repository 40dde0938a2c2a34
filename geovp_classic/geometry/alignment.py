"""The rigid or similarity transform that maps one set of points best onto another."""

import warnings

import numpy as np
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
    """Scale s and b_from_a [4, 4] that minimise |b - (s R a + t)|^2 (Umeyama 1991); s = 1 unless
    `with_scale`.

    Points on a line leave the rotation about it free: any optimum may be returned. BadData for
    fewer than three points, or for points that all coincide.
    """
    if (
        points_a.shape != points_b.shape
        or points_a.ndim != 2
        or points_a.shape[1] != 3
        or len(points_a) < 3
    ):
        raise BadData(
            f"alignment of {points_a.shape} with {points_b.shape} points, expected two [N, 3] "
            "with N >= 3"
        )
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    centred_a, centred_b = points_a - mean_a, points_b - mean_b
    if not centred_a.any():
        raise BadData("alignment of points that all coincide: the camera must have moved")
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # of points on a line, for which pycolmap has no answer at all
        rotation = np.asarray(Rotation.align_vectors(centred_b, centred_a)[0].as_matrix())
    scale = (
        float((centred_b * (centred_a @ rotation.T)).sum() / (centred_a**2).sum())
        if with_scale
        else 1.0
    )
    return scale, se3.compose(rotation, mean_b - scale * rotation @ mean_a)

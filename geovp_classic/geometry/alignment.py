"""The rigid or similarity transform that lays one set of points best onto another (Umeyama 1991)."""

from __future__ import annotations

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
    """Scale s and b_from_a [4, 4] that minimise |b - (s R a + t)|^2; s = 1 unless `with_scale`.

    Points on a line leave the rotation about it free: the smallest one is not chosen, any optimum may come back.
    BadData for fewer than three points, or for points that all coincide.
    """
    if points_a.shape != points_b.shape or points_a.ndim != 2 or points_a.shape[1] != 3 or len(points_a) < 3:
        raise BadData(f"alignment of {points_a.shape} with {points_b.shape} points, expected two [N, 3] with N >= 3")
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    centred_a, centred_b = points_a - mean_a, points_b - mean_b
    variance_a = (centred_a**2).sum() / len(points_a)
    if variance_a <= 0:
        raise BadData("alignment of points that all coincide: the camera must have moved")
    u, singular, vt = np.linalg.svd(centred_b.T @ centred_a / len(points_a))  # eq. 38
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])  # eq. 39
    rotation = u @ np.diag(signs) @ vt  # eq. 40
    scale = float((singular * signs).sum() / variance_a) if with_scale else 1.0  # eq. 42
    return scale, se3.compose(rotation, mean_b - scale * rotation @ mean_a)  # eq. 41

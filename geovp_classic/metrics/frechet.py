"""Frechet distance between two sets of features: FVD, FID (Heusel et al. 2017, eq. 6)."""

import numpy as np

from geovp_classic.types import FloatArray


def frechet_distances(real: FloatArray, predicted: FloatArray) -> FloatArray:
    """Return values [N] by clip, whose mean is the squared Frechet distance of features [N, D].

    The distance is that of Gaussians with the means and covariances of both sets:
    |mean - mean'|^2 + tr(C + C' - 2 (C C')^1/2). The value of a clip differs from the mean by its
    influence on the distance, so that a resampled mean is the distance of a resampled set, to first
    order (infinitesimal jackknife, Efron 1982, ch. 6). Needs at least two clips.
    """
    count = len(real)
    offset = real.mean(axis=0) - predicted.mean(axis=0)
    centred, centred_predicted = real - real.mean(axis=0), predicted - predicted.mean(axis=0)
    # With C = A'A / (N - 1) and C' = B'B / (N - 1), the trace of the root is the sum of the
    # singular values of A B' / (N - 1), which needs no root of a singular matrix.
    basis, factor = np.linalg.qr(centred)
    basis_predicted, factor_predicted = np.linalg.qr(centred_predicted)
    left, singular, right = np.linalg.svd(factor @ factor_predicted.T / (count - 1))
    loads = (basis @ left) ** 2 + (basis_predicted @ right.T) ** 2
    squares = (centred**2 + centred_predicted**2).sum(axis=1)
    of_means = offset @ offset + 2 * (centred - centred_predicted) @ offset
    of_covariances = count / (count - 1) * squares - count * loads @ singular
    return of_means + of_covariances

"""Detail is transferred to magnified surfaces, at the contrast of the view."""

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.rendering.magnified_detail import MagnifiedDetail


def test_detail_is_added_only_where_magnification_removed_it() -> None:
    observed = np.random.default_rng(1).integers(60, 200, (48, 64, 3), dtype=np.uint8)
    magnification = np.ones((1, 48, 64), np.float32)
    detail = MagnifiedDetail()
    same = detail.transfer(observed[None], magnification, observed)
    np.testing.assert_array_equal(same[0], observed)

    magnification[..., 32:] = 3.0
    blurred = pinhole.resize(pinhole.resize(observed, (16, 12)), (64, 48))
    transferred = detail.transfer(blurred[None], magnification, observed)[0]
    before = np.abs(np.diff(blurred.astype(int), axis=1)).mean(axis=(0, 2))
    roughness = np.abs(np.diff(transferred.astype(int), axis=1)).mean(axis=(0, 2))
    assert roughness[36:].mean() > 1.5 * before[36:].mean()
    np.testing.assert_allclose(roughness[:28], before[:28])

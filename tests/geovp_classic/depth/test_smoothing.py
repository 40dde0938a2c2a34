"""Smoothing: planes lose their noise and keep their slopes, edges stay, and units don't matter."""

import numpy as np

from geovp_classic.depth import smoothing
from geovp_classic.types import FloatArray

RNG = np.random.default_rng(3)
SURE = np.ones((40, 50), np.float32)
PLAIN = np.full((40, 50), 128.0, np.float32)
SLANTED = (0.1 + 0.002 * np.arange(50) + 0.001 * np.arange(40)[:, None]).astype(np.float32)


def _twin(q: FloatArray, confidence: FloatArray, image: FloatArray, row: int, column: int) -> float:
    """The plane's value at the pixel by numpy's least squares, without the stiffness."""
    reach, step = smoothing.REACH, smoothing.STEP_PX
    same = smoothing.SAME_SURFACE * max(q[row, column], 0.01 * np.quantile(q, 0.99))
    equations, wanted = [], []
    for j in range(-reach, reach + 1):
        for i in range(-reach, reach + 1):
            y, x = row + step * j, column + step * i
            if not (0 <= y < q.shape[0] and 0 <= x < q.shape[1]):
                continue
            trust = smoothing.LEAST_TRUST + (1 - smoothing.LEAST_TRUST) * confidence[y, x]
            contrast = int(abs(image[y, x] - image[row, column]))
            weight = trust * np.exp(-contrast / smoothing.SIMILAR)
            root = np.sqrt(weight) / (1 + ((q[y, x] - q[row, column]) / same) ** 2)
            equations.append(root * np.array([1, i, j]))
            wanted.append(root * q[y, x])
    return max(float(np.linalg.lstsq(np.array(equations), np.array(wanted), rcond=None)[0][0]), 0.0)


def test_equals_the_slow_twin() -> None:
    q = (SLANTED * RNG.uniform(0.9, 1.1, SLANTED.shape)).astype(np.float32)
    confidence, image = RNG.uniform(0, 1, q.shape), RNG.uniform(100, 160, q.shape).astype(np.float32)
    flat = smoothing.flattened(q, confidence, image)
    for row, column in ((0, 0), (0, 49), (20, 25), (39, 10), (31, 47)):
        assert abs(flat[row, column] - _twin(q, confidence, image, row, column)) < 2e-3 * q[row, column]


def test_a_plane_stays_a_plane() -> None:
    np.testing.assert_allclose(smoothing.flattened(SLANTED, SURE, PLAIN), SLANTED, rtol=1e-3)


def test_noise_on_a_plane_falls_to_less_than_a_third() -> None:
    # 81 equal neighbours would leave 1/9 of the noise in the middle, 2 to 3 times as much at borders and corners
    noise = 0.02 * RNG.normal(size=SLANTED.shape) * SLANTED
    left = smoothing.flattened((SLANTED + noise).astype(np.float32), SURE, PLAIN) - SLANTED
    assert left[8:-8, 8:-8].std() < 0.2 * noise.std()
    assert left.std() < noise.std() / 3


def test_the_edge_of_a_thing_stays() -> None:
    q = np.where(np.arange(50) < 25, 0.5, 0.1).astype(np.float32) * SURE
    np.testing.assert_allclose(smoothing.flattened(q, SURE, PLAIN), q, rtol=0.02)
    image = np.where(np.arange(50) < 25, 40.0, 200.0).astype(np.float32) * SURE
    np.testing.assert_allclose(smoothing.flattened(q, SURE, image), q, rtol=1e-3)


def test_unsure_pixels_follow_sure_ones() -> None:
    q = np.full((40, 50), 0.2, np.float32)
    q[20, 25] = 0.21
    confidence = SURE.copy()
    confidence[20, 25] = 0.0
    assert abs(smoothing.flattened(q, confidence, PLAIN)[20, 25] - 0.2) < 1e-4


def test_the_unit_does_not_matter_and_the_sky_stays_infinitely_far() -> None:
    q = (SLANTED * RNG.uniform(0.9, 1.1, SLANTED.shape)).astype(np.float32)
    q[:12] = 0.0
    flat = smoothing.flattened(q, SURE, PLAIN)
    np.testing.assert_allclose(smoothing.flattened(1000 * q, SURE, PLAIN), 1000 * flat, rtol=1e-3, atol=1e-2)
    assert (flat[:12] < 1e-4).all()
    assert (smoothing.flattened(np.zeros((9, 9), np.float32), np.ones((9, 9)), np.zeros((9, 9))) == 0).all()

"""Umeyama's alignment recovers the similarity that moved the points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.geometry.alignment import rotation_between, umeyama

seeds = st.integers(0, 2**32 - 1)


def cloud(seed: int, count: int = 12) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)) * 5


def motion(seed: int) -> np.ndarray:
    return se3.exp(np.random.default_rng(seed).uniform(-1.7, 1.7, 6))


@given(seeds, st.floats(0.05, 20))
def test_a_similarity_is_recovered(seed: int, scale: float) -> None:
    points_a, b_from_a = cloud(seed), motion(seed + 1)
    points_b = se3.transform(b_from_a, scale * points_a)
    estimated_scale, estimate = umeyama(points_a, points_b, with_scale=True)
    assert estimated_scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(estimate, b_from_a, atol=1e-8 * (1 + scale))


@given(seeds)
def test_a_mirrored_cloud_still_gives_a_rotation(seed: int) -> None:
    points_a = cloud(seed)
    _, b_from_a = umeyama(points_a, points_a * [1, 1, -1], with_scale=True)
    assert np.linalg.det(b_from_a[:3, :3]) == pytest.approx(1.0)


def test_points_on_a_line_are_aligned_with_their_line() -> None:
    line = np.linspace(0, 10, 7)[:, None] * [0.0, 0, 1]
    target = line[:, [2, 1, 0]] + [3.0, 0, 0]
    _, b_from_a = umeyama(line, target, with_scale=False)
    np.testing.assert_allclose(se3.transform(b_from_a, line), target, atol=1e-12)
    assert np.linalg.det(b_from_a[:3, :3]) == pytest.approx(1.0)


def test_too_few_or_coincident_points_are_rejected() -> None:
    with pytest.raises(BadData, match="N >= 3"):
        umeyama(np.zeros((2, 3)), np.zeros((2, 3)), with_scale=True)
    with pytest.raises(BadData, match="coincide"):
        umeyama(np.tile([0.1, 0, 0.7], (10, 1)), cloud(0, 10), with_scale=True)


@given(seeds)
def test_weighted_rotations_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = cloud(seed)
    b = a @ motion(seed)[:3, :3].T + rng.normal(size=a.shape)
    weight = rng.uniform(0.1, 1.0, len(a))
    expected = Rotation.align_vectors(b, a, weight)[0].as_matrix()
    np.testing.assert_allclose(rotation_between(a, b, weight), expected, atol=1e-9)

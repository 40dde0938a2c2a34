"""The costs of a plane sweep, against a slow twin that says what they mean."""

import numpy as np
import pytest

from geovp_classic.depth import matching
from geovp_classic.types import FloatArray


def _bilinear(image: FloatArray, u: float, v: float) -> float:
    height, width = image.shape
    u, v = np.clip(u, 0, width - 1.001), np.clip(v, 0, height - 1.001)
    column, row = int(u), int(v)
    upper = image[row, column] * (column + 1 - u) + image[row, column + 1] * (u - column)
    lower = image[row + 1, column] * (column + 1 - u) + image[row + 1, column + 1] * (u - column)
    return float(upper * (row + 1 - v) + lower * (v - row))


def _cost(
    reference: FloatArray, source: FloatArray, homography: FloatArray, row: int, column: int
) -> float | None:
    """One minus ZNCC of the windows of 5 x 5 pixels, at most 1; None where the source does not see
    the pixel.
    """
    height, width = reference.shape
    own, other = [], []
    for y in np.clip(np.arange(row - 2, row + 3), 0, height - 1):
        for x in np.clip(np.arange(column - 2, column + 3), 0, width - 1):
            u, v, z = homography @ [x, y, 1]
            own.append(reference[y, x])
            other.append(_bilinear(source, u / z, v / z))
    u, v, z = homography @ [column, row, 1]
    inside = -0.5 <= u / z <= source.shape[1] - 0.5 and -0.5 <= v / z <= source.shape[0] - 0.5
    covariance = np.mean((own - np.mean(own)) * (other - np.mean(other)))
    spread = np.sqrt(
        (np.var(own) + matching.NOISE_VARIANCE) * (np.var(other) + matching.NOISE_VARIANCE)
    )
    return min(max(1 - covariance / spread, 0), 1) if inside else None


@pytest.fixture
def images() -> FloatArray:
    rng = np.random.default_rng(3)
    return rng.integers(0, 256, (3, 20, 24)).astype(np.float32)


def test_costs_equal_the_slow_twin(images: FloatArray) -> None:
    infinity = np.array([np.eye(3), [[1.05, 0.02, -3.0], [-0.01, 0.95, 2.0], [0.001, 0.0, 1.0]]])
    epipoles = np.array([[8.0, 3.0, 0.5], [-20.0, 0.0, -0.2]])
    planes = np.array([0.0, 0.3, 1.0])
    costs = matching.sweep_costs(images[0], images[1:], infinity, epipoles, planes)
    assert costs.shape == (20, 24, 3)
    for row, column, n in np.ndindex(*costs.shape):
        homographies = [
            a + planes[n] * np.outer(e, [0, 0, 1]) for a, e in zip(infinity, epipoles, strict=True)
        ]
        twins = [
            _cost(images[0], s, h, row, column)
            for s, h in zip(images[1:], homographies, strict=True)
        ]
        seen = [twin for twin in twins if twin is not None]
        prior = [0, 2, 5][n]  # thirds of FAR_PRIOR
        expected = prior + (matching.WORST * np.mean(seen) if seen else matching.UNSEEN)
        assert abs(costs[row, column, n] - expected) <= 1.5, (row, column, n)


def test_a_near_source_is_compared_at_every_fourth_hypothesis_and_interpolated_between(
    images: FloatArray,
) -> None:
    infinity, epipoles = (
        np.tile(np.eye(3), (2, 1, 1)),
        np.array([[-12.0, 2.0, 0.0], [2.0, 1.0, 0.0]]),
    )
    assert matching.near_sources(epipoles).tolist() == [False, True]
    planes = np.linspace(0.0, 1.0, 7)
    costs = matching.sweep_costs(images[0], images[1:], infinity, epipoles, planes)

    def twin(source: int, n: int, row: int, column: int) -> FloatArray:
        """The score, and 1, where the source sees the pixel."""
        homography = infinity[source] + planes[n] * np.outer(epipoles[source], [0, 0, 1])
        score = _cost(images[0], images[1 + source], homography, row, column)
        return np.zeros(2) if score is None else np.array([score, 1.0])

    for row, column in [(0, 0), (9, 12), (19, 23), (10, 23), (3, 11)]:
        for n in range(7):
            start, end = (0, 4) if n < 4 else (4, 6)
            share = (n - start) / (end - start)
            near = (1 - share) * twin(1, start, row, column) + share * twin(1, end, row, column)
            score, seen = twin(0, n, row, column) + near
            expected = matching.far_prior(7)[n] + (
                matching.WORST * score / seen if seen else matching.UNSEEN
            )
            assert abs(costs[row, column, n] - expected) <= 1.5, (row, column, n)


def test_bands_leave_no_seam(images: FloatArray) -> None:
    tall = np.tile(images[0], (5, 1))  # 100 rows: several bands
    costs = matching.sweep_costs(
        tall, tall[None], np.eye(3)[None], np.array([[3.0, 0, 0]]), np.array([0.0, 1.0])
    )
    np.testing.assert_array_equal(costs[25:35], costs[65:75])  # the image repeats every 20 rows
    assert (costs[..., 0] <= 6).all()  # equal windows: 1 - variance / (variance + noise)


def test_exposure_changes_nothing(images: FloatArray) -> None:
    brighter = np.floor(0.5 * images[0] + 60)
    args = (np.eye(3)[None], np.array([[3.0, 0, 0]]), np.array([0.0, 1.0]))
    same = matching.sweep_costs(images[0], images[:1], *args)
    changed = matching.sweep_costs(images[0], brighter[None], *args)
    assert np.abs(same.astype(int) - changed).max() <= 2


def test_flat_windows_match_nothing() -> None:
    flat = np.full((1, 16, 16), 100.0, np.float32)
    costs = matching.sweep_costs(flat[0], flat, np.eye(3)[None], np.zeros((1, 3)), np.array([0.0]))
    assert (costs >= matching.WORST - 2).all()


def test_what_no_source_sees_is_neither_good_nor_bad(images: FloatArray) -> None:
    aside = np.array([[[1.0, 0, 100.0], [0, 1, 0], [0, 0, 1]]])
    costs = matching.sweep_costs(images[0], images[1:2], aside, np.zeros((1, 3)), np.array([0.0]))
    assert (costs == matching.UNSEEN).all()

"""Costs of a plane sweep against a slow implementation of their definition."""

import cv2
import numpy as np
import pytest

from geovp_classic.depth.matching import WindowCorrelation
from geovp_classic.types import ByteArray, FloatArray

MATCHING = WindowCorrelation()
ASIDE = np.array([[[1.0, 0, 100.0], [0, 1, 0], [0, 0, 1]]])  # a homography


@pytest.fixture
def images() -> ByteArray:
    rng = np.random.default_rng(3)
    return rng.integers(0, 256, (3, 40, 24)).astype(np.uint8)


def source_cost(
    reference: ByteArray, source: ByteArray, homography: FloatArray, row: int, column: int
) -> float:
    """Return 247 times one minus the ZNCC of windows of 5 x 5 pixels; 123 outside of the source."""
    height, width = reference.shape
    u, v, z = homography @ [column, row, 1]
    if not (-0.5 <= u / z <= width - 0.5 and -0.5 <= v / z <= height - 0.5):
        return 123  # half of 247, as the noise of the images is small
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    image = source.astype(np.float32)
    border = cv2.BORDER_REPLICATE
    warped = cv2.warpPerspective(image, homography, (width, height), None, flags, border)
    rows = np.clip(np.arange(row - 2, row + 3), 0, height - 1)
    columns = np.clip(np.arange(column - 2, column + 3), 0, width - 1)
    a = reference[np.ix_(rows, columns)].astype(float)
    b = warped[np.ix_(rows, columns)]
    covariance = np.mean((a - a.mean()) * (b - b.mean()))
    noise = MATCHING.noise_variance
    correlation = covariance / np.sqrt((a.var() + noise) * (b.var() + noise))
    return float(247 * np.clip(1 - correlation, 0, 1))


def test_costs_are_means_over_the_sources_that_see_a_point(images: ByteArray) -> None:
    infinity = np.array([np.eye(3), [[1.05, 0.02, -3.0], [-0.01, 0.95, 2.0], [0.001, 0.0, 1.0]]])
    epipoles = np.array([[-20.0, 2.0, -0.2], [2.0, 1.0, 0.0]])  # the second baseline is short
    planes = np.linspace(0, 1, 7)
    costs, _ = MATCHING.costs(images[0], images[1:], infinity, epipoles, planes)

    def twin(source: int, n: int, row: int, column: int) -> tuple[float, bool]:
        homography = infinity[source] + planes[n] * np.outer(epipoles[source], [0, 0, 1])
        cost = source_cost(images[0], images[1 + source], homography, row, column)
        return cost, cost != 123

    near_costs = [0, 1, 2, 3, 4, 5, 6]  # 8 n / 7, rounded down
    for row, column in [(0, 0), (9, 12), (31, 12), (32, 5), (39, 23), (10, 23)]:
        for n in range(7):
            # The short baseline is compared at planes 0, 4 and 6, and interpolated between them.
            start, end = (0, 4) if n < 4 else (4, 6)
            fraction = (n - start) / (end - start)
            (first, first_seen), (second, second_seen) = (
                twin(1, step, row, column) for step in (start, end)
            )
            short = (1 - fraction) * first + fraction * second
            short_seen = (1 - fraction) * first_seen + fraction * second_seen
            long, long_seen = twin(0, n, row, column)
            weight = short_seen / max(short_seen + long_seen, 1e-6)  # unseen sources do not count
            expected = near_costs[n] + (1 - weight) * long + weight * short
            assert costs[row, column, n] == pytest.approx(expected, abs=2), (row, column, n)


def test_bands_leave_no_seam(images: ByteArray) -> None:
    tall = np.tile(images[0], (3, 1))  # 120 rows: several bands
    sideways = np.array([[3.0, 0, 0]])
    costs, _ = MATCHING.costs(tall, tall[None], np.eye(3)[None], sideways, np.array([0.0, 1.0]))
    difference = costs[45:75].astype(int) - costs[5:35]  # the image repeats every 40 rows
    assert np.abs(difference).max() <= 1
    assert (costs[..., 0] <= 6).all()  # equal windows: 1 - variance / (variance + noise)


def test_points_that_no_source_sees_have_a_neutral_cost(images: ByteArray) -> None:
    costs, is_seen = MATCHING.costs(images[0], images[1:2], ASIDE, np.ones((1, 3)), np.zeros(1))
    assert ((costs >= 123) & (costs <= 125)).all()  # half of 247, and a little for the noise
    assert not is_seen.any()
    _, is_seen = MATCHING.costs(
        images[0], images[1:2], np.eye(3)[None], np.ones((1, 3)), np.zeros(1)
    )
    assert is_seen.mean() > 0.99


def test_windows_without_texture_do_not_prefer_planes_that_no_source_sees() -> None:
    """Such windows match nothing, at 247; at less they would be near wherever that is unseen."""
    flat = np.full((1, 16, 16), 100, np.uint8)
    costs, _ = MATCHING.costs(flat[0], flat, ASIDE, np.ones((1, 3)), np.array([0.0]))
    assert (costs == 247).all()

"""Completion: a weighted median that follows the image."""

import numpy as np
import pytest

from geovp_classic.depth import completion
from geovp_classic.types import BoolArray, FloatArray


def _twin(values: FloatArray, confidence: FloatArray, image: FloatArray, row: int, column: int) -> float:
    """The smallest value of the window whose cumulated weight reaches half of the whole."""
    height, width = values.shape
    pairs = []
    for y in range(max(row - 3, 0), min(row + 4, height)):
        for x in range(max(column - 3, 0), min(column + 4, width)):
            if (x - column + y - row) % 2 != 0:
                continue
            trust = completion.LEAST_TRUST + (1 - completion.LEAST_TRUST) * confidence[y, x]
            contrast = int(abs(image[y, x] - image[row, column]))
            pairs.append((values[y, x], trust * np.exp(-contrast / completion.SIMILAR)))
    pairs.sort()
    cumulated = np.cumsum([weight for _, weight in pairs])
    return float(pairs[int(np.argmax(cumulated >= 0.5 * cumulated[-1]))][0])


def test_equals_the_slow_twin() -> None:
    rng = np.random.default_rng(2)
    values, confidence = rng.uniform(0, 1, (2, 12, 15)).astype(np.float32)
    image = rng.uniform(0, 255, (12, 15)).astype(np.float32)
    completed = completion.complete(values, confidence, image)
    expected = [[_twin(values, confidence, image, r, c) for c in range(15)] for r in range(12)]
    assert (np.abs(completed - expected) < 1e-6).mean() > 0.99  # ties in float32 may fall either way


def test_depth_moves_to_the_edge_of_the_image_and_nothing_lies_between() -> None:
    image = np.where(np.arange(20) < 10, 40, 200).astype(np.float32) * np.ones((20, 1), np.float32)
    fattened = np.where(np.arange(20) < 12, 0.5, 0.1).astype(np.float32) * np.ones((20, 1), np.float32)
    confidence = np.ones((20, 20), np.float32)
    confidence[:, 9:13] = 0.0
    completed = completion.complete(fattened, confidence, image)
    expected = np.where(np.arange(20) < 10, 0.5, 0.1) * np.ones((20, 1))
    np.testing.assert_allclose(completed, expected, rtol=1e-6)


def test_unsure_pixels_follow_sure_ones() -> None:
    values, confidence = np.full((9, 9), 0.2, np.float32), np.ones((9, 9), np.float32)
    values[3:6, 3:6], confidence[3:6, 3:6] = 0.9, 0.0
    completed = completion.complete(values, confidence, np.zeros((9, 9), np.float32))
    np.testing.assert_allclose(completed, 0.2)


def test_gaps_show_what_lies_behind() -> None:
    values = np.array([[0.5, 0, 0.1, 0, 0], [0, 0, 0, 0, 0]], np.float32)
    filled = completion.fill_from_background(values, values > 0)
    np.testing.assert_allclose(filled, [[0.5, 0.1, 0.1, 0.1, 0.1], [0.5, 0.1, 0.1, 0.1, 0.1]])
    assert not completion.fill_from_background(values, np.zeros(values.shape, dtype=bool)).any()


def _filled_slowly(values: FloatArray, known: BoolArray) -> FloatArray:
    filled = np.where(known, values, np.nan)
    for _ in range(2):  # rows, then columns, turned back by the second turn
        before = filled.copy()
        for row, column in np.argwhere(np.isnan(before)):
            beside = [line[np.isfinite(line)] for line in (before[row, :column][::-1], before[row, column:])]
            nearest = [line[0] for line in beside if len(line)]
            filled[row, column] = min(nearest) if nearest else np.nan
        filled = filled.T
    return np.nan_to_num(filled)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2, 0.7, 1.0])
def test_gaps_are_filled_as_the_slow_twin_says(share: float) -> None:
    rng = np.random.default_rng(int(100 * share))
    values = rng.uniform(size=(13, 17)).astype(np.float32)
    known = rng.uniform(size=values.shape) < share
    before = values.copy()
    np.testing.assert_array_equal(completion.fill_from_background(values, known), _filled_slowly(values, known))
    np.testing.assert_array_equal(values, before)


def test_islands_are_found_by_their_size() -> None:
    levels = np.full((20, 20), 5.0, np.float32)
    levels[2:4, 2:4] = 15.0  # 4 px
    levels[10:15, 10:15] = 15.0  # 25 px
    levels[0, 10:] = 6.5  # a step of 1.5 is a slope
    islands = completion.speckles(levels, 10 / 400)
    assert islands[2:4, 2:4].all()
    assert islands.sum() == 4

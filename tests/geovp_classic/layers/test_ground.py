"""The ground of a depth map is its lowest plane."""

import numpy as np
import pytest

from geovp_classic.layers.ground import GroundFit
from geovp_classic.types import FloatArray

HEIGHT, WIDTH = 120, 160
ROW, COLUMN = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
SURE = np.ones((HEIGHT, WIDTH), np.float32)
# A camera 1.5 m above the road, f = 100 px, horizon at row 50: q = (v - 50) / (100 * 1.5)


def road(roll: float = 0.0) -> FloatArray:
    return np.maximum(ROW - 50 - roll * (COLUMN - 80), 0) / 150


def street(roll: float = 0.0) -> FloatArray:
    """The road with walls beside it, a parked car on it, and 3 % noise."""
    walls = np.abs(COLUMN - 80) / 500
    inverse_depth = np.maximum(road(roll), walls)
    inverse_depth[60:90, 60:80] = (90 - 50) / 150  # stands on row 90
    noise = np.random.default_rng(0).normal(1, 0.03, inverse_depth.shape)
    return (inverse_depth * noise).astype(np.float32)


@pytest.mark.parametrize("roll", [0.0, 0.15])
def test_the_road_is_found_below_walls_and_cars(roll: float) -> None:
    ground = GroundFit().inverse_depths(street(roll), SURE)
    np.testing.assert_allclose(ground, road(roll), atol=0.02)
    assert (ground[:20] == 0).all()


def test_a_region_without_parallax_does_not_lower_the_ground() -> None:
    """A car ahead at the speed of the camera seems to be infinitely far."""
    inverse_depth = street()
    inverse_depth[60:90, 90:115] = 0.0001
    ground = GroundFit().inverse_depths(inverse_depth, SURE)
    np.testing.assert_allclose(ground, road(), atol=0.02)


def test_uncertain_depths_are_not_used() -> None:
    inverse_depth, confidence = street(), SURE.copy()
    inverse_depth[100:] = 0.001
    confidence[100:] = 0.1
    ground = GroundFit().inverse_depths(inverse_depth, confidence)
    np.testing.assert_allclose(ground[110], road()[110], atol=0.02)


@pytest.mark.parametrize(
    "inverse_depth",
    [
        np.full((HEIGHT, WIDTH), 0.1, np.float32),  # a wall
        np.maximum(50 - ROW, 0).astype(np.float32) / 150,  # a ceiling
        np.random.default_rng(0).uniform(0.01, 1, (HEIGHT, WIDTH)).astype(np.float32),
        np.zeros((HEIGHT, WIDTH), np.float32),
    ],
)
def test_a_scene_without_ground_has_none(inverse_depth: FloatArray) -> None:
    assert GroundFit().inverse_depths(inverse_depth, SURE) is None

"""Velocities: exact from exact flow, and corrected by tracking when they are a fifth wrong."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects.posed_images import PosedImages
from geovp_classic.dynamic_objects.velocity import VelocityEstimator
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray

TRUE_VELOCITY = np.array([1.2, 0.0, 5.0])


def exact_flow(observed: PosedImages) -> FloatArray:
    """Return the pixels [K, H, W, 2] where an object at 8 m was in earlier frames."""
    points = 8.0 * pinhole.rays(observed.camera)
    return np.stack(
        [
            pinhole.project(
                se3.transform(
                    observed.cam_from_last(k), points - observed.seconds(k) * TRUE_VELOCITY
                ),
                observed.camera,
            )[0]
            for k in observed.steps
        ]
    )


def body_of(traffic: Any) -> BoolArray:
    inner = traffic.mask.copy()
    for axis in (0, 1):
        inner &= np.roll(traffic.mask, 2, axis) & np.roll(traffic.mask, -2, axis)
    return np.asarray(inner)


# At half the depth everything relative to the camera, which drives at 4 m/s, is half.
@pytest.mark.parametrize(("depth", "expected"), [(8.0, [1.2, 0, 5]), (4.0, [0.6, 0, 4.5])])
def test_exact_flow_gives_the_exact_velocity(
    traffic: Any, observed: PosedImages, depth: float, expected: list[float]
) -> None:
    velocity = VelocityEstimator().from_flow(traffic.mask, depth, exact_flow(observed), observed)
    np.testing.assert_allclose(velocity, expected, atol=1e-6)


def test_a_sixth_of_outliers_is_rejected(traffic: Any, observed: PosedImages) -> None:
    flow_pixels = exact_flow(observed)
    rows = np.flatnonzero(traffic.mask.any(axis=1))
    flow_pixels[:, rows[: len(rows) // 6]] += 6.0
    velocity = VelocityEstimator().from_flow(traffic.mask, 8.0, flow_pixels, observed)
    np.testing.assert_allclose(velocity, TRUE_VELOCITY, atol=0.02)


def test_tracking_corrects_the_velocity(traffic: Any, observed: PosedImages) -> None:
    start = np.array([1.0, 0.0, 4.8])
    velocity = VelocityEstimator().track(start, body_of(traffic), 8.0, observed)
    np.testing.assert_allclose(velocity, TRUE_VELOCITY, atol=0.03)


def test_tracking_with_one_earlier_frame(traffic: Any, observed: PosedImages) -> None:
    two = replace(observed, images=observed.images[-2:], past=observed.past[-2:])
    start = np.array([1.1, 0.0, 4.9])
    velocity = VelocityEstimator().track(start, body_of(traffic), 8.0, two)
    np.testing.assert_allclose(velocity, TRUE_VELOCITY, atol=0.3)


def test_tracking_in_uniform_images_changes_nothing(traffic: Any, observed: PosedImages) -> None:
    uniform = replace(observed, images=np.full_like(observed.images, 90.0))
    start = np.array([1.0, 0.0, 4.0])
    velocity = VelocityEstimator().track(start, body_of(traffic), 8.0, uniform)
    np.testing.assert_allclose(velocity, start, atol=1e-9)

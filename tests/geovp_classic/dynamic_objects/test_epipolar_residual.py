"""Evidence of motion: on moving cars, and not on static surfaces."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects.epipolar_residual import EpipolarResidual
from geovp_classic.dynamic_objects.posed_images import PosedImages, grey_difference
from geovp_classic.geometry import pinhole

Observe = Callable[..., tuple[PosedImages, Any]]


def test_evidence_covers_a_crossing_car_and_not_the_street(observe: Observe) -> None:
    observed, traffic = observe(velocity=(2.0, 0.0, 0.0))
    is_moving, _ = EpipolarResidual().evidence(observed)
    assert is_moving[traffic.mask].mean() > 0.25
    assert is_moving[~traffic.mask].mean() < 0.002


# An oncoming car looks like a static one at 4 / 9 of its distance: 5 m/s, the camera drives 4.
@pytest.mark.parametrize("speed", [0.0, -5.0], ids=["parked", "oncoming"])
def test_a_car_that_a_static_scene_explains_has_no_evidence(observe: Observe, speed: float) -> None:
    observed, traffic = observe(velocity=(0.0, 0.0, speed))
    is_moving, _ = EpipolarResidual().evidence(observed)
    assert is_moving[traffic.mask].mean() < 0.05
    if speed == 0:
        assert not is_moving.any()


def test_flow_is_that_of_the_street(observe: Observe) -> None:
    observed, traffic = observe(velocity=(0.0, 0.0, 0.0))
    _, flow_pixels = EpipolarResidual().evidence(observed)
    assert flow_pixels.shape == (3, *traffic.mask.shape, 2)
    # Three frames ago the camera was 1.2 m further back.
    street = ~traffic.mask
    points = pinhole.rays(traffic.camera)[street] / traffic.inverse_depth[street][:, None]
    earlier, _ = pinhole.project(points + np.array([0.0, 0.0, 1.2]), traffic.camera)
    assert np.median(np.linalg.norm(flow_pixels[2][street] - earlier, axis=-1)) < 1


def test_uniform_images_have_no_evidence(observed: PosedImages) -> None:
    uniform = replace(observed, images=np.full_like(observed.images, 100.0))
    is_moving, _ = EpipolarResidual().evidence(uniform)
    assert not is_moving.any()


def test_differences_are_averaged_over_their_window() -> None:
    last = np.zeros((9, 9), np.float32)
    earlier = np.zeros((9, 9), np.float32)
    earlier[4, 4] = 50.0
    pixels = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).astype(np.float32)
    mean = grey_difference(last, earlier, pixels, window_px=5)
    assert mean[4, [4, 6, 7]] == pytest.approx([50 / 25, 50 / 25, 0], abs=1e-6)
    pixels[..., 0] += 0.5  # half of the bright pixel is sampled by each of its neighbours
    assert grey_difference(last, earlier, pixels, 1)[4, 3:5] == pytest.approx([25, 25])

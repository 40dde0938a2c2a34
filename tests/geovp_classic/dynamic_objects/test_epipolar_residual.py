"""Evidence of motion: exact for places that are worked out, silent for everything that stands."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects import epipolar_residual
from geovp_classic.geometry import pinhole

STEPS = (1, 2, 3)


@pytest.fixture(scope="module")
def evidence(
    drive_behind: Callable[..., Any],
) -> Callable[..., tuple[epipolar_residual.ResidualEvidence, Any]]:
    def _evidence(
        velocity: tuple[float, float, float],
    ) -> tuple[epipolar_residual.ResidualEvidence, Any]:
        traffic = drive_behind(velocity=velocity)
        poses = traffic.past.world_from_cam
        found = epipolar_residual.residual_evidence(
            traffic.images, traffic.camera, poses, traffic.inverse_depth, traffic.road, STEPS
        )
        return found, traffic

    return _evidence


def test_a_car_that_crosses_has_a_residual_and_the_street_has_none(
    evidence: Callable[..., Any],
) -> None:
    found, traffic = evidence((2.0, 0.0, 0.0))
    moved = (found.strength > 0.7) & (found.shift_px > 1)
    assert moved[traffic.mask].mean() > 0.25
    assert moved[~traffic.mask].mean() < 0.002


def test_the_same_car_parked_is_explained(evidence: Callable[..., Any]) -> None:
    found, _ = evidence((0.0, 0.0, 0.0))
    assert not ((found.strength > 0.7) & (found.shift_px > 1)).any()


def test_oncoming_cars_straight_ahead_look_like_nearer_ones(evidence: Callable[..., Any]) -> None:
    # 5 m/s towards a camera of 4 m/s is the flow of something standing at 4 / 9 of the distance: a
    # known limit.
    found, traffic = evidence((0.0, 0.0, -5.0))
    assert np.median(found.shift_px[traffic.mask]) < 0.5


def test_flow_leads_to_where_the_street_was(evidence: Callable[..., Any]) -> None:
    found, traffic = evidence((0.0, 0.0, 0.0))
    # Three frames ago the camera was 1.2 m further back, so everything that stands was 1.2 m
    # further away.
    street = ~traffic.mask
    points = pinhole.rays(traffic.camera)[street] / traffic.inverse_depth[street][:, None]
    then, _ = pinhole.project(points + np.array([0.0, 0.0, 1.2]), traffic.camera)
    assert np.median(np.linalg.norm(found.flow_pixels[2][street] - then, axis=-1)) < 1
    assert found.flow_pixels.shape == (3, *traffic.mask.shape, 2)


def test_gain_and_offset_are_taken_back(drive_behind: Callable[..., Any]) -> None:
    traffic = drive_behind(velocity=(0.0, 0.0, 0.0))
    spoilt = traffic.images.copy()
    spoilt[-3] = 0.8 * spoilt[-3] + 12
    args = traffic.camera, traffic.past.world_from_cam, traffic.inverse_depth
    equal = epipolar_residual.equalise_exposure(spoilt, *args, (2,))
    assert np.abs(equal[-3] - traffic.images[-3]).mean() < 2.5
    assert np.abs(spoilt[-3] - traffic.images[-3]).mean() > 10
    for step in (1, 3):  # only what is asked for changes
        np.testing.assert_array_equal(equal[-1 - step], traffic.images[-1 - step])


def test_images_of_one_grey_keep_their_exposure(drive_behind: Callable[..., Any]) -> None:
    traffic = drive_behind(velocity=(0.0, 0.0, 0.0))
    flat = np.full_like(traffic.images, 100.0)
    poses = traffic.past.world_from_cam
    equal = epipolar_residual.equalise_exposure(
        flat, traffic.camera, poses, traffic.inverse_depth, (1,)
    )
    np.testing.assert_array_equal(equal, flat)
    found = epipolar_residual.residual_evidence(
        flat, traffic.camera, poses, traffic.inverse_depth, traffic.road, STEPS
    )
    assert (found.strength == 0).all()


def test_a_difference_is_a_mean_over_its_window() -> None:
    last, earlier = np.zeros((9, 9), np.float32), np.zeros((9, 9), np.float32)
    earlier[4, 4] = 50.0
    place = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).astype(np.float32)
    mean = epipolar_residual.grey_difference(last, earlier, place, window_px=5)
    assert mean[4, 4] == pytest.approx(50 / 25)
    assert mean[4, 6] == pytest.approx(50 / 25)
    assert mean[4, 7] == pytest.approx(0, abs=1e-6)
    place[..., 0] += 0.5  # half of the bright pixel is read from each of its neighbours
    assert epipolar_residual.grey_difference(last, earlier, place, window_px=1)[
        4, 3:5
    ] == pytest.approx([25, 25])

"""Source frames and planes of a plane sweep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.depth.viewpoints import PlaneSpacing, SourceSelection
from geovp_classic.geometry import se3
from geovp_classic.types import Intrinsics
from tests.geovp_classic.boxed_street import straight

CAMERA = Intrinsics(490.0, 490.0, 127.5, 117.0, 256, 256)


def test_baselines_halve() -> None:
    # From step 9 the longest baseline is 9; the next are near 4.5, 2.25 and 1.125.
    assert sorted(SourceSelection().choose(straight(10, 1.0), 9, CAMERA)) == [0, 4, 7, 8]


def test_a_stationary_camera_has_no_sources() -> None:
    assert SourceSelection().choose(straight(5, 0.0), 4, CAMERA) == []
    assert SourceSelection().choose(straight(1, 1.0), 0, CAMERA) == []


def test_frames_without_overlap_are_left_out() -> None:
    # The image is 29 degrees wide. At 5 degrees per step, 4 steps leave less than 40 % in common.
    sources = SourceSelection().choose(straight(8, 1.0, yaw_rad=np.deg2rad(5)), 7, CAMERA)
    assert sources
    assert min(sources) >= 4


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-3, 1e3), st.integers(8, 96))
def test_planes_scale_with_the_unit(unit: float, count: int) -> None:
    poses = straight(10, 1.0)
    sources = se3.inverse(poses[[0, 4, 8]]) @ poses[9]
    scaled = sources.copy()
    scaled[:, :3, 3] *= unit
    planes, step_px = PlaneSpacing().spaced(sources, CAMERA, count)
    scaled_planes, scaled_step_px = PlaneSpacing().spaced(scaled, CAMERA, count)
    assert len(planes) == count
    assert planes[0] == 0
    assert (np.diff(planes) > 0).all()
    np.testing.assert_allclose(scaled_planes * unit, planes, rtol=1e-6)
    assert scaled_step_px == pytest.approx(step_px)


def test_planes_of_a_sideways_step_are_even() -> None:
    # A sideways step of 0.5 shifts every pixel at inverse depth q by 490 * 0.5 * q px.
    aside = se3.compose(np.eye(3), np.array([[-0.5, 0, 0]]))
    planes, step_px = PlaneSpacing().spaced(aside, CAMERA, 33)
    np.testing.assert_allclose(np.diff(planes) * 490 * 0.5, step_px, rtol=1e-6)
    assert 32 <= planes[-1] * 245 <= 36  # an eighth of the width, rounded up to the grid

"""Which frames are compared, and at which inverse depths."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.depth import viewpoints
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(490.0, 490.0, 127.5, 117.0, 256, 256)


def _path(num: int, step: float, yaw_rad: float = 0.0) -> FloatArray:
    return se3.exp(np.arange(num)[:, None] * np.array([0, 0, step, 0, yaw_rad, 0]))


def test_baselines_halve() -> None:
    # 10 steps of 1: 9, 4.5 (4 is nearer on a log scale: 4.5/4 < 5/4.5 is false, so 5), 2.25 and
    # 1.125
    assert sorted(viewpoints.choose_sources(_path(10, 1.0), 9, CAMERA)) == [0, 4, 7, 8]


def test_a_camera_that_stands_has_no_sources() -> None:
    assert viewpoints.choose_sources(_path(5, 0.0), 4, CAMERA) == []
    assert viewpoints.choose_sources(_path(1, 1.0), 0, CAMERA) == []


def test_frames_that_see_something_else_are_left_out() -> None:
    # the image is 29 degrees wide; turning 5 degrees a step, 4 steps leave less than 40 % in common
    chosen = viewpoints.choose_sources(_path(8, 1.0, yaw_rad=np.deg2rad(5)), 7, CAMERA)
    assert chosen
    assert min(chosen) >= 4


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-3, 1e3), st.integers(8, 96))
def test_hypotheses_scale_with_the_unit(unit: float, count: int) -> None:
    poses = _path(10, 1.0)
    sources = se3.inverse(poses[[0, 4, 8]]) @ poses[9]
    scaled = sources.copy()
    scaled[:, :3, 3] *= unit
    planes, step_px = viewpoints.hypotheses(sources, CAMERA, count)
    same, same_px = viewpoints.hypotheses(scaled, CAMERA, count)
    assert len(planes) == count
    assert planes[0] == 0
    assert (np.diff(planes) > 0).all()
    np.testing.assert_allclose(same * unit, planes, rtol=1e-6)
    assert same_px == pytest.approx(step_px)


def test_hypotheses_of_a_sideways_step_are_even() -> None:
    # a step of 0.5 aside shifts inverse depth q by 490 * 0.5 * q px, the same for every pixel
    aside = se3.compose(np.eye(3), np.array([[-0.5, 0, 0]]))
    planes, step_px = viewpoints.hypotheses(aside, CAMERA, 33)
    np.testing.assert_allclose(np.diff(planes) * 490 * 0.5, step_px, rtol=1e-6)
    assert 32 <= planes[-1] * 245 <= 36  # an eighth of the width, rounded up to the grid

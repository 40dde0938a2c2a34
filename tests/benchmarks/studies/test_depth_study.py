"""The evaluation of depth, on depths and motions whose errors can be worked out."""

from dataclasses import dataclass

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.types import Clip, Context, FloatArray, Intrinsics, PrivilegedInput, Trajectory
from studies.depth import evaluate, near_epipole
from tests.benchmarks.conftest import Says

CAMERA = Intrinsics(100.0, 100.0, 49.5, 39.5, 100, 80)


@dataclass(frozen=True)
class Wall:
    """All is equally far."""

    depth_m: float

    @property
    def needs(self) -> PrivilegedInput:
        return PrivilegedInput.NONE

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        size = context.frames.shape[:3]
        return np.full(size, 1 / self.depth_m), np.full(size, 0.25)


def _clip(step: tuple[float, float, float] = (0, 0, 1.0)) -> Clip:
    twists = np.zeros((11, 6))
    twists[:, :3] = np.arange(11)[:, None] * np.array(step)
    depths = np.full((11, 80, 100), 10.0, np.float32)
    depths[:, :, 50:] = 20.0
    depths[:, :10] = np.inf
    depths[:, 10:20] = 0.0
    moving = np.zeros(depths.shape, dtype=bool)
    moving[:, 60:, 50:] = True
    times_s = 0.1 * np.arange(11)
    path = Trajectory(se3.exp(twists), times_s, True)
    frames = np.zeros((11, 80, 100, 3), np.uint8)
    return Clip("street", frames, times_s, CAMERA, path, depths=depths, moving=moving)


def test_errors_of_a_wall() -> None:
    # 12 m for 10 m: 0.2, within 1.25; 12 m for 20 m: 0.4, not within. Sky and unknown do not count.
    measures = evaluate(Wall(12.0), _clip())
    assert set(measures) == {"static", "moving", "near-epipole", "away"}
    np.testing.assert_allclose(measures["moving"], [0.4, 0, 0.25])
    static = [(0.2 * 3000 + 0.4 * 2000) / 5000, 0.6, 0.25]  # 60 * 50 and 40 * 50 pixels
    np.testing.assert_allclose(measures["static"], static, rtol=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_epipole_is_where_the_camera_heads(sign: float) -> None:
    past = _clip(step=(0.1 * sign, 0, sign)).trajectory
    v, u = np.nonzero(near_epipole(past, CAMERA, radius_px=20))
    np.testing.assert_allclose([u.mean(), v.mean()], [59.5, 39.5])


def test_recorded_depth_has_no_error(printed: Says) -> None:
    *_, static = (printed("study", "depth", "1", "--source", "given").splitlines())[:3]
    assert static.split()[1:6:2] == ["static", "1", "0.000"]

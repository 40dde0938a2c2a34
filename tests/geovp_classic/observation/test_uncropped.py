"""The uncropped frames at the square's pixel size, and the detail that they bring to magnified
surfaces.
"""

import dataclasses

import numpy as np
import pytest

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.observation import observations_of, recent
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import (
    Context,
    ExtraView,
    Intrinsics,
    Observations,
    PrivilegedInput,
    Trajectory,
)

NATIVE = Intrinsics(120, 120, 99.5, 39.5, 200, 80)
PAST = Trajectory(np.tile(np.eye(4), (2, 1, 1)), np.arange(2.0), True)


def noise_context(side_px: int = 40) -> Context:
    """Two frames of noise, 200x80, and their central 80x80 square, smaller."""
    native = np.random.default_rng(0).integers(0, 255, (2, 80, 200, 3), dtype=np.uint8)
    window, camera = pinhole.centre_crop(NATIVE, (side_px, side_px))
    square = np.stack([pinhole.resize(frame[window], (side_px, side_px)) for frame in native])
    return Context(square, np.arange(3.0), camera, full=ExtraView(native, NATIVE, np.eye(4)))


def uncropped(context: Context) -> Observations:
    return observations_of(context, "full")


@pytest.mark.parametrize(
    ("side_px", "height_px"), [(80, 80), (64, 80), (40, 60), (20, 30), (160, 160)]
)
def test_pixels_are_finer_than_the_square_s_where_there_are_such(
    side_px: int, height_px: int
) -> None:
    context = noise_context(side_px)
    whole = uncropped(context)
    assert whole.frames.shape == (2, height_px, height_px * 200 // 80, 3)
    edge = pinhole.project(
        pinhole.unproject(np.array([-0.5, -0.5]), 1.0, context.intrinsics), whole.intrinsics
    )[0]
    first = (whole.frames.shape[2] - height_px) / 2 - 0.5, -0.5  # the square lies in the middle
    np.testing.assert_allclose(edge, first, atol=1e-9)


def test_what_cannot_be_done_is_refused() -> None:
    context = noise_context()
    with_depths = dataclasses.replace(context, past_depths=np.ones((2, 40, 40), np.float32))
    with pytest.raises(Incompatible, match="the crop only"):
        recent(with_depths, PAST, "full", 2)


@dataclasses.dataclass(frozen=True)
class Wall:
    """All pixels of all frames are 10 away."""

    needs = PrivilegedInput.NONE

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[np.ndarray, np.ndarray]:
        """0.1 everywhere."""
        return np.full((2, *context.frames.shape[:3]), 0.1, np.float32)


def test_beside_and_nearer_the_uncropped_frame_still_knows_the_image() -> None:
    context = noise_context()
    nearer = se3.exp(
        np.array([0, 0, 5.0, 0, 0, 0])
    )  # half way to the wall: everything is twice as large
    beside = se3.exp(np.array([5.0, 0, 0, 0, 0, 0]))  # 30 of the 40 columns are not in the square
    views = {}
    for frames in ("crop", "full"):
        scene = DepthFusion(Wall(), Blank(), frames=frames, detail=None, exposure=None).reconstruct(
            context, PAST
        )
        views[frames] = scene.view(
            np.stack([nearer, beside]), np.array([2.0, 3.0]), context.intrinsics
        )
    assert views["crop"].covered[1].mean() == pytest.approx(0.25, abs=0.03)
    assert views["full"].covered[1].all()
    # Twice as large is the native resolution: pixel for pixel the native frame, away from where
    # rounding falls.
    native = context.full.frames[-1, 20:60, 80:120].astype(int)  # type: ignore[union-attr]
    error = {
        name: np.abs(view.frames[0].astype(int) - native).mean() for name, view in views.items()
    }
    assert error["full"] < 5
    assert error["crop"] > 30

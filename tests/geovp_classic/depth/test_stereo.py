"""Depth of the paper street from a second eye."""

import dataclasses

import numpy as np
import pytest

from geovp_classic.depth.stereo import Stereo
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import Context, ExtraView, FloatArray, PrivilegedInput, Trajectory
from tests.geovp_classic.boxed_street import image, observe, straight

BASELINE_M = 0.5
Pair = tuple[Context, Trajectory, FloatArray]


@pytest.fixture(scope="module")
def pair() -> Pair:
    """Two steps with right images of other size and scale than the frames, as native ones are."""
    poses = straight(2)
    context, past, truth = observe(poses)
    right_from_cam = se3.compose(np.eye(3), np.array([-BASELINE_M, 0, 0]))
    wide = context.intrinsics.cropped(-40, -4, 208, 120).resized(312, 180)
    frames = np.stack([image(one @ se3.inverse(right_from_cam), wide) for one in poses])
    return dataclasses.replace(context, right=ExtraView(frames, wide, right_from_cam)), past, truth


def test_depth_in_metres(pair: Pair) -> None:
    context, past, truth = pair
    inverse_depths, confidence = Stereo(nearest_m=2.0).inverse_depths(context, past)
    disparity_error_px = (
        np.abs(inverse_depths[-1] - truth[-1]) * BASELINE_M * context.intrinsics.fx_px
    )
    assert np.median(disparity_error_px) < 0.35
    assert (disparity_error_px < 1).mean() > 0.9
    assert set(np.unique(confidence[-1])) == {0.0, 1.0}
    assert confidence[-1].mean() > 0.8
    assert not confidence[0].any()  # only the last frame is wanted
    assert (inverse_depths[-1] > 0).mean() > 0.99  # holes are filled


def test_what_it_needs(pair: Pair) -> None:
    context, past, _ = pair
    with pytest.raises(Incompatible, match="right images"):
        Stereo().inverse_depths(context.only(PrivilegedInput.NONE), past)
    with pytest.raises(Incompatible, match="scale"):
        Stereo().inverse_depths(context, dataclasses.replace(past, is_metric=False))
    with pytest.raises(BadData, match="expected a distance"):
        Stereo(nearest_m=0.0)


@pytest.mark.parametrize(
    "twist", [(0.5, 0, 0, 0, 0, 0), (-0.5, 0.1, 0, 0, 0, 0), (-0.5, 0, 0, 0, 0.1, 0)]
)
def test_only_rectified_pairs(pair: Pair, twist: tuple[float, ...]) -> None:
    context, past, _ = pair
    turned = dataclasses.replace(context.right, view_from_cam=se3.exp(np.array(twist)))
    with pytest.raises(Incompatible, match="rectified"):
        Stereo().inverse_depths(dataclasses.replace(context, right=turned), past)

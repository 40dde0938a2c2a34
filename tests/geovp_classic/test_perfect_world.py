"""With exact depth and poses, geometry must predict the future of the synthetic street.

Exact masks exclude what the last frame does not determine: uncovered pixels, moving objects at
their old and new places, depth edges, and surfaces that the last frame does not show.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.given import Given
from geovp_classic.metrics.strata import strata
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    PrivilegedInput,
    Target,
)

NUM_FUTURE = 5
PREDICTOR = GeometricPredictor(GroundTruth(), DepthFusion(Given(), detail=None, exposure=None))


def quiet_street(index: int, pitch_deg: float, roll_deg: float) -> Clip:
    """Render a street of view-independent surfaces without noise."""
    street = Synthetic(
        num_clips=2,
        num_frames=1 + NUM_FUTURE,
        size_px=(192, 192),
        noise=0.0,
        exposure_drift=0.0,
        haze_per_m=0.0,
        gloss=0.0,
        finest_detail_m=0.3,
        pitch_deg=pitch_deg,
        roll_deg=roll_deg,
    )
    return street[index]


def determined(context: Context, target: Target, moving: BoolArray) -> BoolArray:
    """Mask static future pixels [F, H, W] that the last frame shows and no moving object hides."""
    moving = ndimage.binary_dilation(moving, iterations=2)
    stains = np.where(moving[None, ..., None], np.uint8(255), np.uint8(0))
    stained = replace(context, frames=np.broadcast_to(stains, context.frames.shape))
    is_hidden = PREDICTOR.predict(stained).frames[0].any(axis=-1)
    return strata(context, target)["seen"] & ~is_hidden


def depth_edges(depths: FloatArray) -> BoolArray:
    """Mask pixels [F, H, W] next to a step of the inverse depth of at least a tenth."""
    size = (1, 3, 3)
    nearest, farthest = (
        ndimage.minimum_filter(depths, size),
        ndimage.maximum_filter(depths, size),
    )
    return nearest < 0.9 * farthest


def psnr_db(frames: ByteArray, target: ByteArray, mask: BoolArray) -> float:
    return float(10 * np.log10(255**2 / np.mean((frames[mask].astype(float) - target[mask]) ** 2)))


@pytest.mark.parametrize(
    ("index", "pitch_deg", "roll_deg"),
    [
        pytest.param(0, 0.0, 0.0, id="straight"),
        pytest.param(0, -4.0, 5.0, id="straight-pitched-and-rolled"),
        pytest.param(1, -4.0, 5.0, id="turn-pitched-and-rolled"),
    ],
)
def test_the_future_is_reproduced(index: int, pitch_deg: float, roll_deg: float) -> None:
    clip = quiet_street(index, pitch_deg, roll_deg)
    context, target = clip.split(1, ~PrivilegedInput.NONE)
    prediction = PREDICTOR.predict(context)
    known_pixels = determined(context, target, clip.moving[0])
    known_pixels &= ~depth_edges(target.depths)  # whose pixels show two surfaces
    static = prediction.covered[0] & known_pixels
    assert static.mean() > 0.7
    assert static.sum() > 0.93 * known_pixels.sum()
    assert psnr_db(prediction.frames[0], target.frames, static) >= 35
    assert psnr_db(prediction.frames[0], target.frames, known_pixels) >= 32
    copied = np.broadcast_to(context.frames[-1], target.frames.shape)
    assert psnr_db(copied, target.frames, static) < 28  # the camera moves

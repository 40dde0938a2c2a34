"""Asphalt without texture, and a car ahead on it: exact depths and masks say what must hold."""

import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.multiview import Multiview
from geovp_classic.geometry import pinhole, se3
from geovp_classic.metrics.image import Psnr
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import BoolArray, ByteArray, Clip

NUM_PAST = 10


@pytest.fixture(scope="module")
def clip() -> Clip:
    """A straight drive behind a car, and half a second more than was observed."""
    return Synthetic(num_clips=1, num_frames=NUM_PAST + 5, has_plain_road=True)[0]


def test_the_depth_of_plain_asphalt_is_unsure(clip: Clip) -> None:
    past, _ = clip.split(NUM_PAST, GroundTruth.needs)
    _, confidence = Multiview().inverse_depths(past, past.past)
    # The ground is y = 0 of the street's world, up to 40 m
    depth = clip.depths[NUM_PAST - 1]
    is_near = depth < 40
    pixels = pinhole.pixel_grid(clip.intrinsics)[is_near]
    points = pinhole.unproject(pixels, depth[is_near], clip.intrinsics)
    height = se3.transform(clip.trajectory.world_from_cam[NUM_PAST - 1], points)[:, 1]
    is_sure = confidence[-1][is_near][np.abs(height) < 0.02] > 0.5
    assert is_sure.size > 0.2 * depth.size
    assert is_sure.mean() < 0.25  # .14; with cracks and stains, .61


def test_a_car_ahead_on_plain_asphalt_stays_in_place(clip: Clip) -> None:
    past, target = clip.split(NUM_PAST, GroundTruth.needs)
    frames = GeometricPredictor(GroundTruth(), DepthFusion()).predict(past).frames[0]
    moving = clip.moving[NUM_PAST:]

    def psnr_db(shown: ByteArray, mask: BoolArray) -> float:
        return float(np.mean(Psnr()(shown, target.frames, mask)))

    copies = np.repeat(past.frames[-1:], len(frames), axis=0)
    assert psnr_db(frames, moving) > psnr_db(copies, moving) + 5

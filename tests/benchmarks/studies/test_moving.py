"""The study of moving pixels, on a stationary camera, whose views are copies of the last frame."""

import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.metrics.image import Psnr
from studies.moving import moving_psnr_db


def test_layers_change_nothing_before_a_stationary_camera() -> None:
    clip = Synthetic(num_clips=8, num_frames=12, size_px=(64, 64))[7]
    assert clip.name == "seed0-stand/000"
    assert clip.moving is not None
    copies = np.repeat(clip.frames[9:10], 2, axis=0)
    expected = np.nanmean(Psnr()(copies, clip.frames[10:], clip.moving[10:]))
    static, layers = moving_psnr_db(clip, "ground-truth")
    assert static == layers
    assert static == pytest.approx(expected, abs=0.1)

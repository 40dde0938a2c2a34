"""Windows of clips, and grey ones."""

import numpy as np

from geovp_classic.types import Clip, Intrinsics
from geovp_learned.video import training
from geovp_learned.video.svg import SvgTraining


def clip(num_frames: int) -> Clip:
    """Frame n is of grey level n."""
    frames = (
        np.zeros((num_frames, 8, 8, 3), np.uint8)
        + np.arange(num_frames, dtype=np.uint8)[:, None, None, None]
    )
    return Clip("levels", frames, np.arange(num_frames) / 10, Intrinsics(8, 8, 3.5, 3.5, 8, 8))


def test_windows_begin_every_stride_and_end_within_the_clip() -> None:
    found = training.windows([clip(10), clip(3), clip(5)], size_px=(4, 6), num_frames=4, stride=3)
    assert [window[:, 0, 0, 0].tolist() for window in found] == [
        [0, 1, 2, 3],
        [3, 4, 5, 6],
        [6, 7, 8, 9],
        [0, 1, 2, 3],
    ]
    assert found[0].shape == (4, 4, 6, 3)
    assert np.shares_memory(found[0], found[1])  # frame 3 is in both


def test_grey_is_luma_in_all_three_channels() -> None:
    green = np.zeros((2, 4, 4, 3), np.uint8)
    green[..., 1] = 200
    images = SvgTraining(grey_probability=1.0).example(green, np.random.default_rng(0))["images"]
    assert set(images.flatten().tolist()) == {117}  # 0.587 * 200 = 117.4

"""Windows of clips, and grey ones."""

import numpy as np

from geovp_classic.types import Clip, Intrinsics
from geovp_learned.video.svg import SvgTraining


def clip(num_frames: int) -> Clip:
    """Frame n is of grey level n."""
    frames = (
        np.zeros((num_frames, 8, 8, 3), np.uint8)
        + np.arange(num_frames, dtype=np.uint8)[:, None, None, None]
    )
    return Clip("levels", frames, np.arange(num_frames) / 10, Intrinsics(8, 8, 3.5, 3.5, 8, 8))


def test_an_example_has_the_frames_of_its_window() -> None:
    method = SvgTraining(num_past=2, num_future=3, mirror_probability=0.0)
    prepared = method.prepare(clip(8))
    assert prepared["frames"].shape == (8, 64, 64, 3)
    (last,) = method.examples([prepared], training=True)[-1:]
    images = method.example(last, np.random.default_rng(0))["images"]
    assert images[:, 0, 0, 0].tolist() == [3, 4, 5, 6, 7]
    assert method.validation_example(last)["images"].shape == (5, 3, 64, 64)

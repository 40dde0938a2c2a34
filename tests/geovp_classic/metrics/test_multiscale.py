"""MS-SSIM: the numbers of a package in wide use, masks, refusals."""

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.metrics.multiscale import MsSsim
from geovp_classic.types import ByteArray


def frames(height_px: int, width_px: int) -> tuple[ByteArray, ByteArray]:
    """A prediction and a target [1, H, W, 3]: waves, shifted by 3 pixels and fainter in the
    prediction, and noise.
    """
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:height_px, :width_px]
    waves = [np.sin(u / 7 + v / 11), np.cos(u / 13 - v / 5), np.sin(u * v / 900)]
    base = 127 + 60 * np.stack(waves, axis=-1)
    target = np.clip(base + rng.normal(0, 8, base.shape), 0, 255).round().astype(np.uint8)
    predicted = np.roll(base, 3, axis=1) * 0.9 + 10 + rng.normal(0, 20, base.shape)
    return np.clip(predicted, 0, 255).round().astype(np.uint8)[None], target[None]


@pytest.mark.parametrize(
    ("size_px", "expected"),
    [
        (
            (256, 832),
            0.85366381,
        ),  # pytorch-msssim 1.0.0, ms_ssim(..., data_range=1.0), on the same frames; DMVFN's
        ((176, 208), 0.84218218),
        ((192, 192), 0.83967023),
    ],
)
def test_agrees_with_pytorch_msssim(size_px: tuple[int, int], expected: float) -> None:
    np.testing.assert_allclose(
        MsSsim()(*frames(*size_px), None), [expected], atol=2e-6
    )  # its window is float32


def test_an_odd_last_row_and_column_count_twice() -> None:
    predicted, target = (image[:, :161, :165] for image in frames(176, 176))
    with_twice = [
        np.pad(image, ((0, 0), (0, 15), (0, 11), (0, 0)), mode="edge")
        for image in (predicted, target)
    ]
    # halved four times, 161x165 and its padding to 176x176 agree wherever windows see no more than
    # one repetition
    inside = np.zeros((1, 176, 176), dtype=bool)
    inside[:, :60, :60] = True
    expected = MsSsim()(*with_twice, inside)
    np.testing.assert_allclose(
        MsSsim()(predicted, target, inside[:, :161, :165]), expected, atol=1e-6
    )


def test_masks_select_windows() -> None:
    """A full mask changes nothing, an empty one leaves nothing, and a half knows only its half, but
    for the border.
    """
    predicted, target = frames(256, 832)
    predicted[:, :, 416:] = target[:, :, 416:]  # the right half is perfect
    left, nothing = np.zeros((2, *target.shape[:3]), dtype=bool)
    left[:, :, :400] = True
    metric = MsSsim()
    assert hasattr(metric, "over")
    whole, full, half, none, rest = (
        float(scores[0])
        for scores in metric.over(predicted, target, [None, ~nothing, left, nothing, ~left])
    )
    assert full == pytest.approx(whole)
    assert np.isnan(none)
    alone = float(metric(predicted[:, :, :400], target[:, :, :400], None)[0])
    assert half == pytest.approx(alone, abs=0.01)
    assert half < whole < rest


def test_frames_below_161_pixels_are_refused() -> None:
    blank = np.zeros((1, 160, 200, 3), np.uint8)
    with pytest.raises(BadData, match=r"\(160, 200, 3\), expected at least 161x161"):
        MsSsim()(blank, blank, None)
    enough = np.zeros((1, 161, 161, 3), np.uint8)
    np.testing.assert_allclose(MsSsim()(enough, enough, None), [1.0])

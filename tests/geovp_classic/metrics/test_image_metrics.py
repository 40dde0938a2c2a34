"""PSNR and SSIM: worked numbers, an independent implementation, masks, and what they refuse."""

from typing import Any

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from geovp_classic.errors import BadData
from geovp_classic.interfaces import FrameMetric
from geovp_classic.metrics.image import Psnr, Ssim
from geovp_classic.types import ByteArray

METRICS = [Psnr(), Ssim()]
GAUSSIAN: dict[str, Any] = {
    "gaussian_weights": True,
    "sigma": 1.5,
    "use_sample_covariance": False,
}


def noise(seed: int, shape: tuple[int, ...] = (3, 32, 40, 3)) -> ByteArray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def smooth_street(num_frames: int) -> ByteArray:
    """Frames with edges, slopes and flat sky, each a little shifted."""
    v, u = np.mgrid[:64, :80]
    frames = [
        np.stack([(u + 3 * k) * 3 % 256, np.where(v < 30, 200, v * 2), (u * v // 9 + k) % 256], -1)
        for k in range(num_frames)
    ]
    return np.stack(frames).astype(np.uint8)


def test_psnr_takes_one_mean_square_over_all_channels() -> None:
    target = np.zeros((1, 4, 4, 3), dtype=np.uint8)
    predicted = target.copy()
    predicted[..., 0] = 255  # MSE 1/3 jointly: 4.77 dB; per channel it would be 0 dB, inf and inf
    np.testing.assert_allclose(Psnr()(predicted, target, None), [10 * np.log10(3)])
    np.testing.assert_allclose(Psnr(100.0, "each")(predicted, target, None), [(0 + 100 + 100) / 3])


def test_scores_are_clipped_to_the_ceiling() -> None:
    target = noise(1, (1, 256, 256, 3))
    almost = target.copy()
    almost[0, 5, 5, 1] ^= 1  # 10 log10(255^2 * 256 * 256 * 3) = 101.07 dB
    assert Psnr()(almost, target, None) == 100.0
    np.testing.assert_allclose(Psnr(ceiling_db=200.0)(almost, target, None), [101.066], atol=1e-3)
    np.testing.assert_allclose(Ssim()(target, target, None), [1.0], atol=1e-12)


@pytest.mark.parametrize("kind", ["noise", "shifted", "flat", "faint"])
def test_ssim_agrees_with_scikit_image(kind: str) -> None:
    target = smooth_street(2)
    predicted = {
        "noise": noise(3, target.shape),
        "shifted": np.roll(target, 2, axis=2),
        "flat": np.full_like(target, 255),
        "faint": target ^ np.uint8(1),
    }[kind]
    expected = [
        structural_similarity(t, p, channel_axis=-1, **GAUSSIAN)
        for p, t in zip(predicted, target, strict=True)
    ]
    np.testing.assert_allclose(Ssim()(predicted, target, None), expected, atol=1e-6)


def test_masked_ssim_is_the_mean_of_scikit_images_map() -> None:
    predicted, target = np.roll(smooth_street(1), 1, axis=1), smooth_street(1)
    _, full = structural_similarity(target[0], predicted[0], full=True, channel_axis=-1, **GAUSSIAN)
    mask = np.zeros(target.shape[:3], dtype=bool)
    mask[0, 20:30, 3:12] = True  # columns 3 and 4 are windows that look beyond the frame: left out
    np.testing.assert_allclose(
        Ssim()(predicted, target, mask), [full[20:30, 5:12].mean()], atol=1e-6
    )


@pytest.mark.parametrize("metric", METRICS)
def test_invalid_frames_and_masks_are_refused(metric: FrameMetric) -> None:
    target = noise(1)
    with pytest.raises(BadData, match=r"predicted frames are uint8 of shape \(2, 32, 40, 3\)"):
        metric(target[:2], target, None)
    with pytest.raises(BadData, match=r"predicted frames are float64.*expected uint8"):
        metric(target / 255.0, target, None)
    for other, shape in ((target[0], r"\(32, 40, 3\)"), (target[..., :1], r"\(3, 32, 40, 1\)")):
        with pytest.raises(BadData, match=f"frames are uint8 of shape {shape}, expected"):
            metric(other, other, None)
    with pytest.raises(BadData, match=r"mask is uint8.*expected bool of shape \(3, 32, 40\)"):
        metric(target, target, np.ones((3, 32, 40), dtype=np.uint8))


@pytest.mark.parametrize("border", ["valid", "zero"])
@pytest.mark.parametrize(("window", "radius"), [("uniform", 3), ("gaussian", 5)])
def test_other_windows_and_borders_agree_with_scikit_image(
    window: str, radius: int, border: str
) -> None:
    a = smooth_street(3)
    b = a ^ (noise(0, a.shape) // 8)
    metric = Ssim(window=window, border=border)  # type: ignore[arg-type]
    settings = GAUSSIAN if window == "gaussian" else {}
    pad = (
        ((0, 0), (radius, radius), (radius, radius), (0, 0)) if border == "zero" else ((0, 0),) * 4
    )
    for one, other, value in zip(np.pad(a, pad), np.pad(b, pad), metric(a, b, None), strict=True):
        assert value == pytest.approx(
            structural_similarity(one, other, channel_axis=-1, **settings), abs=1e-9
        )
    rim = np.zeros((3, 64, 80), bool)
    rim[:, 0] = True
    assert np.isnan(metric(a, b, rim)).all() == (border == "valid")

"""Frame metrics on 20 frames of 256x256, next to those of scikit-image."""

from collections.abc import Callable

import numpy as np
from skimage import metrics

from geovp_classic import registry
from geovp_classic.types import ByteArray, FloatArray
from performance import Comparison


def comparisons(size_px: int = 256) -> list[Comparison]:
    """Return the comparisons of PSNR and SSIM on random frames."""
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (2, 20, size_px, size_px, 3), dtype=np.uint8)
    rivals = {"psnr": metrics.peak_signal_noise_ratio, "ssim": skimage_ssim}

    def comparison(name: str, rival: Callable[..., object]) -> Comparison:
        ours = registry.build("frame_metrics", {"name": name})
        return Comparison(
            name,
            lambda: ours(*frames, None),
            "scikit-image",
            lambda: [rival(*pair) for pair in zip(*frames, strict=True)],
        )

    return [comparison(name, rival) for name, rival in rivals.items()]


def skimage_ssim(predicted: ByteArray, target: ByteArray) -> FloatArray:
    """Return SSIM with the Gaussian window of Wang et al. 2004, of frames [H, W, 3]."""
    return metrics.structural_similarity(
        predicted,
        target,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )

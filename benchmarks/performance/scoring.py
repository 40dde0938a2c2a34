"""Time of the frame metrics on 20 frames of 256x256, beside scikit-image's SSIM.

`PYTHONPATH=benchmarks python -m performance.scoring [ROUNDS]`

The metrics are timed one after the other, after one round of warm-up.
"""

import functools
from collections.abc import Sequence

import numpy as np
from skimage.metrics import structural_similarity

from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.types import BoolArray, ByteArray, FloatArray
from performance import rounds_parser, timed

NUM_FRAMES, SIZE_PX = 20, 256


def skimage_ssim(
    predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
) -> FloatArray:
    """SSIM [F] with the Gaussian window of Wang 2004, of frames [F, H, W, 3]."""
    given = {
        "channel_axis": -1,
        "gaussian_weights": True,
        "sigma": 1.5,
        "use_sample_covariance": False,
    }
    pairs = zip(predicted, target, strict=True)
    scores = [structural_similarity(a, b, **given) for a, b in pairs]  # type: ignore[no-untyped-call]
    return np.array(scores)


def line(name: str, rounds: int) -> str:
    """The time a frame of one metric, or why there is none."""
    rng = np.random.default_rng(0)
    try:
        score = (
            skimage_ssim
            if name == "skimage's ssim"
            else registry.build("frame_metrics", {"name": name})
        )
        taken_s = []
        for _ in range(rounds + 1):
            predicted, target = rng.integers(
                0, 256, (2, NUM_FRAMES, SIZE_PX, SIZE_PX, 3), dtype=np.uint8
            )
            taken_s.append(timed(functools.partial(score, predicted, target, None))[1])
    except GeovpError as error:
        return f"{name}: {error}"
    clock_ms, processor_ms = 1e3 * np.median(taken_s[1:], axis=0) / NUM_FRAMES
    return f"{name}: {clock_ms:.1f} ms a frame, of the processor {processor_ms:.1f} ms"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each metric."""
    parser = rounds_parser("performance.scoring", "Time of the frame metrics.", 8)
    rounds = parser.parse_args(arguments).rounds
    for name in ("psnr", "ssim", "skimage's ssim", "lpips"):
        print(line(name, rounds))


if __name__ == "__main__":
    main()

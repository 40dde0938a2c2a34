"""What renderers and predictors give."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types.arrays import BoolArray, ByteArray, FloatArray, ShortRepr, array_of, store
from geovp_classic.types.motion import Motion


@dataclass(frozen=True, repr=False)
class Views(ShortRepr):
    """A scene seen from several poses."""

    frames: ByteArray  # [F, H, W, 3]
    covered: BoolArray  # [F, H, W]; False where the image was invented
    depths: FloatArray  # [F, H, W] float32; 0 = unknown, inf = infinitely far

    def __post_init__(self) -> None:
        store(
            self, frames=array_of("views: frames", self.frames, np.uint8, (*self.covered.shape, 3))
        )
        store(self, covered=array_of("views: covered", self.covered, bool, self.covered.shape))
        store(self, depths=array_of("views: depths", self.depths, np.float32, self.covered.shape))


@dataclass(frozen=True, repr=False)
class Prediction(ShortRepr):
    """Predicted frames, one set per sample, with the motion behind them where there is one."""

    frames: ByteArray  # [S, F, H, W, 3]
    covered: BoolArray | None = None  # [S, F, H, W]
    motion: Motion | None = None

    def __post_init__(self) -> None:
        frames = np.asarray(self.frames)
        if frames.ndim != 5 or frames.shape[-1] != 3:
            raise BadData(f"predicted frames have shape {frames.shape}, expected [S, F, H, W, 3]")
        store(self, frames=array_of("predicted frames", frames, np.uint8, frames.shape))
        if self.covered is not None:
            store(
                self, covered=array_of("predicted coverage", self.covered, bool, frames.shape[:4])
            )

    @property
    def confidence(self) -> FloatArray | None:
        """What each predicted frame [S, F] rests on, from 0 to 1; None without coverage or motion.

        The share of pixels that are covered, times the number of tracked past frames over the
        number of all frames up to the step, P + k. It ranks frames and is no probability.
        """
        if self.covered is None or self.motion is None:
            return None
        tracked = self.motion.tracked
        frames_until = len(tracked) + np.arange(1, self.covered.shape[1] + 1)
        return self.covered.mean(axis=(2, 3)) * tracked.sum() / frames_until

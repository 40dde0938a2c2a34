"""Outputs of renderers and predictors."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types.arrays import (
    BoolArray,
    ByteArray,
    FloatArray,
    ShortRepr,
    store_checked,
)
from geovp_classic.types.motion import Motion


@dataclass(frozen=True, repr=False)
class Views(ShortRepr):
    """Views of a scene from several poses."""

    frames: ByteArray  # [F, H, W, 3]
    covered: BoolArray  # [F, H, W]; False for inpainted pixels
    depths: FloatArray  # [F, H, W] float32; 0 = unknown, inf = infinitely far

    def __post_init__(self) -> None:
        shape = self.covered.shape
        store_checked(self, "frames", np.uint8, (*shape, 3))
        store_checked(self, "covered", bool, shape)
        store_checked(self, "depths", np.float32, shape)


@dataclass(frozen=True, repr=False)
class Prediction(ShortRepr):
    """Predicted frames, one set per sample, with the camera's motion if it is known."""

    frames: ByteArray  # [S, F, H, W, 3]
    covered: BoolArray | None = None  # [S, F, H, W]
    motion: Motion | None = None

    def __post_init__(self) -> None:
        shape = self.frames.shape[:-1]
        if len(shape) != 4:
            raise BadData(
                f"predicted frames have shape {self.frames.shape}, expected [S, F, H, W, 3]"
            )
        store_checked(self, "frames", np.uint8, (*shape, 3))
        store_checked(self, "covered", bool, shape)

    @property
    def confidence(self) -> FloatArray | None:
        """Return the evidence for each frame [S, F], in [0, 1]; None without coverage or motion.

        It is the fraction of covered pixels, times the number of tracked past frames, divided by
        the number of frames up to the step, P + k. It ranks frames and is not a probability.
        """
        if self.covered is None or self.motion is None:
            return None
        tracked = self.motion.tracked
        num_frames = len(tracked) + np.arange(1, self.covered.shape[1] + 1)
        covered_fraction = self.covered.mean(axis=(2, 3))
        return covered_fraction * tracked.sum() / num_frames

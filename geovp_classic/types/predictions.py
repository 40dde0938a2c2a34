"""Outputs of renderers and predictors."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types.arrays import BoolArray, ByteArray, FloatArray, ShortRepr, store_checked
from geovp_classic.types.motion import Motion

ShownBy = Literal["geometry", "image-motion", "last-frame"]


@dataclass(frozen=True, repr=False)
class Views(ShortRepr):
    """Views of a scene from several poses."""

    frames: ByteArray  # [F, H, W, 3]
    covered: BoolArray  # [F, H, W]; False for inpainted pixels
    depths: FloatArray  # [F, H, W] float32; 0 = unknown, inf = infinitely far
    # [F, H, W]; True where a patch that moves on its own is shown
    moving: BoolArray | None = None

    def __post_init__(self) -> None:
        shape = self.covered.shape
        store_checked(self, "frames", np.uint8, (*shape, 3))
        store_checked(self, "covered", bool, shape)
        store_checked(self, "depths", np.float32, shape)
        store_checked(self, "moving", bool, shape)


@dataclass(frozen=True, repr=False)
class Prediction(ShortRepr):
    """Predicted frames, one set per sample, with the camera's motion if it is known.

    A predictor with a fallback states what it shows the clip by.
    """

    frames: ByteArray  # [S, F, H, W, 3]
    covered: BoolArray | None = None  # [S, F, H, W]; False for inpainted and copied pixels
    motion: Motion | None = None
    # [S, F], in [0, 1]; it ranks frames by their expected quality and is not a probability
    confidence: FloatArray | None = None
    shown_by: ShownBy | None = None  # None: by the only way that the predictor has
    copied: BoolArray | None = None  # [S, F, H, W]; True for pixels of the last observed frame

    def __post_init__(self) -> None:
        shape = self.frames.shape[:-1]
        if len(shape) != 4 or not shape[0]:
            raise BadData(
                f"predicted frames have shape {self.frames.shape}, expected [S, F, H, W, 3]"
            )
        store_checked(self, "frames", np.uint8, (*shape, 3))
        store_checked(self, "covered", bool, shape)
        store_checked(self, "confidence", np.float64, shape[:2])
        if self.confidence is not None and not (abs(self.confidence - 0.5) <= 0.5).all():
            raise BadData("confidence has values outside [0, 1]")
        store_checked(self, "copied", bool, shape)

    @property
    def is_trusted(self) -> bool:
        """Return whether the predictor shows its own images, and not those of a fallback."""
        return self.shown_by in (None, "geometry")

    @property
    def is_copy(self) -> BoolArray:
        """Return which frames [S, F] are copies of the last observed frame as a whole."""
        if self.copied is None:
            return np.zeros(self.frames.shape[:2], bool)
        return np.asarray(self.copied.all(axis=(2, 3)))

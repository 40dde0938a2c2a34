"""Observations: what several steps need to know about the observed frames, computed once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.types.arrays import (
    BoolArray,
    ByteArray,
    ShortRepr,
    store_checked,
)
from geovp_classic.types.motion import Intrinsics


@dataclass(frozen=True, repr=False)
class Observations(ShortRepr):
    """The observed frames of one image stream, reduced to the scene, in grey, and screened."""

    frames: ByteArray  # [P, H, W, 3]
    greys: ByteArray  # [P, H, W]
    is_usable: BoolArray  # [P]; False for blank or duplicate frames, and for those before a cut
    intrinsics: Intrinsics

    def __post_init__(self) -> None:
        shape = np.shape(self.frames)[:3]
        store_checked(self, "frames", np.uint8, (*shape, 3))
        store_checked(self, "greys", np.uint8, shape)
        store_checked(self, "is_usable", bool, shape[:1])

    def __getitem__(self, steps: slice | BoolArray) -> Observations:
        """Return the observations of the steps of a slice or a mask [P]."""
        return Observations(
            self.frames[steps],
            self.greys[steps],
            self.is_usable[steps],
            self.intrinsics,
        )

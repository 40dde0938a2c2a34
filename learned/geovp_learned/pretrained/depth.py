"""A network for the depth of single images as a depth source."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import cv2
import numpy as np

from geovp_classic.depth.relative_depth import DepthAlignment, DepthValues, inverse_of, metric
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Context, FloatArray, PrivilegedInput, Trajectory
from geovp_learned.checkpoints import UNKNOWN_ORIGIN


@dataclass(frozen=True, kw_only=True)
class NetworkDepth(ABC):
    """Depth of observed frames by a network that sees one image at a time.

    Relative output is aligned with multi-view depth; without `align` it must be in metres.
    """

    # Steps to estimate, counted from the end when negative
    frames: tuple[int, ...] = (-1,)
    values: DepthValues = "inverse-depth"  # of the network's output
    align: bool = True
    alignment: DepthAlignment = field(default_factory=DepthAlignment)
    device: str = "cpu"

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the alignment."""
        return self.alignment.needs if self.align else PrivilegedInput.NONE

    @abstractmethod
    def predict(self, frames: ByteArray) -> FloatArray:
        """Return the network's output [N, H', W'] for frames [N, H, W, 3]."""

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth [P, H, W] and confidence [P, H, W], 0 for other frames.

        Raises Incompatible if metric depth meets poses that are not metric.
        """
        num_past, height_px, width_px, _ = context.frames.shape
        if not all(-num_past <= frame < num_past for frame in self.frames):
            raise BadData(
                f"frames {self.frames} of {num_past} observed ones: choose from -{num_past} to -1"
            )
        steps = list(self.frames)
        maps = np.full((num_past, height_px, width_px), np.nan, np.float32)
        output = self.predict(context.frames[steps])
        for step, values in zip(steps, inverse_of(output, self.values), strict=True):
            maps[step] = cv2.resize(values, (width_px, height_px))
        if self.align:
            return self.alignment.align(maps, context.only(self.needs), past)
        return metric(maps, past)


def note_on_weights(weights: str, device: str) -> str:
    """Describe the weights of a network from elsewhere in a note below tables."""
    return f"{weights} on {device}; {UNKNOWN_ORIGIN}"

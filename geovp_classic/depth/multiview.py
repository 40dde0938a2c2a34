"""Depth from the observed frames and where the camera was: what the past alone tells about the shape of the street."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.depth import matching, viewpoints
from geovp_classic.depth.sweep import sweep
from geovp_classic.errors import BadData
from geovp_classic.types import Context, FloatArray, Grant, Trajectory


@dataclass(frozen=True)
class Multiview:
    """Plane sweep over the observed frames with the given poses, in whatever unit these have."""

    frames: tuple[int, ...] = (-1,)  # steps whose depth is wanted, counted from the end when negative
    num_planes: int = 48

    def __post_init__(self) -> None:
        """Raise BadData for settings that give no depth."""
        if not self.frames or self.num_planes < 4:
            given = f"frames {self.frames} and num_planes {self.num_planes}"
            raise BadData(f"multiview: {given}, expected at least one frame and at least 4 planes")

    @property
    def needs(self) -> Grant:
        """Nothing beyond the frames."""
        return Grant.NONE

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Inverse depth [P, H, W] and confidence [P, H, W], float32; both are 0 for frames that are not wanted."""
        pictures = np.stack([matching.grey(frame) for frame in context.frames])
        inverse_depths, confidence = np.zeros((2, *pictures.shape), np.float32)
        for step in self._wanted(context.num_past):
            sources = viewpoints.choose_sources(past.world_from_cam, step, context.intrinsics)
            if sources:
                swept = sweep(pictures, context.intrinsics, past.world_from_cam, step, sources, self.num_planes)
                inverse_depths[step] = swept.inverse_depth
                confidence[step] = np.clip(1 - swept.cost, 0, 1)
        return inverse_depths, confidence

    def _wanted(self, num_past: int) -> list[int]:
        """The wanted steps as 0..P-1; BadData when there is no such step."""
        if not all(-num_past <= frame < num_past for frame in self.frames):
            raise BadData(f"multiview: frames {self.frames} of {num_past} observed ones: choose from -{num_past} to -1")
        return sorted({frame % num_past for frame in self.frames})

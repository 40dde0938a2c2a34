"""Renderers that begin with a depth source: depth and rendering, rooms on one floor, meet here and only here."""

from __future__ import annotations

from dataclasses import dataclass, field

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.interfaces import DepthSource, Fill
from geovp_classic.render import fusion, surface
from geovp_classic.render.fill import NearestBackground
from geovp_classic.types import Context, Grant, Trajectory


@dataclass(frozen=True)
class DepthFusion:
    """All observed frames as one cloud of patches; holes are filled, magnified surfaces get their grain back."""

    depth: DepthSource = field(default_factory=Multiview)
    fill: Fill = field(default_factory=NearestBackground)
    num_frames: int = 10  # how many of the last observed frames are used
    crack_px: int = 2  # gaps up to about twice this width are closed between surfaces, not invented
    agreement: float = 0.1  # two inverse depths are of one surface when they differ by less than this share
    grain: float = 1.0  # strength of the borrowed detail; 0 leaves magnified surfaces blurred

    def __post_init__(self) -> None:
        """Raise BadData for settings that make no sense."""
        if self.num_frames < 1:
            raise BadData(f"num_frames is {self.num_frames}, expected 1 or more observed frames to use")
        if not (0 < self.agreement < 1 and self.crack_px >= 0 and self.grain >= 0):
            raise BadData("agreement must lie between 0 and 1, crack_px and grain must not be negative")

    @property
    def needs(self) -> Grant:
        """What the depth source needs."""
        return self.depth.needs

    def reconstruct(self, context: Context, past: Trajectory) -> fusion.CloudScene:
        """The fused cloud of the last `num_frames` frames, in the world frame and the unit of the past."""
        recent, past = context.only(self.depth.needs).recent(self.num_frames), past[-self.num_frames :]
        inverse_depths, confidence = self.depth.inverse_depths(recent, past)
        sources = [
            surface.Source(frame, recent.intrinsics, pose)
            for frame, pose in zip(recent.frames, past.world_from_cam, strict=True)
        ]
        cloud, used = fusion.fuse(sources, inverse_depths, confidence, self.agreement)
        return fusion.CloudScene(cloud, used, self.fill, self.crack_px, self.grain)

"""Fusion in a truncated signed distance volume: in its own file, because it alone needs Open3D."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import DepthSource, Inpainter
from geovp_classic.observation import observations_of
from geovp_classic.observation import recent as recent_frames
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.rendering.source import Source
from geovp_classic.rendering.volume import VolumeScene, VolumeSettings
from geovp_classic.types import Context, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class VolumeFusion:
    """All observed frames in one truncated signed distance volume that is ray-cast (Curless & Levoy
    1996).

    Depths are in median depths of the last frame, so that any unit of the poses will do. Surfaces
    are averaged over frames and smooth over voxels; colours are the last frame's where it shows
    them, else the voxels'. Open3D's threads take blocks in any order: up to one pixel in ten
    thousand differs from run to run.
    """

    depth: DepthSource = Multiview()
    inpainter: Inpainter = DetailTransfer()
    volume: VolumeSettings = VolumeSettings()
    num_frames: int = 10  # the last usable ones: one second at KITTI's 10 Hz
    # Relative; the last frame shows a surface up to this difference of inverse depths. Set by hand,
    # three times that of depth fusion: voxels move surfaces.
    max_depth_difference: float = 0.3
    # Up to which gaps in a column are closed. Set by hand: six voxels at the median depth.
    gap_px: int = 16

    def __post_init__(self) -> None:
        if self.num_frames < 1:
            raise BadData(f"num_frames is {self.num_frames}, expected 1 or more observed frames")
        if not 0 < self.max_depth_difference < 1:
            raise BadData(
                f"max_depth_difference is {self.max_depth_difference}, expected a fraction "
                "between 0 and 1"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """Return the privileged inputs of the depth source."""
        return self.depth.needs

    @single_threaded_blas
    def reconstruct(self, context: Context, past: Trajectory) -> VolumeScene:
        """Return the volume of the last frames, in the world frame and the unit of the past."""
        recent, past = recent_frames(context.only(self.needs), past, "crop", self.num_frames)
        inverse_depths, confidence = self.depth.inverse_depths(recent, past)
        is_known = confidence > 0
        is_known[-1] = True  # the last frame's depth map has no holes
        mask = observations_of(recent, "crop").mask
        if mask is not None:
            is_known &= ~mask
        poses = past.world_from_cam
        volume = self.volume.integrate(
            recent.frames, inverse_depths, is_known, recent.intrinsics, poses
        )
        last = Source(recent.frames[-1], recent.intrinsics, poses[-1])
        last_depth = inverse_depths[-1].astype(np.float32)
        return VolumeScene(
            volume,
            last,
            last_depth,
            self.max_depth_difference,
            self.gap_px,
            self.inpainter,
        )

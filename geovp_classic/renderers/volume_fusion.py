"""The renderer by a truncated signed distance volume: a module of its own, because it alone needs
Open3D.
"""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import DepthSource, Inpainter
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.rendering import patches, volume
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

    depth: DepthSource = field(default_factory=Multiview)
    inpainter: Inpainter = field(default_factory=DetailTransfer)
    num_frames: int = 10  # how many of the last observed frames are used
    voxel_px: float = 2.5  # the edge of a voxel, as seen at the median depth
    reach: float = 5.0  # surfaces farther away lie on a far plane
    # a surface is what the last frame shows when inverse depths differ by at most this share
    agreement: float = 0.3

    def __post_init__(self) -> None:
        if self.num_frames < 1:
            raise BadData(
                f"num_frames is {self.num_frames}, expected 1 or more observed frames to use"
            )
        if not (0 < self.agreement < 1 and 0 < self.reach < 2 * self.voxel_px + 1):
            given = f"agreement {self.agreement}, voxel_px {self.voxel_px} and reach {self.reach}"
            raise BadData(
                f"{given}: agreement must lie between 0 and 1, reach between 0 and 2 voxel_px + 1"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """What the depth source needs."""
        return self.depth.needs

    @single_threaded_blas
    def reconstruct(self, context: Context, past: Trajectory) -> volume.VolumeScene:
        """The volume of the last `num_frames` frames, in the world frame and the unit of
        the past.
        """
        recent, past = (
            context.only(self.depth.needs).recent(self.num_frames),
            past[-self.num_frames :],
        )
        inverse_depths, confidence = self.depth.inverse_depths(recent, past)
        known = confidence > 0
        known[-1] = True  # the last frame keeps all its pixels, as completed
        filled = volume.integrate(
            recent.frames,
            inverse_depths,
            known,
            recent.intrinsics,
            past.world_from_cam,
            self.voxel_px,
            self.reach,
        )
        last = patches.Source(recent.frames[-1], recent.intrinsics, past.world_from_cam[-1])
        return volume.VolumeScene(
            filled, last, inverse_depths[-1].astype(np.float32), self.agreement, self.inpainter
        )

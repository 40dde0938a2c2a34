"""Renderers with a depth source: packages `depth`, `dynamic_objects` and `render` meet here and
only here.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.dynamic_objects import sprites as moving_sprites
from geovp_classic.dynamic_objects.detection import DynamicObjects
from geovp_classic.errors import BadData
from geovp_classic.geometry.ground_plane import fit_ground
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import DepthSource, Inpainter, Scene
from geovp_classic.observation import recent as recent_frames
from geovp_classic.observation import stream
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.rendering import fusion, patches
from geovp_classic.rendering.exposure import ExposedScene, Exposure, ExposureControl
from geovp_classic.rendering.standing import StandingScene
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class DepthFusion:
    """All observed frames as one cloud of patches; holes are filled, detail is transferred to
    magnified surfaces.
    """

    depth: DepthSource = field(default_factory=Multiview)
    inpainter: Inpainter = field(default_factory=DetailTransfer)
    frames: Literal["crop", "full"] = "crop"  # wide: the uncropped ones, in full resolution
    num_frames: int = 10  # how many of the last observed frames are used
    crack_px: int = 3  # gaps between surfaces up to about twice this width are closed, not filled
    agreement: float = 0.1  # largest relative difference of inverse depths of one surface
    detail_strength: float = 1.0  # of the transferred detail; 0 leaves magnified surfaces blurred
    dynamic_objects: DynamicObjects | None = field(
        default_factory=DynamicObjects
    )  # None: they are rendered as static
    exposure: ExposureControl | None = field(
        default_factory=ExposureControl
    )  # None: it stays as it was last

    def __post_init__(self) -> None:
        if self.frames not in ("crop", "full"):
            raise BadData(f"frames is {self.frames!r}, expected 'crop' or 'full'")
        if self.num_frames < 1:
            raise BadData(
                f"num_frames is {self.num_frames}, expected 1 or more observed frames to use"
            )
        if not (0 < self.agreement < 1 and self.crack_px >= 0 and self.detail_strength >= 0):
            raise BadData(
                "agreement must lie between 0 and 1, crack_px and detail_strength must not be "
                "negative"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """What the depth source needs, and the uncropped frames when they are asked for."""
        return self.depth.needs | (
            PrivilegedInput.FULL_FRAMES if self.frames == "full" else PrivilegedInput.NONE
        )

    @single_threaded_blas
    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The fused cloud of the last `num_frames` frames, in the world frame and the unit of the
        past.
        """
        recent, past = self._recent(context, past)
        inverse_depths, confidence = self.depth.inverse_depths(recent, past)
        since_s, last_s = past.times_s - past.times_s[-1], float(past.times_s[-1])
        moving = self._sprites(recent, past, inverse_depths[-1])
        inverse_depths, confidence, cut = moving_sprites.mask_out(
            moving, inverse_depths, confidence, past.world_from_cam, since_s
        )
        details = [None] * len(past) if recent.full is None else recent.full.frames
        sources = [
            patches.Source(frame, recent.intrinsics, pose, detail)
            for frame, pose, detail in zip(recent.frames, past.world_from_cam, details, strict=True)
        ]
        exposure = Exposure.of(sources, inverse_depths[-1], since_s)
        cloud, used = fusion.fuse(
            exposure.match(sources), inverse_depths, confidence, self.agreement
        )
        static = fusion.remove_masked(cloud, 0, cut[-1])
        scene: Scene = fusion.CloudScene(
            static, used, self.inpainter, self.crack_px, self.detail_strength
        )
        if self.frames == "full" and not moving:
            crop = context.frames[np.abs(context.times_s[: context.num_past] - last_s).argmin()]
            place = patches.Source(crop, context.intrinsics, past.world_from_cam[-1])
            scene = StandingScene(scene, place, float(np.max(inverse_depths[-1])))
        scene = moving_sprites.DynamicScene(scene, moving, last_s) if moving else scene
        if self.exposure is None:
            return scene
        return ExposedScene(
            scene, sources[-1], exposure, self.exposure, last_s, whole=self.frames == "full"
        )

    def sprites(self, context: Context, past: Trajectory) -> tuple[moving_sprites.Sprite, ...]:
        """The dynamic objects of the last frame, as the scene renders them; in the unit of the
        past.
        """
        recent, past = self._recent(context, past)
        return self._sprites(recent, past, self.depth.inverse_depths(recent, past)[0][-1])

    def _recent(self, context: Context, past: Trajectory) -> tuple[Context, Trajectory]:
        return recent_frames(context.only(self.needs), past, self.frames, self.num_frames)

    def _sprites(
        self, recent: Context, past: Trajectory, inverse_depth: FloatArray
    ) -> tuple[moving_sprites.Sprite, ...]:
        if self.dynamic_objects is None:
            return ()
        images = stream(recent, "crop").greys.astype(np.float32)
        camera, ground = recent.intrinsics, fit_ground(inverse_depth, recent.intrinsics)
        found = self.dynamic_objects.find(images, camera, past, inverse_depth, ground)
        taken = camera, past.world_from_cam[-1]
        return tuple(
            moving_sprites.Sprite(recent.frames[-1], one.mask, *taken, one.depth, one.velocity)
            for one in found
        )

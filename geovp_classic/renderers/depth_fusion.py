"""Depth fusion: `depth` and `rendering` meet here and only here."""

from dataclasses import dataclass

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import DepthSource, Inpainter, Scene
from geovp_classic.layers.ground import GroundFit
from geovp_classic.layers.moving_regions import MovingRegions
from geovp_classic.observation import ImageStream, observations_of, recent, stream_needs
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.rendering import fusion
from geovp_classic.rendering.exposure import ExposedScene, ExposureControl, ExposureEstimator
from geovp_classic.rendering.layered_scene import LayeredScene
from geovp_classic.rendering.magnified_detail import MagnifiedDetail
from geovp_classic.rendering.patches import PatchModel
from geovp_classic.rendering.source import Source
from geovp_classic.types import Context, PrivilegedInput, Trajectory
from geovp_classic.types.layers import MovingPatch


@dataclass(frozen=True)
class DepthFusion:
    """All observed frames as one cloud of patches; holes are inpainted, and detail is transferred
    to magnified surfaces.
    """

    depth: DepthSource = Multiview()
    inpainter: Inpainter = DetailTransfer()
    # full: the uncropped ones, with all their detail
    frames: ImageStream = "crop"
    num_frames: int = 10  # the last usable ones: one second at KITTI's 10 Hz
    # Gaps up to twice this width between surfaces are closed, not inpainted. Chosen on train, val.
    crack_px: int = 3
    # Of a view; with less it is the last frame, not inpainted. Chosen on KITTI's train and val, by
    # LPIPS and the look of the views.
    min_covered_fraction: float = 0.2
    # Relative, of inverse depths of one surface in two frames. Set by hand.
    max_depth_difference: float = 0.1
    patch_model: PatchModel = PatchModel()
    # None: magnified surfaces stay blurred.
    detail: MagnifiedDetail | None = MagnifiedDetail()
    exposure_estimator: ExposureEstimator = ExposureEstimator()
    # None: the exposure stays that of the last frame.
    exposure: ExposureControl | None = ExposureControl()

    # None: no surface is taken for the ground.
    ground: GroundFit | None = GroundFit()
    # None: everything is taken for a part of the static scene.
    moving: MovingRegions | None = MovingRegions()

    def __post_init__(self) -> None:
        if self.num_frames < 1:
            raise BadData(f"num_frames is {self.num_frames}, expected 1 or more observed frames")
        if not 0 <= self.min_covered_fraction <= 1:
            raise BadData(
                f"min_covered_fraction is {self.min_covered_fraction}, expected from 0 to 1"
            )
        if not (0 < self.max_depth_difference < 1 and self.crack_px >= 0):
            raise BadData(
                f"max_depth_difference is {self.max_depth_difference} and crack_px "
                f"{self.crack_px}, expected a fraction between 0 and 1 and pixels of 0 or more"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """Return the privileged inputs of the depth source, and uncropped frames if used."""
        return self.depth.needs | stream_needs(self.frames)

    @single_threaded_blas
    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """Return the fused cloud of the last frames, in the world frame and unit of the past."""
        context, past = recent(context.only(self.needs), past, self.frames, self.num_frames)
        last_s = float(past.times_s[-1])

        inverse_depths, confidence = self.depth.inverse_depths(context, past)
        observed = observations_of(context, "crop")
        exposure = self.exposure_estimator.estimate(
            observed.greys, context.intrinsics, past, inverse_depths[-1]
        )

        # One cloud of all frames, each with its own image.
        is_known = confidence > 0
        is_known[-1] = True  # the last frame's depth map has no holes
        is_known &= ~observed.mask
        # What moves on its own is no part of it.
        patches: list[MovingPatch] = []
        ground = None
        if self.ground is not None:
            ground = self.ground.inverse_depths(inverse_depths[-1], confidence[-1])
        if self.moving is not None:
            patches = self.moving.detect(
                observed.greys, past, context.intrinsics, inverse_depths[-1], ground
            )
        for patch in patches:
            is_known[-1] &= ~patch.mask
        # Uncropped frames are rendered at their own resolution.
        frames = context.frames if context.full is None else context.full.frames
        sources = [
            Source(frame, context.intrinsics, pose)
            for frame, pose in zip(frames, past.world_from_cam, strict=True)
        ]
        cloud, used = fusion.fuse(
            sources,
            inverse_depths,
            is_known,
            self.max_depth_difference,
            self.patch_model,
        )
        # All images as bright as the last one.
        matched = [exposure.match(sources[step], step) for step in used]

        scene: Scene = fusion.CloudScene(
            cloud,
            matched,
            self.patch_model,
            self.inpainter,
            self.detail,
            self.crack_px,
            self.min_covered_fraction,
        )
        if patches:
            scene = LayeredScene(scene, sources[-1], last_s, patches)
        if self.exposure is not None:
            is_whole = self.frames == "full"
            scene = ExposedScene(scene, sources[-1], exposure, self.exposure, last_s, is_whole)
        return scene

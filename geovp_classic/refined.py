"""Refined motion: a pose source and corrections from the images; packages `depth` and `pose_refinement` meet here."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.geometry import frame_screening, se3, wide_frames
from geovp_classic.geometry.ground_plane import fit_ground
from geovp_classic.interfaces import DepthSource, PoseRefinement, PoseSource
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.pose_refinement.nonholonomic import NonholonomicConstraint
from geovp_classic.pose_refinement.registration import Registration
from geovp_classic.pose_refinement.road_height import RoadProfile
from geovp_classic.pose_refinement.rotation_drift import RotationDrift
from geovp_classic.pose_refinement.unmeasured_intervals import UnmeasuredIntervals
from geovp_classic.types import Context, Grant, Motion


@dataclass(frozen=True)
class RoadHeight:
    """Future positions moved towards their height above the road that the last observed frame shows."""

    depth: DepthSource = field(default_factory=Multiview)  # the renderer's, so that it is computed once
    frames: Literal["crop", "wide"] = "crop"
    num_frames: int = 10

    @property
    def needs(self) -> Grant:
        """What the depth source needs, and the uncropped frames when they are asked for."""
        return self.depth.needs | (Grant.WIDE_FRAMES if self.frames == "wide" else Grant.NONE)

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion with other future heights; unchanged where no road is visible."""
        recent = wide_frames.select(context.only(self.needs), self.frames).recent(self.num_frames)
        recent, past = frame_screening.screened(recent, motion.past[-self.num_frames :])
        inverse_depth = self.depth.inverse_depths(recent, past)[0][-1]
        ground = fit_ground(inverse_depth, recent.intrinsics)
        if ground is None:
            return motion
        profile = RoadProfile.of(inverse_depth, recent.intrinsics, ground)
        world_from_last = past.world_from_cam[-1]
        last_from_cam = se3.inverse(world_from_last) @ motion.futures
        futures = np.stack([profile.correct_heights(future) for future in last_from_cam])
        return motion.refined(motion.past, world_from_last @ futures)


def _defaults() -> tuple[PoseRefinement, ...]:
    return Registration(), UnmeasuredIntervals(), RotationDrift(), NonholonomicConstraint(), RoadHeight()


@dataclass(frozen=True)
class Refined:
    """A pose source whose motion is refined, by one refinement after the other; the default chain won on `val`."""

    source: PoseSource
    refinements: tuple[PoseRefinement, ...] = field(default_factory=_defaults)

    @property
    def needs(self) -> Grant:
        """What the source and the refinements need."""
        needs = self.source.needs
        for refinement in self.refinements:
            needs |= refinement.needs
        return needs

    @single_threaded_blas
    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The refined motion; each part sees only what it was granted of the context."""
        motion = self.source.estimate(context.only(self.source.needs), num_samples)
        for refinement in self.refinements:
            motion = refinement.refine(context.only(refinement.needs), motion)
        return motion

"""Refinement of future heights by the road of the last observed frame; it combines depth and pose
refinement.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geovp_classic import observation
from geovp_classic.depth.multiview import Multiview
from geovp_classic.geometry import se3
from geovp_classic.geometry.ground_plane import GroundFit
from geovp_classic.interfaces import DepthSource
from geovp_classic.pose_refinement.road_height import RoadProfile
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class RoadHeight:
    """Future positions moved towards their height above the road that the last observed frame
    shows.
    """

    depth: DepthSource = field(
        default_factory=Multiview
    )  # the renderer's: it is computed once
    frames: Literal["crop", "full"] = "crop"
    num_frames: int = 10
    ground: GroundFit = field(default_factory=GroundFit)
    profile: RoadProfile = field(default_factory=RoadProfile)

    @property
    def needs(self) -> PrivilegedInput:
        """Return what the depth source needs, and the uncropped frames if they are used."""
        full = (
            PrivilegedInput.FULL_FRAMES
            if self.frames == "full"
            else PrivilegedInput.NONE
        )
        return self.depth.needs | full

    def refine(self, context: Context, motion: Motion) -> Motion:
        """Return the motion with other future heights; unchanged where no road is visible."""
        recent, past = observation.recent(
            context.only(self.needs), motion.past, self.frames, self.num_frames
        )
        inverse_depth = self.depth.inverse_depths(recent, past)[0][-1]
        ground = self.ground.fit(inverse_depth, recent.intrinsics)
        if ground is None:
            return motion
        points = self.profile.points(inverse_depth, recent.intrinsics, ground)
        world_from_last = past.world_from_cam[-1]
        last_from_cam = se3.inverse(world_from_last) @ motion.futures
        futures = np.stack(
            [
                self.profile.correct_heights(future, points, ground)
                for future in last_from_cam
            ]
        )
        return motion.refined(motion.past, world_from_last @ futures)

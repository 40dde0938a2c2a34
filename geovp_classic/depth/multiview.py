"""Multi-view depth from the observed frames and their poses.

Forward motion leaves no parallax around its own direction, the epipole: the longest baseline
decides there, the neighbours help, and pixels without any evidence come out far and uncertain.
"""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.depth import viewpoints
from geovp_classic.depth.sweep import TALL_PX, GroundPrior, sweep
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.observation import stream
from geovp_classic.types import Context, FloatArray, Observations, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class LevelRoad:
    """A level road at the recorded camera height, for frames without parallax."""

    def inverse_depth(self, context: Context, past: Trajectory) -> FloatArray:
        """Inverse depth [H, W] of the road, 0 above its horizon; Incompatible without a height or
        without metres.
        """
        if context.camera_height_m is None or not past.is_metric:
            raise Incompatible(
                "a level road needs a recorded camera height and metric poses: leave level_road out"
            )
        road = GroundPlane(np.array([0.0, 1.0, 0.0]), context.camera_height_m)
        return np.maximum(road.inverse_depth(context.intrinsics), 0)


@dataclass(frozen=True)
class Multiview:
    """Plane sweep (Collins 1996) over the observed frames with the given poses, in whatever unit
    these have.

    Where the camera stood still or only turned, nothing is known: confidence is 0 everywhere and
    all is infinitely far, or lies on a level road where one is given.
    """

    frames: tuple[int, ...] = (
        -1,
    )  # steps whose depth is wanted, counted from the end when negative
    num_planes: int = (
        96  # of a sweep over images of up to TALL_PX rows; over taller ones proportionally more
    )
    ground: GroundPrior | None = field(default_factory=GroundPrior)  # None: no prior
    level_road: LevelRoad | None = None  # where there is no parallax

    def __post_init__(self) -> None:
        if not self.frames or self.num_planes < 4:
            given = f"frames {self.frames} and num_planes {self.num_planes}"
            raise BadData(f"multiview: {given}, expected at least one frame and at least 4 planes")

    @property
    def needs(self) -> PrivilegedInput:
        """Nothing beyond the frames, unless the camera's height is asked for."""
        return PrivilegedInput.NONE if self.level_road is None else PrivilegedInput.CAMERA_HEIGHT

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Inverse depth [P, H, W] and confidence [P, H, W], float32; both are 0 for frames that are
        not wanted.

        BadData when a wanted frame was not observed.
        """
        count = len(context.frames)
        if not all(-count <= frame < count for frame in self.frames):
            raise BadData(
                f"multiview: frames {self.frames} of {count} observed ones: choose from "
                f"-{count} to -1"
            )
        still = None if self.level_road is None else self.level_road.inverse_depth(context, past)
        observations = stream(context, "crop")
        inverse_depths, confidence = np.zeros((2, *context.frames.shape[:3]), np.float32)
        for step in {frame % count for frame in self.frames}:
            depth_map = self._depth_map(observations, past.world_from_cam, step)
            if depth_map is not None:
                inverse_depths[step], confidence[step] = depth_map
            elif still is not None:
                inverse_depths[step] = still
        return inverse_depths, confidence

    def _depth_map(
        self, observations: Observations, world_from_cam: FloatArray, step: int
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return inverse depth and confidence [H, W] of a frame; None without any parallax."""
        camera = observations.intrinsics
        used = [step, *viewpoints.choose_sources(world_from_cam, step, camera)]
        if len(used) == 1:
            return None
        poses = world_from_cam[used]
        key = (self, tuple(used), len(world_from_cam), *poses.ravel().tolist())
        if key not in observations.depth_maps:
            images = observations.greys[used].astype(np.float32)
            num_planes = round(self.num_planes * max(1, camera.height_px / TALL_PX))
            observations.depth_maps[key] = sweep(
                images, camera, poses, 0, range(1, len(used)), num_planes, self.ground
            )
        return observations.depth_maps[key]

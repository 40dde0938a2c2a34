"""Poses of images relative to keyframes: they improve with their keyframe, and are final once it is
fixed.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.odometry.resection import resect
from geovp_classic.odometry.windowed_map import WindowedMap
from geovp_classic.types import BoolArray, FloatArray, IntArray

MIN_INLIERS = 12  # that a pose rests on
MAX_PENDING = 60  # images whose poses may still change


@dataclass(frozen=True)
class Observations:
    """Pixels of the active tracks in one image."""

    track_ids: IntArray  # [M]
    pixels: FloatArray  # [M, 2]
    inliers: BoolArray  # [M]


@dataclass
class RelativePose:
    """One image's pose relative to a keyframe."""

    keyframe_id: int
    keyframe_from_cam: FloatArray  # [4, 4]
    tracked: bool
    observations: Observations | None  # of an image that waits for the map to start


class RelativePoses:
    """The images of one camera in their order: pending ones first relative to a map's keyframes,
    then final.
    """

    def __init__(self, keyframes: WindowedMap) -> None:
        self.map = keyframes
        self._pending: list[RelativePose] = []
        self._final: list[tuple[FloatArray, bool]] = []

    def add(
        self, world_from_cam: FloatArray, tracked: bool, observations: Observations | None
    ) -> None:
        """Add an image at a pose [4, 4], relative to the newest keyframe; without one the pose is
        final.
        """
        if len(self.map) == 0:
            self._final.append((world_from_cam, tracked))
            return
        waiting = None if self.map.triangulated.any() else observations
        keyframe_from_cam = self.map.cam_from_world[-1] @ world_from_cam
        self._pending.append(
            RelativePose(self.map.newest_keyframe_id, keyframe_from_cam, tracked, waiting)
        )
        while len(self._pending) > MAX_PENDING:  # the camera stands, and there are no new keyframes
            self._finish_first()

    def finish(self, keyframe_id: int) -> None:
        """Make poses relative to keyframes before this one final."""
        while self._pending and self._pending[0].keyframe_id < keyframe_id:
            self._finish_first()

    def take_final(self) -> tuple[FloatArray, BoolArray]:
        """Final poses [T, 4, 4] and marks of tracked ones [T] since the last call."""
        final, self._final = self._final, []
        poses = np.array([pose for pose, _ in final]).reshape(-1, 4, 4)
        return poses, np.array([tracked for _, tracked in final], dtype=bool)

    def take_waiting(self) -> list[tuple[FloatArray, bool, Observations]]:
        """Remove the images that wait for the map to start: what `add` takes of each."""
        waiting = [
            (self._pose(one), one.tracked, one.observations)
            for one in self._pending
            if one.observations is not None
        ]
        self._pending = [one for one in self._pending if one.observations is None]
        return waiting

    def localise_waiting(self, seed: int) -> None:
        """Localise the waiting images in the map, which has just started."""
        for one in self._pending:
            if one.observations is None:
                continue
            index = self.map.index_of(one.observations.track_ids)
            use = one.observations.inliers & (index >= 0)
            use[use] = self.map.triangulated[index[use]]
            keyframe = self.map.cam_from_world[one.keyframe_id - self.map.first_keyframe_id]
            guess = se3.inverse(one.keyframe_from_cam) @ keyframe
            rays = self.map.lens.rays(one.observations.pixels[use])
            pose, inliers = resect(self.map.points[index[use]], rays, guess, self.map.noise, seed)
            if inliers.sum() >= MIN_INLIERS:
                one.keyframe_from_cam = keyframe @ se3.inverse(pose)
            one.observations = None

    def _finish_first(self) -> None:
        first = self._pending.pop(0)
        self._final.append((self._pose(first), first.tracked))

    def _pose(self, pending: RelativePose) -> FloatArray:
        """The current world_from_cam [4, 4]."""
        keyframe = self.map.cam_from_world[max(0, pending.keyframe_id - self.map.first_keyframe_id)]
        return se3.inverse(keyframe) @ pending.keyframe_from_cam

"""A scene behind letterbox bars, the ego vehicle and a followed vehicle, which views show again."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.interfaces import Scene
from geovp_classic.observation.followed_vehicle import FollowedVehicle
from geovp_classic.observation.observe import back_fractions
from geovp_classic.observation.scene_mask import scene_window
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Views,
)


@dataclass(frozen=True)
class MaskedScene:
    """A scene with the last frame's non-scene pixels in front of it."""

    scene: Scene
    context: Context  # as it was given
    mask: BoolArray  # [H, W], non-scene pixels of its frames
    vehicle: FollowedVehicle | None  # within the scene window of the mask

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4]; only the scene for any other camera."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if intrinsics != self.context.intrinsics:
            return views
        last = self.context.frames[-1]
        frames = np.where(self.mask[..., None], last, views.frames)
        covered = views.covered | self.mask
        if self.vehicle is not None:
            self._add_vehicle(self.vehicle, times_s, frames, covered)
        return Views(frames, covered, views.depths)

    def _add_vehicle(
        self,
        vehicle: FollowedVehicle,
        times_s: FloatArray,
        frames: ByteArray,
        covered: BoolArray,
    ) -> None:
        """Draw the followed vehicle into frames [F, H, W, 3], where its motion takes it."""
        rows, columns = scene_window(self.mask)
        last = np.ascontiguousarray(self.context.frames[-1][rows, columns])
        outline = vehicle.mask.astype(np.uint8)
        first_s = float(self.context.times_s[0])
        last_s = float(self.context.times_s[self.context.num_past - 1])
        for step, fraction in enumerate(
            back_fractions(times_s, first_s, last_s)
        ):
            is_shown = vehicle.moved(outline, fraction) > 0
            frames[step, rows, columns][is_shown] = vehicle.moved(
                last, fraction
            )[is_shown]
            covered[step, rows, columns] |= is_shown

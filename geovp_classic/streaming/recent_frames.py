"""The last usable frames of a stream."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geovp_classic.observation import Observed, observations_of
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import BoolArray, ByteArray, Context, Intrinsics, Observations

Status = Literal["used", "duplicate", "blank", "late", "restarted"]


@dataclass(frozen=True)
class Frame:
    """An image of the camera, and when it was taken."""

    image: ByteArray  # [H, W, 3]
    time_s: float


class RecentFrames:
    """The last usable frames of a camera, which are observed together."""

    observed: Observed  # the frames

    def __init__(
        self,
        predictor: GeometricPredictor,
        camera: Intrinsics,
        height_m: float | None,
        num_frames: int,  # that are remembered
    ) -> None:
        self.frames: list[Frame] = []
        self._predictor = predictor
        self._camera = camera
        self._height_m = height_m
        self._num_frames = num_frames

    @property
    def observations(self) -> Observations:
        """Return what was observed in the frames [P]."""
        return observations_of(self.observed.context, "crop")

    def add(self, frame: Frame) -> Status:
        """Remember a frame if it shows something new; after a cut, forget those before."""
        self._observe([*self.frames, frame][-self._num_frames :])
        is_usable = self.observations.is_usable
        # Of two frames, the screening keeps a blank one, too
        min_contrast = self._predictor.observer.screening.min_contrast
        is_blank = self.observations.greys[-1].std() <= min_contrast
        if is_blank or not is_usable[-1]:
            self.frames = self.frames[:-1]
            return "blank" if is_blank else "duplicate"
        if is_usable.all():
            return "used"
        self.keep(is_usable)
        return "restarted"

    def keep(self, is_kept: BoolArray | slice) -> None:
        """Forget the other frames [P]."""
        numbers = np.arange(len(self.frames))[is_kept]
        self._observe([self.frames[number] for number in numbers])

    def _observe(self, frames: list[Frame]) -> None:
        """Replace the frames and what was observed in them."""
        times_s = [frame.time_s for frame in frames]
        context = Context(
            frames=np.stack([frame.image for frame in frames]),
            times_s=np.array([*times_s, times_s[-1] + 1]),  # of one future frame, at any time
            intrinsics=self._camera,
            camera_height_m=self._height_m,
        )
        self.observed = self._predictor.observe(context)
        self.frames = frames

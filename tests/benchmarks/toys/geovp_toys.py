"""Components small enough that one knows what comes out; those with a `log` append a line to it
when they work.
"""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from geovp_classic.errors import BadData, Incompatible, MissingExtra
from geovp_classic.geometry import pinhole
from geovp_classic.types import (
    Clip,
    Context,
    Intrinsics,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)

INTERVAL_S = 0.1


def note(log: str, line: str) -> None:
    if log:
        with Path(log).open("a") as file:
            file.write(line + "\n")


@dataclass(frozen=True)
class Road:
    """Grey frames; the one of step t of clip c has the brightness 10 c + t. The camera goes 1 m a
    step.
    """

    clips: int = 5
    root: str = ""
    with_depths: bool = False
    broken_clip: int = -1
    num_frames: int = 5
    stride: int = 1
    size_px: tuple[int, int] = (8, 8)

    @property
    def name(self) -> str:
        return "toy-road"

    @property
    def clip_names(self) -> tuple[str, ...]:
        return tuple(f"road/{index:03d}" for index in range(self.clips))

    def __len__(self) -> int:
        return self.clips

    def __getitem__(self, index: int) -> Clip:
        if index == self.broken_clip:
            raise BadData(f"road/{index:03d}.png is truncated: fetch it again")
        width_px, height_px = self.size_px
        steps = np.arange(self.num_frames)
        frames = np.broadcast_to(
            (10 * index + steps)[:, None, None, None], (len(steps), height_px, width_px, 3)
        )
        poses = np.tile(np.eye(4), (len(steps), 1, 1))
        poses[:, 2, 3] = index + steps
        depths = np.full(frames.shape[:3], 50.0, np.float32) if self.with_depths else None
        return Clip(
            name=self.clip_names[index],
            frames=frames.astype(np.uint8),
            times_s=INTERVAL_S * steps,
            intrinsics=Intrinsics(
                8.0, 8.0, (width_px - 1) / 2, (height_px - 1) / 2, width_px, height_px
            ),
            trajectory=Trajectory(poses, INTERVAL_S * steps, is_metric=True),
            depths=depths,
        )


@dataclass(frozen=True)
class Steady:
    """The known past, and so many metres a step from there on; sample s goes s times as fast."""

    step_m: float = 1.0
    log: str = ""
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        note(self.log, "estimate")
        assert context.past is not None
        assert (context.future, context.past_depths, context.full) == (None, None, None)
        ahead = np.tile(np.eye(4), (num_samples, context.num_future, 1, 1))
        metres = self.step_m * np.arange(1, context.num_future + 1)
        ahead[..., 2, 3] = np.arange(1, num_samples + 1)[:, None] * metres
        return Motion(
            context.past, context.past.world_from_cam[-1] @ ahead, np.ones(context.num_past, bool)
        )


@dataclass(frozen=True)
class Slide:
    """The last frame from everywhere, its left half invented."""

    log: str = ""
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def reconstruct(self, context: Context, past: Trajectory) -> SlideScene:
        note(self.log, "reconstruct")
        assert context.past is None
        return SlideScene(context.frames[-1])


@dataclass(frozen=True)
class SlideScene:
    frame: np.ndarray

    def view(
        self, world_from_cam: np.ndarray, times_s: np.ndarray, intrinsics: Intrinsics
    ) -> Views:
        size_px = (intrinsics.width_px, intrinsics.height_px)
        frame = pinhole.resize(self.frame, size_px)
        shape = (len(world_from_cam), *frame.shape[:2])
        covered = np.ones(shape, bool)
        covered[:, :, : shape[2] // 2] = False
        return Views(np.broadcast_to(frame, (*shape, 3)), covered, np.ones(shape, np.float32))


@dataclass(frozen=True)
class Still:
    """The last frame; takes its time."""

    sleep_s: float = 0.0
    log: str = ""
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        note(self.log, "predict")
        time.sleep(self.sleep_s)
        return Prediction(np.tile(context.frames[-1], (1, context.num_future, 1, 1, 1)))


@dataclass(frozen=True)
class Fallback(Still):
    """States that clips 0 and 1 of five are shown by image motion, 2 by the last frame."""

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        number = int(context.name.rpartition("/")[2])
        ways = ("image-motion", "image-motion", "last-frame", "geometry", "geometry")
        return replace(super().predict(context), shown_by=ways[number])


@dataclass(frozen=True)
class Noise:
    """Random frames, the same for the same seed; without one, nobody knows them before."""

    seed: int | None = 0
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        shape = (num_samples, context.num_future, *context.frames.shape[1:])
        return Prediction(np.random.default_rng(self.seed).integers(0, 256, shape, dtype=np.uint8))


@dataclass(frozen=True)
class Broken(Still):
    """Fails on a clip whose last observed frame is as bright as this or brighter."""

    brightness: int = 0

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        note(self.log, "predict")
        if context.frames[-1].max() >= self.brightness:
            raise ZeroDivisionError("the road ended")
        return super().predict(context, num_samples)


@dataclass(frozen=True)
class Deadly(Still):
    """Ends its process, or sleeps, on the clip whose last observed frame is as bright as this."""

    brightness: int = 0
    death: str = "kill"

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        if context.frames[-1].max() == self.brightness:
            if self.death == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(1000.0)
        return super().predict(context, num_samples)


@dataclass(frozen=True)
class Needless:
    """Says nothing of what it needs."""

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        return Prediction(np.zeros((1, context.num_future, 8, 8, 3), np.uint8))


@dataclass(frozen=True)
class Picky(Broken):
    """Does not suit such a clip; by default no clip at all."""

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        try:
            return super().predict(context, num_samples)
        except ZeroDivisionError:
            raise Incompatible("picky needs a dark road: give one") from None


@dataclass(frozen=True)
class Difference:
    """The mean absolute difference in grey levels."""

    scale: float = 1.0
    unit: ClassVar[str] = "grey levels"
    higher_is_better: ClassVar[bool] = False
    protocol: ClassVar[str] = "mean over pixels and channels"

    def __call__(
        self, predicted: np.ndarray, target: np.ndarray, mask: np.ndarray | None
    ) -> np.ndarray:
        differences = np.abs(predicted.astype(float) - target).mean(axis=-1) * self.scale
        counted = np.ones(differences.shape, bool) if mask is None else mask
        return np.array(
            [d[m].mean() if m.any() else np.nan for d, m in zip(differences, counted, strict=True)]
        )


@dataclass(frozen=True)
class Weightless:
    """Its weights can never be had, unless a file called `weights` is there; a folder is 0-d."""

    weights: str = ""
    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = False

    def __call__(
        self, predicted: np.ndarray, target: np.ndarray, mask: np.ndarray | None
    ) -> np.ndarray:
        if not self.weights or not Path(self.weights).exists():
            raise MissingExtra("weights of toy-weightless are not here: fetch them")
        return np.zeros(len(target) if Path(self.weights).is_file() else ())


@dataclass(frozen=True)
class Gap:
    """How many metres the predicted camera is ahead of the real one."""

    unit: ClassVar[str] = "m"
    higher_is_better: ClassVar[bool] = False

    def __call__(self, predicted: Trajectory, target: Trajectory) -> np.ndarray:
        return predicted.world_from_cam[:, 2, 3] - target.world_from_cam[:, 2, 3]


@dataclass(frozen=True)
class Brightness:
    """The mean grey level of the last observed and of the last future frame as features."""

    max_samples: int = 2
    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = False
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    def features(self, observed: np.ndarray, future: np.ndarray) -> np.ndarray:
        return np.array([observed[-1].mean(), future[-1].mean()])

"""Clips, and their two parts: what a predictor may see, and the real future."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types import arrays
from geovp_classic.types.arrays import (
    BoolArray,
    ByteArray,
    FloatArray,
    ShortRepr,
    array_of,
    cut,
    rigid,
    store,
)
from geovp_classic.types.motion import Intrinsics, Trajectory
from geovp_classic.types.observations import Observations


class PrivilegedInput(enum.Flag):
    """What a component asks for beyond the protocol's own input; nothing else is shown to it."""

    NONE = 0
    PAST_POSES = enum.auto()
    FUTURE_POSES = enum.auto()
    PAST_DEPTHS = enum.auto()
    CAMERA_HEIGHT = enum.auto()
    FULL_FRAMES = enum.auto()
    RIGHT_FRAMES = enum.auto()


_GRANTED_BY = {  # fields of a context
    "past": PrivilegedInput.PAST_POSES,
    "future": PrivilegedInput.FUTURE_POSES,
    "past_depths": PrivilegedInput.PAST_DEPTHS,
    "camera_height_m": PrivilegedInput.CAMERA_HEIGHT,
    "full": PrivilegedInput.FULL_FRAMES,
    "full_observations": PrivilegedInput.FULL_FRAMES,
    "right": PrivilegedInput.RIGHT_FRAMES,
}


_OF_PAST = (  # fields of a context with a value for each observed frame
    "frames",
    "past",
    "past_depths",
    "full",
    "right",
    "observations",
    "full_observations",
)


@dataclass(frozen=True, repr=False)
class ExtraView(ShortRepr):
    """Another image of the same instants: the uncropped one ("full"), or the right camera's; native
    resolution.
    """

    frames: ByteArray  # [T, H', W', 3]
    intrinsics: Intrinsics
    view_from_cam: FloatArray  # [4, 4]; the identity for the wide image

    def __post_init__(self) -> None:
        store(self, frames=_frames("extra view", self.frames, self.intrinsics))
        store(self, view_from_cam=rigid("view_from_cam", np.asarray(self.view_from_cam)[None])[0])

    def __getitem__(self, steps: slice | BoolArray) -> ExtraView:
        """The steps of a slice or a mask [T]."""
        return replace(self, frames=self.frames[steps].copy())


@dataclass(frozen=True, repr=False)
class Clip(ShortRepr):
    """A short piece of video with all that is known about it, ground truth included."""

    name: str
    frames: ByteArray  # [T, H, W, 3]
    times_s: FloatArray  # [T]
    intrinsics: Intrinsics
    trajectory: Trajectory | None = None  # [T]
    depths: FloatArray | None = None  # [T, H, W] float32 z-depth; 0 = unknown, inf = sky
    moving: BoolArray | None = None  # [T, H, W]; True on dynamic objects
    full: ExtraView | None = None
    right: ExtraView | None = None
    camera_height_m: float | None = None

    def __post_init__(self) -> None:
        store(self, frames=_frames(self.name, self.frames, self.intrinsics))
        store(self, times_s=arrays.times(f"{self.name}: times_s", self.times_s, len(self.frames)))
        if self.trajectory is not None and len(self.trajectory) != len(self.frames):
            raise BadData(
                f"{self.name}: {len(self.trajectory)} poses for {len(self.frames)} frames, "
                "expected one each"
            )
        for field, kind in (("depths", np.float32), ("moving", bool)):
            value = getattr(self, field)
            if value is not None:
                store(
                    self,
                    **{
                        field: array_of(f"{self.name}: {field}", value, kind, self.frames.shape[:3])
                    },
                )
        for field in ("full", "right"):
            view = getattr(self, field)
            if view is not None and len(view.frames) != len(self.frames):
                raise BadData(
                    f"{self.name}: {len(view.frames)} {field} frames for {len(self.frames)} frames"
                )

    def __len__(self) -> int:
        """T, the number of frames."""
        return len(self.frames)

    def split(self, num_past: int, grant: PrivilegedInput) -> tuple[Context, Target]:
        """What a predictor with these grants may see, and what it will be scored against."""
        if not 1 <= num_past < len(self):
            raise BadData(
                f"{self.name}: num_past is {num_past}, expected 1 to {len(self) - 1} for "
                f"{len(self)} frames"
            )
        past, future = slice(0, num_past), slice(num_past, None)
        everything = Context(
            frames=cut(self.frames, past),
            times_s=self.times_s,
            intrinsics=self.intrinsics,
            past=cut(self.trajectory, past),
            future=cut(self.trajectory, future),
            past_depths=cut(self.depths, past),
            camera_height_m=self.camera_height_m,
            full=cut(self.full, past),
            right=cut(self.right, past),
            name=self.name,
        )
        target = Target(
            *(cut(one, future) for one in (self.frames, self.trajectory, self.depths, self.moving))
        )
        return everything.only(grant), target


@dataclass(frozen=True, repr=False)
class Context(ShortRepr):
    """What a predictor is given: the observed frames, when to predict, and whatever was granted
    (None otherwise).
    """

    frames: ByteArray  # [P, H, W, 3]
    times_s: FloatArray  # [P + F], past and future
    intrinsics: Intrinsics
    past: Trajectory | None = None  # [P], PrivilegedInput.PAST_POSES
    future: Trajectory | None = None  # [F], PrivilegedInput.FUTURE_POSES
    past_depths: FloatArray | None = None  # [P, H, W], PrivilegedInput.PAST_DEPTHS
    camera_height_m: float | None = None  # PrivilegedInput.CAMERA_HEIGHT
    full: ExtraView | None = None  # [P], PrivilegedInput.FULL_FRAMES
    right: ExtraView | None = None  # [P], PrivilegedInput.RIGHT_FRAMES
    name: str = ""  # the clip's, by which recorded predictions are found
    observations: Observations | None = None  # [P], of the frames
    full_observations: Observations | None = None  # [P], PrivilegedInput.FULL_FRAMES

    def __post_init__(self) -> None:
        store(self, frames=_frames("context", self.frames, self.intrinsics))
        store(self, times_s=arrays.times("context: times_s", self.times_s, None))
        if self.num_future < 1:
            raise BadData(
                f"context: {len(self.times_s)} times for {self.num_past} frames, expected at "
                "least one more"
            )

    @property
    def num_past(self) -> int:
        """P, the number of observed frames."""
        return len(self.frames)

    @property
    def num_future(self) -> int:
        """F, the number of frames to predict."""
        return len(self.times_s) - len(self.frames)

    def recent(self, num_frames: int) -> Context:
        """The same context with only the last `num_frames` observed frames; all of them when there
        are fewer.
        """
        return self.observed(np.arange(self.num_past) >= self.num_past - num_frames)

    def observed(self, kept: BoolArray) -> Context:
        """The same context with only some of the observed frames, as a mask [P] says."""
        if kept.all():
            return self
        fewer = {field: cut(getattr(self, field), kept) for field in _OF_PAST}
        times_s = np.concatenate(
            [self.times_s[: self.num_past][kept], self.times_s[self.num_past :]]
        )
        return replace(self, times_s=times_s, **fewer)

    def only(self, grant: PrivilegedInput) -> Context:
        """The same context with everything removed that the grant does not name."""
        hidden: dict[str, Any] = {
            field: None for field, needed in _GRANTED_BY.items() if needed not in grant
        }
        return replace(self, **hidden)


@dataclass(frozen=True, repr=False)
class Target(ShortRepr):
    """The real future; a predictor never holds one."""

    frames: ByteArray  # [F, H, W, 3]
    trajectory: Trajectory | None = None  # [F]
    depths: FloatArray | None = None  # [F, H, W]
    moving: BoolArray | None = None  # [F, H, W]


def _frames(what: str, value: ByteArray, camera: Intrinsics) -> ByteArray:
    """Frames [T, H, W, 3] of the camera's size."""
    return array_of(
        f"{what}: frames", value, np.uint8, (len(value), camera.height_px, camera.width_px, 3)
    )

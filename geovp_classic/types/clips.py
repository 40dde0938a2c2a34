"""Clips, and their two parts: the context of a predictor with its observations, and the target."""

from __future__ import annotations

import copy
import enum
from dataclasses import dataclass, replace
from numbers import Integral, Real

import numpy as np

from geovp_classic.errors import BadData, check_kind
from geovp_classic.types.arrays import (
    BoolArray,
    ByteArray,
    FloatArray,
    IntArray,
    ShortRepr,
    store_checked,
    store_rigid,
    store_times,
    take,
)
from geovp_classic.types.motion import Intrinsics, Trajectory


class PrivilegedInput(enum.Flag):
    """Inputs beyond the protocol's own; a component sees only those that it declares."""

    NONE = 0
    PAST_POSES = enum.auto()
    FUTURE_POSES = enum.auto()
    PAST_DEPTHS = enum.auto()
    CAMERA_HEIGHT = enum.auto()
    FULL_FRAMES = enum.auto()
    RIGHT_FRAMES = enum.auto()
    FUTURE_FRAMES = enum.auto()  # for poses only


@dataclass(frozen=True, repr=False)
class ExtraView(ShortRepr):
    """Other images at the same times: uncropped frames, or those of the right camera."""

    frames: ByteArray  # [T, H', W', 3], in native resolution
    intrinsics: Intrinsics
    view_from_cam: FloatArray  # [4, 4]; the identity for uncropped frames

    def __post_init__(self) -> None:
        store_checked(self, "frames", np.uint8, _shape(self.frames, self.intrinsics))
        store_rigid(self, "view_from_cam", 2)

    def __len__(self) -> int:
        """Return T, the number of frames."""
        return len(self.frames)

    def __getitem__(self, steps: slice | BoolArray) -> ExtraView:
        """Return the steps of a slice or a mask [T]."""
        return replace(self, frames=self.frames[steps].copy())


@dataclass(frozen=True, repr=False)
class Clip(ShortRepr):
    """Short piece of video with the available ground truth."""

    name: str
    frames: ByteArray  # [T, H, W, 3]
    times_s: FloatArray  # [T]
    intrinsics: Intrinsics
    trajectory: Trajectory | None = None  # [T]
    # [T, H, W] float32 z-depth; 0 = unknown, inf = sky
    depths: FloatArray | None = None
    moving: BoolArray | None = None  # [T, H, W]; True on dynamic objects
    full: ExtraView | None = None  # [T]
    right: ExtraView | None = None  # [T]
    camera_height_m: float | None = None

    def __post_init__(self) -> None:
        shape = _shape(self.frames, self.intrinsics)
        store_checked(self, "frames", np.uint8, shape)
        store_checked(self, "depths", np.float32, shape[:3])
        store_checked(self, "moving", bool, shape[:3])
        store_times(self, len(self))
        _check_height(self)
        for field in ("trajectory", "full", "right"):
            _check_steps(self, field, len(self))

    def __len__(self) -> int:
        """Return T, the number of frames."""
        return len(self.frames)

    def split(self, num_past: int, needs: PrivilegedInput) -> tuple[Context, Target]:
        """Return the context of a predictor with these privileged inputs, and the target."""
        check_kind("num_past", num_past, Integral, "a whole number")
        check_kind(
            "needs", needs, PrivilegedInput, "a PrivilegedInput, such as PrivilegedInput.NONE"
        )
        if not 1 <= num_past < len(self):
            raise BadData(
                f"{self.name}: num_past is {num_past}, expected 1 to {len(self) - 1} for "
                f"{len(self)} frames"
            )
        past = slice(0, num_past)
        future = slice(num_past, None)
        context = Context(
            frames=take(self.frames, past),
            times_s=self.times_s,
            intrinsics=self.intrinsics,
            past=take(self.trajectory, past),
            future=take(self.trajectory, future),
            past_depths=take(self.depths, past),
            camera_height_m=self.camera_height_m,
            full=take(self.full, past),
            right=take(self.right, past),
            future_frames=take(self.frames, future),
            future_full=take(self.full, future),
            name=self.name,
        )
        target = Target(
            frames=take(self.frames, future),
            trajectory=take(self.trajectory, future),
            depths=take(self.depths, future),
            moving=take(self.moving, future),
        )
        return context.only(needs), target


@dataclass(frozen=True, repr=False)
class Observations(ShortRepr):
    """The observed frames of one image stream, reduced to the scene, in grey, and screened."""

    frames: ByteArray  # [P, H, W, 3]
    greys: ByteArray  # [P, H, W]
    is_usable: BoolArray  # [P]; False for blank or duplicate frames, and for those before a cut
    intrinsics: Intrinsics
    mask: BoolArray  # [H, W]; True for pixels that do not show the scene, such as a time stamp
    # Left, top, right and bottom border of the scene, as fractions of the whole image
    window: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        shape = np.shape(self.frames)[:3]
        store_checked(self, "mask", bool, shape[1:])
        store_checked(self, "frames", np.uint8, (*shape, 3))
        store_checked(self, "greys", np.uint8, shape)
        store_checked(self, "is_usable", bool, shape[:1])

    def __getitem__(self, steps: slice | BoolArray) -> Observations:
        """Return the observations of the steps of a slice or a mask [P]."""
        arrays = {name: getattr(self, name)[steps] for name in ("frames", "greys", "is_usable")}
        return replace(self, **arrays)


@dataclass(frozen=True, repr=False)
class Context(ShortRepr):
    """Input of a predictor: observed frames, times, and the privileged inputs that it declares."""

    frames: ByteArray  # [P, H, W, 3]
    times_s: FloatArray  # [P + F], past and future
    intrinsics: Intrinsics
    past: Trajectory | None = None  # [P], PrivilegedInput.PAST_POSES
    future: Trajectory | None = None  # [F], PrivilegedInput.FUTURE_POSES
    # [P, H, W], PrivilegedInput.PAST_DEPTHS
    past_depths: FloatArray | None = None
    camera_height_m: float | None = None  # PrivilegedInput.CAMERA_HEIGHT
    full: ExtraView | None = None  # [P], PrivilegedInput.FULL_FRAMES
    right: ExtraView | None = None  # [P], PrivilegedInput.RIGHT_FRAMES
    # [F, H, W, 3], PrivilegedInput.FUTURE_FRAMES
    future_frames: ByteArray | None = None
    # [F], PrivilegedInput.FUTURE_FRAMES with FULL_FRAMES
    future_full: ExtraView | None = None
    # Of the clip, by which results of other software are found; see `frame_numbers`.
    name: str = ""
    # [P], indices of the observed frames in the clip; None: all from the first one
    steps: IntArray | None = None
    observations: Observations | None = None  # [P], of the frames
    # [P], PrivilegedInput.FULL_FRAMES
    full_observations: Observations | None = None

    def __post_init__(self) -> None:
        store_checked(self, "frames", np.uint8, _shape(self.frames, self.intrinsics))
        store_times(self)
        if self.steps is None:
            object.__setattr__(self, "steps", np.arange(self.num_past))
        if not 1 <= self.num_past < len(self.times_s):
            raise BadData(
                f"context: {len(self.times_s)} times for {self.num_past} frames, expected at least "
                "one frame, and more times"
            )
        _check_height(self)
        for field in ("past", "past_depths", "full", "right"):
            _check_steps(self, field, self.num_past)
        for field in ("future", "future_frames", "future_full"):
            _check_steps(self, field, self.num_future)

    @property
    def num_past(self) -> int:
        """Return P, the number of observed frames."""
        return len(self.frames)

    @property
    def num_future(self) -> int:
        """Return F, the number of frames to predict."""
        return len(self.times_s) - len(self.frames)

    @property
    def past_s(self) -> FloatArray:
        """Return the times [P] of the observed frames."""
        return self.times_s[: self.num_past]

    @property
    def future_s(self) -> FloatArray:
        """Return the times [F] of the frames to predict."""
        return self.times_s[self.num_past :]

    def frame_numbers(self) -> tuple[str, IntArray]:
        """Return the clip's sequence and the numbers [P] of the observed frames in it.

        Raises BadData if the clip's name is not of the form "03/000180".
        """
        sequence, _, first = self.name.rpartition("/")
        if not sequence or not first.isdecimal():
            raise BadData(
                f"the clip is called {self.name!r}, expected SEQUENCE/NUMBER: results of other "
                "software are found by the sequence and the numbers of its frames"
            )
        assert self.steps is not None
        return sequence, int(first) + self.steps

    def recent(self, num_frames: int) -> Context:
        """Return the context with only the last `num_frames` observed frames, or all if fewer."""
        return self.observed(np.arange(self.num_past) >= self.num_past - num_frames)

    def observed(self, mask: BoolArray) -> Context:
        """Return the context with only some of the observed frames, by a mask [P]."""
        if mask.all():
            return self
        future = np.ones(self.num_future, bool)
        arrays = {"times_s": self.times_s[np.append(mask, future)]}
        fields = ("frames", "past", "past_depths", "full", "right", "steps")
        for field in (*fields, "observations", "full_observations"):
            arrays[field] = take(getattr(self, field), mask)
        return replace(self, **arrays)

    def only(self, needs: PrivilegedInput) -> Context:
        """Return the context with these privileged inputs alone."""
        input_of_field = {
            "past": PrivilegedInput.PAST_POSES,
            "future": PrivilegedInput.FUTURE_POSES,
            "past_depths": PrivilegedInput.PAST_DEPTHS,
            "camera_height_m": PrivilegedInput.CAMERA_HEIGHT,
            "full": PrivilegedInput.FULL_FRAMES,
            "full_observations": PrivilegedInput.FULL_FRAMES,
            "right": PrivilegedInput.RIGHT_FRAMES,
            "future_frames": PrivilegedInput.FUTURE_FRAMES,
            "future_full": PrivilegedInput.FUTURE_FRAMES | PrivilegedInput.FULL_FRAMES,
        }
        hidden = copy.copy(self)  # its arrays were checked when it was made
        for field, needed in input_of_field.items():
            if needed not in needs:
                object.__setattr__(hidden, field, None)
        return hidden


@dataclass(frozen=True, repr=False)
class Target(ShortRepr):
    """Real future of a clip, which no predictor sees."""

    frames: ByteArray  # [F, H, W, 3]
    trajectory: Trajectory | None = None  # [F]
    depths: FloatArray | None = None  # [F, H, W]
    moving: BoolArray | None = None  # [F, H, W]


def _check_steps(owner: Clip | Context, field: str, count: int) -> None:
    """Check that a field has as many steps as there are frames; skip None."""
    value = getattr(owner, field)
    if value is not None and len(value) != count:
        raise BadData(
            f"{owner.name or 'context'}: {field} has {len(value)} steps, expected {count}"
        )


def _check_height(owner: Clip | Context) -> None:
    """Check the height of the camera, if it is known."""
    height_m = owner.camera_height_m
    check_kind("camera_height_m", height_m, (Real, type(None)), "a number or None")
    if height_m is not None and not 0 < height_m < np.inf:
        raise BadData(
            f"{owner.name or 'context'}: camera_height_m is {height_m}, expected more than 0, or "
            "None if it is not known"
        )


def _shape(frames: ByteArray, camera: Intrinsics) -> tuple[int, ...]:
    """Return the expected shape [T, H, W, 3] of a camera's frames."""
    return (len(frames), camera.height_px, camera.width_px, 3)

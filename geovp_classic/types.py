"""The data types of the suite: clips, camera motion, and the input and output of predictors.

Conventions, stated once and kept everywhere:

- `a_from_b` maps points of frame b into frame a; chain by cancelling: `cam_from_world @ world_from_rig`. Transforms are
  plain 4x4 float64 arrays.
- Camera axes as OpenCV: x right, y down, z forward. Depth is z-depth; 0 = unknown, inf = sky (inverse depth 0).
- Pixels (u, v) = (column, row); (0, 0) is the centre of the top-left pixel; resizing maps c to (c + 0.5) * s - 0.5.
- Images are uint8 RGB [..., H, W, 3] at the borders (clips, views, predictions, files), float32 in [0, 1] inside.
- Axes letters: T clip, P past, F future, S samples, H, W, N points. Steps: 0..P-1 | P..P+F-1; horizon k = 1..F.
- Units are suffixes: `_s _m _px _rad _deg _hz`. A length without one is in the trajectory's own unit; `is_metric` tells
  whether that is metres.
- The world frame is any frame, one per trajectory; nobody assumes that `world_from_cam[0]` is the identity.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData

FloatArray = npt.NDArray[np.floating[Any]]
ByteArray = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.integer[Any]]

RIGID_TOLERANCE = 1e-4  # KITTI writes seven digits, other tools six


class Grant(enum.Flag):
    """What a component asks for beyond the protocol's own input; nothing else is shown to it."""

    NONE = 0
    PAST_POSES = enum.auto()
    FUTURE_POSES = enum.auto()
    PAST_DEPTHS = enum.auto()
    CAMERA_HEIGHT = enum.auto()
    WIDE_FRAMES = enum.auto()
    RIGHT_FRAMES = enum.auto()


_GRANTED_BY = {  # fields of a context
    "past": Grant.PAST_POSES,
    "future": Grant.FUTURE_POSES,
    "past_depths": Grant.PAST_DEPTHS,
    "camera_height_m": Grant.CAMERA_HEIGHT,
    "wide": Grant.WIDE_FRAMES,
    "right": Grant.RIGHT_FRAMES,
}


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; (0, 0) is the centre of the top-left pixel."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        """Raise BadData unless focal lengths and sizes are positive and finite."""
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px)
        if not np.isfinite(numbers).all() or min(self.fx_px, self.fy_px, self.width_px, self.height_px) <= 0:
            raise BadData(f"intrinsics {self} must be finite, with positive focal lengths and sizes")

    @property
    def matrix(self) -> FloatArray:
        """The 3x3 calibration matrix K."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1]], dtype=np.float64)

    def cropped(self, left_px: int, top_px: int, width_px: int, height_px: int) -> Intrinsics:
        """The camera of image[top : top + height, left : left + width]."""
        return replace(
            self, cx_px=self.cx_px - left_px, cy_px=self.cy_px - top_px, width_px=width_px, height_px=height_px
        )

    def resized(self, width_px: int, height_px: int) -> Intrinsics:
        """The camera of the image resized to width x height, edges kept on edges."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        cx_px, cy_px = (self.cx_px + 0.5) * sx - 0.5, (self.cy_px + 0.5) * sy - 0.5
        return Intrinsics(self.fx_px * sx, self.fy_px * sy, cx_px, cy_px, width_px, height_px)


class _ShortRepr:
    """Prints the fields that are set, arrays by their shapes."""

    def __repr__(self) -> str:
        """As Trajectory(world_from_cam=[10, 4, 4], times_s=[10], is_metric=True)."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        texts = {
            name: str(list(value.shape)) if isinstance(value, np.ndarray) else repr(value)
            for name, value in values.items()
            if value is not None
        }
        return f"{type(self).__name__}({', '.join(f'{name}={text}' for name, text in texts.items())})"


@dataclass(frozen=True, repr=False)
class Trajectory(_ShortRepr):
    """Where one camera was, step by step."""

    world_from_cam: FloatArray  # [T, 4, 4]
    times_s: FloatArray  # [T], increasing
    is_metric: bool  # True: lengths are metres; False: an unknown but constant unit
    scale_uncertainty: float | None = None  # relative standard deviation of these metres, where they were estimated

    def __post_init__(self) -> None:
        """Raise BadData unless poses are finite and rigid and times increase."""
        _store(self, "world_from_cam", _rigid("world_from_cam", self.world_from_cam))
        _store(self, "times_s", _times("times_s", self.times_s, self.world_from_cam.shape[0]))
        uncertainty = self.scale_uncertainty
        if uncertainty is not None and not (self.is_metric and 0 <= uncertainty < np.inf):
            raise BadData(f"scale_uncertainty is {uncertainty}, expected 0 or more of a metric trajectory, else None")

    def __len__(self) -> int:
        """T, the number of steps."""
        return self.world_from_cam.shape[0]

    def __getitem__(self, steps: slice | BoolArray) -> Trajectory:
        """The steps of a slice or a mask [T], in the same world frame."""
        return replace(self, world_from_cam=self.world_from_cam[steps].copy(), times_s=self.times_s[steps].copy())

    def then(self, later: Trajectory) -> Trajectory:
        """These steps followed by later ones of the same world frame and unit."""
        if self.is_metric != later.is_metric:
            raise BadData("a metric and a scale-free trajectory cannot be joined: give both the same unit")
        poses = np.concatenate([self.world_from_cam, later.world_from_cam])
        return replace(self, world_from_cam=poses, times_s=np.concatenate([self.times_s, later.times_s]))


@dataclass(frozen=True, repr=False)
class Motion(_ShortRepr):
    """Where the camera was and will be, from a pose source; all poses share the world frame of `past`."""

    past: Trajectory  # [P]
    futures: FloatArray  # [S, F, 4, 4]; S = 1 when deterministic
    tracked: BoolArray  # [P]; False where a pose was bridged instead of measured
    unrefined: Motion | None = None  # the pose source's own, where refinements have corrected it since

    def __post_init__(self) -> None:
        """Raise BadData unless shapes agree and all poses are finite and rigid."""
        futures = np.asarray(self.futures, dtype=np.float64)
        if futures.ndim != 4:
            raise BadData(f"futures have shape {futures.shape}, expected [S, F, 4, 4]")
        _store(self, "futures", _rigid("futures", futures))
        _store(self, "tracked", _array("tracked", self.tracked, bool, (len(self.past),)))

    def refined(self, past: Trajectory, futures: FloatArray) -> Motion:
        """The same motion with better poses; the pose source's own are kept in `unrefined`."""
        return Motion(past, futures, self.tracked, self.unrefined or self)


@dataclass(frozen=True, repr=False)
class ExtraView(_ShortRepr):
    """Another image of the same instants: the uncropped one ("wide"), or the right camera's; native resolution."""

    frames: ByteArray  # [T, H', W', 3]
    intrinsics: Intrinsics
    view_from_cam: FloatArray  # [4, 4]; the identity for the wide image

    def __post_init__(self) -> None:
        """Raise BadData unless the frames fit the intrinsics and the transform is rigid."""
        _store(self, "frames", _frames("extra view", self.frames, self.intrinsics))
        _store(self, "view_from_cam", _rigid("view_from_cam", np.asarray(self.view_from_cam)[None])[0])

    def __getitem__(self, steps: slice | BoolArray) -> ExtraView:
        """The steps of a slice or a mask [T]."""
        return replace(self, frames=self.frames[steps].copy())


@dataclass(frozen=True, repr=False)
class Clip(_ShortRepr):
    """A short piece of video with all that is known about it, ground truth included."""

    name: str
    frames: ByteArray  # [T, H, W, 3]
    times_s: FloatArray  # [T]
    intrinsics: Intrinsics
    trajectory: Trajectory | None = None  # [T]
    depths: FloatArray | None = None  # [T, H, W] float32 z-depth; 0 = unknown, inf = sky
    moving: BoolArray | None = None  # [T, H, W]; True on dynamic objects
    wide: ExtraView | None = None
    right: ExtraView | None = None
    camera_height_m: float | None = None

    def __post_init__(self) -> None:
        """Raise BadData unless everything has one length and one size."""
        _store(self, "frames", _frames(self.name, self.frames, self.intrinsics))
        _store(self, "times_s", _times(f"{self.name}: times_s", self.times_s, len(self.frames)))
        if self.trajectory is not None and len(self.trajectory) != len(self.frames):
            raise BadData(f"{self.name}: {len(self.trajectory)} poses for {len(self.frames)} frames, expected one each")
        for field, kind in (("depths", np.float32), ("moving", bool)):
            value = getattr(self, field)
            if value is not None:
                _store(self, field, _array(f"{self.name}: {field}", value, kind, self.frames.shape[:3]))
        for field in ("wide", "right"):
            view = getattr(self, field)
            if view is not None and len(view.frames) != len(self.frames):
                raise BadData(f"{self.name}: {len(view.frames)} {field} frames for {len(self.frames)} frames")

    def __len__(self) -> int:
        """T, the number of frames."""
        return len(self.frames)

    def split(self, num_past: int, grant: Grant) -> tuple[Context, Target]:
        """What a predictor with these grants may see, and what it will be scored against."""
        if not 1 <= num_past < len(self):
            raise BadData(f"{self.name}: num_past is {num_past}, expected 1 to {len(self) - 1} for {len(self)} frames")
        past, future = slice(0, num_past), slice(num_past, None)
        everything = Context(
            frames=_cut(self.frames, past),
            times_s=self.times_s,
            intrinsics=self.intrinsics,
            past=_cut(self.trajectory, past),
            future=_cut(self.trajectory, future),
            past_depths=_cut(self.depths, past),
            camera_height_m=self.camera_height_m,
            wide=_cut(self.wide, past),
            right=_cut(self.right, past),
            name=self.name,
        )
        target = Target(*(_cut(one, future) for one in (self.frames, self.trajectory, self.depths, self.moving)))
        return everything.only(grant), target


@dataclass(frozen=True, repr=False)
class Context(_ShortRepr):
    """What a predictor is given: the observed frames, when to predict, and whatever was granted (None otherwise)."""

    frames: ByteArray  # [P, H, W, 3]
    times_s: FloatArray  # [P + F], past and future
    intrinsics: Intrinsics
    past: Trajectory | None = None  # [P], Grant.PAST_POSES
    future: Trajectory | None = None  # [F], Grant.FUTURE_POSES
    past_depths: FloatArray | None = None  # [P, H, W], Grant.PAST_DEPTHS
    camera_height_m: float | None = None  # Grant.CAMERA_HEIGHT
    wide: ExtraView | None = None  # [P], Grant.WIDE_FRAMES
    right: ExtraView | None = None  # [P], Grant.RIGHT_FRAMES
    name: str = ""  # the clip's, by which recorded predictions are found

    def __post_init__(self) -> None:
        """Raise BadData unless frames fit the camera and there is at least one future time."""
        _store(self, "frames", _frames("context", self.frames, self.intrinsics))
        _store(self, "times_s", _times("context: times_s", self.times_s, None))
        if self.num_future < 1:
            raise BadData(f"context: {len(self.times_s)} times for {self.num_past} frames, expected at least one more")

    @property
    def num_past(self) -> int:
        """P, the number of observed frames."""
        return len(self.frames)

    @property
    def num_future(self) -> int:
        """F, the number of frames to predict."""
        return len(self.times_s) - len(self.frames)

    def recent(self, num_frames: int) -> Context:
        """The same context with only the last `num_frames` observed frames; all of them when there are fewer."""
        return self.observed(np.arange(self.num_past) >= self.num_past - num_frames)

    def observed(self, kept: BoolArray) -> Context:
        """The same context with only some of the observed frames, as a mask [P] says."""
        cut = {field: _cut(getattr(self, field), kept) for field in ("frames", "past", "past_depths", "wide", "right")}
        times_s = np.concatenate([self.times_s[: self.num_past][kept], self.times_s[self.num_past :]])
        return replace(self, times_s=times_s, **cut)

    def only(self, grant: Grant) -> Context:
        """The same context with everything removed that the grant does not name."""
        hidden: dict[str, Any] = {field: None for field, needed in _GRANTED_BY.items() if needed not in grant}
        return replace(self, **hidden)


@dataclass(frozen=True, repr=False)
class Target(_ShortRepr):
    """The real future; a predictor never holds one."""

    frames: ByteArray  # [F, H, W, 3]
    trajectory: Trajectory | None = None  # [F]
    depths: FloatArray | None = None  # [F, H, W]
    moving: BoolArray | None = None  # [F, H, W]


@dataclass(frozen=True, repr=False)
class Views(_ShortRepr):
    """A scene seen from several poses."""

    frames: ByteArray  # [F, H, W, 3]
    covered: BoolArray  # [F, H, W]; False where the image was invented
    depths: FloatArray  # [F, H, W] float32; 0 = unknown, inf = infinitely far

    def __post_init__(self) -> None:
        """Raise BadData unless the three arrays have one size."""
        _store(self, "frames", _array("views: frames", self.frames, np.uint8, (*self.covered.shape, 3)))
        _store(self, "covered", _array("views: covered", self.covered, bool, self.covered.shape))
        _store(self, "depths", _array("views: depths", self.depths, np.float32, self.covered.shape))


@dataclass(frozen=True, repr=False)
class Prediction(_ShortRepr):
    """Predicted frames, one set per sample, with the motion behind them where there is one."""

    frames: ByteArray  # [S, F, H, W, 3]
    covered: BoolArray | None = None  # [S, F, H, W]
    motion: Motion | None = None

    def __post_init__(self) -> None:
        """Raise BadData unless frames are uint8 [S, F, H, W, 3] and the coverage fits them."""
        frames = np.asarray(self.frames)
        if frames.ndim != 5 or frames.shape[-1] != 3:
            raise BadData(f"predicted frames have shape {frames.shape}, expected [S, F, H, W, 3]")
        _store(self, "frames", _array("predicted frames", frames, np.uint8, frames.shape))
        if self.covered is not None:
            _store(self, "covered", _array("predicted coverage", self.covered, bool, frames.shape[:4]))

    @property
    def confidence(self) -> FloatArray | None:
        """What each predicted frame [S, F] rests on, from 0 to 1; None without coverage or motion.

        The share of pixels that are covered, times the number of tracked past frames over the number of all frames up
        to the step, P + k. It ranks frames and is no probability.
        """
        if self.covered is None or self.motion is None:
            return None
        tracked = self.motion.tracked
        frames_until = len(tracked) + np.arange(1, self.covered.shape[1] + 1)
        confidence: FloatArray = self.covered.mean(axis=(2, 3)) * tracked.sum() / frames_until
        return confidence


def _store(owner: object, field: str, value: object) -> None:
    """Set a field of a frozen dataclass while it is being made, arrays read-only."""
    if isinstance(value, np.ndarray):
        value = value.view()
        value.flags.writeable = False
    object.__setattr__(owner, field, value)


def _cut(value: Any, steps: slice | BoolArray) -> Any:
    """value[steps], or None; arrays are copied, because the base of a slice would show the other steps."""
    part = None if value is None else value[steps]
    return part.copy() if isinstance(part, np.ndarray) else part


def _array(what: str, value: Any, kind: Any, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    array = np.asarray(value)
    if array.dtype != np.dtype(kind) or array.shape != tuple(shape):
        raise BadData(
            f"{what}: {array.dtype} array of shape {array.shape}, expected {np.dtype(kind)} of shape {tuple(shape)}"
        )
    return array


def _frames(what: str, value: Any, camera: Intrinsics) -> npt.NDArray[Any]:
    shape = (len(value), camera.height_px, camera.width_px, 3)
    return _array(f"{what}: frames", value, np.uint8, shape)


def _times(what: str, value: Any, count: int | None) -> FloatArray:
    times_s = np.asarray(value, dtype=np.float64)
    if times_s.ndim != 1 or (count is not None and len(times_s) != count):
        raise BadData(f"{what} has shape {times_s.shape}, expected ({'T' if count is None else count},)")
    if not np.isfinite(times_s).all():
        raise BadData(f"{what}: a time is not finite: every step needs its time in seconds")
    if (np.diff(times_s) <= 0).any():
        step = int(np.argmax(np.diff(times_s) <= 0)) + 1
        raise BadData(f"{what}: step {step} is not later than the step before it: times must increase")
    return times_s


def _rigid(what: str, value: Any) -> FloatArray:
    poses = np.asarray(value, dtype=np.float64)
    if poses.ndim < 3 or poses.shape[-2:] != (4, 4):
        raise BadData(f"{what} has shape {poses.shape}, expected [..., 4, 4]")
    finite = np.isfinite(poses).all(axis=(-2, -1))
    if not finite.all():
        raise BadData(f"{what}: pose {_first(~finite)} has a number that is not finite: remove or mend it")
    rotation = poses[..., :3, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    good = (defect < RIGID_TOLERANCE) & (np.linalg.det(rotation) > 0) & (poses[..., 3, :] == [0, 0, 0, 1]).all(-1)
    if not good.all():
        raise BadData(f"{what}: pose {_first(~good)} is not rigid: expected a rotation matrix and a last row 0 0 0 1")
    return poses


def _first(bad: Any) -> int | tuple[int, ...]:
    """The index of the first True."""
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    return index[0] if len(index) == 1 else index

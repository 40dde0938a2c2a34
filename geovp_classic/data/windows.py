"""Clips cut from long recordings: which frames, which square of the image, with which camera."""

import itertools
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import cv2
import numpy as np
import numpy.typing as npt

from geovp_classic.data.frames import FrameReader
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import (
    ByteArray,
    Clip,
    ExtraView,
    FloatArray,
    Intrinsics,
    Trajectory,
)

Fit = Literal["crop", "stretch"]  # how a frame becomes one of size_px
Array = npt.NDArray[Any]


@dataclass(frozen=True)
class FrameRange:
    """Frames of a sequence, the first inclusive, the last exclusive."""

    sequence: str
    first: int = 0
    last: int | None = None  # None: to the end

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse "03" or "03[180:360)"."""
        match = re.fullmatch(
            r"([^\[\]\s]+?)(?:\[(\d{1,9}):(\d{1,9})\))?", text.strip()
        )
        if match is not None:
            sequence, first, last = match.groups()
            if first is None:
                return cls(sequence)
            if int(first) < int(last):
                return cls(sequence, int(first), int(last))
        raise BadData(
            f"{text!r} is not a range of frames, expected a sequence such as '03' or "
            "'03[180:360)', the first frame inclusive, the last exclusive"
        )

    def within(self, num_frames: int) -> Self:
        """Return the range with its end spelled out; BadData if the sequence is shorter."""
        if self.last is None:
            return replace(self, last=num_frames)
        if self.last > num_frames:
            raise BadData(
                f"{self}: sequence {self.sequence} has {num_frames} frames, so give at most "
                f"[0:{num_frames})"
            )
        return self

    def __str__(self) -> str:
        return (
            self.sequence
            if self.last is None
            else f"{self.sequence}[{self.first}:{self.last})"
        )


@dataclass(frozen=True)
class SideCamera:
    """A second camera beside the first, such as the right one of a stereo pair."""

    frames: FrameReader
    intrinsics: Intrinsics
    view_from_cam: FloatArray  # [4, 4]


@dataclass(frozen=True)
class Recording:
    """A long video with its camera and poses; its frames are read when a clip needs them."""

    name: str
    frames: FrameReader
    times_s: FloatArray  # [N]
    intrinsics: Intrinsics  # of the frames as they are stored
    trajectory: Trajectory | None = None  # [N]
    camera_height_m: float | None = None
    right: SideCamera | None = None
    # a frame's number -> z-depth [H, W] in metres, 0 = unknown
    depths: Callable[[int], FloatArray] | None = None
    # frames that do not follow the one before, so that no clip holds both
    breaks: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        counts = {}
        if self.trajectory is not None:
            counts["poses"] = len(self.trajectory)
        counts["times"] = len(self.times_s)
        if self.right is not None:
            counts["right frames"] = len(self.right.frames)
            _check_camera(self.name, self.right.intrinsics)
        for what, count in counts.items():
            if count != len(self.frames):
                raise BadData(
                    f"{self.name}: {count} {what} for {len(self.frames)} frames, expected one each"
                )
        _check_camera(self.name, self.intrinsics)
        if (
            self.camera_height_m is not None
            and not 0 < self.camera_height_m < 1e4
        ):
            raise BadData(
                f"{self.name}: camera_height_m is {self.camera_height_m}, expected 0 to 10000 m"
            )
        if len(self.times_s) > 1 and not np.median(np.diff(self.times_s)) < 60:
            raise BadData(
                f"{self.name}: half of the times are a minute or more apart: give times in seconds"
            )


def _check_camera(name: str, camera: Intrinsics) -> None:
    """Raise BadData for focal lengths and principal points that do not fit the images.

    Focal lengths of 0.05 to 100 widths are fields of view from 169 to half a degree.
    """
    size_px = np.array([camera.width_px, camera.height_px])
    focal_ratio = np.array([camera.fx_px, camera.fy_px]) / size_px.max()
    centre_px = np.array([camera.cx_px, camera.cy_px])
    is_focal_plausible = focal_ratio.min() > 0.05 and focal_ratio.max() < 100
    if (
        not is_focal_plausible
        or (centre_px < -0.5).any()
        or (centre_px > size_px - 0.5).any()
    ):
        raise BadData(
            f"{name}: {camera} has an implausible focal length or its principal point outside the "
            "images: give the calibration in pixels of the images as they are stored"
        )


def check_protocol(
    num_frames: int, stride: int, size_px: tuple[int, int], fit: Fit = "crop"
) -> None:
    """Raise BadData unless clips of these settings can be cut."""
    if num_frames < 2:
        raise BadData(
            f"num_frames is {num_frames}, expected 2 or more: one to observe and one to predict"
        )
    if stride < 1:
        raise BadData(
            f"stride is {stride}, expected 1 or more frames between the starts of two clips"
        )
    if min(size_px) < 1 or (fit == "crop" and size_px[0] != size_px[1]):
        raise BadData(
            f"size_px is {list(size_px)}, expected a square: frames are cropped to one and then "
            "resized"
        )


def starts(frames: FrameRange, num_frames: int, stride: int) -> range:
    """Return the first frame of every clip inside a range whose end is spelled out.

    BadData if no clip fits.
    """
    assert frames.last is not None
    if frames.last - frames.first < num_frames:
        raise BadData(
            f"{frames} has {frames.last - frames.first} frames, but one clip needs {num_frames}"
        )
    return range(frames.first, frames.last - num_frames + 1, stride)


def pieces(
    frames: FrameRange, breaks: Iterable[int], num_frames: int
) -> list[FrameRange]:
    """Cut a range, its end spelled out, at breaks.

    Return the pieces that hold a clip of `num_frames`, else the longest.
    """
    assert frames.last is not None
    inner = [at for at in breaks if frames.first < at < frames.last]
    bounds = [frames.first, *inner, frames.last]
    max_length = np.diff(bounds).max()
    return [
        FrameRange(frames.sequence, first, last)
        for first, last in itertools.pairwise(bounds)
        if last - first >= min(num_frames, max_length)
    ]


def clip_name(sequence: str, first: int) -> str:
    """Return the name of a clip in results: its sequence and first frame, "03/000180"."""
    return f"{sequence}/{first:06d}"


def cut(
    recording: Recording,
    first: int,
    num_frames: int,
    size_px: tuple[int, int],
    *,
    with_full: bool = False,
    fit: Fit = "crop",
) -> Clip:
    """Cut the clip of `num_frames` frames from `first` at size_px = (width, height).

    Frames are cropped to their middle of that aspect and resized, or, with "stretch", resized
    whole. `with_full` adds the uncropped frames as they are stored; the right view comes with the
    recording.
    """
    last = first + num_frames
    native = _stack(recording.frames.read, first, last)
    full = (
        ExtraView(native, recording.intrinsics, np.eye(4))
        if with_full
        else None
    )
    right = None
    if recording.right is not None:
        side = recording.right
        side_frames = _stack(side.frames.read, first, last)
        right = ExtraView(side_frames, side.intrinsics, side.view_from_cam)
    trajectory = None
    if recording.trajectory is not None:
        trajectory = recording.trajectory[first:last]
    if fit == "crop":
        window, intrinsics = pinhole.centre_crop(recording.intrinsics, size_px)
        resize = pinhole.resize
    else:
        window = (slice(None), slice(None))
        intrinsics = recording.intrinsics.resized(*size_px)
        resize = _stretch
    depths = None
    if recording.depths is not None:
        depth_maps = _stack(recording.depths, first, last)
        depths = np.stack(
            [_nearest(depth[window], size_px) for depth in depth_maps]
        )
    return Clip(
        name=clip_name(recording.name, first),
        frames=np.stack([resize(image[window], size_px) for image in native]),
        times_s=recording.times_s[first:last],
        intrinsics=intrinsics,
        trajectory=trajectory,
        full=full,
        right=right,
        depths=depths,
        camera_height_m=recording.camera_height_m,
    )


def _stack(read: Callable[[int], Array], first: int, last: int) -> Array:
    """Read the images [T, H, W, ...] of a range of frames."""
    return np.stack([read(step) for step in range(first, last)])


def _stretch(image: ByteArray, size_px: tuple[int, int]) -> ByteArray:
    """Resize a frame bilinearly without smoothing.

    OpenCV does so by default, and so does the data preparation of DMVFN (Hu et al. 2023): the
    protocols that stretch frames are compared by numbers that depend on it.
    """
    return np.asarray(cv2.resize(image, size_px), dtype=np.uint8)


def _nearest(depth: FloatArray, size_px: tuple[int, int]) -> FloatArray:
    """Resize a depth map to the nearest pixels: the mean over an edge is the depth of nothing."""
    contiguous = np.ascontiguousarray(depth, np.float32)
    resized = cv2.resize(
        contiguous, size_px, interpolation=cv2.INTER_NEAREST_EXACT
    )
    return np.asarray(resized, dtype=np.float32)

"""Clips cut from long recordings: which frames, which square of the image, with which camera."""

import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import cv2
import numpy as np

from geovp_classic.data.frames.image_frames import Array, FrameReader, Size
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import (
    Clip,
    ExtraView,
    FloatArray,
    IntArray,
    Intrinsics,
    Trajectory,
)

# how a frame becomes one of size_px; "width" keeps the aspect and takes the height from it
Fit = Literal["crop", "stretch", "width"]
Rate = float | Literal["native"]  # frames that are used per second; all of them
EXPECTED = "expected a sequence such as '03' or '03[180:360)', [first:last) with first < last"


@dataclass(frozen=True)
class FrameRange:
    """Frames of a sequence, the first inclusive, the last exclusive."""

    sequence: str
    first: int = 0
    last: int | None = None  # None: to the end

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse "03" or "03[180:360)"; a name may hold spaces and brackets."""
        match = re.fullmatch(r"(.+?)(?:\[(\d{1,9}):(\d{1,9})\))?", text.strip())
        if match is None:
            raise BadData(f"{text!r} is not a range of frames, {EXPECTED}")
        if match[2] is None:
            return cls(match[1])
        return cls(match[1].strip(), int(match[2]), int(match[3]))

    def __post_init__(self) -> None:
        if self.last is not None and not 0 <= self.first < self.last:
            raise BadData(f"{self} is not a range of frames, {EXPECTED}")

    def within(self, num_frames: int) -> Self:
        """Return the range with its end spelled out; BadData if the sequence is shorter."""
        last = num_frames if self.last is None else self.last
        if last > num_frames:
            raise BadData(
                f"{self}: sequence {self.sequence} has {num_frames} frames, so give at most "
                f"[0:{num_frames})"
            )
        return replace(self, last=last)

    def starts(self, num_frames: int, stride: int) -> range:
        """Return the first frames of clips inside the range, whose end is spelled out."""
        assert self.last is not None
        return range(self.first, self.last - num_frames + 1, stride)

    def __str__(self) -> str:
        frames = "" if self.last is None else f"[{self.first}:{self.last})"
        return self.sequence + frames


@dataclass(frozen=True)
class SideCamera:
    """A second camera next to the first, such as the right one of a stereo pair."""

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
    depths: FrameReader | None = None  # z-depth [H, W] in metres, 0 = unknown
    # frames that do not follow the one before, so that no clip holds both
    breaks: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        name = self.name
        check_plausible(name, self.intrinsics)
        height_m = self.camera_height_m
        if height_m is not None and not 0 < height_m < 1e4:
            raise BadData(f"{name}: camera_height_m is {height_m}, expected 0 to 10000 m")
        if len(self.times_s) > 1 and not np.median(np.diff(self.times_s)) < 60:
            raise BadData(
                f"{name}: half of the times are a minute or more apart: give times in seconds"
            )

    def selected(self, numbers: IntArray) -> Self:
        """Return the recording of the numbered frames alone, with the breaks between them."""
        right = self.right
        if right is not None:
            right = replace(right, frames=SelectedFrames(right.frames, numbers))
        return replace(
            self,
            frames=SelectedFrames(self.frames, numbers),
            times_s=self.times_s[numbers],
            trajectory=self.trajectory and self.trajectory[numbers],
            right=right,
            depths=self.depths and SelectedFrames(self.depths, numbers),
            breaks=tuple(np.unique(np.searchsorted(numbers, self.breaks)).tolist()),
        )


@dataclass(frozen=True)
class SelectedFrames:
    """Some of the frames of another reader."""

    frames: FrameReader
    numbers: IntArray  # [N]

    def __len__(self) -> int:
        return len(self.numbers)

    def read(self, index: int) -> Array:
        """Return one frame; BadData names the file that is wrong."""
        return self.frames.read(int(self.numbers[index]))

    def digest(self, index: int) -> bytes:
        """Return a hash of the content of a frame."""
        return self.frames.digest(int(self.numbers[index]))


def check_plausible(name: str, camera: Intrinsics) -> None:
    """Raise BadData for a principal point outside the images, or an extreme focal length."""
    ratios = np.divide([camera.fx_px, camera.fy_px], max(camera.width_px, camera.height_px))
    # fields of view from 169 to half a degree
    is_plausible = ratios.min() > 0.05 and ratios.max() < 100
    is_plausible &= -0.5 <= camera.cx_px <= camera.width_px - 0.5
    is_plausible &= -0.5 <= camera.cy_px <= camera.height_px - 0.5
    if ratios.max() >= 100 and max(camera.size_px) <= 10:
        raise BadData(f"{name}: its images have {camera.size_px} pixels, expected more than 10")
    if not is_plausible:
        raise BadData(
            f"{name}: {camera} has an implausible focal length or its principal point outside "
            "the images: give the calibration in pixels of the stored images"
        )


def frames_at_rate(
    times_s: FloatArray, rate_hz: Rate, frame_step: int = 1, anchor: int = 0
) -> IntArray:
    """Return the numbers of frames to use, about `rate_hz` a second, and every Nth of these.

    `anchor` is one of them. Of a video with a constant rate, each is as many frames after the one
    before: at 25 Hz, 10 Hz becomes every second frame, because nearest frames would jitter. Where
    frames come more slowly, all are used.
    """
    step_s = half_s = 0.0
    if rate_hz != "native" and len(times_s) > 1:
        usual_s = float(np.median(np.diff(times_s)))
        step_s = max(1, round(1 / (usual_s * rate_hz))) * usual_s
        half_s = usual_s / 2  # times jitter by less than that

    def following(times_s: FloatArray) -> IntArray:
        numbers = [0]
        while True:
            due_s = times_s[numbers[-1]] + step_s - half_s
            number = max(int(np.searchsorted(times_s, due_s)), numbers[-1] + 1)
            if number >= len(times_s):
                return np.array(numbers)[::frame_step]
            numbers.append(number)

    if not len(times_s):
        return np.zeros(0, int)
    before = anchor - following(times_s[anchor] - times_s[anchor::-1])
    return np.concatenate([before[:0:-1], anchor + following(times_s[anchor:])])


def pieces(frames: FrameRange, breaks: Iterable[int], num_frames: int) -> list[FrameRange]:
    """Cut a range, its end spelled out, at breaks.

    Return the pieces that hold a clip of `num_frames`; BadData if none does.
    """
    assert frames.last is not None
    inner = [at for at in breaks if frames.first < at < frames.last]
    bounds = [frames.first, *inner, frames.last]
    fitting = [
        FrameRange(frames.sequence, first, last)
        for first, last in itertools.pairwise(bounds)
        if last - first >= num_frames
    ]
    if not fitting:
        raise BadData(
            f"{frames} has {np.diff(bounds).max()} frames without a break, but one clip needs "
            f"{num_frames}: give a longer recording, or shorter clips"
        )
    return fitting


def clip_name(sequence: str, first: int) -> str:
    """Return the name of a clip in results: its sequence and first frame, "03/000180"."""
    return f"{sequence}/{first:06d}"


def cut(
    recording: Recording,
    first: int,
    num_frames: int,
    size_px: Size,
    *,
    with_full: bool = False,
    fit: Fit = "crop",
) -> Clip:
    """Cut the clip of `num_frames` frames from `first` at size_px = (width, height).

    Frames are cropped to their middle of that aspect and resized, or, with "stretch" or "width",
    resized whole; with "width" the height is that of the frames' aspect. `with_full` adds the
    uncropped frames as they are stored; the right view comes with the recording.
    """
    span = slice(first, first + num_frames)

    def read(reader: FrameReader) -> Array:
        steps = range(first, first + num_frames)
        return np.stack([reader.read(step) for step in steps])

    camera = recording.intrinsics
    side = recording.right
    if fit == "width":
        height_px = camera.height_px * size_px[0] / camera.width_px
        size_px = size_px[0], 2 * max(1, round(height_px / 2))  # even, for codecs
    window, intrinsics = pinhole.centre_crop(camera, size_px)
    resize: Any = pinhole.resize
    if fit != "crop":
        window = slice(None), slice(None)
        intrinsics = camera.resized(*size_px)
    if fit == "stretch":
        # bilinear without smoothing, as the data preparation of DMVFN (Hu et al. 2023): the
        # protocols that stretch frames are compared by numbers that depend on it
        resize = cv2.resize
    native = read(recording.frames)
    right = None
    if side is not None:
        right = ExtraView(read(side.frames), side.intrinsics, side.view_from_cam)
    depths = None
    if recording.depths is not None:
        # A mean over an edge would be on no surface.
        nearest = {"interpolation": cv2.INTER_NEAREST_EXACT}
        maps = read(recording.depths)[:, *window].astype(np.float32)
        depths = np.stack([cv2.resize(depth, size_px, **nearest) for depth in maps])
    return Clip(
        clip_name(recording.name, first),
        np.stack([resize(image[window], size_px) for image in native]),
        recording.times_s[span],
        intrinsics,
        recording.trajectory and recording.trajectory[span],
        depths,
        full=ExtraView(native, camera, np.eye(4)) if with_full else None,
        right=right,
        camera_height_m=recording.camera_height_m,
    )

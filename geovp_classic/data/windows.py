"""Clips cut from long recordings: which frames, which square of the image, with which camera."""

import itertools
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, Self

import cv2
import numpy as np

from geovp_classic.data.frames import FrameReader
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, Clip, ExtraView, FloatArray, Intrinsics, Trajectory

Fit = Literal["crop", "stretch"]  # how a frame becomes one of size_px
_RANGE = re.compile(r"(?P<sequence>[^\[\]\s]+?)(\[(?P<first>\d{1,9}):(?P<last>\d{1,9})\))?")
MIN_FOCAL, MAX_FOCAL = (
    0.05,
    100.0,
)  # in lengths of the longer side: 1 : 0.05 is 169 degrees wide, 1 : 100 half a degree
MAX_OFF_CENTRE = 2.5  # of the principal point, in widths or heights of the image
MAX_HEIGHT_M = 1e4
LATEST_S = 1e11  # 3,000 years since 1970


@dataclass(frozen=True)
class FrameRange:
    """Frames of a sequence, the first inclusive, the last exclusive; all of it when no numbers are
    given.
    """

    sequence: str
    first: int = 0
    last: int | None = None  # None: to the end

    @classmethod
    def parse(cls, text: str) -> Self:
        """The range of "03" or "03[180:360)"."""
        match = _RANGE.fullmatch(text.strip())
        if match is None:
            raise BadData(
                f"{text!r} is not a range of frames, expected a sequence such as '03' or "
                "'03[180:360)'"
            )
        if match["first"] is None:
            return cls(match["sequence"])
        first, last = int(match["first"]), int(match["last"])
        if first >= last:
            raise BadData(
                f"{text!r} holds no frame: the first is inclusive and the last exclusive, give "
                "first < last"
            )
        return cls(match["sequence"], first, last)

    def within(self, num_frames: int) -> Self:
        """The same range with its end spelled out; BadData when the sequence is shorter
        than that.
        """
        if self.last is not None and self.last > num_frames:
            raise BadData(
                f"{self}: sequence {self.sequence} has {num_frames} frames, so give at most "
                f"[0:{num_frames})"
            )
        return replace(self, last=num_frames if self.last is None else self.last)

    def __str__(self) -> str:
        return self.sequence if self.last is None else f"{self.sequence}[{self.first}:{self.last})"


@dataclass(frozen=True)
class SideCamera:
    """A second camera beside the first, such as the right one of a stereo pair."""

    frames: FrameReader
    intrinsics: Intrinsics
    view_from_cam: FloatArray  # [4, 4]


@dataclass(frozen=True)
class Recording:
    """A long video with everything known about it; its frames are read when a clip needs them."""

    name: str
    frames: FrameReader
    times_s: FloatArray  # [N]
    intrinsics: Intrinsics  # of the frames as they are stored
    trajectory: Trajectory | None = None  # [N]
    camera_height_m: float | None = None
    right: SideCamera | None = None
    depths: Callable[[int], FloatArray] | None = (
        None  # a frame's number -> z-depth [H, W] in metres, 0 = unknown
    )
    breaks: tuple[
        int, ...
    ] = ()  # frames that do not follow the one before, so that no clip holds both

    def __post_init__(self) -> None:
        right = None if self.right is None else self.right.frames
        for what, given in (
            ("times", self.times_s),
            ("poses", self.trajectory),
            ("right frames", right),
        ):
            if given is not None and len(given) != len(self.frames):
                raise BadData(
                    f"{self.name}: {len(given)} {what} for {len(self.frames)} frames, expected "
                    "one each"
                )
        _check_camera(self.name, self.intrinsics)
        if self.right is not None:
            _check_camera(self.name, self.right.intrinsics)
        if self.camera_height_m is not None and not 0 < self.camera_height_m < MAX_HEIGHT_M:
            raise BadData(
                f"{self.name}: camera_height_m is {self.camera_height_m}, expected 0 to "
                f"{MAX_HEIGHT_M:g} m"
            )
        if len(self.times_s) and not np.abs(self.times_s).max() < LATEST_S:
            raise BadData(f"{self.name}: a time beyond {LATEST_S:g} s: give times in seconds")


def _check_camera(name: str, camera: Intrinsics) -> None:
    """BadData for focal lengths and principal points that no camera of images of that size has."""
    sizes_px = np.array([camera.width_px, camera.height_px])
    focal = np.array([camera.fx_px, camera.fy_px]) / sizes_px.max()
    centre = np.array([camera.cx_px, camera.cy_px]) / sizes_px
    if not (
        focal.min() > MIN_FOCAL
        and focal.max() < MAX_FOCAL
        and np.abs(centre - 0.5).max() < MAX_OFF_CENTRE
    ):
        raise BadData(
            f"{name}: no camera of {camera.width_px}x{camera.height_px} pixels has {camera}: "
            "check the calibration, "
            "which is in pixels of the images as they are stored"
        )


def check_protocol(
    num_frames: int, stride: int, size_px: tuple[int, int], fit: Fit = "crop"
) -> None:
    """Raise BadData unless clips of these settings can be cut."""
    if num_frames < 2:
        raise BadData(
            f"num_frames is {num_frames}, expected 2 or more: one to look at and one to predict"
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
    """The first frame of every clip inside a range whose end is spelled out; BadData when not even
    one fits.
    """
    assert frames.last is not None
    if frames.last - frames.first < num_frames:
        raise BadData(
            f"{frames} has {frames.last - frames.first} frames, but one clip needs {num_frames}"
        )
    return range(frames.first, frames.last - num_frames + 1, stride)


def pieces(frames: FrameRange, breaks: Iterable[int], num_frames: int) -> list[FrameRange]:
    """A range, its end spelled out, cut at breaks: the pieces that hold a clip of `num_frames`,
    else the longest.
    """
    assert frames.last is not None
    bounds = [frames.first, *(at for at in breaks if frames.first < at < frames.last), frames.last]
    found = [FrameRange(frames.sequence, *ends) for ends in itertools.pairwise(bounds)]
    lengths = [last - first for first, last in itertools.pairwise(bounds)]
    enough = min(num_frames, max(lengths))
    return [piece for piece, length in zip(found, lengths, strict=True) if length >= enough]


def clip_name(sequence: str, first: int) -> str:
    """The name of a clip in results: its sequence and first frame, "03/000180"."""
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
    """The clip of `num_frames` frames from `first` at size_px = (width, height).

    Frames are cropped to their middle of that aspect and resized, or, with "stretch", resized
    whole. The wide view is the uncropped frames as they are stored; the right view comes with the
    recording.
    """
    steps = range(first, first + num_frames)
    native = [recording.frames.read(step) for step in steps]
    side = recording.right
    right = None
    if side is not None:
        right = ExtraView(
            np.stack([side.frames.read(step) for step in steps]),
            side.intrinsics,
            side.view_from_cam,
        )
    frames, intrinsics = _fitted(native, recording.intrinsics, size_px, fit)
    return Clip(
        name=clip_name(recording.name, first),
        frames=frames,
        times_s=recording.times_s[first : first + num_frames],
        intrinsics=intrinsics,
        trajectory=None
        if recording.trajectory is None
        else recording.trajectory[first : first + num_frames],
        full=ExtraView(np.stack(native), recording.intrinsics, np.eye(4)) if with_full else None,
        right=right,
        depths=_fitted_depths(recording, steps, size_px, fit),
        camera_height_m=recording.camera_height_m,
    )


def _fitted(
    native: list[ByteArray], camera: Intrinsics, size_px: tuple[int, int], fit: Fit
) -> tuple[ByteArray, Intrinsics]:
    """Frames [T, H, W, 3] at a size, and their camera.

    A stretched frame is sampled bilinearly without smoothing, as OpenCV does by default and the
    data preparation of DMVFN (Hu et al. 2023) therefore does: the protocols that stretch frames are
    compared by numbers that depend on it.
    """
    if fit == "crop":
        window, intrinsics = pinhole.centre_crop(camera, size_px)
        return np.stack([pinhole.resize(image[window], size_px) for image in native]), intrinsics
    return np.stack([np.asarray(cv2.resize(image, size_px)) for image in native]), camera.resized(
        *size_px
    )


def _fitted_depths(
    recording: Recording, steps: range, size_px: tuple[int, int], fit: Fit
) -> FloatArray | None:
    """Depths [T, H, W] at a size, each of the nearest pixel: a mean over an edge is the depth of
    nothing.
    """
    if recording.depths is None:
        return None
    window = (
        pinhole.centre_crop(recording.intrinsics, size_px)[0]
        if fit == "crop"
        else (slice(None), slice(None))
    )
    images = [np.ascontiguousarray(recording.depths(step)[window], np.float32) for step in steps]
    return np.stack(
        [cv2.resize(image, size_px, interpolation=cv2.INTER_NEAREST_EXACT) for image in images]
    )

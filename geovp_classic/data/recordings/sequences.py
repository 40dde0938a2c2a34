"""Data sets of several sequences below one root, and the frames that their clips are cut from.

A layout (`kitti`, `kitti_raw`, `cityscapes`, `tum`, `euroc`, `colmap`, `rosbag`, `folder`) scans a
sequence into a `Scan`, and adds what is wrong with its files to the findings: a data set raises the
first error, the doctor lists all of them.
"""

import dataclasses
import functools
import hashlib
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from geovp_classic import files
from geovp_classic.data.findings import RAISE, Findings
from geovp_classic.data.frames import image_frames
from geovp_classic.data.frames.image_frames import Load
from geovp_classic.data.recordings import splits, windows
from geovp_classic.data.recordings.scans import Scan, sequence_folders
from geovp_classic.data.recordings.windows import (
    Fit,
    FrameRange,
    Rate,
    Recording,
    frames_at_rate,
)
from geovp_classic.errors import BadData
from geovp_classic.types import Clip


@dataclass(frozen=True, kw_only=True)
class SequenceDataset(ABC):
    """Clips of sequences, one every `stride` frames, and the settings that all data sets share.

    `sequences` names sequences or frames of them ("06", "03[180:360)"); without it, all are used.
    Frames are cropped to their central square at `size_px`, or with `fit = "stretch"` resized
    whole; `with_full` adds the uncropped ones. `image_bits` is the number of used bits of 16-bit
    images. Everything but the images is checked on construction.

    `rate_hz` is about how many frames per second are used of faster recordings, `frame_step` takes
    every Nth of these; frames are counted after that. No clip holds both sides of a pause.
    """

    # Images are turned as EXIF says, and their camera has no lens; else, the stored pixels are
    # shown without the distortion of their lens.
    is_upright: ClassVar[bool] = False

    sequences: tuple[str, ...] | None = None
    num_frames: int = 30  # 10 observed and 20 predicted, as in the thesis
    stride: int = 10  # frames, as many as are observed
    size_px: tuple[int, int] = (256, 256)  # as in the thesis
    fit: Fit = "crop"
    with_full: bool = False
    camera_height_m: float | None = None
    image_bits: int | None = None
    rate_hz: Rate = "native"
    frame_step: int = 1
    # A longer step between frames is a pause: at 1 s, a car in a town is 10 m further.
    max_step_s: float = 1.0

    def __post_init__(self) -> None:
        """Raise BadData for bad settings, or unless all named sequences can be used."""
        width_px, height_px = self.size_px
        if self.frame_step < 1 or (self.rate_hz != "native" and not 0.02 <= self.rate_hz < np.inf):
            raise BadData(
                f"rate_hz is {self.rate_hz}, frame_step is {self.frame_step}: expected a number of "
                'at least 0.02 or "native", and 1 or more'
            )
        if self.num_frames < 2 or self.stride < 1:
            raise BadData(
                f"num_frames is {self.num_frames}, stride is {self.stride}: expected 2 or more, to "
                "observe and to predict, and 1 or more between the starts of clips"
            )
        if min(self.size_px) < 1 or (self.fit == "crop" and width_px != height_px):
            raise BadData(
                f"size_px is {list(self.size_px)}, expected a square: frames are cropped to one "
                "and then resized"
            )
        self._check_files()

    def _check_files(self) -> None:
        """Raise BadData unless all named sequences can be used."""
        for name, count in Counter(self.clip_names).items():
            files.check_name(name, "the clip")
            if count > 1:
                raise BadData(f"clip {name} is named twice: give ranges that do not overlap")

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings alone, so that a copy in another process reads its own files."""
        names = [item.name for item in dataclasses.fields(self)]
        return {name: getattr(self, name) for name in names}

    @cached_property
    def ranges(self) -> tuple[FrameRange, ...]:
        """Return the frames that clips are cut from, every end spelled out.

        They are broken where the recording is.
        """
        ranges: list[FrameRange] = []
        for frame_range in self._named_ranges():
            recording = self.recordings[frame_range.sequence]
            complete = frame_range.within(len(recording.frames))
            ranges += windows.pieces(complete, recording.breaks, self.num_frames)
        return tuple(ranges)

    @property
    def split_hash(self) -> str:
        """Return the hash of `ranges`, which is the same for clips from the same frames."""
        return splits.content_hash(self.ranges)

    @cached_property
    def _clips(self) -> list[tuple[str, Recording, int]]:
        """Return the name of each clip, the recording that holds it, and its first frame there."""
        return [
            (windows.clip_name(each.sequence, first), self.recordings[each.sequence], first)
            for each in self.ranges
            for first in each.starts(self.num_frames, self.stride)
        ]

    @property
    def clip_names(self) -> tuple[str, ...]:
        """Return the clips' names in order, without reading the clips."""
        return tuple(name for name, *_ in self._clips)

    @cached_property
    def recordings(self) -> dict[str, Recording]:
        """Return the sequences in use, by name, with the frames in use."""
        return {
            name: self._paused(
                recording.selected(frames_at_rate(recording.times_s, self.rate_hz, self.frame_step))
            )
            for name, recording in self.native_recordings.items()
        }

    def _paused(self, recording: Recording) -> Recording:
        """Return a recording with a break after each pause."""
        steps_s = np.diff(recording.times_s)
        if not len(steps_s):
            return recording
        is_pause = steps_s > max(self.max_step_s, 2 * float(np.median(steps_s)))
        pauses = (np.flatnonzero(is_pause) + 1).tolist()
        return replace(recording, breaks=tuple(sorted({*recording.breaks, *pauses})))

    @cached_property
    def native_recordings(self) -> dict[str, Recording]:
        """Return the sequences in use, by name, with all of their frames."""
        recordings = {}
        for frame_range in self._named_ranges():
            name = frame_range.sequence
            if name not in self._folders:
                names = ", ".join(self._folders) or "none"
                raise BadData(
                    f"there is no sequence {name!r}: name one of {names}, or frames of one as in "
                    "'03[180:360)'"
                )
            if name not in recordings:
                recordings[name] = self._read(name, self._folders[name])
        return recordings

    @cached_property
    def _load(self) -> Load:
        """Return the function that reads an image; clips overlap."""
        load = functools.partial(
            image_frames.read_image, bits=self.image_bits, is_upright=self.is_upright
        )
        return functools.lru_cache(maxsize=2 * self.num_frames)(load)

    def __len__(self) -> int:
        return len(self._clips)

    def __getitem__(self, index: int) -> Clip:
        """Return one clip; BadData names the image that is wrong."""
        name, recording, first = self._clips[index]
        settings = self.num_frames, self.size_px
        clip = windows.cut(recording, first, *settings, with_full=self.with_full, fit=self.fit)
        return replace(clip, name=name)

    def clip_digest(self, index: int) -> str:
        """Return a hash of the content of a clip, which does not depend on paths.

        Of image files, the size and a sample of bytes are read.
        """
        _, recording, first = self._clips[index]
        span = slice(first, first + self.num_frames)
        content = hashlib.sha256(repr((self.size_px, self.fit, self.image_bits)).encode())
        for step in range(span.start, span.stop):
            key = recording.name, step
            if key not in self._frame_digests:
                readers = filter(None, (recording.frames, recording.depths))
                self._frame_digests[key] = b"".join(reader.digest(step) for reader in readers)
            content.update(self._frame_digests[key])
        content.update(recording.times_s[span].tobytes())
        if recording.trajectory is not None:
            content.update(recording.trajectory.world_from_cam[span].tobytes())
        content.update(repr((recording.intrinsics, recording.camera_height_m)).encode())
        return content.hexdigest()[:16]

    @cached_property
    def _frame_digests(self) -> dict[tuple[str, int], bytes]:
        """Return the hashes of frames that were read, since clips overlap."""
        return {}

    def _named_ranges(self) -> tuple[FrameRange, ...]:
        """Return the frames that the settings name."""
        ranges = map(FrameRange, self._folders)
        if self.sequences is not None:
            ranges = map(FrameRange.parse, self.sequences)
        if named := tuple(ranges):
            return named
        raise BadData("no sequence is named: name some that the data set's folder holds")

    @cached_property
    def _folders(self) -> dict[str, Path]:
        return self.folders()

    @abstractmethod
    def folders(self) -> dict[str, Path]:
        """Return the sequences by name; BadData if there are none."""

    def scans(self, folder: Path, findings: Findings) -> dict[str, Scan]:
        """Scan a sequence by the names of its cameras, "" for one."""
        scan = Scan((), np.empty(0))
        with findings.catch(folder):
            scan = self.scan(folder, findings)
        return {"": scan}

    @abstractmethod
    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a sequence with the camera that clips show."""

    def _read(self, name: str, folder: Path) -> Recording:
        """Read a sequence, whose images are loaded later."""
        return self._recording(name, folder, self.scan(folder, RAISE))

    def _recording(self, name: str, folder: Path, scan: Scan) -> Recording:
        """Return a scanned sequence for clips; a camera height of the settings counts."""
        if self.camera_height_m is not None:
            scan = replace(scan, camera_height_m=self.camera_height_m)
        return scan.recording(name, folder, self._load, self.is_upright)


@dataclass(frozen=True)
class PosedSequences(SequenceDataset):
    """Sequences below one root, or a root that is one itself.

    Frames are counted among those with a pose.
    """

    patterns: ClassVar[tuple[str, ...]]  # of files that the folder of a sequence holds

    root: Path
    _: KW_ONLY

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root))  # scripts give text
        super().__post_init__()

    def folders(self) -> dict[str, Path]:
        """Return the sequences of the root by name; BadData if it has another layout."""

        def is_sequence(folder: Path) -> bool:
            return any(any(folder.glob(pattern)) for pattern in self.patterns)

        return sequence_folders(self.root, is_sequence, f"a folder with {self.patterns[0]}")

"""Clips of KITTI odometry, or of anything laid out like it (see `kitti_layout`)."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from geovp_classic.data import kitti_layout, splits, windows
from geovp_classic.data.frames import FrameCache, read_image
from geovp_classic.data.windows import Fit, FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Clip


@dataclass(frozen=True)
class Kitti:
    """KITTI odometry; one clip every `stride` frames of each range.

    Either `split` (a name, or a .toml file) or `sequences` ("06", "03[180:360)") says which frames; with neither, all
    sequences are used. Without `camera`, each sequence shows image_2 if it has it, else image_0, else what it has.
    Poses are those of the camera shown, or None for a sequence without a pose file. Frames are the central square at
    `size_px`, or whole frames stretched to it with `fit = "stretch"`; `with_wide` adds the uncropped ones, `with_right`
    those of the right camera where there is one. Everything but the images is read and checked on construction.
    """

    root: Path
    split: str | None = None
    sequences: tuple[str, ...] | None = None
    camera: int | None = None
    num_frames: int = 30
    stride: int = 10
    size_px: tuple[int, int] = (256, 256)
    fit: Fit = "crop"
    camera_height_m: float = 1.65
    with_wide: bool = False
    with_right: bool = False

    def __post_init__(self) -> None:
        """Raise BadData unless every sequence that is named can be used."""
        object.__setattr__(self, "root", Path(self.root))  # scripts give text
        windows.check_protocol(self.num_frames, self.stride, self.size_px, self.fit)
        if self.split is not None and self.sequences is not None:
            raise BadData(f"both split {self.split!r} and sequences {list(self.sequences)} are given: keep one of them")
        if self.camera is not None and self.camera not in kitti_layout.PREFERRED_CAMERAS:
            raise BadData(f"camera is {self.camera}, expected 0 to 3 for image_0 to image_3")
        for name, count in Counter(self.clip_names).items():
            if count > 1:
                raise BadData(f"clip {name} is named twice: give ranges that do not overlap")

    def __getstate__(self) -> dict[str, Any]:
        """The settings alone, so that a copy in another process reads its own files."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    @property
    def name(self) -> str:
        """The data set's name in results."""
        return "kitti"

    @cached_property
    def ranges(self) -> tuple[FrameRange, ...]:
        """The frames that clips are cut from, every end spelled out."""
        return tuple(frames.within(len(self.recordings[frames.sequence].frames)) for frames in self._wanted)

    @property
    def split_hash(self) -> str:
        """The hash of `ranges`: two people have the same one when their clips come from the same frames."""
        return splits.content_hash(self.ranges)

    @property
    def clip_names(self) -> tuple[str, ...]:
        """The clips' names in order, without reading the clips."""
        return tuple(windows.clip_name(sequence, first) for sequence, first in self._starts)

    @cached_property
    def recordings(self) -> dict[str, Recording]:
        """The sequences in use, by name."""
        load = FrameCache(read_image)
        return {name: self._read(name, load) for name in dict.fromkeys(frames.sequence for frames in self._wanted)}

    def __len__(self) -> int:
        """The number of clips."""
        return len(self._starts)

    def __getitem__(self, index: int) -> Clip:
        """One clip; BadData names the image that is wrong."""
        sequence, first = self._starts[index]
        recording = self.recordings[sequence]
        return windows.cut(recording, first, self.num_frames, self.size_px, with_wide=self.with_wide, fit=self.fit)

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        if self.split is not None:
            return splits.load(self.split)
        texts = self._names() if self.sequences is None else self.sequences
        if not texts:
            raise BadData(f"no sequence is named: name some that {self.root} holds")
        return tuple(FrameRange.parse(text) for text in texts)

    def _names(self) -> list[str]:
        """All sequences of the root."""
        return kitti_layout.sequence_names(self.root)

    def _read(self, name: str, load: Callable[[Path], ByteArray]) -> Recording:
        """One sequence."""
        settings = (self.camera, load, self.camera_height_m)
        return kitti_layout.read_recording(self.root, name, *settings, with_right=self.with_right)

    @cached_property
    def _starts(self) -> list[tuple[str, int]]:
        cuts = ((frames, windows.starts(frames, self.num_frames, self.stride)) for frames in self.ranges)
        return [(frames.sequence, first) for frames, firsts in cuts for first in firsts]

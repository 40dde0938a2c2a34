"""Data sets of several recordings below one root: which frames of which recording clips are cut
from.
"""

import dataclasses
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

from geovp_classic import files
from geovp_classic.data import splits, windows
from geovp_classic.data.frames import FrameCache, read_image
from geovp_classic.data.windows import Fit, FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Clip

Load = Callable[[Path], ByteArray]


class SequenceDataset(ABC):
    """What such data sets share; each is a frozen dataclass with these settings.

    `sequences` names sequences or frames of them ("06", "03[180:360)"); without it, all are used.
    """

    sequences: tuple[str, ...] | None
    num_frames: int
    stride: int
    size_px: tuple[int, int]
    with_full: bool
    fit: Fit = "crop"

    def _check(self) -> None:
        """Raise BadData unless every sequence that is named can be used."""
        windows.check_protocol(self.num_frames, self.stride, self.size_px, self.fit)
        for name, count in Counter(self.clip_names).items():
            files.check_name(name, "the clip")
            if count > 1:
                raise BadData(f"clip {name} is named twice: give ranges that do not overlap")

    def __getstate__(self) -> dict[str, Any]:
        """The settings alone, so that a copy in another process reads its own files."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}  # type: ignore[arg-type]

    @cached_property
    def ranges(self) -> tuple[FrameRange, ...]:
        """The frames that clips are cut from, every end spelled out; broken where the
        recording is.
        """
        pieces = []
        for frames in self._wanted:
            recording = self.recordings[frames.sequence]
            pieces += windows.pieces(
                frames.within(len(recording.frames)), recording.breaks, self.num_frames
            )
        return tuple(pieces)

    @property
    def split_hash(self) -> str:
        """The hash of `ranges`: two people have the same one when their clips come from the same
        frames.
        """
        return splits.content_hash(self.ranges)

    @property
    def clip_names(self) -> tuple[str, ...]:
        """The clips' names in order, without reading the clips."""
        return tuple(windows.clip_name(sequence, first) for sequence, first in self._starts)

    @cached_property
    def recordings(self) -> dict[str, Recording]:
        """The sequences in use, by name."""
        load = FrameCache(self._load)
        return {
            name: self._read(name, load)
            for name in dict.fromkeys(frames.sequence for frames in self._wanted)
        }

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, index: int) -> Clip:
        """One clip; BadData names the image that is wrong."""
        sequence, first = self._starts[index]
        recording = self.recordings[sequence]
        return windows.cut(
            recording, first, self.num_frames, self.size_px, with_full=self.with_full, fit=self.fit
        )

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        if self.sequences is None:
            found = tuple(FrameRange(name) for name in self._names())
        else:
            found = tuple(FrameRange.parse(text) for text in self.sequences)
        if not found:
            raise BadData("no sequence is named: name some that the data set's folder holds")
        return found

    @abstractmethod
    def _names(self) -> list[str]:
        """All sequences of the root."""

    @abstractmethod
    def _read(self, name: str, load: Load) -> Recording:
        """One sequence."""

    def _load(self, path: Path) -> ByteArray:
        return read_image(path)

    @cached_property
    def _starts(self) -> list[tuple[str, int]]:
        cuts = (
            (frames, windows.starts(frames, self.num_frames, self.stride)) for frames in self.ranges
        )
        return [(frames.sequence, first) for frames, firsts in cuts for first in firsts]

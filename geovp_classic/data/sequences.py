"""Data sets of several sequences below one root, and the frames that their clips are cut from."""

import dataclasses
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar

from geovp_classic import files
from geovp_classic.data import splits, windows
from geovp_classic.data.frames import Load, read_image
from geovp_classic.data.scan import Scan
from geovp_classic.data.windows import Fit, FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Clip


@dataclass(frozen=True, kw_only=True)
class SequenceDataset(ABC):
    """Clips of sequences, one every `stride` frames, and the settings that all data sets share.

    `sequences` names sequences or frames of them ("06", "03[180:360)"); without it, all are used.
    Frames are cropped to their central square at `size_px`, or with `fit = "stretch"` resized
    whole; `with_full` adds the uncropped ones. `image_bits` is the number of used bits of 16-bit
    images. Everything but the images is checked on construction.
    """

    sequences: tuple[str, ...] | None = None
    num_frames: int = 30
    stride: int = 10
    size_px: tuple[int, int] = (256, 256)
    with_full: bool = False
    camera_height_m: float | None = None
    image_bits: int | None = None

    def _check(self) -> None:
        """Raise BadData unless all named sequences can be used."""
        windows.check_protocol(
            self.num_frames, self.stride, self.size_px, self._fit
        )
        for name, count in Counter(self.clip_names).items():
            files.check_name(name, "the clip")
            if count > 1:
                raise BadData(
                    f"clip {name} is named twice: give ranges that do not overlap"
                )

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings alone, so that a copy in another process reads its own files."""
        return {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
        }

    @property
    def _fit(self) -> Fit:
        """Return the setting `fit` of the data sets that have it."""
        return getattr(self, "fit", "crop")

    @cached_property
    def ranges(self) -> tuple[FrameRange, ...]:
        """Return the frames that clips are cut from, every end spelled out.

        They are broken where the recording is.
        """
        pieces: list[FrameRange] = []
        for frames in self._wanted:
            recording = self.recordings[frames.sequence]
            complete = frames.within(len(recording.frames))
            pieces += windows.pieces(
                complete, recording.breaks, self.num_frames
            )
        return tuple(pieces)

    @property
    def split_hash(self) -> str:
        """Return the hash of `ranges`, which is the same for clips from the same frames."""
        return splits.content_hash(self.ranges)

    @property
    def clip_names(self) -> tuple[str, ...]:
        """Return the clips' names in order, without reading the clips."""
        return tuple(
            windows.clip_name(sequence, first)
            for sequence, first in self._starts
        )

    @cached_property
    def recordings(self) -> dict[str, Recording]:
        """Return the sequences in use, by name."""
        load = lru_cache(maxsize=2 * self.num_frames)(
            self._load
        )  # clips overlap
        names = dict.fromkeys(frames.sequence for frames in self._wanted)
        return {name: self._read(name, load) for name in names}

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, index: int) -> Clip:
        """Return one clip; BadData names the image that is wrong."""
        sequence, first = self._starts[index]
        recording = self.recordings[sequence]
        return windows.cut(
            recording,
            first,
            self.num_frames,
            self.size_px,
            with_full=self.with_full,
            fit=self._fit,
        )

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        if self.sequences is None:
            ranges = tuple(FrameRange(name) for name in self._folders)
        else:
            ranges = tuple(FrameRange.parse(text) for text in self.sequences)
        if not ranges:
            raise BadData(
                "no sequence is named: name some that the data set's folder holds"
            )
        return ranges

    @cached_property
    @abstractmethod
    def _folders(self) -> dict[str, Path]:
        """Return the sequences of the root by name."""

    @abstractmethod
    def _read(self, name: str, load: Load) -> Recording:
        """Read a sequence, whose images are loaded later."""

    def _folder(self, name: str) -> Path:
        """Return the folder of a sequence; BadData lists the others."""
        if name not in self._folders:
            raise BadData(
                f"there is no sequence {name!r}: name one of {', '.join(self._folders) or 'none'}"
            )
        return self._folders[name]

    def _load(self, path: Path) -> ByteArray:
        return read_image(path, self.image_bits)

    @cached_property
    def _starts(self) -> list[tuple[str, int]]:
        starts = []
        for frames in self.ranges:
            for first in windows.starts(frames, self.num_frames, self.stride):
                starts.append((frames.sequence, first))
        return starts


@dataclass(frozen=True)
class PosedSequences(SequenceDataset):
    """Sequences below one root, or a root that is one itself, shown without lens distortion.

    Frames are counted among those with a pose.
    """

    # scan(folder) scans a sequence as the default settings see it
    scan: ClassVar[Callable[..., Scan]]

    root: Path
    _: KW_ONLY
    fit: Fit = "crop"

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root))  # scripts give text
        self._check()

    @staticmethod
    @abstractmethod
    def folders(root: Path) -> dict[str, Path]:
        """Return the sequences of a root by name; BadData if it has another layout."""

    @classmethod
    def scans(cls, folder: Path) -> dict[str, Scan]:
        """Scan a sequence by the names of its cameras, "" for one."""
        return {"": cls.scan(folder)}

    @abstractmethod
    def _scan(self, folder: Path) -> Scan:
        """Scan a sequence."""

    @cached_property
    def _folders(self) -> dict[str, Path]:
        return self.folders(self.root)

    def _read(self, name: str, load: Load) -> Recording:
        folder = self._folder(name)
        return self._scan(folder).recording(
            name, folder, load, self.camera_height_m
        )

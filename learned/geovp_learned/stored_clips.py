"""Clips on disk as the examples of a training need them: frames are read where they are used.

The first start of a run reads each clip once and stores its frames at the network's size, so that
neither the loop nor its worker processes hold them in memory.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from geovp_classic import files
from geovp_classic.interfaces import Dataset
from geovp_classic.types import Clip, FloatArray, Intrinsics

# What examples need of a clip: "frames" [T, H, W, 3], "world_from_cam" [T, 4, 4], "camera" [6], ...
Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class StoredClip(Mapping[str, npt.NDArray[Any]]):
    """Arrays in the files of a folder, mapped into memory when they are asked for."""

    folder: Path

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        try:
            array: npt.NDArray[Any] = np.load(self.folder / f"{name}.npy", mmap_mode="r")
        except FileNotFoundError:
            raise KeyError(name) from None
        return array

    def __iter__(self) -> Any:
        return (file.stem for file in sorted(self.folder.glob("*.npy")))

    def __len__(self) -> int:
        return sum(1 for _ in self)


@dataclass(frozen=True)
class Window:
    """The frames of a clip from `first` on."""

    clip: Arrays
    first: int


def windows(clips: Sequence[Arrays], num_frames: int, stride: int) -> list[Window]:
    """Return every `stride`-th window of `num_frames` frames of each clip."""
    return [
        Window(clip, first)
        for clip in clips
        for first in range(0, len(clip["frames"]) - num_frames + 1, stride)
    ]


def store(
    datasets: Sequence[Dataset], prepare: Callable[[Clip], Arrays], folder: Path
) -> list[StoredClip]:
    """Store the prepared arrays of all clips, but of those that are there already."""
    stored = []
    for number, dataset in enumerate(datasets):
        indices = range(len(dataset))
        for index in tqdm(indices, desc=f"reading {dataset.name}", leave=False, delay=2.0):
            place = folder / f"{number}-{index:06d}"
            if not place.is_dir():
                partial = place.with_suffix(".part")
                shutil.rmtree(partial, ignore_errors=True)
                arrays = prepare(dataset[index])
                with files.checked(
                    f"{place} cannot be written", "make room, or give another --out"
                ):
                    partial.mkdir(parents=True)
                    for name, array in arrays.items():
                        np.save(partial / f"{name}.npy", array)
                    partial.rename(place)
            stored.append(StoredClip(place))
    return stored


def camera_array(camera: Intrinsics) -> FloatArray:
    """Return fx, fy, cx, cy, width and height in pixels [6]."""
    return np.array([*vars(camera).values()], dtype=float)

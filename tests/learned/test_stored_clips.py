"""Clips of a training on disk: read once, mapped into memory, and small to hand to a process."""

import pickle
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from geovp_classic.types import Clip, Intrinsics
from geovp_learned import stored_clips
from geovp_learned.stored_clips import Arrays

CAMERA = Intrinsics(50.0, 60.0, 31.5, 15.5, 64, 32)


@dataclass(frozen=True)
class Levels:
    """Clips of four frames whose grey level is the number of the clip; it notes what is read."""

    num_clips: int = 3
    broken: int = -1
    reads: list[int] = field(default_factory=list)

    @property
    def name(self) -> str:
        return "levels"

    def __len__(self) -> int:
        return self.num_clips

    def __getitem__(self, index: int) -> Clip:
        if index == self.broken:
            raise KeyboardInterrupt
        self.reads.append(index)
        frames = np.full((4, 32, 64, 3), index, np.uint8)
        return Clip(f"levels/{index}", frames, np.arange(4.0), CAMERA)


def prepare(clip: Clip) -> Arrays:
    return {"frames": clip.frames, "camera": stored_clips.camera_array(clip.intrinsics)}


def test_clips_are_read_once_and_mapped(tmp_path: Path) -> None:
    dataset = Levels()
    stored = stored_clips.store([dataset], prepare, tmp_path)
    again = stored_clips.store([dataset], prepare, tmp_path)
    assert dataset.reads == [0, 1, 2]
    assert again == stored
    assert [clip["frames"][0, 0, 0, 0] for clip in stored] == [0, 1, 2]
    assert isinstance(stored[1]["frames"], np.memmap)
    assert stored[1]["camera"].tolist() == [50.0, 60.0, 31.5, 15.5, 64, 32]
    assert sorted(stored[0]) == ["camera", "frames"]
    both = stored_clips.store([dataset, dataset], prepare, tmp_path / "both")
    assert len({clip.folder for clip in both}) == 6


def test_a_window_takes_its_place_along_and_not_its_frames(tmp_path: Path) -> None:
    """The frames of a clip have 24 kB; a worker process gets less than a tenth."""
    windows = stored_clips.windows(stored_clips.store([Levels()], prepare, tmp_path), 2, 1)
    assert len(windows) == 9  # three of each clip
    content = pickle.dumps(windows[-1])
    assert len(content) < 2400
    copied = pickle.loads(content)
    assert (copied.first, copied.clip["frames"][copied.first, 0, 0, 0]) == (2, 2)


def test_an_interrupted_start_goes_on_with_whole_clips(tmp_path: Path) -> None:
    broken = Levels(broken=2)
    with pytest.raises(KeyboardInterrupt):
        stored_clips.store([broken], prepare, tmp_path)
    assert not [*tmp_path.glob("*.part")]
    mended = replace(broken, broken=-1)
    assert len(stored_clips.store([mended], prepare, tmp_path)) == 3
    assert mended.reads == [0, 1, 2]

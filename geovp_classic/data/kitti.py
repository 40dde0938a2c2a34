"""Clips of KITTI odometry, or of anything laid out like it (see `kitti_layout`)."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from geovp_classic.data import kitti_layout, splits
from geovp_classic.data.sequences import Load, SequenceDataset
from geovp_classic.data.windows import Fit, FrameRange, Recording
from geovp_classic.errors import BadData


@dataclass(frozen=True)
class Kitti(SequenceDataset):
    """KITTI odometry; one clip every `stride` frames of each range.

    Either `split` (a name, or a .toml file) or `sequences` ("06", "03[180:360)") says which frames;
    with neither, all sequences are used. Without `camera`, each sequence shows image_2 if it has
    it, else image_0, else what it has. Poses are those of the camera shown, or None for a sequence
    without a pose file. Frames are the central square at `size_px`, or whole frames stretched to it
    with `fit = "stretch"`; `with_full` adds the uncropped ones, `with_right` those of the right
    camera where there is one. Everything but the images is read and checked on construction.
    """

    name: ClassVar[str] = "kitti"  # in results
    layout: ClassVar[Any] = kitti_layout  # the module that knows the files

    root: Path
    split: str | None = None
    sequences: tuple[str, ...] | None = None
    camera: int | None = None
    num_frames: int = 30
    stride: int = 10
    size_px: tuple[int, int] = (256, 256)
    fit: Fit = "crop"
    camera_height_m: float = 1.65
    with_full: bool = False
    with_right: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root))  # scripts give text
        if self.split is not None and self.sequences is not None:
            raise BadData(
                f"both split {self.split!r} and sequences {list(self.sequences)} are given: "
                "keep one of them"
            )
        if self.camera is not None and self.camera not in kitti_layout.PREFERRED_CAMERAS:
            raise BadData(f"camera is {self.camera}, expected 0 to 3 for image_0 to image_3")
        self._check()

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        return super()._wanted if self.split is None else splits.load(self.split)

    def _names(self) -> list[str]:
        return list(self.layout.sequence_names(self.root))

    def _read(self, name: str, load: Load) -> Recording:
        settings = (self.camera, load, self.camera_height_m)
        return self.layout.read_recording(self.root, name, *settings, with_right=self.with_right)

"""Depth maps of other software as a depth source."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from geovp_classic import files
from geovp_classic.data.formats import sequence_paths
from geovp_classic.data.frames.image_frames import decode
from geovp_classic.depth.relative_depth import DepthAlignment, DepthValues, inverse_of, metric
from geovp_classic.errors import BadData, MissingExtra, install_command
from geovp_classic.geometry import pinhole
from geovp_classic.types import Context, FloatArray, Intrinsics, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class RecordedDepth:
    """Depth maps from a folder with one file per frame of a sequence.

    Files are named by the number of the frame, as 000187.npz (with one array [H, W]), 000187.png
    (16 bits) or 000187.exr; "{sequence}" in `path` stands for the clip's sequence. NaN and negative
    values are unknown, and so is a depth of 0. Each map must depend on its frame and earlier ones
    alone.
    """

    path: Path
    values: DepthValues = "depth"
    # Depth in metres is the stored value times this; inverse depth per metre likewise. It is
    # 1 / (focal length x baseline) of disparities.
    unit: float = 1.0
    align: bool = False  # relative values, aligned in inverse depth
    alignment: DepthAlignment = DepthAlignment()
    # Whether maps show the uncropped frames, which are cropped to their middle, or the crop
    frames: Literal["full", "crop"] = "full"

    def __post_init__(self) -> None:
        sequence_paths.check_exists(self.path, "a folder with a depth map per frame")
        if not self.unit > 0 or (self.values == "disparity" and not self.align and self.unit == 1):
            raise BadData(
                f"unit is {self.unit}, expected a positive number; disparities need 1 / (focal "
                "length x baseline), or align = true"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the alignment."""
        return self.alignment.needs if self.align else PrivilegedInput.NONE

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth [P, H, W] and confidence [P, H, W]: 1 where it is known, else 0.

        Frames without a file are unknown. Raises Incompatible if metric depth meets poses that are
        not metric, and BadData if the last frame has no file.
        """
        sequence, numbers = context.frame_numbers()
        folder = sequence_paths.of_sequence(self.path, sequence)
        maps = np.full(context.frames.shape[:3], np.nan, np.float32)
        stored = [_find(folder, number) for number in numbers]
        if stored[-1] is None:
            raise BadData(
                f"{folder} has no depth map of frame {numbers[-1]}, expected "
                f"{numbers[-1]:06d}.npz, .png or .exr"
            )
        for step, file in enumerate(stored):
            if file is not None:
                maps[step] = self._read(file, context)
        if self.align:
            return self.alignment.align(maps, context.only(self.needs), past)
        return metric(maps, past)

    def _read(self, file: Path, context: Context) -> FloatArray:
        """Return the inverse depth [H, W] of one frame, NaN where it is unknown."""
        # Maps are of whole images, of which the context may hold a window
        observed = context.observations
        left, top, right, bottom = (0, 0, 1, 1) if observed is None else observed.window
        width_px, height_px = context.intrinsics.size_px
        size_px = round(width_px / (right - left)), round(height_px / (bottom - top))
        stored = _read_map(file)
        stored_camera = Intrinsics(1.0, 1.0, 0.0, 0.0, stored.shape[1], stored.shape[0])
        if self.frames == "full":
            window, _ = pinhole.centre_crop(stored_camera, size_px)
            stored = stored[window]
        # Means across an edge would lie on no surface.
        values = cv2.resize(
            np.ascontiguousarray(stored),
            size_px,
            interpolation=cv2.INTER_NEAREST_EXACT,
        )[round(top * size_px[1]) :, round(left * size_px[0]) :][:height_px, :width_px]
        return inverse_of(values, self.values, self.unit)


def _find(folder: Path, number: int) -> Path | None:
    """Return the file of a frame, whose number may have zeros in front; None if there is none."""
    for suffix in ("npz", "png", "exr"):
        for stem in (f"{number:06d}", f"{number:010d}", str(number)):
            file = folder / f"{stem}.{suffix}"
            if file.exists():
                return file
    return None


def _read_map(file: Path) -> FloatArray:
    """Return the stored values [H, W] as float32; raise BadData for other contents."""
    if file.suffix == ".npz":
        array = next(iter(files.read_npz(file).values()), np.zeros(0))
    elif file.suffix == ".png":
        array = decode(file, cv2.IMREAD_UNCHANGED)
    else:
        array = _read_exr(file)
    if array.ndim != 2 or array.dtype == np.uint8:
        raise BadData(
            f"{file} holds {array.dtype} of shape {array.shape}, expected [H, W] with 16 bits or "
            "floating-point numbers"
        )
    return array.astype(np.float32)


def _read_exr(file: Path) -> FloatArray:
    """Return the only or first channel [H, W] of an EXR file."""
    try:
        import OpenEXR
    except ImportError as problem:
        raise MissingExtra(
            f"EXR files need OpenEXR, which is not installed: {install_command('exr')}"
        ) from problem
    with (
        files.checked(f"{file} cannot be read", "restore it, or give npz files"),
        OpenEXR.File(str(file), separate_channels=True) as image,
    ):
        return next(iter(image.channels().values())).pixels

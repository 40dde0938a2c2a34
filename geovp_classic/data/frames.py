"""The frames of one camera, read one at a time: a list of image files, or a video."""

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self

import cv2
import numpy as np

from geovp_classic import files
from geovp_classic.data import decoding
from geovp_classic.data.findings import Findings
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray

SUFFIXES = frozenset(
    {
        ".png",
        ".jpg",
        ".jpeg",
        ".webp",
        ".bmp",
        ".tif",
        ".tiff",
        ".ppm",
        ".pgm",
        ".jp2",
    }
)
Load = Callable[[Path], ByteArray]


class FrameReader(Protocol):
    """Frames by number, all of one size; the same number gives the same image."""

    def __len__(self) -> int:
        """Return the number of frames."""

    def read(self, index: int) -> ByteArray:
        """Return one frame [H, W, 3]; BadData names the file that is wrong."""


def read_image(path: Path, bits: int | None = None) -> ByteArray:
    """Return the RGB image [H, W, 3], grey ones with three equal channels.

    `bits` is the number of used bits of an image with 16 bits per channel, of which the upper 8
    are kept. Without it, such an image is refused: 12 bits in 16 and a dark image of 16 bits look
    alike. BadData if the file is damaged.
    """
    image = decoding.decoded(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if image.dtype == np.uint16 and bits is not None and 8 <= bits <= 16:
        max_value = int(image.max())
        if max_value >= 2**bits:
            raise BadData(
                f"{path} has the value {max_value}, more than {bits} bits hold: give a larger "
                "image_bits"
            )
        image = (image >> (bits - 8)).astype(np.uint8)
    if image.dtype != np.uint8:
        raise BadData(
            f"{path} holds {image.dtype} values, expected 8 bits a channel: convert the images, "
            "or set image_bits to the number of used bits (8 to 16) if they are uint16"
        )
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def image_size(path: Path) -> tuple[int, int]:
    """Return (width, height) of an image file; BadData if it is incomplete."""
    with files.opened(path) as file:
        return decoding.checked_size(path, file)


@dataclass(frozen=True)
class FrameFiles:
    """One image file per frame."""

    paths: tuple[Path, ...]  # N
    sizes_px: tuple[
        tuple[int, int], ...
    ]  # N, (width, height) that a file must have
    load: Load = read_image

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, index: int) -> ByteArray:
        """Return one frame; BadData if its file is damaged or of another size."""
        return load_sized(self.paths[index], self.sizes_px[index], self.load)


def load_sized(
    path: Path, size_px: tuple[int, int], load: Callable[[Path], Any]
) -> Any:
    """Return the array [H, W, ...] of an image file; BadData if its size is not the given one."""
    image = load(path)
    height_px, width_px = image.shape[:2]
    if (width_px, height_px) != size_px:
        raise BadData(
            f"{path} is {width_px}x{height_px} pixels, expected {size_px[0]}x{size_px[1]} as the "
            "first frame or the calibration: restore the file"
        )
    return image


@dataclass
class VideoFrames:
    """The frames of a video, decoded from its start up to the frame that is read.

    Seeking by number is not used, because the index of many containers is wrong.
    """

    path: Path
    count: int  # according to the container
    size_px: tuple[int, int]
    rate_hz: float | None  # according to the container; None if unknown
    _capture: Any = field(repr=False)
    _next: int = 0

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a video file; BadData if it cannot be decoded.

        Frames are counted if the container does not state their number.
        """
        files.check_file(path)
        capture = cv2.VideoCapture(str(path))
        width_px = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height_px = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if (
            not capture.isOpened()
            or not 0 < width_px * height_px <= decoding.MAX_PIXELS
        ):
            raise BadData(
                f"{path} cannot be decoded as a video of at most {decoding.MAX_PIXELS:,} pixels: "
                "give a folder of images or another video file"
            )
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate_hz = float(capture.get(cv2.CAP_PROP_FPS))
        if count < 1:
            count = 0
            while capture.grab():
                count += 1
            capture = cv2.VideoCapture(str(path))
        if (
            not 0 < count <= path.stat().st_size
        ):  # a frame takes at least a byte
            raise BadData(
                f"{path} claims {count} frames, which its size cannot hold: restore the file"
            )
        is_plausible = 0 < rate_hz < 1000
        return cls(
            path,
            count,
            (width_px, height_px),
            rate_hz if is_plausible else None,
            capture,
        )

    def __post_init__(self) -> None:
        self._cached = functools.lru_cache(maxsize=64)(self._decode)

    def __len__(self) -> int:
        return self.count

    def read(self, index: int) -> ByteArray:
        """Return one frame; BadData if the video ends before it or is damaged there."""
        return self._cached(index)

    def _decode(self, index: int) -> ByteArray:
        if index < self._next:
            self._capture = cv2.VideoCapture(str(self.path))
            self._next = 0
        while self._next < index and self._capture.grab():
            self._next += 1
        image = self._capture.read()[1] if self._next == index else None
        if image is None or image.shape[1::-1] != self.size_px:
            raise BadData(
                f"{self.path}: frame {index} of {self.count} cannot be decoded: exclude it from "
                "the range"
            )
        self._next += 1
        return np.asarray(
            cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8
        )


def is_image(path: Path) -> bool:
    """Return whether a file has the name of a visible image."""
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".")


def image_files(folder: Path) -> list[Path]:
    """Return the images of a folder by name, numbers in names counted as numbers (2 before 10)."""
    try:
        images = filter(is_image, folder.iterdir())
        return sorted(images, key=natural_order)
    except OSError as problem:
        raise BadData(
            f"{folder} cannot be listed ({problem.strerror}): give a folder of images"
        ) from problem


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts file names with numbers in them counted as numbers."""
    parts = re.split(r"(\d+)", path.name)
    return [
        (int(part), "") if part.isdecimal() else (-1, part)
        for part in parts
        if part
    ]


def scan_numbered(folder: Path, findings: Findings) -> tuple[Path, ...]:
    """Return the images 000000, 000001, ... of a folder; report gaps, duplicates, other files."""
    images: dict[int, Path] = {}
    for path in sorted(folder.glob("[!.]*")):
        if not is_image(path) or not path.stem.isdecimal():
            findings.note(path, "is not a numbered image: ignored")
            continue
        first = images.setdefault(int(path.stem), path)
        if first is not path:
            findings.error(
                path, f"has the same number as {first.name}: keep one of them"
            )
    if not images:
        findings.error(
            folder,
            "holds no images, expected 000000.png (or jpg, webp, ...) and so on",
        )
    numbers = sorted(images)
    for expected, number in enumerate(numbers):
        if number != expected:
            findings.error(
                folder,
                f"lacks frame {expected:06d}: number frames without a gap",
            )
            break
    return tuple(images[number] for number in numbers)

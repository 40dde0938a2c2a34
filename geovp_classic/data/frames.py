"""The frames of one camera, read one at a time: a list of image files, or a video."""

import re
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self

import cv2
import numpy as np
import numpy.typing as npt

from geovp_classic import files
from geovp_classic.data import decoding
from geovp_classic.data.findings import Finding, error
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray

SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".jp2"}
)
CACHE_LIMIT_BYTES = 2**27  # 128 MiB: 96 frames of KITTI


class FrameReader(Protocol):
    """Frames by number, all of one size; the same number gives the same image."""

    def __len__(self) -> int:
        """The number of frames."""

    def read(self, index: int) -> ByteArray:
        """One frame [H, W, 3]; BadData names the file that is wrong."""


def read_image(path: Path, bits: int | None = None) -> ByteArray:
    """The image [H, W, 3] in RGB, grey ones with three equal channels; BadData when the file is
    damaged.

    `bits` says how many bits of an image of 16 bits a channel are used; the upper 8 of them are
    kept. Without it, such an image is refused: 12 bits in 16 and a dark image of 16 bits look
    alike.
    """
    image = decoding.decoded(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    image = _eight_bits(path, image, bits)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _eight_bits(path: Path, image: npt.NDArray[Any], bits: int | None) -> ByteArray:
    """The image as it is, or the upper 8 of the used bits."""
    if image.dtype == np.uint8:
        return image
    if image.dtype != np.uint16 or bits is None:
        raise BadData(
            f"{path} holds {image.dtype} values, expected 8 bits a channel: convert the images, "
            "or where they are "
            "uint16 and the data set has the setting image_bits, say how many bits are used "
            "(image_bits = 12 or 16)"
        )
    if not 8 <= bits <= 16:
        raise BadData(f"image_bits is {bits}, expected 8 to 16, the number of bits that images use")
    if int(image.max()) >= 2**bits:
        raise BadData(
            f"{path} has the value {int(image.max())}, more than {bits} bits hold: give a "
            "larger image_bits"
        )
    return (image >> (bits - 8)).astype(np.uint8)


def image_size(path: Path, *, deep: bool = False) -> tuple[int, int]:
    """(width, height) from the header, or of the decoded image when `deep`.

    BadData when the file is damaged; without `deep`, damage in the middle is not found.
    """
    if deep:
        height_px, width_px = read_image(path).shape[:2]
        return width_px, height_px
    with files.opened(path) as file:
        return decoding.header_size(path, file)


@dataclass(frozen=True)
class FrameFiles:
    """One image file a frame."""

    paths: tuple[Path, ...]
    size_px: tuple[int, int]  # (width, height) that every file must have
    load: Callable[[Path], ByteArray] = read_image

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, index: int) -> ByteArray:
        """One frame; BadData when its file is damaged or of another size."""
        image = self.load(self.paths[index])
        height_px, width_px = image.shape[:2]
        if (width_px, height_px) != self.size_px:
            expected = f"{self.size_px[0]}x{self.size_px[1]} as the first frame"
            raise BadData(
                f"{self.paths[index]} is {width_px}x{height_px} pixels, expected {expected}"
            )
        return image


class FrameCache:
    """The frames decoded last, up to a number of bytes, so that overlapping clips decode each frame
    once.
    """

    def __init__(
        self, load: Callable[[Any], ByteArray], limit_bytes: int = CACHE_LIMIT_BYTES
    ) -> None:
        self._load, self._limit_bytes, self._held_bytes = load, limit_bytes, 0
        self._frames: OrderedDict[Any, ByteArray] = OrderedDict()
        self._lock = threading.Lock()

    def __call__(self, key: Any) -> ByteArray:
        """The frame of a key, decoded only when it is not in the cache; read-only, because it is
        shared.
        """
        with self._lock:
            if key in self._frames:
                self._frames.move_to_end(key)
                return self._frames[key]
        frame = self._load(key)
        frame.flags.writeable = False
        with self._lock:
            if key not in self._frames:
                self._frames[key] = frame
                self._held_bytes += frame.nbytes
            while self._held_bytes > self._limit_bytes:
                self._held_bytes -= self._frames.popitem(last=False)[1].nbytes
        return frame


@dataclass
class VideoFrames:
    """The frames of a video, decoded from its start up to the frame that is read; the last ones are
    cached.

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
        """The video of a file; BadData when it cannot be decoded. Frames are counted where the
        container is silent.
        """
        files.check_file(path)
        capture = cv2.VideoCapture(str(path))
        size_px = (
            int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        if not capture.isOpened() or min(size_px) < 1:
            raise BadData(
                f"{path} cannot be decoded as a video: give a folder of images or another video "
                "file"
            )
        if size_px[0] * size_px[1] > decoding.MAX_PIXELS:
            raise BadData(
                f"{path} is {size_px[0]}x{size_px[1]} pixels, more than "
                f"{decoding.MAX_PIXELS:,}: shrink it"
            )
        count, rate_hz = (
            int(capture.get(cv2.CAP_PROP_FRAME_COUNT)),
            float(capture.get(cv2.CAP_PROP_FPS)),
        )
        if count < 1:
            count = 0
            while capture.grab():
                count += 1
            capture = cv2.VideoCapture(str(path))
        if not 0 < count <= path.stat().st_size:  # a frame takes at least a byte
            raise BadData(
                f"{path} says that it has {count} frames, which its size cannot hold: restore "
                "the file"
            )
        known = np.isfinite(rate_hz) and 0 < rate_hz < 1000
        return cls(path, count, size_px, rate_hz if known else None, capture)

    def __post_init__(self) -> None:
        self._cached = FrameCache(self._decode)

    def __len__(self) -> int:
        return self.count

    def read(self, index: int) -> ByteArray:
        """One frame; BadData when the video ends before it or is damaged there."""
        return self._cached(index)

    def _decode(self, index: int) -> ByteArray:
        if index < self._next:
            self._capture, self._next = cv2.VideoCapture(str(self.path)), 0
        while self._next < index and self._capture.grab():
            self._next += 1
        good, image = self._capture.read() if self._next == index else (False, None)
        if not good or image is None or image.shape[1::-1] != self.size_px:
            raise BadData(
                f"{self.path}: frame {index} of {self.count} cannot be decoded: leave it out of "
                "the range"
            )
        self._next += 1
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def image_files(folder: Path) -> list[Path]:
    """The images of a folder by name, numbers in names counted as numbers (2 before 10)."""
    try:
        found = [
            path
            for path in folder.iterdir()
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
        ]
    except OSError as problem:
        raise BadData(
            f"{folder} cannot be listed ({problem.strerror}): give a folder of images"
        ) from problem
    return sorted(found, key=natural_order)


def scan_numbered(folder: Path) -> tuple[tuple[Path, ...], list[Finding]]:
    """The images 000000, 000001, ... of a folder, and a finding for every gap, duplicate and
    foreign file.
    """
    found: dict[int, Path] = {}
    findings = []
    for path in sorted(path for path in folder.iterdir() if not path.name.startswith(".")):
        if path.suffix.lower() not in SUFFIXES or not path.stem.isdecimal():
            findings.append(Finding(path, None, "note", "is not a numbered image and is left out"))
            continue
        first = found.setdefault(int(path.stem), path)
        if first is not path:
            findings.append(
                error(path, None, f"is frame {int(path.stem)} as {first.name} is: keep one")
            )
    if not found:
        findings.append(
            error(
                folder, None, "holds no images, expected 000000.png (or jpg, webp, ...) and so on"
            )
        )
    numbers = sorted(found)
    for before, number in zip([-1, *numbers], numbers, strict=False):
        if number > before + 1:
            one = number == before + 2
            gap = (
                f"frame {before + 1:06d} is"
                if one
                else f"frames {before + 1:06d} to {number - 1:06d} are"
            )
            findings.append(
                error(
                    folder,
                    None,
                    f"{gap} missing: frames must be numbered from 000000 without a gap",
                )
            )
    return tuple(found[number] for number in numbers), findings


def natural_order(path: Path) -> list[tuple[int, str]]:
    """A key that sorts file names with numbers in them counted as numbers."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part)
        for part in re.split(r"(\d+)", path.name)
        if part
    ]

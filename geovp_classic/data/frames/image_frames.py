"""Frames of one camera in image files, read one at a time.

Images are decoded only if they are complete. PNG has a checksum for every chunk. JPEG, WebP, BMP,
PPM and JPEG 2000 have none: a flipped bit in their pixels is not noticed. Missing or overwritten
bytes of a JPEG mostly are, because its codes then end too early or too late.
"""

import contextlib
import fnmatch
import hashlib
import io
import itertools
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import av
import cv2
import numpy as np
import numpy.typing as npt
from PIL import ExifTags, Image

from geovp_classic import files
from geovp_classic.data.findings import Findings
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray, IntArray

MAX_PIXELS = 2**25  # 8192 x 4096; 8K video has 7680 x 4320
Array = npt.NDArray[Any]
Load = Callable[[Path], Array]
Size = tuple[int, int]  # (width, height)


class FrameReader(Protocol):
    """Frames by number, all of one size; the same number gives the same image."""

    def __len__(self) -> int:
        """Return the number of frames."""

    def read(self, index: int) -> ByteArray:
        """Return one frame [H, W, 3]; BadData names the file that is wrong."""

    def digest(self, index: int) -> bytes:
        """Return a hash of the content of a frame, which does not depend on its path."""


def decode(
    path: Path,
    flags: int,
    content: bytes | None = None,
    *,
    is_upright: bool = False,
) -> Array:
    """Return the image of a file, or of its content, as OpenCV decodes it.

    BadData if the file is damaged.
    """
    data = files.read_bytes(path) if content is None else content
    what = f"{path} cannot be decoded as an image"
    _, orientation = _check_image(path, io.BytesIO(data), is_upright=is_upright)
    with files.checked(what, "restore the file"):
        pixels = np.frombuffer(data, np.uint8)
        image = cv2.imdecode(pixels, flags | cv2.IMREAD_IGNORE_ORIENTATION)
        if image is None:
            raise ValueError("its pixels are damaged, or of a type that OpenCV does not read")
        return oriented(
            image,
            is_transposed=orientation >= 5,
            has_rows_reversed=orientation in (3, 4, 7, 8),
            has_columns_reversed=orientation in (2, 3, 6, 7),
        )


def oriented(
    image: Array, *, is_transposed: bool, has_rows_reversed: bool, has_columns_reversed: bool
) -> Array:
    """Return an image that is turned by a multiple of 90 degrees, mirrored or both."""
    if is_transposed:
        image = image.swapaxes(0, 1)
    image = image[:: -1 if has_rows_reversed else 1, :: -1 if has_columns_reversed else 1]
    return np.ascontiguousarray(image)


def read_image(
    path: Path,
    bits: int | None = None,
    content: bytes | None = None,
    *,
    is_upright: bool = True,
) -> ByteArray:
    """Return the RGB image [H, W, 3] of a file or of its content, grey ones with equal channels.

    It is turned as its EXIF data say; with `is_upright` False it has the stored pixels, which
    calibrations of other programs are about.

    `bits` is the number of used bits of an image with 16 bits per channel, of which the upper 8
    are kept. Without it, such an image is refused: 12 bits in 16 and a dark image of 16 bits look
    alike. BadData if the file is damaged.
    """
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
    image = decode(path, flags, content, is_upright=is_upright)
    return cv2.cvtColor(to_8_bits(path, image, bits), cv2.COLOR_BGR2RGB)


def to_8_bits(path: Path, image: Array, bits: int | None) -> ByteArray:
    """Return the upper 8 of an image's used `bits`, as in `read_image`."""
    if image.dtype == np.uint16 and bits is not None and 8 <= bits <= 16:
        if (max_value := image.max()) >= 2**bits:
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
    return image


def read_depth(path: Path, values_per_m: float = 5000.0) -> FloatArray:
    """Return a depth image [H, W] in metres; BadData for an image of another type."""
    image = decode(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise BadData(
            f"{path} holds {image.dtype} in {image.ndim} dimensions, expected a depth image of "
            "one channel of 16 bits: restore the file"
        )
    return (image / values_per_m).astype(np.float32)


def image_size(path: Path, *, is_upright: bool = False) -> Size:
    """Return (width, height) of an image as `read_image` returns it; BadData if it is damaged."""
    with files.opened(path) as file:
        size_px, orientation = _check_image(path, file, is_upright=is_upright)
    return size_px[::-1] if orientation >= 5 else size_px


def _check_image(path: Path, file: BinaryIO, *, is_upright: bool) -> tuple[Size, int]:
    """Return (width, height) of the stored image, and the EXIF orientation that it is shown with.

    BadData if the image is too large, truncated or damaged. OpenCV would show the missing part of
    a truncated image in grey, and shift what follows a gap.
    """
    what = f"{path} cannot be decoded as an image"
    with files.checked(what, "restore or shrink it"), Image.open(file) as image:
        size_px = image.size
        if math.prod(size_px) > MAX_PIXELS:
            raise ValueError(f"it has more than {MAX_PIXELS:,} pixels")
        # Pillow would decode a PNG to look for EXIF data behind its pixels
        orientation = 1
        if image.format != "PNG" or "exif" in image.info:
            orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
        if image.format == "TIFF":  # Pillow and OpenCV turn it upright
            if orientation != 1 and not is_upright:
                raise ValueError(f"its pixels are turned by EXIF orientation {orientation}")
            orientation = 1
        # a PNG has checksums, and a WebP is complete once it is opened
        if image.format in ("PNG", "WEBP"):
            image.verify()
        else:
            # Pillow notices that a JPEG has no end, and FFmpeg that its middle is damaged; both
            # decode it at an eighth of its size
            image.draft("RGB", (1, 1))
            image.load()
        if image.format in ("JPEG", "MPO"):
            decoder = av.CodecContext.create("mjpeg", "r")
            decoder.options = {"err_detect": "explode", "lowres": "3"}
            file.seek(0)
            with contextlib.suppress(av.PatchWelcomeError):  # it does not decode CMYK
                decoder.decode(av.Packet(file.read()))
    is_turned = is_upright and orientation in range(2, 9)
    return size_px, orientation if is_turned else 1


@dataclass(frozen=True)
class FrameFiles:
    """One image file per frame."""

    paths: tuple[Path | None, ...]  # N; None for an image that is 0 everywhere
    sizes_px: tuple[Size, ...]  # N, (width, height) that a file must have
    load: Load = read_image

    def __len__(self) -> int:
        return len(self.paths)

    def digest(self, index: int) -> bytes:
        """Return a hash of the content of a frame, from a part of its file."""
        path = self.paths[index]
        if path is None or not path.is_file():  # an image of a bag
            return hashlib.sha256(self.read(index).tobytes()).digest()
        return file_digest(path)

    def read(self, index: int) -> Array:
        """Return one frame [H, W, ...]; BadData if its file is damaged or of another size."""
        path = self.paths[index]
        width_px, height_px = self.sizes_px[index]
        if path is None:
            return np.zeros((height_px, width_px), np.float32)
        image = self.load(path)
        if image.shape[:2] != (height_px, width_px):
            raise BadData(
                f"{path} is {image.shape[1]}x{image.shape[0]} pixels, expected "
                f"{width_px}x{height_px} as the first frame or the calibration: restore the file"
            )
        return image


def file_digest(path: Path, sample_bytes: int = 1024) -> bytes:
    """Return a hash of a file's size and of its start, middle and end.

    The ends of compressed images depend on all pixels (PNG has checksums there).
    """
    with files.opened(path) as file:
        size = file.seek(0, io.SEEK_END)
        digest = hashlib.sha256(str(size).encode())
        for start in (0, size // 2, max(0, size - sample_bytes)):
            file.seek(start)
            digest.update(file.read(sample_bytes))
    return digest.digest()


def is_image(path: Path) -> bool:
    """Return whether a file has the name of a visible image."""
    return bool(
        re.fullmatch(
            r"[^.].*\.(png|jpe?g|webp|bmp|tiff?|p[gp]m|jp2)",
            path.name,
            re.IGNORECASE,
        )
    )


def images_below(root: Path) -> Iterator[Path]:
    """Yield the images below a folder and below linked folders, but none of them twice."""
    seen = set()
    for folder, folders, names in os.walk(root, followlinks=True):
        real = os.path.realpath(folder)
        if real in seen:  # links in a circle
            folders.clear()
            continue
        seen.add(real)
        yield from filter(is_image, (Path(folder, name) for name in names))


def image_files(folder: Path) -> list[Path]:
    """Return the images of a folder by name, numbers in names counted as numbers (2 before 10)."""
    what = f"{folder} cannot be listed"
    with files.checked(what, "give a video or a folder of images"):
        return sorted(filter(is_image, folder.iterdir()), key=natural_order)


def image_series(folder: Path, name_pattern: str | None = None) -> list[Path]:
    """Return the images of a folder in their order, of which the names must leave no doubt.

    `name_pattern` chooses some: "frame*.png" those whose names differ by numbers alone, or else all
    that it matches. BadData names the series of images that lie between each other, such as frames
    and masks, and numbers that can be read in two ways.
    """
    paths = image_files(folder)
    if name_pattern is not None:
        paths = _matching(paths, name_pattern)
        if not paths:
            raise BadData(
                f"{folder} holds no image called {name_pattern}: give another name_pattern"
            )
    series = Counter(series_name(path.name) for path in paths)
    if name_pattern is None and sum("*" in name for name in series) > 3 + len(paths) / 2:
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, whose names have no common form: "
            'number the images, or give name_pattern = "*" for this order'
        )
    if equal := _equal_numbers(paths):
        names = ", ".join(f"{name} ({count} images)" for name, count in series.items())
        (main_series, _), *others = series.most_common()
        choice = f', or give name_pattern = "{main_series}"' if others else ""
        raise BadData(
            f"{folder} holds {len(series)} series of images, {names:.300}, of which "
            f"{equal[0].name} and {equal[1].name} have the same number: remove one of them{choice}"
        )
    # "1.5" and "1.25" have another order as decimal numbers than by their parts.
    is_decimal = all(re.fullmatch(r"\d+\.\d+(e[-+]\d+)?", path.stem) for path in paths)
    if is_decimal and sorted(paths, key=lambda path: float(path.stem)) != paths:
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, whose order is another if they "
            "are decimal numbers: write equally many digits behind the point"
        )
    patterns = _camera_patterns(paths)
    if name_pattern is None and not is_decimal and patterns:
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, as of several cameras: give "
            f'name_pattern = "{patterns[0]}" or "{patterns[1]}", or "*" for all images in this '
            "order"
        )
    if name_pattern is None and _began_again(paths):
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, as if a counter began again: "
            'number the images in their order, or give name_pattern = "*" for this order'
        )
    return paths


def _began_again(paths: list[Path]) -> bool:
    """Return whether a camera's counter seems to have gone from 9999 to 1.

    Its numbers have a wide gap inside, but none from the last one to the first.
    """
    numbers = [int(each) for path in paths for each in re.findall(r"^\D*(\d+)\D*$", path.stem)]
    if len(numbers) < 2:
        return False
    gaps = [after - before for before, after in itertools.pairwise(numbers)]
    end_gap = numbers[0] + 10 ** len(str(numbers[-1])) - numbers[-1]
    return max(gaps) > max(100, 10 * end_gap, 10 * min(gaps))


def _matching(paths: list[Path], name_pattern: str) -> list[Path]:
    """Return the images of the series that a pattern is the name of, or else all that match it.

    "frame*.png" matches frame1_mask.png, too, but is the name of another series.
    """
    series = [path for path in paths if series_name(path.name) == name_pattern]
    return series or [path for path in paths if fnmatch.fnmatchcase(path.name, name_pattern)]


def _equal_numbers(paths: list[Path]) -> list[Path]:
    """Return images whose numbers are equal, the last one aside, or none.

    They are of several series, or an image is there twice, as "frame 1.png" and "frame 1 (2).png".
    """
    by_number: dict[tuple[int, ...], list[Path]] = {}
    for path in paths:
        numbers = tuple(map(int, re.findall(r"\d+", path.stem)))
        by_number.setdefault(numbers or (-len(by_number),), []).append(path)
    groups = ([*by_number.get(numbers[:-1], ()), *by_number[numbers]] for numbers in by_number)
    return next((group for group in groups if len(group) > 1), [])


def series_name(name: str) -> str:
    """Return a name with a star for each number, which the names of a series share."""
    return re.sub(r"\d+", "*", name)


def _camera_patterns(paths: list[Path], max_cameras: int = 8) -> list[str]:
    """Return a pattern for the images of each camera if names number several cameras.

    Either "cam" stands before the number, as in cam0_0001 (but not before a date, as in
    dashcam_20261129_0001), or names end in it, and the cameras have the same frames: 0001_0,
    0001_1, 0002_0 and so on.
    """
    after_word = r"(?i)^(.*?cam(?:era)?[-_ ]?)(\d\d?)(?!\d)(.*)$"
    at_end = r"^(.*\d\D+)(\d+)(\D*\.\w+)$"
    for expression in (after_word, at_end):
        names = [name for path in paths for name in re.findall(expression, path.name)]
        images = Counter(series_name(a) + camera + series_name(b) for a, camera, b in names)
        frames = {(a, b) for a, _, b in names}
        if len(names) < len(paths) or not 1 < len(images) <= max_cameras:
            continue
        if expression == after_word and min(images.values()) > 1:
            return list(images)
        cameras = sorted({int(camera) for _, camera, _ in names})
        is_consecutive = cameras == list(range(cameras[0], cameras[0] + len(images)))
        is_complete = len(images) * len(frames) == len(paths)
        if is_consecutive and is_complete and len(images) < len(frames):
            return list(images)
    return []


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts file names with numbers in them counted as numbers."""
    pieces = re.findall(r"\d+|\D", path.name)
    return [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in pieces]


def frame_numbers(paths: Sequence[Path]) -> IntArray:
    """Return the numbers [N] of frames at a constant rate, some of which may be missing.

    Each name must hold one number, but none of a clock; if the steps between them are not multiples
    of the usual step, none is missing.
    """
    names = [re.findall(r"^\D*(\d{1,9})\D*$", path.stem) for path in paths]
    if len(names) > 1 and all(names):
        numbers = np.array(names, int)[:, 0]
        steps = np.diff(numbers)
        usual = int(np.median(steps))
        if steps.min() > 0 and not (steps % usual).any():
            return (numbers - numbers[0]) // usual
    return np.arange(len(paths))


def numbered_images(folder: Path, findings: Findings) -> tuple[Path, ...]:
    """Return the images 000000, 000001, ... of a folder; report gaps, duplicates, other files."""
    images: dict[int, Path] = {}
    for path in sorted(folder.glob("[!.]*")):
        if not is_image(path) or not path.stem.isdecimal():
            findings.add(path, "is not a numbered image: ignored", severity="note")
            continue
        first = images.setdefault(int(path.stem), path)
        if first != path:
            findings.add(path, f"has the same number as {first.name}: keep one of them")
    missing = set(range(len(images))) - images.keys()
    if not images:
        findings.add(
            folder,
            "holds no images, expected 000000.png (or jpg, webp, ...) and so on",
        )
    if missing:
        findings.add(
            folder,
            f"lacks frame {min(missing):06d}: number frames without a gap",
        )
    return tuple(images[number] for number in sorted(images))

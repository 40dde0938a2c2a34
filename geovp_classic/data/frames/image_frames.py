"""Frames of one camera in image files, read one at a time.

Images are decoded only if they are complete. PNG has a checksum for every chunk. JPEG, WebP, BMP,
PPM and JPEG 2000 have none: a flipped bit in their pixels is not noticed. Missing or overwritten
bytes of a JPEG mostly are, because its codes then end too early or too late.
"""

import contextlib
import hashlib
import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import av
import cv2
import numpy as np
import numpy.typing as npt
from PIL import ExifTags, Image

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray

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
    elif bits is not None and image.dtype == np.uint8:
        raise BadData(f"{path} has 8 bits a channel: leave out image_bits")
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
        """Return a hash of the content of a frame, from a part of its file if that suffices."""
        path = self.paths[index]
        if path is None or not path.is_file():  # an image of a bag
            return hashlib.sha256(self.read(index).tobytes()).digest()
        # In a file without compression, no sample depends on all pixels
        is_compressed = path.suffix.lower() not in (".bmp", ".pgm", ".ppm")
        return file_digest(path, 1024 if is_compressed else MAX_PIXELS)

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

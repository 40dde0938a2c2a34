"""Image files decoded only when they are whole: size and end first, then checksums where the format
has them.

PNG has a checksum for every chunk. JPEG, WebP, BMP, PPM and JPEG 2000 have none: a flipped bit in
their pixels shows only against a SHA256SUMS beside them, see `files`.
"""

import io
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from geovp_classic import files
from geovp_classic.errors import BadData

MAX_PIXELS = 2**25  # 8192 x 4096; 8K video has 7680 x 4320
LAST_BYTES = {
    "PNG": b"IEND\xaeB`\x82",
    "JPEG": b"\xff\xd9",
    "MPO": b"\xff\xd9",
}  # by Pillow's name of the format
TAIL_BYTES = 4096  # where the last bytes are looked for first
WITHOUT_MARKS = (
    "BMP",
    "DIB",
    "PPM",
    "TIFF",
    "JPEG2000",
)  # only decoding them shows that they are cut short


def decoded(path: Path, flags: int) -> npt.NDArray[Any]:
    """The image of a whole file as OpenCV decodes it with these flags; BadData names a file that is
    damaged.
    """
    data = files.read_bytes(path)
    header_size(path, io.BytesIO(data))
    if problem := _damage(data):
        raise BadData(f"{path} cannot be decoded as an image, {problem}: restore the file")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise BadData(
            f"{path} cannot be decoded as an image ({error.err}): restore the file"
        ) from error
    if image is None:
        raise BadData(f"{path} cannot be decoded as an image: restore the file")
    return image


def header_size(path: Path, file: BinaryIO) -> tuple[int, int]:
    """(width, height); BadData when the image is too large, or its end is missing: OpenCV would
    fill it with grey.
    """
    try:
        image = Image.open(file)
    except (
        Exception
    ) as problem:  # Pillow's plug-ins raise whatever their parsing of damaged bytes ends in
        raise BadData(f"{path} cannot be decoded as an image: restore the file") from problem
    width_px, height_px = image.size
    if width_px * height_px > MAX_PIXELS:
        raise BadData(
            f"{path} is {width_px}x{height_px} pixels, more than {MAX_PIXELS:,}: give smaller "
            "images"
        )
    header_end, file_end = file.tell(), file.seek(0, io.SEEK_END)
    for start in (
        max(header_end, file_end - TAIL_BYTES),
        header_end,
    ):  # a phone's JPEG may be followed by a film
        file.seek(start)
        if LAST_BYTES.get(image.format or "", b"") in file.read():
            return width_px, height_px
    raise BadData(f"{path} is cut short: its end is missing: restore the file")


def _damage(data: bytes) -> str:
    """What is wrong with a file; "" where nothing is found."""
    if data.startswith(b"\x89PNG"):
        return _png_damage(data)
    if data.startswith(b"RIFF") and len(data) < 8 + int.from_bytes(data[4:8], "little"):
        return "its end is missing"
    try:
        image = Image.open(io.BytesIO(data))
        if image.format in WITHOUT_MARKS:
            image.load()
    except Exception as problem:  # as above
        return str(problem)
    return ""


def _png_damage(data: bytes) -> str:
    """What the lengths and checksums (CRC-32) of a PNG's chunks say is wrong: ISO/IEC 15948, clause
    5.3.
    """
    start = 8
    while start + 12 <= len(data):
        end = start + 8 + int.from_bytes(data[start : start + 4], "big")
        if zlib.crc32(data[start + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return f"the checksum at byte {end} is wrong"
        if data[start + 4 : start + 8] == b"IEND":
            return ""
        start = end + 4
    return "its end is missing"

"""Image files, decoded only if they are complete.

PNG has a checksum for every chunk. JPEG, WebP, BMP, PPM and JPEG 2000 have none: a flipped bit in
their pixels shows only against a SHA256SUMS beside them, see `files`.
"""

import io
import math
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from geovp_classic import files
from geovp_classic.errors import BadData

MAX_PIXELS = 2**25  # 8192 x 4096; 8K video has 7680 x 4320


def decoded(path: Path, flags: int) -> npt.NDArray[Any]:
    """Return the image of a file as OpenCV decodes it; BadData if the file is damaged."""
    data = files.read_bytes(path)
    checked_size(path, io.BytesIO(data))
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise BadData(f"{path} cannot be decoded as an image: restore the file")
    return image


def checked_size(path: Path, file: BinaryIO) -> tuple[int, int]:
    """Return (width, height); BadData if the image is too large, truncated or damaged.

    OpenCV would show the missing part of a truncated image in grey.
    """
    try:
        with Image.open(file) as image:
            size_px = image.size
            is_too_large = math.prod(size_px) > MAX_PIXELS
            if not is_too_large:
                _check_content(image)
    except (
        Exception
    ) as problem:  # Pillow's plug-ins raise many types for damaged bytes
        raise BadData(
            f"{path} cannot be decoded as an image, it is damaged or truncated: restore the file"
        ) from problem
    if is_too_large:
        raise BadData(
            f"{path} is {size_px[0]}x{size_px[1]} pixels, more than {MAX_PIXELS:,}: shrink it"
        )
    return size_px


def _check_content(image: Image.Image) -> None:
    """Raise an exception if the content of an opened image is incomplete."""
    if image.format in (
        "PNG",
        "WEBP",
    ):  # have checksums, or are complete once they are opened
        image.verify()
    else:
        image.draft("RGB", (1, 1))  # a JPEG is decoded at an eighth of its size
        image.load()

"""The size of a PNG, JPEG or WebP image from its header, and whether the file is whole, without decoding it.

OpenCV 4 decodes a file that was cut short without a word, its lower part grey; hence the check.
"""

from __future__ import annotations

import mmap
import struct

from geovp_classic.errors import BadData

Buffer = bytes | mmap.mmap
_PNG, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF markers
_JPEG_SCAN = 0xDA


def inspect(data: Buffer) -> tuple[int, int] | None:
    """(width, height) in pixels, None for another format; BadData says why the file cannot be whole."""
    if len(data) == 0:
        raise BadData("is empty")
    try:
        if data[:8] == _PNG:
            return _png(data)
        if data[:2] == _JPEG:
            return _jpeg(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp(data)
    except (struct.error, IndexError) as problem:
        raise BadData("is cut short in its header") from problem
    return None


def _png(data: Buffer) -> tuple[int, int]:
    width_px, height_px = struct.unpack(">II", data[16:24])
    _whole(data.rfind(_PNG_END) > 0)
    return width_px, height_px


def _jpeg(data: Buffer) -> tuple[int, int]:
    size_px, position = None, 2
    while True:
        start, marker, length = struct.unpack(">BBH", data[position : position + 4])
        if start != 0xFF:
            raise BadData(f"is damaged: no JPEG marker at byte {position}")
        if marker in _JPEG_FRAMES:
            height_px, width_px = struct.unpack(">HH", data[position + 5 : position + 9])
            size_px = (width_px, height_px)
        if marker == _JPEG_SCAN:
            break
        position += 1 if marker == 0xFF else 2 + length  # 0xFF may be repeated as padding
    _whole(data.rfind(_JPEG_END) > position)
    if size_px is None:
        raise BadData("is damaged: a JPEG without a frame header")
    return size_px


def _webp(data: Buffer) -> tuple[int, int]:
    (length,) = struct.unpack("<I", data[4:8])
    kind = data[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack("<HH", data[26:30])
        size_px = (width & 0x3FFF, height & 0x3FFF)
    elif kind == b"VP8L":
        (bits,) = struct.unpack("<I", data[21:25])
        size_px = ((bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)
    else:  # VP8X
        size_px = (int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1)
    _whole(len(data) >= length + 8)
    return size_px


def _whole(condition: bool) -> None:
    if not condition:
        raise BadData("is cut short: its end is missing")

"""Whether the counts in a binary COLMAP model fit its files: pycolmap loops over a count of 2^60
without an end.

The layouts are those of COLMAP's documentation ("Output format") and of its 3.12 release for rigs
and frames.
"""

import itertools
import struct
from collections.abc import Callable
from pathlib import Path

from geovp_classic import files
from geovp_classic.errors import BadData

LIMIT_BYTES = 4096 * files.MIB
POSE_BYTES = 7 * 8


def check(model: Path) -> None:
    """BadData for a binary file of a model that is shorter or longer than its counts say."""
    for name, record_end in RECORDS.items():
        path = model / f"{name}.bin"
        if not path.exists():
            continue
        content = files.read_bytes(path, LIMIT_BYTES)
        try:
            (count,), at = struct.unpack_from("<Q", content), 8
            for _ in itertools.repeat(None, min(count, len(content))):
                at = record_end(content, at)
            if (
                at > len(content)
                or (record_end is not _camera and at != len(content))
                or count > len(content)
            ):
                raise ValueError(f"{len(content)} bytes, {count} records end at {at}")
        except (struct.error, ValueError) as problem:
            raise BadData(
                f"{model} is not a COLMAP model ({path.name}: {problem}): run COLMAP again"
            ) from problem


def _camera(content: bytes, at: int) -> int:
    """At least its id, model, width and height; how many parameters follow, the model says."""
    return at + 24


def _image(content: bytes, at: int) -> int:
    """Id, pose, camera, name, then 24 bytes for each of its points."""
    name_end = content.index(b"\0", at + 4 + POSE_BYTES + 4)
    return name_end + 9 + 24 * int(struct.unpack_from("<Q", content, name_end + 1)[0])


def _point(content: bytes, at: int) -> int:
    """Id, position, colour, error, then 8 bytes for each image that shows it."""
    return at + 51 + 8 * int(struct.unpack_from("<Q", content, at + 43)[0])


def _frame(content: bytes, at: int) -> int:
    """Id, rig, pose, then 16 bytes for each of its images."""
    return (
        at + 12 + POSE_BYTES + 16 * int(struct.unpack_from("<I", content, at + 8 + POSE_BYTES)[0])
    )


def _rig(content: bytes, at: int) -> int:
    """Id, the reference sensor, then each other sensor with or without a pose."""
    (sensors,) = struct.unpack_from("<I", content, at + 4)
    at += 8 if sensors == 0 else 16
    for _ in range(1, min(sensors, len(content))):
        at += 9 + POSE_BYTES * bool(content[at + 8 : at + 9] != b"\0")
    return at if sensors <= len(content) else len(content) + 1


RECORDS: dict[str, Callable[[bytes, int], int]] = {
    "cameras": _camera,
    "images": _image,
    "points3D": _point,
    "frames": _frame,
    "rigs": _rig,
}

"""Small videos of any container, codec, time base and display matrix."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np


def write_video(
    path: Path,
    frames: Sequence[np.ndarray],  # [H, W, 3], RGB
    *,
    codec: str = "libx264",
    rate: int = 10,
    times_ms: Sequence[int] | None = None,  # of frames; None: at the rate
    options: dict[str, str] | None = None,
    pixel_format: str = "yuv420p",
    aspect: Fraction | None = None,  # of a pixel
    turn_deg: int = 0,  # of the display matrix, counterclockwise
    metadata: dict[str, str] | None = None,
    matrix: Sequence[int] | None = None,  # of the display, in 16.16 numbers
    **container: Any,
) -> Path:
    """Write a video whose frames are shown from 0 s on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(f"file:{path.absolute()}", "w", **container) as output:
        output.metadata.update(metadata or {})
        stream = output.add_stream(codec, rate=rate)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = pixel_format
        stream.options = options or {"crf": "1"} if codec == "libx264" else options or {}
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        if turn_deg:
            stream.set_display_rotation(turn_deg)
        if matrix is not None:
            stream.set_display_matrix(matrix)
        if times_ms is not None:
            stream.codec_context.time_base = Fraction(1, 1000)
        for number, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            if times_ms is not None:
                frame.pts, frame.time_base = times_ms[number], Fraction(1, 1000)
            output.mux(stream.encode(frame))
        output.mux(stream.encode())
    return path


def grey_levels(count: int, step: int = 10, size_px: tuple[int, int] = (64, 48)) -> list[Any]:
    """Return frames, number k all grey `step` k."""
    width_px, height_px = size_px
    return [np.full((height_px, width_px, 3), step * k, np.uint8) for k in range(count)]

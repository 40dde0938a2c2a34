"""A predicted clip as a film strip, an mp4 video and a gif."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray

PREDICTED = np.array([230, 120, 20], np.uint8)  # the bar above predicted frames
BAR_SHARE = 1 / 64  # of a frame's height
GAP_PX = 4
HORIZONS = (1, 5, 10, 15, 20)  # of the frames in a film strip
LABEL_PX = 22
FOURCC = "mp4v"


def mosaic(rows: Sequence[Sequence[ByteArray]], gap_px: int, label_px: int = 0) -> ByteArray:
    """One white image [H, W, 3] of rows of frames of one size, with room for a label above each row."""
    height_px, width_px = rows[0][0].shape[:2]
    right_px, down_px = width_px + gap_px, height_px + gap_px + label_px
    size_px = len(rows) * down_px - gap_px, max(map(len, rows)) * right_px - gap_px
    sheet = np.full((*size_px, 3), 255, np.uint8)
    for i, row in enumerate(rows):
        for j, frame in enumerate(row):
            top_px, left_px = i * down_px + label_px, j * right_px
            sheet[top_px : top_px + height_px, left_px : left_px + width_px] = frame
    return sheet


def strip(rows: Sequence[tuple[str, Sequence[ByteArray]]], labels: Sequence[str]) -> ByteArray:
    """One image [H, W, 3]: a row of frames for every (name, frames), a label above each column, white between."""
    sheet = mosaic([frames for _, frames in rows], GAP_PX, LABEL_PX)
    height_px, width_px = rows[0][1][0].shape[:2]
    for i, (name, frames) in enumerate(rows):
        for j in range(len(frames)):
            place = (j * (width_px + GAP_PX) + 2, i * (height_px + GAP_PX + LABEL_PX) + LABEL_PX - 6)
            text, font = f"{name} {labels[j]}", cv2.FONT_HERSHEY_SIMPLEX
            cv2.putText(sheet, text, place, font, 0.45, (40, 40, 40), 1, cv2.LINE_AA)
    return sheet


def side_by_side(
    observed: ByteArray,  # [P, H, W, 3]
    predicted: ByteArray,  # [F, H, W, 3]
    actual: ByteArray | None,  # [F, H, W, 3], the ground truth, shown beside the prediction
) -> ByteArray:
    """Frames [P + F, H', W', 3] of a video; predicted frames carry a coloured bar on top."""
    marked = predicted.copy()
    marked[:, : max(1, round(BAR_SHARE * predicted.shape[1]))] = PREDICTED
    left = np.concatenate([observed, marked])
    return left if actual is None else np.concatenate([left, np.concatenate([observed, actual])], axis=2)


def write_mp4(path: Path, frames: ByteArray, rate_hz: float) -> None:
    """The frames [N, H, W, 3] as an mp4 video; BadData when this OpenCV cannot write one."""
    height_px, width_px = frames.shape[1:3]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*FOURCC), rate_hz, (width_px, height_px))
    if not writer.isOpened():
        raise BadData(f"{path} cannot be written: this OpenCV has no {FOURCC} encoder, install its headless wheel")
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()


def gif(frames: ByteArray, rate_hz: float) -> bytes:
    """The frames [N, H, W, 3] as an endless gif."""
    from PIL import Image

    images = [Image.fromarray(frame) for frame in frames]
    buffer = io.BytesIO()
    step_ms = max(20, round(1000 / rate_hz))
    images[0].save(buffer, "GIF", save_all=True, append_images=images[1:], duration=step_ms, loop=0)
    return buffer.getvalue()

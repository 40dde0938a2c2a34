"""A predicted clip as a film strip, an mp4 video and a gif."""

import io
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray

PREDICTED = np.array([230, 120, 20], np.uint8)  # the bar above predicted frames
BAR_SHARE = 1 / 64  # of a frame's height
GAP_PX = 4
LONGEST_MS = 655_350  # between two frames of a gif
HORIZONS = (1, 5, 10, 15, 20)  # of the frames in a film strip
LABEL_PX = 22
CODEC, PIXELS, QUALITY = (
    "libx264",
    "yuv420p",
    "18",
)  # what every browser plays; a constant rate factor


def mosaic(rows: Sequence[Sequence[ByteArray]], gap_px: int, label_px: int = 0) -> ByteArray:
    """One white image [H, W, 3] of rows of frames of one size, with room for a label above each
    row.
    """
    height_px, width_px = rows[0][0].shape[:2]
    right_px, down_px = width_px + gap_px, height_px + gap_px + label_px
    size_px = len(rows) * down_px - gap_px, max(map(len, rows)) * right_px - gap_px
    sheet = np.full((*size_px, 3), 255, np.uint8)
    for i, row in enumerate(rows):
        for j, frame in enumerate(row):
            top_px, left_px = i * down_px + label_px, j * right_px
            sheet[top_px : top_px + height_px, left_px : left_px + width_px] = frame
    return sheet


def strip(
    last: ByteArray,  # [H, W, 3], the last observed frame
    predicted: ByteArray,  # [F, H, W, 3]
    actual: ByteArray | None,  # [F' <= F, H, W, 3]
    num_horizons: int = 6,
    max_width_px: int = 1600,
    min_frame_px: int = 128,  # room for a label
) -> ByteArray:
    """Return one image [H, W, 3] with rows of predicted, real and copied frames over the horizon.

    Columns are evenly spaced steps; the frames are scaled to the width.
    """
    numbers = np.linspace(1, len(predicted), min(num_horizons, len(predicted)))
    steps = [int(step) for step in numbers.round()]
    width_px = (max_width_px + GAP_PX) // len(steps) - GAP_PX
    width_px = min(width_px, max(last.shape[1], min_frame_px))
    size_px = width_px, max(1, round(last.shape[0] * width_px / last.shape[1]))
    rows = {"predicted": [predicted[step - 1] for step in steps]}
    if actual is not None:
        rows["real"] = [actual[step - 1] for step in steps if step <= len(actual)]
    rows["copy-last"] = [last] * len(steps)
    images = [[pinhole.resize(frame, size_px) for frame in row] for row in rows.values() if row]
    names = [name for name, row in rows.items() if row]
    sheet = mosaic(images, GAP_PX, LABEL_PX)
    for i, name in enumerate(names):
        for j in range(len(images[i])):
            left_px = j * (width_px + GAP_PX) + 2
            bottom_px = i * (size_px[1] + GAP_PX + LABEL_PX) + LABEL_PX - 6
            text, font = f"{name} +{steps[j]}", cv2.FONT_HERSHEY_SIMPLEX
            place = left_px, bottom_px
            cv2.putText(sheet, text, place, font, 0.45, (40, 40, 40), 1, cv2.LINE_AA)
    return sheet


def side_by_side(
    observed: ByteArray,  # [P, H, W, 3]
    predicted: ByteArray,  # [F, H, W, 3]
    actual: ByteArray
    | None,  # [F' <= F, H, W, 3], the ground truth, shown beside the prediction; black beyond
) -> ByteArray:
    """Frames [P + F, H', W', 3] of a video; predicted frames carry a coloured bar on top, all say
    what they are.
    """
    marked = predicted.copy()
    marked[:, : max(1, round(BAR_SHARE * predicted.shape[1]))] = PREDICTED
    seen = _labelled(observed, "observed")
    left = np.concatenate([seen, _labelled(marked, "predicted")])
    if actual is None:
        return left
    beyond = np.zeros((len(predicted) - len(actual), *predicted.shape[1:]), np.uint8)
    right = [seen, _labelled(actual, "real"), _labelled(beyond, "not recorded")]
    return np.concatenate([left, np.concatenate(right)], axis=2)


def _labelled(frames: ByteArray, label: str) -> ByteArray:
    """The frames [N, H, W, 3] with a word in their lower left corner."""
    scale, shown = max(0.35, min(1.0, frames.shape[1] / 400)), frames.copy()
    for frame in shown:
        for colour, away_px in (
            ((0, 0, 0), 1),
            ((255, 255, 255), 0),
        ):  # a shadow keeps it legible on anything
            place, font = (4 + away_px, frame.shape[0] - 5 + away_px), cv2.FONT_HERSHEY_SIMPLEX
            cv2.putText(frame, label, place, font, scale, colour, 1, cv2.LINE_AA)
    return shown


def write_mp4(path: Path, frames: ByteArray, rate_hz: float) -> None:
    """The frames [N, H, W, 3] as H.264 video; an odd row or column is repeated, because colours are
    halved.
    """
    import av
    from av.video.stream import VideoStream

    even = np.pad(
        frames, ((0, 0), (0, frames.shape[1] % 2), (0, frames.shape[2] % 2), (0, 0)), mode="edge"
    )
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream(CODEC, rate=Fraction(rate_hz).limit_denominator(1000))
        assert isinstance(stream, VideoStream)
        stream.height, stream.width, stream.pix_fmt = even.shape[1], even.shape[2], PIXELS
        stream.options = {"crf": QUALITY}
        for frame in even:
            container.mux(
                stream.encode(
                    av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
                )
            )
        container.mux(stream.encode())


def gif(frames: ByteArray, rate_hz: float) -> bytes:
    """The frames [N, H, W, 3] as an endless gif."""
    from PIL import Image

    images = [Image.fromarray(frame) for frame in frames]
    buffer = io.BytesIO()
    step_ms = min(max(20, round(1000 / rate_hz)), LONGEST_MS)
    images[0].save(buffer, "GIF", save_all=True, append_images=images[1:], duration=step_ms, loop=0)
    return buffer.getvalue()

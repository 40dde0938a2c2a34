"""Predicted frames as a film strip, an mp4 video and a gif."""

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray


def horizons(num_future: int, num_steps: int) -> list[int]:
    """Return evenly spaced steps, the first and the last included."""
    steps = np.linspace(1, num_future, min(num_steps, num_future))
    return [int(step) for step in steps.round()]


def film_strip(
    rows: Mapping[str, ByteArray],  # [F' <= F, H, W, 3] by name; empty rows are left out
    num_steps: int = 6,
    max_width_px: int = 1600,
    label_px: int = 22,
    gap_px: int = 4,
) -> ByteArray:
    """Return one image [H', W', 3] with a row of labelled frames per name.

    Columns are evenly spaced steps; a row ends where its frames end.
    """
    rows = {name: frames for name, frames in rows.items() if len(frames)}
    steps = horizons(max(map(len, rows.values())), num_steps)
    height_px, width_px = next(iter(rows.values())).shape[1:3]
    min_width_px = 128  # room for a label
    tile_px = min((max_width_px + gap_px) // len(steps) - gap_px, max(width_px, min_width_px))
    size_px = tile_px, max(1, round(height_px * tile_px / width_px))
    down_px, right_px = label_px + size_px[1] + gap_px, tile_px + gap_px
    shape = len(rows) * down_px - gap_px, len(steps) * right_px - gap_px, 3
    sheet = np.full(shape, 255, np.uint8)
    for row, (name, frames) in enumerate(rows.items()):
        top_px = row * down_px + label_px
        for column, step in enumerate(steps):
            left_px = column * right_px
            if step <= len(frames):
                tile = pinhole.resize(frames[step - 1], size_px)
                sheet[top_px : top_px + size_px[1], left_px : left_px + tile_px] = tile
                _write_text(sheet, f"{name} +{step}", (left_px + 2, top_px - 6), 0.45, (40,) * 3)
    return sheet


def film(
    observed: ByteArray,  # [P, H, W, 3]
    predicted: ByteArray,  # [F, H, W, 3]
    actual: ByteArray,  # [F' <= F, H, W, 3], shown beside the prediction
) -> ByteArray:
    """Return the labelled frames [P + F, H', W', 3] of a video."""
    seen = _labelled(observed, "observed")
    left = np.concatenate([seen, _labelled(predicted, "predicted")])
    if not len(actual):
        return left
    unrecorded = np.zeros_like(predicted[len(actual) :])
    right = [seen, _labelled(actual, "real"), _labelled(unrecorded, "not recorded")]
    return np.concatenate([left, np.concatenate(right)], axis=2)


def write_mp4(path: Path, frames: ByteArray, rate_hz: float) -> None:
    """Write frames [N, H, W, 3] as H.264 video that browsers play.

    An odd row or column is repeated, because the format stores colours at half resolution.
    """
    import av
    from av.video.stream import VideoStream

    is_odd = np.array(frames.shape[1:3]) % 2
    even = np.pad(frames, ((0, 0), (0, is_odd[0]), (0, is_odd[1]), (0, 0)), mode="edge")
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=Fraction(rate_hz).limit_denominator(1000))
        assert isinstance(stream, VideoStream)
        stream.height, stream.width = even.shape[1:3]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "18"}
        for frame in even:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def write_gif(path: Path, frames: ByteArray, rate_hz: float) -> None:
    """Write frames [N, H, W, 3] as an endless gif."""
    from PIL import Image

    first, *rest = map(Image.fromarray, frames)
    step_ms = np.clip(round(1000 / rate_hz), 20, 655_350)  # the limits of viewers and format
    first.save(path, save_all=True, append_images=rest, duration=int(step_ms), loop=0)


def _labelled(frames: ByteArray, label: str) -> ByteArray:
    """Return the frames [N, H, W, 3] with a word in their lower left corner."""
    shown = frames.copy()
    scale = max(0.35, min(1.0, frames.shape[1] / 400))
    for frame in shown:
        place_px = (4, len(frame) - 5)
        _write_text(frame, label, place_px, scale, (0, 0, 0), 3)  # an outline
        _write_text(frame, label, place_px, scale, (255, 255, 255))
    return shown


def _write_text(
    image: ByteArray,
    text: str,
    place_px: tuple[int, int],
    scale: float,
    colour: tuple[int, ...],
    thickness: int = 1,
) -> None:
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(image, text, place_px, font, scale, colour, thickness, cv2.LINE_AA)

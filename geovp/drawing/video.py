"""Predicted frames with labels and outlines, as an mp4 video and a gif."""

import itertools
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from geovp_classic.types import BoolArray, ByteArray


def film(
    observed: ByteArray,  # [P, H, W, 3]
    predicted: ByteArray,  # [F, H, W, 3]
    actual: ByteArray,  # [F' <= F, H, W, 3], shown next to the prediction
) -> ByteArray:
    """Return the labelled frames [P + F, H', W', 3] of a video."""
    seen = [labelled(frame, "observed") for frame in observed]
    left = seen + [labelled(frame, "predicted") for frame in predicted]
    if not len(actual):
        return np.array(left)
    right = seen + [labelled(frame, "real") for frame in actual]
    unrecorded = labelled(np.zeros_like(predicted[0]), "not recorded")
    right += [unrecorded] * (len(left) - len(right))
    return np.concatenate([left, right], axis=2)


def write_mp4(path: Path, frames: Iterable[ByteArray], rate_hz: float) -> None:
    """Write frames, N of [H, W, 3], as H.264 video that browsers play.

    Odd sizes grow by a pixel, because the format stores colours at half resolution.
    """
    import av

    remaining = iter(frames)
    first = next(remaining)
    height_px, width_px = first.shape[:2]
    options = {"movflags": "faststart"}
    with av.open(str(path), "w", format="mp4", options=options) as container:
        rate = Fraction(rate_hz).limit_denominator(1000)
        stream = container.add_stream("libx264", rate, {"crf": "18"})
        stream.height, stream.width = height_px + height_px % 2, width_px + width_px % 2
        stream.pix_fmt = "yuv420p"
        for frame in itertools.chain([first], remaining):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def write_gif(path: Path, frames: ByteArray, rate_hz: float) -> None:
    """Write frames [N, H, W, 3] as an endless gif."""
    first, *rest = map(Image.fromarray, frames)
    first.save(
        path,
        save_all=True,
        append_images=rest,
        duration=max(20, round(1000 / rate_hz)),  # ms; viewers show no shorter steps
        loop=0,
    )


def outlined(
    frame: ByteArray,  # [H, W, 3]
    mask: BoolArray,  # [H, W]
    rgb: tuple[int, int, int] = (255, 64, 200),
) -> ByteArray:
    """Return the frame with outlines of the regions of a mask."""
    regions = mask.astype(np.uint8)
    outlines, _ = cv2.findContours(regions, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return cv2.drawContours(frame.copy(), outlines, -1, rgb, 2, cv2.LINE_AA)


def labelled(frame: ByteArray, label: str) -> ByteArray:
    """Return a frame with an outlined label in its lower left corner."""
    image = Image.fromarray(frame)
    pen = ImageDraw.Draw(image)
    widest_px = 100 * (image.width - 8) / pen.textlength(label, font_size=100)  # that fits
    pen.text(
        (4, image.height - 4),
        label,
        anchor="ld",
        font_size=max(10, min(image.height // 16, int(widest_px))),
        stroke_width=1,
        stroke_fill="black",
    )
    return np.asarray(image)

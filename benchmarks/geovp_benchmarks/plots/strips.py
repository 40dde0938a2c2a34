"""Film strips: the ground truth and the prediction of each method at a few horizons."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.plots import style
from geovp_classic.types import BoolArray, ByteArray, FloatArray

INPAINTED = (214, 39, 160)  # a colour that streets do not have


@dataclass(frozen=True)
class Strip:
    """The predicted frames of one method."""

    label: str
    note: str  # a small line under the label
    frames: ByteArray  # [K, H, W, 3] at the horizons shown
    covered: BoolArray | None = None  # [K, H, W]; False where the image was inpainted


@dataclass(frozen=True)
class Truth:
    """The ground truth."""

    last_observed: ByteArray  # [H, W, 3]
    frames: ByteArray  # [K, H, W, 3]
    horizons: Sequence[int]  # [K]
    ahead_s: FloatArray  # [K], seconds after the last observed frame


def draw(
    truth: Truth,
    strips: Sequence[Strip],
    heading: style.Heading,
    layout: style.Layout,
    tile_in: float = 1.14,
    min_height_in: float = 0.5,
) -> Figure:
    """Draw a row of images per method, with the ground truth on top and labels on the left."""
    height_px, width_px = truth.last_observed.shape[:2]
    gap_px = max(1, width_px // 40)
    blank = np.full_like(truth.last_observed, 255)
    images = [[truth.last_observed, *truth.frames], *([blank, *strip.frames] for strip in strips)]
    sheet = mosaic(images, gap_px)
    if layout.width_in is not None:
        tile_in = layout.width_in * width_px / sheet.shape[1]
    tile_in = max(tile_in, 0.0 if layout.width_in else min_height_in * width_px / height_px)
    size_in = (tile_in * sheet.shape[1] / width_px, tile_in * sheet.shape[0] / width_px + 0.9)
    figure, axes = layout.single_axes(size_in, heading)
    axes.imshow(sheet, interpolation="nearest")
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.xaxis.tick_top()
    times = [
        f"+{k}\n{ahead_s:.1f} s" for k, ahead_s in zip(truth.horizons, truth.ahead_s, strict=True)
    ]
    middles = [n * (width_px + gap_px) + width_px / 2 for n in range(len(times) + 1)]
    axes.set_xticks(middles, ["last\nobserved", *times])
    axes.set_yticks([height_px / 2], ["ground truth"], rotation=90, va="center")
    font_pt = min(7.5, 60 * tile_in * height_px / width_px / 4)
    for number, strip in enumerate(strips, 1):
        label = textwrap.fill(strip.label, max(8, int(135 * tile_in / font_pt)))
        place = (width_px * 0.97, number * (height_px + gap_px) + height_px / 2)
        text = f"{label}\n{strip.note}".strip()
        axes.text(*place, text, ha="right", va="center", fontsize=font_pt, linespacing=1.05)
    return figure


def mosaic(rows: Sequence[Sequence[ByteArray]], gap_px: int, label_px: int = 0) -> ByteArray:
    """Return one white image [H, W, 3] of rows of frames of one size."""
    height_px, width_px = rows[0][0].shape[:2]
    right_px, down_px = width_px + gap_px, height_px + gap_px + label_px
    size_px = len(rows) * down_px - gap_px, max(map(len, rows)) * right_px - gap_px
    sheet = np.full((*size_px, 3), 255, np.uint8)
    for i, row in enumerate(rows):
        for j, frame in enumerate(row):
            top_px, left_px = i * down_px + label_px, j * right_px
            sheet[top_px : top_px + height_px, left_px : left_px + width_px] = frame
    return sheet


def mark_inpainted(strip: Strip) -> Strip:
    """Tint the inpainted pixels of a strip."""
    if strip.covered is None:
        return strip
    tinted = (0.35 * strip.frames + 0.65 * np.array(INPAINTED)).astype(np.uint8)
    return replace(strip, frames=np.where(strip.covered[..., None], strip.frames, tinted))

"""Film strips: what came and what every method predicted, at a few horizons, one row each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.plots import style
from geovp_classic.types import BoolArray, ByteArray, FloatArray

MOST_ROWS = 10
MARGINS = style.Margins(left_in=0.22, right_in=0.08, top_in=0.7, bottom_in=0.08)
WIDTH_IN = 7.0
LEAST_WIDTH_PX = 1500
LABEL_CHARACTERS = 21
LINE_SPACING = 1.2  # matplotlib's
INVENTED = np.array([214, 39, 160])  # a colour that streets do not have


@dataclass(frozen=True)
class Row:
    """One method's predicted frames."""

    label: str
    note: str  # small lines under the label: its scores on this clip
    frames: ByteArray  # [K, H, W, 3]; the frames of the horizons shown
    covered: BoolArray | None = None  # [K, H, W]; False where the picture was invented


@dataclass(frozen=True)
class Truth:
    """What was really seen."""

    last_seen: ByteArray  # [H, W, 3]
    frames: ByteArray  # [K, H, W, 3]
    horizons: Sequence[int]  # [K]
    ahead_s: FloatArray  # [K], seconds after the last observed frame


def draw(truth: Truth, rows: Sequence[Row], title: str, subtitle: str) -> list[Figure]:
    """One figure per ten rows, the truth on top of each."""
    pages = style.pages(len(rows), MOST_ROWS)
    many = len(pages) > 1
    return [
        _page(truth, rows[page.start : page.stop], title + f" ({n} of {len(pages)})" * many, subtitle)
        for n, page in enumerate(pages, 1)
    ]


def invented(row: Row) -> Row:
    """The same row with a wash of colour on every pixel that was invented."""
    if row.covered is None:
        return row
    washed = (0.35 * row.frames + 0.65 * INVENTED).astype(np.uint8)
    return Row(row.label, row.note, np.where(row.covered[..., None], row.frames, washed), row.covered)


def _page(truth: Truth, rows: Sequence[Row], title: str, subtitle: str) -> Figure:
    """The figure; its resolution is such that a predicted pixel is a whole number of pixels of the file."""
    height_px, width_px = truth.last_seen.shape[:2]
    gap_px = max(2, width_px // 40)
    sheet = _mosaic(truth, rows, gap_px)
    enlarged = max(1, round(LEAST_WIDTH_PX / sheet.shape[1]))
    height_in = WIDTH_IN * sheet.shape[0] / sheet.shape[1]
    figure, axes = style.sheet(WIDTH_IN, height_in, MARGINS, dpi=enlarged * sheet.shape[1] / WIDTH_IN)
    axes.set_axis_off()
    axes.imshow(sheet, aspect="auto", extent=(0, sheet.shape[1], sheet.shape[0], 0), interpolation="nearest")
    _headings(axes, truth, width_px + gap_px, width_px)
    for number, row in enumerate(rows, 1):
        _label(axes, row, width_px, number * (height_px + gap_px) + height_px / 2)
    axes.text(-gap_px, height_px / 2, "ground truth", rotation=90, ha="right", va="center", fontsize=8, weight="bold")
    style.headline(axes, title, subtitle, lift_pt=22)
    return figure


def _mosaic(truth: Truth, rows: Sequence[Row], gap_px: int) -> ByteArray:
    """All pictures on one white sheet; the first column holds the last observed frame, then names."""
    height_px, width_px = truth.last_seen.shape[:2]
    down_px, right_px = height_px + gap_px, width_px + gap_px
    sheet = np.full(
        ((len(rows) + 1) * down_px - gap_px, (len(truth.horizons) + 1) * right_px - gap_px, 3), 255, np.uint8
    )
    sheet[:height_px, :width_px] = truth.last_seen
    for i, frames in enumerate([truth.frames, *(row.frames for row in rows)]):
        for j, frame in enumerate(frames, 1):
            sheet[i * down_px : i * down_px + height_px, j * right_px : j * right_px + width_px] = frame
    return sheet


def _headings(axes: Axes, truth: Truth, right_px: int, width_px: int) -> None:
    words = [f"frame +{k}  ({ahead_s:.1f} s)" for k, ahead_s in zip(truth.horizons, truth.ahead_s, strict=True)]
    for number, text in enumerate(["last observed frame", *words]):
        x = number * right_px + width_px / 2
        axes.annotate(text, (x, 0), (0, 4), textcoords="offset points", ha="center", fontsize=7.5, color=style.INK)


def _label(axes: Axes, row: Row, right_px: float, middle_px: float) -> None:
    """Name and note right-aligned beside the row, centred together; a long name is set smaller."""
    parts = [style.wrapped(part, LABEL_CHARACTERS) for part in row.label.split(" + ")]
    name = " +\n".join(parts)
    name_pt = 8.0 if name.count("\n") < 4 else 6.5
    name_height, note_height = (text.count("\n") * size + size for text, size in ((name, name_pt), (row.note, 6.5)))
    top_pt = (name_height + note_height * bool(row.note)) * LINE_SPACING / 2
    for text, size, drop_pt, colour in (
        (name, name_pt, 0.0, style.INK),
        (row.note, 6.5, name_height * LINE_SPACING + 2, style.FAINT),
    ):
        place = (-3, top_pt - drop_pt)
        axes.annotate(
            text,
            (right_px, middle_px),
            place,
            textcoords="offset points",
            ha="right",
            va="top",
            size=size,
            color=colour,
        )

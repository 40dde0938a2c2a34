"""Film strips: ground truth and every method's prediction at a few horizons, one row each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.plots import style
from benchmarks.plots.video import mosaic
from geovp_classic.geometry.pinhole import resize
from geovp_classic.types import BoolArray, ByteArray, FloatArray

MOST_ROWS = 10
MARGINS = style.Margins(left_in=0.22, right_in=0.08, top_in=0.7, bottom_in=0.08)
TILE_IN = 1.14  # width of an image: six of them fill a page
LEAST_DPI = 220
LABEL_CHARACTERS = 21
NAME_PT, NOTE_PT = 8.0, 6.5
LINE_SPACING = 1.2  # matplotlib's
INVENTED = np.array([214, 39, 160])  # a colour that streets do not have


@dataclass(frozen=True)
class Row:
    """One method's predicted frames."""

    label: str
    note: str  # small lines under the label: its scores on this clip
    frames: ByteArray  # [K, H, W, 3]; the frames of the horizons shown
    covered: BoolArray | None = None  # [K, H, W]; False where the image was invented


@dataclass(frozen=True)
class Truth:
    """The ground truth."""

    last_seen: ByteArray  # [H, W, 3]
    frames: ByteArray  # [K, H, W, 3]
    horizons: Sequence[int]  # [K]
    ahead_s: FloatArray  # [K], seconds after the last observed frame


def draw(truth: Truth, rows: Sequence[Row], words: style.Words) -> list[Figure]:
    """One figure per ten rows, the truth on top of each."""
    pages = style.pages(len(rows), MOST_ROWS)
    return [
        _page(truth, rows[page.start : page.stop], words.numbered(n, len(pages))) for n, page in enumerate(pages, 1)
    ]


def invented(row: Row) -> Row:
    """The same row tinted on every pixel that was invented."""
    if row.covered is None:
        return row
    tinted = (0.35 * row.frames + 0.65 * INVENTED).astype(np.uint8)
    return Row(row.label, row.note, np.where(row.covered[..., None], row.frames, tinted), row.covered)


class Sheet(Artist):
    """Pixels copied as they are onto the axes: no scaling, no colour map, and many times faster than `imshow`."""

    def __init__(self, pixels: ByteArray) -> None:
        """Keep the pixels [H, W, 3]."""
        super().__init__()
        self.pixels = pixels

    def draw(self, renderer: Any) -> None:
        """Draw from the lower left corner of the axes; renderers take rows from the bottom up."""
        assert self.axes is not None
        opaque = np.full((*self.pixels.shape[:2], 1), 255, np.uint8)
        upwards = np.ascontiguousarray(np.concatenate([self.pixels, opaque], axis=2)[::-1])
        graphics = renderer.new_gc()
        renderer.draw_image(graphics, self.axes.bbox.x0, self.axes.bbox.y0, upwards)
        graphics.restore()


def _page(truth: Truth, rows: Sequence[Row], words: style.Words) -> Figure:
    """The figure; a predicted pixel is a whole number of pixels of the file, unless the frames are very large."""
    height_px, width_px = truth.last_seen.shape[:2]
    gap_px = max(1, width_px // 40)
    first_column = [truth.last_seen, *([np.full_like(truth.last_seen, 255)] * len(rows))]  # names stand in the white
    frames = [truth.frames, *(row.frames for row in rows)]
    sheet = mosaic([[first, *row] for first, row in zip(first_column, frames, strict=True)], gap_px)
    high_px, wide_px = sheet.shape[:2]
    pixels, dpi = _enlarged(sheet, width_px)
    size_in = (TILE_IN * wide_px / width_px, TILE_IN * high_px / width_px)
    figure, axes = style.sheet(size_in, MARGINS, words, dpi)
    axes.set_axis_off()
    axes.set_xlim(0, wide_px)
    axes.set_ylim(high_px, 0)
    axes.add_artist(Sheet(pixels))
    _headings(axes, truth, width_px + gap_px, width_px)
    for number, row in enumerate(rows, 1):
        middle_px = number * (height_px + gap_px) + height_px / 2
        _label(axes, row, width_px, middle_px, room_pt=72 * TILE_IN * height_px / width_px)
    place: dict[str, Any] = {"textcoords": "offset points", "rotation": 90, "ha": "right", "va": "center"}
    axes.annotate("ground truth", (0, height_px / 2), (-3, 0), **place, fontsize=8, weight="bold")
    return figure


def _enlarged(sheet: ByteArray, width_px: int) -> tuple[ByteArray, float]:
    """The sheet with every pixel repeated, or shrunk where frames are very large, and its dots per inch."""
    times = max(1, round(LEAST_DPI * TILE_IN / width_px))
    dpi = times * width_px / TILE_IN
    if dpi <= style.PRINT_DPI:
        return sheet.repeat(times, axis=0).repeat(times, axis=1), dpi
    scale = style.PRINT_DPI / dpi
    return resize(sheet, (round(sheet.shape[1] * scale), round(sheet.shape[0] * scale))), style.PRINT_DPI


def _headings(axes: Axes, truth: Truth, right_px: int, width_px: int) -> None:
    words = [f"frame +{k}  ({ahead_s:.1f} s)" for k, ahead_s in zip(truth.horizons, truth.ahead_s, strict=True)]
    for number, text in enumerate(["last observed frame", *words]):
        x = number * right_px + width_px / 2
        axes.annotate(text, (x, 0), (0, 4), textcoords="offset points", ha="center", fontsize=7.5, color=style.INK)


def _label(axes: Axes, row: Row, right_px: float, middle_px: float, room_pt: float) -> None:
    """Name and note right-aligned beside the row, centred together; small for a long name, no note for a low row."""
    parts = row.label.split(" + ") if len(row.label) > LABEL_CHARACTERS else [row.label]
    name = " +\n".join(style.wrapped(part, LABEL_CHARACTERS) for part in parts)
    name_pt = NAME_PT if name.count("\n") < 4 else NOTE_PT
    name_high_pt, note_high_pt = _height_pt(name, name_pt), _height_pt(row.note, NOTE_PT)
    note = row.note if name_high_pt + note_high_pt <= room_pt else ""
    top_pt = (name_high_pt + note_high_pt * bool(note)) / 2
    place: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "va": "top"}
    axes.annotate(name, (right_px, middle_px), (-3, top_pt), **place, fontsize=name_pt, color=style.INK)
    below_pt = top_pt - name_high_pt - 2
    axes.annotate(note, (right_px, middle_px), (-3, below_pt), **place, fontsize=NOTE_PT, color=style.FAINT)


def _height_pt(text: str, size_pt: float) -> float:
    return len(text.splitlines()) * size_pt * LINE_SPACING

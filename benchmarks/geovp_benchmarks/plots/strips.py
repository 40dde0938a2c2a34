"""Film strips: ground truth and every method's prediction at a few horizons, one row each."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geovp_benchmarks.plots import style
from geovp_benchmarks.plots.video import mosaic
from geovp_classic.types import BoolArray, ByteArray, FloatArray

MOST_ROWS = 10
TILE_IN, LEAST_HEIGHT_IN = (
    1.14,
    0.6,
)  # width of an image: six of them fill a page; height, for two lines of a label
LEAST_DPI = 220
LETTERS_AN_INCH = 18.5  # of a label
LABEL_PT, NOTE_PT, TRUTH_PT = 9.7, 7.9, 60  # heights of a line, and the length of "ground truth"
BESIDE_IN = 0.5  # left of the images, and margins
INPAINTED = np.array([214, 39, 160])  # a colour that streets do not have


@dataclass(frozen=True)
class Row:
    """One method's predicted frames."""

    label: str
    note: str  # small lines under the label: its scores on this clip
    frames: ByteArray  # [K, H, W, 3]; the frames of the horizons shown
    covered: BoolArray | None = None  # [K, H, W]; False where the image was inpainted


@dataclass(frozen=True)
class Truth:
    """The ground truth."""

    last_observed: ByteArray  # [H, W, 3]
    frames: ByteArray  # [K, H, W, 3]
    horizons: Sequence[int]  # [K]
    ahead_s: FloatArray  # [K], seconds after the last observed frame


def draw(
    truth: Truth, rows: Sequence[Row], heading: style.Heading, width_in: float | None = None
) -> list[Figure]:
    """One figure per ten rows, the truth on top of each; about as wide as the page, where it has a
    width.
    """
    size_in = _image_in(truth, width_in)
    return [
        _page(truth, rows[page], own, size_in)
        for page, own in style.pages(len(rows), MOST_ROWS, heading)
    ]


def has_room(truth: Truth, rows: Sequence[Row], width_in: float | None) -> bool:
    """Whether each row's label and note are no higher than its images."""
    wide_in, high_in = _image_in(truth, width_in)
    return all(sum(_heights_pt(_wrapped(row, wide_in))) <= 72 * high_in for row in rows)


def mark_inpainted(row: Row) -> Row:
    """The same row, with every inpainted pixel tinted."""
    if row.covered is None:
        return row
    tinted = (0.35 * row.frames + 0.65 * INPAINTED).astype(np.uint8)
    return replace(row, frames=np.where(row.covered[..., None], row.frames, tinted))


def _image_in(truth: Truth, width_in: float | None) -> tuple[float, float]:
    """Width and height of an image."""
    height_px, width_px = truth.last_observed.shape[:2]
    wide_in = max(TILE_IN, LEAST_HEIGHT_IN * width_px / height_px)
    if width_in is not None:
        wide_in = (width_in - BESIDE_IN) / (1 + len(truth.frames))
    return wide_in, wide_in * height_px / width_px


def _wrapped(row: Row, wide_in: float) -> Row:
    return replace(row, label=textwrap.fill(row.label, int(LETTERS_AN_INCH * wide_in)))


def _heights_pt(row: Row) -> tuple[float, float]:
    """Of the label and of the note."""
    return LABEL_PT * len(row.label.splitlines()), NOTE_PT * len(row.note.splitlines())


def _page(
    truth: Truth, rows: Sequence[Row], heading: style.Heading, size_in: tuple[float, float]
) -> Figure:
    """The figure; an image's pixel is a whole number of pixels of the file, unless the images are
    very large.
    """
    height_px, width_px = truth.last_observed.shape[:2]
    (tile_in, high_in), gap_px = size_in, max(1, width_px // 40)
    first_column = [
        truth.last_observed,
        *([np.full_like(truth.last_observed, 255)] * len(rows)),
    ]  # room for labels
    frames = [truth.frames, *(row.frames for row in rows)]
    sheet = mosaic([[first, *row] for first, row in zip(first_column, frames, strict=True)], gap_px)
    sheet_in = (tile_in * sheet.shape[1] / width_px, tile_in * sheet.shape[0] / width_px)
    dpi = max(1, round(LEAST_DPI * tile_in / width_px)) * width_px / tile_in
    figure, axes = style.single_axes(sheet_in, heading, min(dpi, style.PRINT_DPI), pad_pt=26)
    axes.set_axis_off()
    axes.imshow(sheet, extent=(0, sheet.shape[1], sheet.shape[0], 0), aspect="auto")
    times = [
        f"frame +{k}\n({ahead_s:.1f} s)"
        for k, ahead_s in zip(truth.horizons, truth.ahead_s, strict=True)
    ]
    for number, text in enumerate(["last observed\nframe", *times]):
        x = number * (width_px + gap_px) + width_px / 2
        _text(axes, text, (x, 0), (0, 4), ha="center", va="bottom", fontsize=7.5)
    for number, row in enumerate((_wrapped(row, tile_in) for row in rows), 1):
        right_middle = (width_px, number * (height_px + gap_px) + height_px / 2)
        label_pt, note_pt = _heights_pt(row)
        _text(axes, row.label, right_middle, (-3, note_pt / 2), ha="right", va="center")
        _text(
            axes,
            row.note,
            right_middle,
            (-3, -label_pt / 2),
            ha="right",
            va="center",
            fontsize=6.5,
            color=style.FAINT,
        )
    truth_label = "ground truth" if 72 * high_in > TRUTH_PT else "ground\ntruth"
    _text(
        axes,
        truth_label,
        (0, height_px / 2),
        (-3, 0),
        rotation=90,
        ha="right",
        va="center",
        weight="bold",
    )
    return figure


def _text(
    axes: Axes,
    text: str,
    pixel: tuple[float, float],
    offset_pt: tuple[float, float],
    **options: Any,
) -> None:
    axes.annotate(
        text, pixel, offset_pt, textcoords="offset points", **{"color": style.INK, **options}
    )

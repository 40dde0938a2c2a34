"""Film strips: rows of frames with a label each."""

from collections.abc import Mapping

import numpy as np
from matplotlib.style import context

from geovp.drawing.page import SHEET, Page
from geovp_classic.types import ByteArray, FloatArray


@context(SHEET)
def draw_strip(
    page: Page,
    rows: Mapping[str, ByteArray],  # [F' <= F, H, W, 3] by label
    ahead_s: FloatArray,  # [F], seconds after the last observed frame
    width_in: float,
) -> None:
    """Draw frames at evenly spaced steps below the label of a row, which ends with its frames."""
    _, height_px, width_px, _ = next(iter(rows.values())).shape
    num_steps = min(len(ahead_s), 6, int(width_in / 0.75))
    steps = np.linspace(1, len(ahead_s), num_steps).round().astype(int)
    height_in = len(rows) * (width_in / num_steps * height_px / width_px + 0.17) + 0.3
    gap_px = 1 + width_px // 40
    all_axes = page.add_axes(width_in, height_in, len(rows))
    for axes, (label, frames) in zip(all_axes, rows.items(), strict=True):
        pad = (0, len(ahead_s) - len(frames)), (0, 0), (0, gap_px), (0, 0)
        tiles = np.pad(frames, pad, constant_values=255)[steps - 1]
        axes.imshow(np.concatenate(tiles, axis=1))
        axes.set_title(label, loc="left")
        axes.set(frame_on=False, xticks=[], yticks=[])
        axes.tick_params(length=0, grid_alpha=0)
    digits = 1 if ahead_s[0] > 0.095 else 2  # of seconds: 30 frames per second are 0.03 s apart
    heads = [f"+{k}, {ahead_s[k - 1]:.{digits}f} s" for k in steps]
    axes.set_xticks(np.arange(num_steps) * (width_px + gap_px) + width_px / 2, heads)

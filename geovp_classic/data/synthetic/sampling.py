"""Look up textures, averaged over a pixel's footprint: mip-maps across, several taps along it."""

from __future__ import annotations

import math

import numba
import numpy as np

from geovp_classic.data.synthetic.textures import Atlas, IntArray
from geovp_classic.types import FloatArray

MOST_TAPS = 8  # along the longer side of a footprint


def sample(
    atlas: Atlas,
    textures: IntArray,  # [N]
    uv: FloatArray,  # [N, 2], in tiles; the images repeat
    steps: FloatArray,  # [N, 2, 2], change of uv to the next pixel right and down
    finest: FloatArray | float = 0.0,  # [N], tiles; nothing smaller than this is resolved
) -> FloatArray:
    """RGBA [N, 4] float32 in 0..1, as bytes are: display brightness."""
    count = len(textures)
    out = np.empty((count, 4), dtype=np.float32)
    _sample(
        atlas.texels,
        atlas.starts,
        atlas.widths,
        atlas.heights,
        np.ascontiguousarray(textures, dtype=np.int64),
        np.ascontiguousarray(uv, dtype=np.float32),
        np.ascontiguousarray(steps, dtype=np.float32),
        np.ascontiguousarray(np.broadcast_to(finest, (count,)), dtype=np.float32),
        out,
    )
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sample(texels, starts, widths, heights, textures, uv, steps, finest, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(len(textures)):
        texture = textures[i]
        full_width, full_height = widths[texture, 0], heights[texture, 0]
        across = math.hypot(steps[i, 0, 0] * full_width, steps[i, 0, 1] * full_height)
        down = math.hypot(steps[i, 1, 0] * full_width, steps[i, 1, 1] * full_height)
        longer = 0 if across > down else 1
        major, minor = max(across, down), min(across, down)
        minor = max(minor, major / MOST_TAPS, finest[i] * full_height, 1.0)
        taps = min(max(math.ceil(major / minor), 1), MOST_TAPS)
        level = math.log2(minor)
        low = int(level)
        red, green, blue, alpha = 0.0, 0.0, 0.0, 0.0
        for upper in range(2):  # two mip levels, mixed
            this = min(low + upper, widths.shape[1] - 1)  # the last level is one texel
            share = (level - low if upper else 1.0 - (level - low)) / (255.0 * taps)
            if share == 0.0:
                continue
            while widths[texture, this] == 0:
                this -= 1
            start, width, height = starts[texture, this], widths[texture, this], heights[texture, this]
            for tap in range(taps):
                place = (tap + 0.5) / taps - 0.5
                x = (uv[i, 0] + place * steps[i, longer, 0]) * width - 0.5
                y = (uv[i, 1] + place * steps[i, longer, 1]) * height - 0.5
                column, row = math.floor(x), math.floor(y)
                fx, fy = x - column, y - row
                left, right = column & (width - 1), (column + 1) & (width - 1)  # sizes are powers of two
                above, below = start + (row & (height - 1)) * width, start + ((row + 1) & (height - 1)) * width
                for corner in range(4):
                    texel = (below if corner >> 1 else above) + (right if corner & 1 else left)
                    weight = share * (fx if corner & 1 else 1.0 - fx) * (fy if corner >> 1 else 1.0 - fy)
                    red += weight * texels[texel, 0]
                    green += weight * texels[texel, 1]
                    blue += weight * texels[texel, 2]
                    alpha += weight * texels[texel, 3]
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = red, green, blue, alpha

"""Where frames show no scene: black bars at their borders, and the vehicle that carries the camera.

The vehicle's parts, such as the hood, stay in place below a lasting edge while the rest of the
image moves.
"""

import itertools

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.observation import frame_screening
from geovp_classic.types import BoolArray, ByteArray

BLACK, LIT_SHARE = (
    20,
    0.02,
)  # grey values of a bar; share of a line's pixels that are brighter where there is none
# of the image's brightness (a quantile of 0.95) that a bar stays below, too: dim films are no bars
BLACK_SHARE = 0.1
LEAST_IMAGE = 0.5  # of the height and the width, between bars; the night is none
BORDER_PX = 2  # of the image between bars, where it is blended with them
FEWEST_FRAMES, LEAST_ROWS = 3, 64  # fewer frames, or rows of an image, show too little
STILL = (
    3.0  # standard deviation over the frames, in grey values, below which a pixel stays in place
)
MOVING = (
    3.0  # mean difference of the first from the last frame above which the rest of the image moves
)
LARGEST_SHARE = 0.4  # of the image's height
LEAST_WIDTH = 0.6  # of the lowest row
EDGE = 12.0  # grey values between what lies above its border and below it, in most frames
EDGE_SHARE = (
    0.75  # of the frames: the border of a shadow on a road without texture is that in one of them
)
MARGIN_PX = 3  # on either side of that border
ARC_SHARE, ARC_COLUMNS, MOST_LEAKS = (
    0.03,
    12,
    1 / 3,
)  # see _leaks: of the image's height; columns; of the columns
TOP_QUANTILE = 0.05  # of the border's rows over the columns: its top, whatever single columns do


def static_mask(frames: ByteArray) -> BoolArray:
    """The pixels [H, W] of frames [P, H, W, 3] that show no scene."""
    window = _between_bars(frames)
    mask = np.ones(frames.shape[1:3], bool)
    mask[window] = vehicle_mask(frames[:, *window])
    return mask


def scene_window(mask: BoolArray) -> tuple[slice, slice]:
    """The rows and columns of a static mask [H, W] that show the scene: all between the bars, down
    to the vehicle.
    """
    rows, columns = (np.flatnonzero(~mask.all(axis=axis)) for axis in (1, 0))
    across = slice(int(columns[0]), int(columns[-1]) + 1)
    return slice(int(rows[0]), int(rows[0]) + top_row(mask[rows[0] :, across])), across


def _between_bars(frames: ByteArray) -> tuple[slice, slice]:
    found = []
    for lines in (frames, frames.swapaxes(1, 2)):
        whole = slice(0, lines.shape[1])
        found.append(whole)
        if all((lines[:, end] > BLACK).any(axis=(0, 2)).mean() > LIT_SHARE for end in (0, -1)):
            continue
        brightest = lines.max(axis=(0, 3))
        black = min(BLACK, BLACK_SHARE * float(np.quantile(brightest, 0.95)))
        lit = np.flatnonzero((brightest > black).mean(axis=1) > LIT_SHARE)
        if len(lit):
            first, last = int(lit[0]), int(lit[-1])
            start = first + BORDER_PX if first > 0 else 0
            stop = last + 1 - BORDER_PX if last + 1 < whole.stop else whole.stop
            if stop - start >= LEAST_IMAGE * whole.stop:
                found[-1] = slice(start, stop)
    return found[0], found[1]


def top_row(mask: BoolArray) -> int:
    """The first row of a mask [H, W] that reaches down to the last; H where it is empty."""
    columns = mask.any(axis=0)
    return (
        int(np.quantile(mask.argmax(axis=0)[columns], TOP_QUANTILE)) if columns.any() else len(mask)
    )


def _leaks(mask: BoolArray) -> BoolArray:
    """Where a mask [H, W] goes on into a road without texture: far above the arc that most of its
    columns end at.

    Of parabolas through the tops of three columns each, the one with the least absolute errors, cut
    at a bound.
    """
    columns = np.flatnonzero(mask.any(axis=0))
    if len(columns) < 3:
        return np.zeros_like(mask)
    tops, bound_px = mask.argmax(axis=0)[columns].astype(float), ARC_SHARE * len(mask)
    chosen = np.linspace(0, len(columns) - 1, ARC_COLUMNS).astype(int)
    triples = np.array(list(itertools.combinations(np.unique(chosen), 3)))
    across = columns / mask.shape[1]
    arcs = (
        np.linalg.solve(np.vander(across, 3)[triples], tops[triples][..., None])[..., 0]
        @ np.vander(across, 3).T
    )
    arc = arcs[np.minimum(np.abs(arcs - tops), bound_px).mean(axis=1).argmin()]
    leaks, limit = tops < arc - bound_px, np.zeros(mask.shape[1])
    limit[columns[leaks]] = arc[leaks] if leaks.mean() < MOST_LEAKS else 0
    return np.asarray(np.arange(len(mask))[:, None] < limit)


def vehicle_mask(frames: ByteArray) -> BoolArray:
    """The pixels [H, W] of frames [P, H, W, 3] that stay in place at the bottom, behind an edge,
    while others move.
    """
    nothing = np.zeros(frames.shape[1:3], bool)
    frames = frames[frame_screening.usable(frames)]
    if len(frames) < FEWEST_FRAMES or frames.shape[1] < LEAST_ROWS:
        return nothing
    lowest = frames[:, -MARGIN_PX:].astype(np.float32).mean(axis=(1, 3)).std(axis=0) < STILL
    if lowest.mean() < LEAST_WIDTH:
        return nothing
    first = round(frames.shape[1] * (1 - LARGEST_SHARE)) - 2 * MARGIN_PX
    grey = np.stack([pinhole.grey(frame[first:]) for frame in frames])
    still = grey.std(axis=0) < STILL
    labels = cv2.connectedComponents(
        cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5)))
    )[1]
    label = np.bincount(labels[-1]).argmax()
    mask = nothing.copy()
    mask[first:] = labels == label
    mask &= ~_leaks(mask)
    top = top_row(mask)
    mask[:top] = False
    if label == 0 or mask[-1].mean() < LEAST_WIDTH or top <= first + MARGIN_PX:
        return nothing
    tops, own = mask.argmax(axis=0), mask.any(axis=0)
    mask |= (np.arange(len(mask))[:, None] >= tops) & own
    columns, border = np.flatnonzero(own), tops[own] - first
    above, below = (
        grey[:, border - MARGIN_PX, columns],
        grey[:, np.minimum(border + MARGIN_PX, len(still) - 1), columns],
    )
    edge = np.quantile(np.median(np.abs(above - below), axis=1), 1 - EDGE_SHARE)
    moves = np.abs(grey[-1] - grey[0])[~mask[first:]].mean()
    return mask if edge >= EDGE and moves >= MOVING else nothing

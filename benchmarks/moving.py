"""What carrying moving things on is worth: depth fusion with and without it, over all and over truly moving pixels.

`python -m benchmarks.moving synthetic SEED...` (its moving pixels are known) or
`python -m benchmarks.moving kitti ROOT SEQUENCE...` prints one line a clip with moving things and the means. Poses are
the recorded ones, past and future; horizons 1, 5, 10, 15 and 20 are scored.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.commands import command, watched
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.interfaces import FrameMetric
from geovp_classic.renderers import DepthFusion
from geovp_classic.types import BoolArray, ByteArray, Clip, Context, FloatArray, Grant, Trajectory, Views

NUM_PAST = 10
SCORED = (0, 4, 9, 14, 19)  # of the future frames
METRICS = ("psnr", "ssim", "lpips")
SMALL, SMALL_PX = "00", 128  # a sequence whose frames are no higher


@dataclass(frozen=True)
class MovingRow:
    """One clip, ignoring motion [0] and carrying it on [1]."""

    clip: str
    num_things: int
    true_px: int  # of the last observed frame that really move; 0 where that isn't known
    found_px: int
    both_px: int
    scores: Mapping[str, FloatArray]  # [2] by metric, "psnr" over all pixels, "psnr@moving" over truly moving ones
    cpu_s: FloatArray  # [2], of depth, fusion and views


def measure(clips: Iterable[Clip], metrics: Mapping[str, FrameMetric]) -> list[MovingRow]:
    """One row a clip; BadData for a clip without poses."""
    return [_row(clip, metrics) for clip in clips]


def _row(clip: Clip, metrics: Mapping[str, FrameMetric]) -> MovingRow:
    if clip.trajectory is None:
        raise BadData(f"{clip.name} has no poses: moving things are measured with recorded ones")
    context, target = clip.split(NUM_PAST, Grant.NONE)
    past, future = clip.trajectory[:NUM_PAST], clip.trajectory.world_from_cam[NUM_PAST:]
    ignored, ignored_s = _shown(DepthFusion(dynamic_objects=None), context, past, future)
    views, carried_s = _shown(DepthFusion(), context, past, future)
    things = DepthFusion().sprites(context, past)
    found = np.any([thing.mask for thing in things], axis=0) if things else np.zeros(clip.frames.shape[1:3], bool)
    true = np.zeros_like(found) if clip.moving is None else clip.moving[NUM_PAST - 1]
    scored = [step for step in SCORED if step < len(target.frames)]
    pairs = [(one.frames[scored], target.frames[scored]) for one in (ignored, views)]
    scores = {name: _scores(metric, pairs, None) for name, metric in metrics.items()}
    if clip.moving is not None:
        mask = clip.moving[NUM_PAST:][scored]
        scores.update({f"{name}@moving": _scores(metric, pairs, mask) for name, metric in metrics.items()})
    counts = int(true.sum()), int(found.sum()), int((true & found).sum())
    return MovingRow(clip.name, len(things), *counts, scores, np.array([ignored_s, carried_s]))


def _shown(renderer: DepthFusion, context: Context, past: Trajectory, future: FloatArray) -> tuple[Views, float]:
    start_s = time.process_time()
    views = renderer.reconstruct(context, past).view(future, context.times_s[NUM_PAST:], context.intrinsics)
    return views, time.process_time() - start_s


def _scores(metric: FrameMetric, pairs: Sequence[tuple[ByteArray, ByteArray]], mask: BoolArray | None) -> FloatArray:
    """Means over the frames that have a pixel to score [2]; NaN when none has."""
    values = np.stack([metric(*pair, mask) for pair in pairs])
    return (
        np.asarray(values[:, np.isfinite(values).all(axis=0)].mean(axis=1))
        if np.isfinite(values).any()
        else values[:, 0]
    )


def table(rows: Sequence[MovingRow]) -> str:
    """A line for every clip with moving things, the means over those and over all clips, and how well masks fit."""
    names = list(dict.fromkeys(name for row in rows for name in row.scores))
    lines = [f"{'':<28}{'things':>7}{'IoU':>6}" + "".join(f"{name:>18}" for name in names)]
    some = [row for row in rows if row.num_things]
    lines += [_line(row.clip, [row], names) for row in some]
    lines += [_line(f"mean of {len(group)} clips", group, names) for group in (some, rows) if group]
    true, found, both = (sum(getattr(row, name) for row in rows) for name in ("true_px", "found_px", "both_px"))
    if true:
        precision, recall = both / max(found, 1), both / true
        iou = both / (true + found - both)
        lines.append(f"moving pixels of the last frame: precision {precision:.2f}, recall {recall:.2f}, IoU {iou:.2f}")
    extra_ms = 1000 * np.median(np.diff([row.cpu_s for row in rows])) if rows else 0.0
    lines.append(f"carrying costs {extra_ms:.0f} ms of processor time a clip (median)")
    return "\n".join(lines)


def _line(title: str, rows: Sequence[MovingRow], names: Sequence[str]) -> str:
    union = sum(row.true_px + row.found_px - row.both_px for row in rows)
    iou = f"{sum(row.both_px for row in rows) / union:.2f}" if any(row.true_px for row in rows) else "-"
    cells = []
    for name in names:
        pairs = np.array([row.scores[name] for row in rows])
        before, after = np.nanmean(pairs, axis=0) if np.isfinite(pairs).any() else (np.nan, np.nan)
        cells.append(f"{before:.3f} -> {after:.3f}")
    return f"{title:<28}{sum(row.num_things for row in rows):>7}{iou:>6}" + "".join(f"{cell:>18}" for cell in cells)


def specs_of(arguments: Sequence[str]) -> list[dict[str, object]]:
    """Data sets of eight clips a synthetic seed, or of a KITTI folder's sequences, a clip every ten frames.

    BadData unless it is `synthetic SEED...` or `kitti ROOT SEQUENCE...`.
    """
    name, *wanted = arguments or [""]
    if name == "synthetic" and wanted and all(seed.isdecimal() for seed in wanted):
        return [{"name": name, "seed": int(seed), "num_clips": 8} for seed in wanted]
    if name == "kitti" and len(wanted) > 1:
        root, *sequences = wanted
        small = [one for one in sequences if one.startswith(SMALL)]
        sized = (([one for one in sequences if one not in small], 256), (small, SMALL_PX))
        shared = {"name": name, "root": root, "num_frames": 30, "stride": 10}
        return [{**shared, "sequences": some, "size_px": [size_px, size_px]} for some, size_px in sized if some]
    given = " ".join(arguments) or "nothing"
    raise BadData(f"moving: given {given!r}, expected `synthetic SEED...` or `kitti ROOT SEQUENCE...`")


@command
def main(arguments: Sequence[str]) -> str:
    """The table."""
    datasets = [registry.build("datasets", spec) for spec in specs_of(arguments)]
    metrics = {metric: registry.build("frame_metrics", metric) for metric in METRICS}
    clips = (dataset[i] for dataset in datasets for i in range(len(dataset)))
    return table(measure(watched(clips, sum(map(len, datasets)), "moving"), metrics))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

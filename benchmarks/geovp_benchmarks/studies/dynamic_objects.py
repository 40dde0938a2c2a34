"""The gain from predicting dynamic objects: depth fusion without and with it, over all and over
moving pixels.

One line a clip with dynamic objects, and the means. Poses are the recorded ones, refined; horizons
1, 5, 10, 15 and 20 are scored.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.studies import ablation
from geovp_benchmarks.studies.ablation import METRICS, NUM_PAST, SCORED
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.interfaces import FrameMetric
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    PrivilegedInput,
    Trajectory,
    Views,
)

if TYPE_CHECKING:
    from geovp_classic.renderers.depth_fusion import DepthFusion


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A data set: eight clips a seed, or a clip every ten frames of the sequences."""
    parser.add_argument(
        "dataset", choices=("synthetic", "kitti"), help="synthetic: its moving pixels are known"
    )
    help_text = (
        "synthetic: seeds; kitti: the folder, then sequences or stretches of them, as 03 or "
        "03[0:180)"
    )
    parser.add_argument("words", nargs="+", metavar="WORD", help=help_text)


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table."""
    datasets = [
        registry.build("datasets", spec) for spec in dataset_specs(chosen.dataset, chosen.words)
    ]
    metrics = {metric: registry.build("frame_metrics", metric) for metric in METRICS}
    clips = (dataset[i] for dataset in datasets for i in range(len(dataset)))
    rows = [measure(clip, metrics) for clip in tracked(clips, sum(map(len, datasets)), progress)]
    yield from table(rows)


def dataset_specs(name: str, words: Sequence[str]) -> list[dict[str, Any]]:
    """One data set a synthetic seed, or one a stretch of KITTI; BadData for words that
    are neither.
    """
    if name == "synthetic" and all(seed.isdecimal() for seed in words):
        return [{"name": name, "seed": int(seed), "num_clips": 8} for seed in words]
    if name == "kitti" and len(words) > 1:
        return ablation.dataset_specs(Path(words[0]), words[1:])
    raise BadData(
        f"given '{name} {' '.join(words)}', expected `synthetic SEED...` or `kitti ROOT "
        "SEQUENCE...`"
    )


@dataclass(frozen=True)
class ClipScores:
    """One clip, without [0] and with [1] dynamic objects."""

    clip: str
    num_objects: int
    moving_px: int  # of the last observed frame; 0 where the ground truth is unknown
    detected_px: int
    overlap_px: int  # both moving and detected
    scores: Mapping[
        str, FloatArray
    ]  # [2] by metric, "psnr" over all pixels, "psnr@moving" over moving ones
    cpu_s: FloatArray  # [2], of depth, fusion and views


def measure(clip: Clip, metrics: Mapping[str, FrameMetric]) -> ClipScores:
    """Render the clip's future both ways and score it; BadData for a clip without poses."""
    from geovp_classic.pose_sources.ground_truth import GroundTruth
    from geovp_classic.pose_sources.refined import Refined
    from geovp_classic.renderers.depth_fusion import DepthFusion

    if clip.trajectory is None:
        raise BadData(f"{clip.name} has no poses: dynamic objects are measured with recorded ones")
    context, target = clip.split(
        NUM_PAST, PrivilegedInput.PAST_POSES | PrivilegedInput.FUTURE_POSES
    )
    motion = Refined(GroundTruth()).estimate(context)
    past, future = motion.past, motion.futures[0]
    static, static_s = _render(DepthFusion(dynamic_objects=None), context, past, future)
    dynamic, dynamic_s = _render(DepthFusion(), context, past, future)
    objects = DepthFusion().sprites(context, past)
    detected = (
        np.any([one.mask for one in objects], axis=0)
        if objects
        else np.zeros(clip.frames.shape[1:3], bool)
    )
    moving = np.zeros_like(detected) if clip.moving is None else clip.moving[NUM_PAST - 1]
    scored = [step for step in SCORED if step < len(target.frames)]
    pairs = [(views.frames[scored], target.frames[scored]) for views in (static, dynamic)]
    scores = {name: _scores(metric, pairs, None) for name, metric in metrics.items()}
    if clip.moving is not None:
        mask = clip.moving[NUM_PAST:][scored]
        scores.update(
            {f"{name}@moving": _scores(metric, pairs, mask) for name, metric in metrics.items()}
        )
    counts = int(moving.sum()), int(detected.sum()), int((moving & detected).sum())
    return ClipScores(clip.name, len(objects), *counts, scores, np.array([static_s, dynamic_s]))


def _render(
    renderer: DepthFusion, context: Context, past: Trajectory, future: FloatArray
) -> tuple[Views, float]:
    start_s = time.process_time()
    views = renderer.reconstruct(context, past).view(
        future, context.times_s[NUM_PAST:], context.intrinsics
    )
    return views, time.process_time() - start_s


def _scores(
    metric: FrameMetric, pairs: Sequence[tuple[ByteArray, ByteArray]], mask: BoolArray | None
) -> FloatArray:
    """Means over the frames that have a pixel to score [2]; NaN when none has."""
    values = np.stack([metric(*pair, mask) for pair in pairs])
    known = np.isfinite(values).all(axis=0)
    return np.asarray(values[:, known].mean(axis=1)) if known.any() else np.full(2, np.nan)


def table(rows: Sequence[ClipScores]) -> Iterator[str]:
    """A line per clip with dynamic objects, the means over those and over all clips, and the
    accuracy of the masks.
    """
    names = list(dict.fromkeys(name for row in rows for name in row.scores))
    yield f"{'':<28}{'objects':>8}{'IoU':>6}" + "".join(f"{name:>18}" for name in names)
    some = [row for row in rows if row.num_objects]
    yield from (_line(row.clip, [row], names) for row in some)
    yield from (
        _line(f"mean of {len(group)} clips", group, names) for group in (some, rows) if group
    )
    moving, detected, overlap = _pixels(rows)
    if moving:
        precision, recall, iou = (
            overlap / max(detected, 1),
            overlap / moving,
            overlap / (moving + detected - overlap),
        )
        yield (
            f"moving pixels of the last frame: precision {precision:.2f}, recall {recall:.2f}, "
            f"IoU {iou:.2f}"
        )
    extra_ms = 1000 * np.median(np.diff([row.cpu_s for row in rows])) if rows else 0.0
    yield f"dynamic objects cost {extra_ms:.0f} ms of processor time a clip (median)"


def _pixels(rows: Sequence[ClipScores]) -> tuple[int, int, int]:
    """Moving, detected, and both."""
    moving_px, detected_px = (
        sum(row.moving_px for row in rows),
        sum(row.detected_px for row in rows),
    )
    return moving_px, detected_px, sum(row.overlap_px for row in rows)


def _line(title: str, rows: Sequence[ClipScores], names: Sequence[str]) -> str:
    moving, detected, overlap = _pixels(rows)
    iou = f"{overlap / (moving + detected - overlap):.2f}" if moving else "-"
    cells = []
    for name in names:
        pairs = np.array([row.scores[name] for row in rows])
        before, after = np.nanmean(pairs, axis=0) if np.isfinite(pairs).any() else (np.nan, np.nan)
        cells.append(f"{before:.3f} -> {after:.3f}")
    return f"{title:<28}{sum(row.num_objects for row in rows):>8}{iou:>6}" + "".join(
        f"{cell:>18}" for cell in cells
    )

"""Gain of each component of the default method on clips of train and val.

A row compares the default method with a variant without the component: the gain of the default in
PSNR and SSIM (more is better) and LPIPS (less is better), as the mean of paired differences over
clips with its 95 % interval, and the additional time. Components of the renderer and the
refinements are measured with true poses, components of the odometry without.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.analysis.intervals import KIND
from geovp_benchmarks.cli.options import add
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.results.score_names import UNBOUNDED
from geovp_benchmarks.tables.formats import markdown
from geovp_benchmarks.tables.table_model import Column, MethodScores, Score, Table
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import ByteArray, Clip

NUM_PAST, NUM_FUTURE = 10, 20
SCORED_STEPS = np.array([0, 4, 9, 14, 19])  # of the future
STRETCHES = ("03[0:180)", "raw0095", "00[0:569)", "00[600:725)")  # train and val


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the clips and the components."""
    add(parser, "root", "FOLDER", "Folder laid out as KITTI odometry.")
    text = f"Sequences or stretches of them. Default: {' '.join(STRETCHES)}."
    add(parser, "frames", "FRAMES", text, STRETCHES, nargs="*")
    add(parser, "--stride", "N", "Frames between the starts of two clips. Default: 10.", 10)
    add(parser, "--only", "NAME...", "Names of the components. Default: all.")


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield the table."""
    available = variants()
    names = args.only or [name for name, variant in available.items() if variant.default]
    for name in names:
        if name not in available:
            raise BadData(f"no component is called {name!r}{registry.nearest(name, available)}")
    defaults = {available[name].default: None for name in names}
    compared = {name: available[name].predictor for name in (*defaults, *names)}
    metrics = {name: registry.build("frame_metrics", name) for name in ("psnr", "ssim", "lpips")}
    clips = [
        (f"{stretch}/{number}", dataset, number)
        for stretch, dataset in zip(
            args.frames, datasets(args.root, args.frames, args.stride), strict=True
        )
        for number in range(len(dataset))
    ]
    scores: dict[str, list[list[float]]] = {name: [] for name in compared}
    for _, dataset, number in tracked(clips, len(clips), progress):
        clip = dataset[number]
        real = clip.frames[NUM_PAST + SCORED_STEPS]
        for name, predictor in compared.items():
            start_s = time.perf_counter()
            frames = predicted(predictor, clip)
            ms = 1000 * (time.perf_counter() - start_s)
            scores[name].append([*(m(frames, real, None).mean() for m in metrics.values()), ms])
    columns = [Column(name, name.upper(), None, 4) for name in metrics]
    columns.append(Column("ms", "ms", None, 0))
    names_of_clips = [name for name, _, _ in clips]
    rows = []
    for name in names:
        gains = np.subtract(scores[available[name].default], scores[name])
        gained = {
            column.key: Score.of(values, names_of_clips, UNBOUNDED)
            for column, values in zip(columns, gains.T, strict=True)
        }
        rows.append(MethodScores(name, gained, num_clips=len(clips)))
    title = f"Gain of components on clips of {', '.join(args.frames)}"
    yield markdown(Table("ablation", title, columns, rows, [KIND], starred=()))


@dataclass(frozen=True)
class Variant:
    """Default method without a component."""

    predictor: GeometricPredictor
    default: str  # the variant with all components; empty for itself


def variants() -> dict[str, Variant]:
    """Return the default method with true poses and with odometry, and without each component."""
    result = {}

    def add(name: str, default: str, source: Any, refined: bool = True, **renderer: Any) -> None:
        if refined:
            source = {"name": "refined", "source": source}
        predictor = GeometricPredictor(
            registry.build("pose_sources", source),
            registry.build("renderers", {"name": "depth-fusion", **renderer}),
        )
        result[name] = Variant(predictor, default)

    true = {"name": "ground-truth"}
    add("all", "", true)
    add("refinements", "all", true, refined=False)
    add("ground prior", "all", true, depth={"name": "multiview", "ground": "none"})
    add("crack closing", "all", true, crack_px=0)
    add("detail transfer", "all", true, detail="none")
    add("borrowed detail", "all", true, inpainter={"name": "nearest-background"})
    add("exposure", "all", true, exposure="none")

    tracked = {"name": "chained"}
    default = "all, odometry"
    add(default, "", tracked)
    add("refinements, odometry", default, tracked, refined=False)
    kalman = {"name": "acceleration-kalman"}
    add("motion prior (damped CTRA)", default, {**tracked, "forecaster": kalman})
    settings: dict[str, Any]
    for name, settings in (
        ("bundle adjustment", {"tracking": {"keyframes": {"max_bundle_points": 0}}}),
        ("road scale (unit speed)", {"scale": {"name": "unit-speed"}}),
    ):
        add(name, default, {**tracked, "odometry": {"name": "monocular", **settings}})
    return result


def predicted(predictor: GeometricPredictor, clip: Clip) -> ByteArray:
    """Return the predicted frames [N, H, W, 3] at the scored steps."""
    context, _ = clip.split(NUM_PAST, predictor.needs)
    observed = predictor.observe(context)
    motion = predictor.estimate(observed)
    scene = predictor.reconstruct(observed, motion.past)
    times_s = context.times_s[NUM_PAST + SCORED_STEPS]
    return scene.view(motion.futures[0, SCORED_STEPS], times_s, context.intrinsics).frames


def datasets(root: Path, frames: Sequence[str], stride: int, **fields: Any) -> list[Any]:
    """Return a data set per stretch; images of sequence 00 have a height of 128 pixels."""
    shared = {"name": "kitti", "root": root, "num_frames": NUM_PAST + NUM_FUTURE, **fields}
    sides_px = [128 if stretch.startswith("00") else 256 for stretch in frames]
    return [
        registry.build(
            "datasets",
            {**shared, "sequences": [stretch], "stride": stride, "size_px": [side_px, side_px]},
        )
        for stretch, side_px in zip(frames, sides_px, strict=True)
    ]

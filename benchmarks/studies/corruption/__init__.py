"""Robustness: the gain over copy-last on clips with 24 corruptions of four severities.

A row per corruption and severity, a column per pose source and renderer (after Hendrycks &
Dietterich 2019). Values are mean PSNR over steps and clips, minus that of the corrupted last frame,
copied; `--plot` draws them as curves. Lasting corruptions (noise, dimming, a hood, a lorry ahead)
also apply to the real future; transient ones (a black frame, a swap) do not. `<` marks values more
than LIMIT_DB below copying, `-` clips that could not be predicted.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.arguments import figure_file, positive
from geovp_benchmarks.evaluation.budget.scores import SCORED_STEPS
from geovp_benchmarks.progress import Progress
from geovp_classic import registry
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.interfaces import PoseSource, Renderer
from geovp_classic.observation import Observer
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.rendering.source import Source, resampled
from geovp_classic.types import (
    ByteArray,
    Clip,
    Context,
    ExtraView,
    FloatArray,
    Motion,
    PrivilegedInput,
    Target,
)
from studies.ablation import NUM_PAST, STRETCHES, dataset_specs
from studies.corruption.kinds import (
    CORRUPTIONS,
    NUM_SEVERITIES,
    Corruption,
    Severity,
)

LIMIT_DB = 0.5


def columns() -> dict[str, tuple[Any, Any]]:
    """Pose source and renderer of each column."""
    sources = {"true": {"name": "ground-truth"}, "vo": {"name": "chained"}}
    renderers: dict[str, dict[str, Any]] = {
        "crop": {"name": "depth-fusion"},
        "full": {"name": "depth-fusion", "frames": "full"},
        "plane": {"name": "ground-far-plane"},
    }
    return {
        f"{source} {renderer}": (
            registry.build("pose_sources", {"name": "refined", "source": spec}),
            registry.build("renderers", renderers[renderer]),
        )
        for source, spec in sources.items()
        for renderer in renderers
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the data is, and what of it."""
    parser.add_argument(
        "root", type=Path, metavar="ROOT", help="a folder laid out as KITTI odometry"
    )
    parser.add_argument(
        "frames", nargs="*", default=STRETCHES[:2], metavar="FRAMES", help="stretches of sequences"
    )
    parser.add_argument(
        "--stride", type=positive, default=60, metavar="N", help="frames between clips' starts (60)"
    )
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        help="only these corruptions, by the words of the table",
    )
    parser.add_argument(
        "--plot", type=figure_file, metavar="FILE", help="draw curves, as png, pdf or svg"
    )
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="write the page; what is under its Notes stays"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table."""
    names = chosen.only or list(CORRUPTIONS)
    if unknown := [name for name in names if name not in CORRUPTIONS]:
        raise BadData(
            f"no corruption is called {unknown[0]!r}{registry.nearest(unknown[0], CORRUPTIONS)}"
        )
    specs = [
        {**spec, "with_full": True}
        for spec in dataset_specs(chosen.root, chosen.frames, chosen.stride)
    ]
    clips = [
        dataset[number]
        for dataset in (registry.build("datasets", s) for s in specs)
        for number in range(len(dataset))
    ]
    methods = columns()
    what = f"{len(clips)} clips of {', '.join(chosen.frames)}; dB over copying the last frame"
    yield what
    yield f"{'corruption':<32}" + "".join(f"{name:>12}" for name in methods)
    severities = [
        (name, severity)
        for name in names
        for severity in range(1 if name in ("none", "stationary") else NUM_SEVERITIES)
    ]
    found: dict[str, list[FloatArray]] = {name: [] for name in names}
    for done, (name, severity) in enumerate(severities, 1):
        gains = np.array([gains_db(clip, name, severity, methods) for clip in clips])
        found[name].append(_mean(gains))
        progress(done, len(severities))
        yield f"{name} {severity + 1}".ljust(32) + "".join(_text(gain) for gain in found[name][-1])
    means = {name: np.array(gains) for name, gains in found.items()}
    values = np.concatenate(list(means.values()))
    num_below = (values < -LIMIT_DB).sum()
    lowest = np.nanmin(values)
    yield f"{num_below} of {values.size} below -{LIMIT_DB} dB, the lowest {lowest:.1f} dB"
    if chosen.plot is not None:
        from studies.corruption.figure import corruption_figure

        pairs = [(source, renderer) for source, renderer in (name.split() for name in methods)]
        corruption_figure(means, pairs, LIMIT_DB).savefig(chosen.plot)
    if chosen.page is not None:
        from geovp_benchmarks.tables.formats import write_page

        frames = " ".join(f"'{one}'" for one in chosen.frames)
        command = (
            f"python benchmarks/studies corruption path/to/kitti {frames} --stride {chosen.stride}"
        )
        write_page(
            chosen.page,
            "Corruptions",
            [command],
            "the same with `--page`",
            _page(what, list(methods), means),
        )


def gains_db(
    clip: Clip, name: str, severity: Severity, methods: Mapping[str, tuple[PoseSource, Renderer]]
) -> FloatArray:
    """Return each method's mean PSNR over SCORED_STEPS steps, less that of the last frame, copied.

    It is NaN for a method that could not predict. Methods share observations, and motions by the
    first word of their name.
    """
    metric = registry.build("frame_metrics", "psnr")
    needs = [source.needs | renderer.needs for source, renderer in methods.values()]
    context, target = corrupted(
        clip, CORRUPTIONS[name], severity, reduce(PrivilegedInput.__or__, needs)
    )
    steps = np.array(SCORED_STEPS)
    actual, times_s = target.frames[steps], context.times_s[NUM_PAST + steps]
    copied = np.repeat(context.frames[-1:], len(steps), axis=0)
    observed = Observer().observe(context)
    motions: dict[str, Motion] = {}
    gains = []
    for label, (source, renderer) in methods.items():
        predictor = GeometricPredictor(source, renderer)
        motion_name = label.split()[0]
        try:
            if motion_name not in motions:
                motions[motion_name] = predictor.estimate(observed)
            motion = motions[motion_name]
            scene = predictor.reconstruct(observed, motion.past)
            views = scene.view(motion.futures[0, steps], times_s, context.intrinsics)
        except GeovpError:
            gains.append(np.nan)
            continue
        gain = metric(views.frames, actual, None) - metric(copied, actual, None)
        gains.append(float(gain.mean()))
    return np.array(gains)


def corrupted(
    clip: Clip, what: Corruption, severity: Severity, needs: Any
) -> tuple[Context, Target]:
    """Context and target of the corrupted clip."""
    order = what.order(severity)

    def images(frames: ByteArray) -> ByteArray:
        return np.stack(
            [what.image(frames[shown], step, severity) for step, shown in enumerate(order)]
        )

    wide = clip.full and ExtraView(
        images(clip.full.frames), clip.full.intrinsics, clip.full.view_from_cam
    )
    frames = images(clip.frames)
    if wide is not None and what.crop_from_full:
        sources = (Source(frame, wide.intrinsics, wide.view_from_cam) for frame in wide.frames)
        frames = np.stack([resampled(source, clip.intrinsics) for source in sources])
    changes: dict[str, Any] = {"frames": frames, "full": wide}
    if what.poses_follow and clip.trajectory is not None:
        changes["trajectory"] = replace(
            clip.trajectory, world_from_cam=clip.trajectory.world_from_cam[order]
        )
    context, target = replace(clip, **changes).split(NUM_PAST, needs)
    return what.context(context, severity), target


def _mean(gains: FloatArray) -> FloatArray:
    """Return means [methods] over the predicted clips [clips, methods]; NaN without one."""
    known = np.isfinite(gains)
    total, count = np.where(known, gains, 0).sum(axis=0), known.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _text(gain: float) -> str:
    if not np.isfinite(gain):
        return f"{'-':>12}"
    return f"{gain:>11.1f}" + ("<" if gain < -LIMIT_DB else " ")


def _page(what: str, methods: list[str], means: dict[str, FloatArray]) -> str:
    """What is written of the table, in Markdown."""
    from geovp_benchmarks.tables.formats import grid

    rows = [["corruption, severity", *methods]]
    for name, gains in means.items():
        for severity, line in enumerate(gains, 1):
            texts = [f"**{gain:.1f}**" if gain < -LIMIT_DB else f"{gain:.1f}" for gain in line]
            rows.append([f"{name} {severity}", *("-" if text == "nan" else text for text in texts)])
    values, names = np.concatenate(list(means.values())), np.array(methods)
    crop, wide = (values[:, np.char.endswith(names, renderer)] for renderer in ("crop", "full"))
    below, behind = (values < -LIMIT_DB).sum(), (wide < crop - LIMIT_DB).sum()
    lines = [
        f"{what}, mean of horizons {', '.join(str(step + 1) for step in SCORED_STEPS)}.",
        "True: recorded poses, refined; vo: odometry and motion prior, refined. Crop and full: "
        "depth fusion; plane:",
        f"ground-far-plane. Below -{LIMIT_DB} dB in **bold** ({below} of {values.size}); - "
        "where nothing was "
        "predicted.",
        f"Uncropped frames are more than {LIMIT_DB} dB behind the crop in {behind} of {wide.size}.",
    ]
    return "\n".join([*lines, "", *grid(rows)])

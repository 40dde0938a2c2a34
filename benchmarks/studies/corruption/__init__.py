"""Gain over copy-last on clips with 16 corruptions of four severities.

The study follows Hendrycks & Dietterich 2019: a row per corruption and severity, a column per pose
source and renderer. Values are the mean PSNR over steps and clips, minus that of copying the
corrupted last frame. Lasting corruptions (noise, a hood) also apply to the real future; transient
ones (a black frame) do not. Pose sources: recorded poses (true), odometry with the motion prior
(vo), both refined. Renderers: depth fusion of the crop and of the full frames, and planes. As in
the predictor `default`, the hindcast may show image motion or the last frame instead.
"""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from geovp.progress import tracked
from geovp_benchmarks.cli.options import option
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.observation import Observer
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import Hindcast
from geovp_classic.rendering.source import Source, resampled
from geovp_classic.types import (
    Clip,
    Context,
    FloatArray,
    Motion,
    PrivilegedInput,
    Target,
)
from studies.corruption.kinds import CORRUPTIONS, Corruption

ARGUMENTS = {
    "": {
        "root FOLDER": "Folder laid out as KITTI odometry.",
        # val and train
        "frames FRAMES... = 03[0:180) raw0095": option(
            "Sequences or stretches of them.", nargs="*"
        ),
        "--stride N = 60": "Frames between the starts of two clips.",
        "--only NAME...": option(
            "Names of the corruptions. Default: all.",
            default=list(CORRUPTIONS),
            choices=CORRUPTIONS,
        ),
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield a Markdown table."""
    dataset = registry.build(
        "datasets",
        {
            "name": "kitti",
            "root": args.root,
            "sequences": args.frames,
            "num_frames": 30,
            "stride": args.stride,
            "size_px": [256, 256],
            "with_full": True,
        },
    )
    clips = [dataset[index] for index in range(len(dataset))]
    compared = methods()
    tasks = [
        (name, severity) for name in args.only for severity in range(CORRUPTIONS[name].severities)
    ]
    means = []
    for name, severity in tracked(tasks):
        of_clips = [gains_db(clip, CORRUPTIONS[name], severity, compared) for clip in clips]
        means.append(nanmean(np.array(of_clips), axis=0))
    values = np.array(means)
    yield f"{len(clips)} clips of {', '.join(args.frames)}; dB over copying the last frame"
    num_below = (values < -0.5).sum()
    yield f"{num_below} of {values.size} values below -0.5 dB, minimum {np.nanmin(values):.1f} dB"
    yield ""
    lines = [
        [f"{name} {severity + 1}", *(f"{value:z.1f}" for value in row)]
        for (name, severity), row in zip(tasks, values, strict=True)
    ]
    yield from grid([["corruption, severity", *compared], *lines])


def methods() -> dict[str, GeometricPredictor]:
    """Return all pose sources with all renderers; the first word names the pose source."""
    sources = {"true": {"name": "ground-truth"}, "vo": {"name": "chained"}}
    renderers = {
        "crop": {"name": "depth-fusion"},
        "full": {"name": "depth-fusion", "frames": "full"},
        "plane": {"name": "ground-far-plane"},
    }
    return {
        f"{source} {renderer}": GeometricPredictor(
            registry.build("pose_sources", {"name": "refined", "source": sources[source]}),
            registry.build("renderers", renderers[renderer]),
            hindcast=Hindcast(),
        )
        for source in sources
        for renderer in renderers
    }


def gains_db(
    clip: Clip, corruption: Corruption, severity: int, compared: Mapping[str, GeometricPredictor]
) -> FloatArray:
    """Return the gain [M] of each method over copying the last frame; NaN if it failed.

    Methods share observations, and motions by the first word of their name.
    """
    psnr = registry.build("frame_metrics", "psnr")
    context, target = corrupted(clip, corruption, severity)
    steps = np.array([0, 4, 9, 14, 19])  # of the future
    real = target.frames[steps]
    times_s = context.times_s[context.num_past + steps]
    copied_db = psnr(np.repeat(context.frames[-1:], len(real), axis=0), real, None)
    observed = Observer().observe(context)
    motions: dict[str, Motion] = {}
    gains = np.full(len(compared), np.nan)
    for number, (name, predictor) in enumerate(compared.items()):
        source = name.split()[0]
        with suppress(GeovpError):
            if source not in motions:
                motions[source] = predictor.estimate(observed)
            motion = motions[source]
            scene = predictor.judge(predictor.reconstruct(observed, motion.past), motion)
            views = scene.view(motion.futures[0, steps], times_s, context.intrinsics)
            gains[number] = (psnr(views.frames, real, None) - copied_db).mean()
    return gains


def corrupted(
    clip: Clip, corruption: Corruption, severity: int, num_past: int = 10
) -> tuple[Context, Target]:
    """Return context, with all privileged inputs, and target of the corrupted clip."""
    steps = np.arange(len(clip))
    if corruption.is_stationary:
        steps[:] = num_past - 1
    frames, full, trajectory = clip.frames[steps], clip.full, clip.trajectory
    corruption.change(frames, severity)
    if full is not None:
        full_frames = full.frames[steps]
        corruption.change(full_frames, severity)
        full = replace(full, frames=full_frames)
        if corruption.crop_from_full:
            sources = [Source(frame, full.intrinsics, full.view_from_cam) for frame in full_frames]
            frames = np.stack([resampled(source, clip.intrinsics) for source in sources])
    if trajectory is not None:
        trajectory = replace(trajectory, world_from_cam=trajectory.world_from_cam[steps])
    changed = replace(clip, frames=frames, full=full, trajectory=trajectory)
    context, target = changed.split(num_past, ~PrivilegedInput.NONE)
    return corruption.context(context, severity), target

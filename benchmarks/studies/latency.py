"""Quality of a predictive display over the latency, next to what needs no prediction.

Drives are streamed through the live predictor. At a frame's arrival, the present is the frame some
tenths of a second later: shown are the late frame, the late frame shifted by the yaw since then,
extrapolated optical flow, and live views with the forecast motion, with commanded speeds and yaw
rates (the recorded ones with a constant error in each latency), and with the recorded motion. The
last tables show what lost frames and jitter cost the forecast views.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from geovp_benchmarks.analysis.intervals import BlockBootstrap
from geovp_benchmarks.cli.options import option
from geovp_benchmarks.display.channel import Channel, InFlight
from geovp_benchmarks.progress import tracked
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.geometry import planar, se3
from geovp_classic.predictors.flow_extrapolation import FlowExtrapolation
from geovp_classic.streaming import Command, LivePredictor
from geovp_classic.types import ByteArray, Clip, Context, FloatArray
from studies._figures import panels

LATENCY_FRAMES = np.array([1, 2, 3, 5, 7, 10, 15, 20, 25])  # of 0.1 s
NUM_WARM_UP = 12  # frames
METHODS = (
    "late image",
    "late image, shifted",
    "flow extrapolation",
    "live, forecast",
    "live, commanded",
    "live, recorded motion",
)
CHANNELS = {
    "clean": Channel(),
    "5 % lost": Channel(loss=0.05),
    "100 ms jitter": Channel(jitter_s=0.1),
}


@dataclass(frozen=True)
class CommandErrors:
    """Standard deviations of commands from the motion that results, constant in each latency."""

    speed_fraction: float = 0.05
    yaw_rate_rad_s: float = 0.01


ARGUMENTS = {
    "": {
        "root FOLDER": "Folder laid out as KITTI odometry.",
        "frames FRAMES": option(
            "Sequences or stretches of them. Default: 03[0:180) raw0095.",  # train and val
            ["03[0:180)", "raw0095"],
            nargs="*",
        ),
        "--num-frames N": option("Frames of a drive, at least 39. Default: 90.", 90),
        "--every N": option("Frames between two scored ones. Default: 5.", 5),
        "--metrics NAME...": option("Default: psnr ssim lpips.", ["psnr", "ssim", "lpips"]),
        "--plot FILE": "File for curves: png, pdf or svg.",
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield tables over the latency and over faults of the channel; draw the first metric."""
    spec = {"name": "kitti", "root": args.root, "sequences": args.frames, "size_px": [256, 256]}
    spec |= {"num_frames": args.num_frames, "stride": args.num_frames}
    dataset = registry.build("datasets", spec)
    metrics = {name: registry.build("frame_metrics", name) for name in args.metrics}

    def scored(frames: ByteArray, real: ByteArray) -> FloatArray:
        return np.array([metric(frames, real, None) for metric in metrics.values()])

    shown, warned = [], []
    names: list[str] = []
    channels: dict[str, list[FloatArray]] = {name: [] for name in CHANNELS}
    for index in tracked(range(len(dataset))):
        clip = dataset[index]
        for views, real, fraction in presents(clip, args.every):
            shown.append([scored(frames, real) for frames in views])
            names.append(f"{clip.name}/{len(names)}")
            warned.append(fraction)
        for name, channel in CHANNELS.items():
            present, real = received(clip, args.every, replace(channel, seed=index))
            channels[name].append(scored(present, real))
    values = np.array(shown)  # [present, method, metric, latency]
    yield f"{len(values)} presents of {len(dataset)} drives; the live views are replaced by the "
    yield f"late image, with a warning, in {100 * np.mean(warned):.1f} % of the forecasts"
    for column, name in enumerate(metrics):
        means = values[:, :, column].mean(axis=0)
        head = [name, *(f"{frames / 10:g} s" for frames in LATENCY_FRAMES)]
        rows = [
            [method, *(f"{mean:.3g}" for mean in row)]
            for method, row in zip(METHODS, means, strict=True)
        ]
        yield ""
        yield from grid([head, *rows])
    yield ""
    yield from gains(values, names, list(metrics))
    yield ""
    rows = [
        [name, *(f"{mean:.4g}" for mean in np.concatenate(scores, axis=1).mean(axis=1))]
        for name, scores in channels.items()
    ]
    yield from grid([["channel at 0.5 s", *metrics], *rows])
    if args.plot is not None:
        draw(args.plot, values[:, :, 0].mean(axis=0), next(iter(metrics)))


def gains(values: FloatArray, names: Sequence[str], metrics: Sequence[str]) -> Iterator[str]:
    """Yield the mean paired gains of the forecast views, with 95 % intervals."""
    steps = np.flatnonzero(np.isin(LATENCY_FRAMES, (2, 5, 10, 20)))
    rows = []
    for column, metric in enumerate(metrics):
        for reference in range(3):
            gain = values[:, 3, column] - values[:, reference, column]
            entries = []
            for step in steps:
                mean = BlockBootstrap().interval(gain[:, step], names)
                entries.append(f"{mean.mean:+.2f} [{mean.low:.2f}, {mean.high:.2f}]")
            rows.append([f"{metric}: over {METHODS[reference]}", *entries])
    head = ["gain of the forecast views", *(f"{LATENCY_FRAMES[step] / 10:g} s" for step in steps)]
    yield from grid([head, *rows])


def presents(
    clip: Clip, stride: int, errors: CommandErrors = CommandErrors()
) -> Iterator[tuple[list[ByteArray], ByteArray, float]]:
    """Yield the views [L, H, W, 3] of each method, the real frames, and the fraction of warnings,
    for each scored frame.
    """
    assert clip.trajectory is not None
    poses = clip.trajectory.world_from_cam
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    rng = np.random.default_rng(0)
    for step, (frame, time_s) in enumerate(zip(clip.frames, clip.times_s, strict=True)):
        live.push(frame, time_s)
        steps = step + LATENCY_FRAMES
        if step < NUM_WARM_UP or step % stride or steps[-1] >= len(clip):
            continue
        moved = se3.inverse(poses[step]) @ poses[steps]  # last_from_present
        yaw_rad = np.arctan2(moved[:, 0, 2], moved[:, 2, 2])
        commands = commanded(clip, range(step, steps[-1]), errors, rng)
        times_s = clip.times_s[steps]
        forecast = [live.view(now_s) for now_s in times_s]
        live_views = [
            forecast,
            [live.view(now_s, commands) for now_s in times_s],
            [live.view(now_s, (), motion) for now_s, motion in zip(times_s, moved, strict=True)],
        ]
        recent = slice(step - 2, step + 1)
        context = Context(
            frames=clip.frames[recent],
            times_s=np.append(clip.times_s[recent], times_s),
            intrinsics=clip.intrinsics,
        )
        views = [
            np.repeat(frame[None], len(steps), axis=0),
            np.stack([shifted(frame, clip.intrinsics.fx_px * np.tan(yaw)) for yaw in yaw_rad]),
            FlowExtrapolation().predict(context).frames[0],
            *(np.stack([view.frame for view in shown]) for shown in live_views),
        ]
        warned = np.mean([not view.is_predicted for view in forecast])
        yield views, clip.frames[steps], float(warned)


def commanded(
    clip: Clip, steps: Sequence[int], errors: CommandErrors, rng: np.random.Generator
) -> list[Command]:
    """Return the recorded speeds and yaw rates from each step to the next, with an error."""
    assert clip.trajectory is not None
    speed_error, yaw_error = rng.standard_normal(2)
    commands = []
    for step in steps:
        pair = clip.trajectory.world_from_cam[step : step + 2]
        _, ahead_m, yaw_rad = planar.reduce(pair, pair[0], planar.level_vehicle_from_cam())[1]
        elapsed_s = clip.times_s[step + 1] - clip.times_s[step]
        speed = ahead_m / elapsed_s * (1 + errors.speed_fraction * speed_error)
        yaw_rate = yaw_rad / elapsed_s + errors.yaw_rate_rad_s * yaw_error
        commands.append(Command(clip.times_s[step], speed, yaw_rate))
    return commands


def shifted(frame: ByteArray, left_px: float) -> ByteArray:
    """Return the frame [H, W, 3] with its content shifted to the left."""
    return np.asarray(ndimage.shift(frame, (0, -left_px, 0), order=1, mode="nearest"))


def received(clip: Clip, stride: int, channel: Channel) -> tuple[ByteArray, ByteArray]:
    """Return forecast views [N, H, W, 3] over a channel with faults, and the real frames."""
    in_flight = InFlight(channel)
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    views, real = [], []
    for step, (frame, now_s) in enumerate(zip(clip.frames, clip.times_s, strict=True)):
        in_flight.send(step, frame, now_s, now_s)
        for sent in in_flight.receive(now_s):
            live.push(sent.frame, sent.time_s)
        if step >= 2 * NUM_WARM_UP and step % stride == 0:
            views.append(live.view(now_s).frame)
            real.append(frame)
    return np.stack(views), np.stack(real)


def draw(path: Path, means: FloatArray, metric: str) -> None:
    """Draw the means [method, latency] of a metric."""
    with panels(path, (9.5, 3.6), 1) as (axes,):
        for method, row in zip(METHODS, means, strict=True):
            axes.plot(LATENCY_FRAMES / 10, row, marker="o", markersize=3, label=method)
        axes.set_xlabel("latency (s)")
        axes.set_ylabel(metric.upper())

"""Quality of a predictive display over the latency, next to what needs no prediction.

Drives are streamed through the live predictor. At a frame's arrival, the present is the frame some
tenths of a second later: shown are the late frame, the late frame shifted by the yaw since then,
extrapolated optical flow, and live views with the forecast motion, with commanded speeds and yaw
rates (the recorded ones with a constant error in each latency), and with the recorded motion.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from geovp.drawing.page import Page
from geovp.progress import tracked
from geovp_benchmarks.cli.options import option
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.geometry import planar, se3
from geovp_classic.predictors.flow_extrapolation import FlowExtrapolation
from geovp_classic.streaming import Command, LivePredictor
from geovp_classic.types import ByteArray, Clip, Context, FloatArray


@dataclass(frozen=True)
class Setup:
    """What is shown when, and standard deviations of the commands from the motion that results."""

    latencies: tuple[int, ...] = (1, 2, 3, 5, 7, 10, 15, 20, 25)  # frames of 0.1 s
    num_frames: int = 90  # of a drive
    stride: int = 5  # frames between two presents
    num_warm_up: int = 12  # frames
    speed_error_fraction: float = 0.05  # constant in each latency
    yaw_rate_error_rad_s: float = 0.01  # as well


ARGUMENTS = {
    "": {
        "root FOLDER": "Folder laid out as KITTI odometry.",
        # val and train
        "frames FRAMES... = 03[0:180) raw0095": option(
            "Sequences or stretches of them.", nargs="*"
        ),
        "--every N = 5": "Frames between two scored ones.",
        "--metrics NAME... = psnr ssim lpips": "Metrics of frames.",
        "--plot FILE": "File for curves: png, pdf or svg.",
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield tables over the latency; draw the first metric."""
    spec = {"name": "kitti", "root": args.root, "sequences": args.frames, "size_px": [256, 256]}
    setup = Setup(stride=args.every)
    spec |= {"num_frames": setup.num_frames, "stride": setup.num_frames}
    dataset = registry.build("datasets", spec)
    metrics = {name: registry.build("frame_metrics", name) for name in args.metrics}
    # Views of each method at each latency.
    scores: defaultdict[str, list[FloatArray]] = defaultdict(list)
    names: list[str] = []
    warned = []
    for index in tracked(range(len(dataset))):
        clip = dataset[index]
        for views, real, fraction in presents(clip, setup):
            for method, frames in views.items():
                of_metrics = [metric(frames, real, None) for metric in metrics.values()]
                scores[method].append(np.array(of_metrics))
            names.append(f"{clip.name}/{len(names)}")
            warned.append(fraction)
    # Means over the drives, and gains over the late image.
    values = {method: np.array(each) for method, each in scores.items()}
    yield f"{len(names)} presents of {len(dataset)} drives; the live views are replaced by the "
    yield f"late image, with a warning, in {100 * np.mean(warned):.1f} % of the forecasts"
    for column, name in enumerate(metrics):
        head = [name, *(f"{frames / 10:g} s" for frames in setup.latencies)]
        rows = [
            [method, *(f"{mean:.3g}" for mean in each[:, column].mean(axis=0))]
            for method, each in values.items()
        ]
        yield ""
        yield from grid([head, *rows])
    yield ""
    yield from gains(values, names, list(metrics), setup)
    if args.plot is not None:
        means = {method: each[:, 0].mean(axis=0) for method, each in values.items()}
        draw(args.plot, means, next(iter(metrics)), setup)


def gains(
    values: Mapping[str, FloatArray],  # [present, metric, latency] of each method
    names: Sequence[str],
    metrics: Sequence[str],
    setup: Setup,
) -> Iterator[str]:
    """Yield the mean paired gains of the forecast views, with 95 % intervals."""
    shown = (2, 5, 10, 20)  # frames
    steps = [setup.latencies.index(frames) for frames in shown]
    rows = [["gain of the forecast views", *(f"{frames / 10:g} s" for frames in shown)]]
    for column, metric in enumerate(metrics):
        for reference in ("late image", "late image, shifted", "flow extrapolation"):
            gain = (values["live, forecast"] - values[reference])[:, column]
            means = [Intervals().interval(gain[:, step], names) for step in steps]
            entries = [f"{mean.mean:+z.2f} [{mean.low:z.2f}, {mean.high:z.2f}]" for mean in means]
            rows.append([f"{metric}: over {reference}", *entries])
    yield from grid(rows)


def presents(clip: Clip, setup: Setup) -> Iterator[tuple[dict[str, ByteArray], ByteArray, float]]:
    """Yield the views [L, H, W, 3] of each method, the real frames, and the fraction of warnings,
    for each scored frame.
    """
    assert clip.trajectory is not None
    poses = clip.trajectory.world_from_cam
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    rng = np.random.default_rng(0)
    for step, (frame, time_s) in enumerate(zip(clip.frames, clip.times_s, strict=True)):
        live.push(frame, time_s)
        steps = step + np.array(setup.latencies)
        if step < setup.num_warm_up or step % setup.stride or steps[-1] >= len(clip):
            continue
        # The true motion since the last image, and commands that lead there.
        moved = se3.inverse(poses[step]) @ poses[steps]  # last_from_present
        yaw_rad = np.arctan2(moved[:, 0, 2], moved[:, 2, 2])
        commands = commanded(clip, range(step, steps[-1]), setup, rng)
        times_s = clip.times_s[steps]
        # The live predictor with its forecast, with commands, and with the recorded motion.
        live_views = {
            "live, forecast": [live.view(now_s) for now_s in times_s],
            "live, commanded": [live.view(now_s, commands) for now_s in times_s],
            "live, recorded motion": [
                live.view(now_s, (), motion) for now_s, motion in zip(times_s, moved, strict=True)
            ],
        }
        # What needs no geometry: the late image, shifted by the turn, and flow extrapolation.
        recent = slice(step - 2, step + 1)
        context = Context(
            frames=clip.frames[recent],
            times_s=np.append(clip.times_s[recent], times_s),
            intrinsics=clip.intrinsics,
        )
        shifts_px = clip.intrinsics.fx_px * np.tan(yaw_rad)
        views = {
            "late image": np.repeat(frame[None], len(steps), axis=0),
            "late image, shifted": np.stack([shifted(frame, left_px) for left_px in shifts_px]),
            "flow extrapolation": FlowExtrapolation().predict(context).frames[0],
        }
        for method, shown in live_views.items():
            views[method] = np.stack([view.frame for view in shown])
        warned = np.mean([not view.is_predicted for view in live_views["live, forecast"]])
        yield views, clip.frames[steps], float(warned)


def commanded(
    clip: Clip, steps: Sequence[int], setup: Setup, rng: np.random.Generator
) -> list[Command]:
    """Return the recorded speeds and yaw rates from each step to the next, with an error."""
    assert clip.trajectory is not None
    speed_error, yaw_error = rng.standard_normal(2)
    commands = []
    for step in steps:
        pair = clip.trajectory.world_from_cam[step : step + 2]
        _, ahead_m, yaw_rad = planar.reduce(pair, pair[0], planar.level_vehicle_from_cam())[1]
        elapsed_s = clip.times_s[step + 1] - clip.times_s[step]
        speed = ahead_m / elapsed_s * (1 + setup.speed_error_fraction * speed_error)
        yaw_rate = yaw_rad / elapsed_s + setup.yaw_rate_error_rad_s * yaw_error
        commands.append(Command(clip.times_s[step], speed, yaw_rate))
    return commands


def shifted(frame: ByteArray, left_px: float) -> ByteArray:
    """Return the frame [H, W, 3] with its content shifted to the left."""
    return np.asarray(ndimage.shift(frame, (0, -left_px, 0), order=1, mode="nearest"))


def draw(path: Path, means: Mapping[str, FloatArray], metric: str, setup: Setup) -> None:
    """Draw the means [latency] of a metric for each method."""
    page = Page("latency")
    (axes,) = page.add_axes(9.5, 3.6)
    latencies_s = np.array(setup.latencies) / 10
    lines = {
        method: axes.plot(latencies_s, row, marker="o", markersize=3)[0]
        for method, row in means.items()
    }
    axes.set(xlabel="latency (s)", ylabel=metric.upper())
    page.add_legend(lines)
    page.write(path)

"""Processing time of one clip by stage (odometry, forecast, refinements, depth, fusion, views), and
peak memory.

`PYTHONPATH=benchmarks python -m performance.clip [ROUNDS] [--full] [--kitti ROOT SEQUENCE]`

10 frames are observed and 20 predicted, at 256x256, on a clip of the synthetic street or of KITTI,
from the crop or from uncropped frames. The first round, which compiles or loads compiled code, is
not counted. CPU time is shown beside wall-clock time, which depends on the load of the machine.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from geovp_benchmarks.running.profiling import peak_mb
from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.observation import Observer
from geovp_classic.observation import recent as recent_frames
from geovp_classic.pose_refinement.registration import Registration
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import Context, FloatArray, Motion, Views
from performance import Seconds, rounds_parser, timed

NUM_PAST = 10
STAGES = ("observation", "odometry", "forecast", "refinements", "depth", "fusion", "views")


def lines(
    # [1 + rounds, stages, 2], wall clock and CPU; the first round is a warm-up
    taken_s: FloatArray,
) -> list[str]:
    """Medians over rounds, as lines of text."""
    rounds_s = taken_s[1:]
    medians = [*np.median(rounds_s, axis=0), np.median(rounds_s.sum(axis=1), axis=0)]
    rows = zip((*STAGES, "all"), medians, strict=True)
    return [
        f"{len(rounds_s)} rounds, medians by the clock and of the processor",
        *(
            f"{name:<24}{1e3 * clock:6.0f} ms{1e3 * processor:7.0f} ms"
            for name, (clock, processor) in rows
        ),
        "first round {:.1f} s, of the processor {:.1f} s; ".format(*taken_s[0].sum(axis=0))
        + f"peak memory of the process {peak_mb():.0f} MB",
    ]


def parts(frames: Literal["crop", "full"]) -> tuple[Refined, DepthFusion]:
    """Refined `chained` and `depth-fusion` at their defaults, but for the frames."""
    return Refined(Chained(), (Registration(frames),)), DepthFusion(frames=frames)


def one_clip(
    context: Context, frames: Literal["crop", "full"] = "crop"
) -> tuple[Views, list[Seconds]]:
    """Predict with `parts`; the views and the times of STAGES."""
    (refined, renderer), source = parts(frames), Chained()
    observed, observation = timed(lambda: Observer().observe(context))
    (past, tracked), odometry = timed(
        lambda: source.odometry.track(observed.only(source.odometry.needs))
    )
    futures, forecast = timed(lambda: source.forecaster.forecast(past, context.times_s[NUM_PAST:]))
    given_motion: Any = SimpleNamespace(
        needs=source.needs, estimate=lambda *_: Motion(past, futures, tracked)
    )
    motion, refinement = timed(
        lambda: replace(refined, source=given_motion).estimate(observed.context)
    )
    needs = renderer.depth.needs
    recent, past = recent_frames(observed.context, motion.past, frames, renderer.num_frames)
    estimate, depth = timed(lambda: renderer.depth.inverse_depths(recent.only(needs), past))
    given: Any = SimpleNamespace(needs=needs, inverse_depths=lambda *_: estimate)
    scene, fusion = timed(
        lambda: replace(renderer, depth=given).reconstruct(
            observed.only(renderer.needs), motion.past
        )
    )
    views, view = timed(
        lambda: scene.view(motion.futures[0], context.times_s[NUM_PAST:], context.intrinsics)
    )
    return views, [observation, odometry, forecast, refinement, depth, fusion, view]


def add_kitti(parser: argparse.ArgumentParser) -> None:
    """Add the option that replaces the synthetic street by a KITTI sequence."""
    parser.add_argument(
        "--kitti",
        nargs=2,
        metavar=("ROOT", "SEQUENCE"),
        help="Clip of KITTI odometry, such as ROOT '03[0:180)'. Default: the synthetic street.",
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the timing."""
    parser = rounds_parser("performance.clip", "Processing time of one clip, stage by stage.", 10)
    parser.add_argument("--full", action="store_true", help="Predict from uncropped frames.")
    add_kitti(parser)
    args = parser.parse_args(arguments)
    frames: Literal["crop", "full"] = "full" if args.full else "crop"
    spec: dict[str, Any] = {"name": "synthetic", "num_frames": 30, "with_full": args.full}
    if args.kitti:
        spec |= {"name": "kitti", "root": args.kitti[0], "sequences": [args.kitti[1]]}
    try:
        refined, renderer = parts(frames)
        context, _ = registry.build("datasets", spec)[0].split(
            NUM_PAST, refined.needs | renderer.needs
        )
    except GeovpError as error:
        parser.error(str(error))
    taken_s = np.array([one_clip(context, frames)[1] for _ in range(args.rounds + 1)])
    print(*lines(taken_s), sep="\n")


if __name__ == "__main__":
    main()

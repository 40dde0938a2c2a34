"""What every part is worth: each one taken out, on clips that constants may be chosen on.

A line a part: what the whole has more than the whole without it (PSNR and SSIM up, LPIPS down is
better), as the mean of paired differences over clips with its 95 % interval from a block bootstrap
over clips, the time it takes, and its lines of code. Parts of the renderer and of the refinements
are measured with true poses, parts of the odometry without any. A part earns its lines where an
interval excludes zero and the gain is .05 dB or .002 LPIPS.
"""

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.arguments import positive
from geovp_benchmarks.evaluation.budget.scores import SCORED_STEPS
from geovp_benchmarks.progress import Progress
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.interfaces import PoseSource, Renderer
from geovp_classic.types import ByteArray, Context, FloatArray

NUM_PAST, NUM_FUTURE = 10, 20
METRICS = ("psnr", "ssim", "lpips")
STRETCHES = ("03[0:180)", "raw0095", "00[0:569)", "00[600:725)")  # train and val
SMALL, SMALL_PX, SIZE_PX = "00", 128, 256  # a sequence whose frames are no higher

Spec = Mapping[str, Any]
TRUE: Spec = {"name": "ground-truth"}
FUSION: Spec = {"name": "depth-fusion"}


def refined(source: Spec) -> Spec:
    """Return the source with the default refinements."""
    return {"name": "refined", "source": source}


@dataclass(frozen=True)
class Variant:
    """The whole without one part."""

    part: str
    pose_source: Spec
    renderer: Spec
    whole: str  # the variant that it is compared with


def variants() -> list[Variant]:
    """The whole, and the whole without each part."""
    chained: Spec = {"name": "chained"}
    whole_source, with_odometry, found = refined(TRUE), "all, odometry", []

    def add(part: str, source: Spec = whole_source, whole: str = "all", **renderer: Any) -> None:
        found.append(Variant(part, source, {**FUSION, **renderer}, whole))

    def add_tracked(part: str, **settings: Any) -> None:
        add(part, source=refined({**chained, **settings}), whole=with_odometry)

    add("all")
    add("refinements", source=TRUE)
    add("ground prior", depth={"name": "multiview", "ground": "none"})
    add("crack closing", crack_px=0)
    add("detail transfer", detail="none")
    add("borrowed detail", inpainter={"name": "nearest-background"})
    add("exposure", exposure="none")
    add_tracked(with_odometry)
    add("refinements, odometry", source=chained, whole=with_odometry)
    add_tracked("motion prior (damped CTRA)", forecaster={"name": "acceleration-kalman"})
    add_tracked(
        "bundle adjustment",
        odometry={"name": "monocular", "tracking": {"keyframes": {"max_bundle_points": 0}}},
    )
    unit_speed = {"name": "monocular", "scale": {"name": "unit-speed"}}
    add_tracked(
        "road scale (unit speed)",
        odometry=unit_speed,
    )
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the data is, and what of it."""
    parser.add_argument(
        "root", type=Path, metavar="ROOT", help="a folder laid out as KITTI odometry"
    )
    help_text = f"sequences or stretches of them ({' '.join(STRETCHES)})"
    parser.add_argument("frames", nargs="*", default=STRETCHES, metavar="FRAMES", help=help_text)
    parser.add_argument(
        "--stride",
        type=positive,
        default=10,
        metavar="N",
        help="frames between two clips' starts (10)",
    )
    parser.add_argument(
        "--only", nargs="+", metavar="PART", help="only these parts, by the words of the table"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table."""
    wanted = [one for one in variants() if not chosen.only or one.part in chosen.only]
    if not wanted:
        raise BadData(
            f"no part is called {chosen.only[0]!r}: known are "
            f"{', '.join(one.part for one in variants())}"
        )
    wholes = [
        one
        for one in variants()
        if any(one.part == other.whole for other in wanted) and one not in wanted
    ]
    data = [
        registry.build("datasets", spec)
        for spec in dataset_specs(chosen.root, chosen.frames, chosen.stride)
    ]
    results = measure(wholes + wanted, data, progress)
    yield f"{len(next(iter(results.values())).scores)} clips of {', '.join(chosen.frames)}"
    yield f"{'without':<32}{'PSNR (dB)':>26}{'SSIM':>27}{'LPIPS':>27}{'ms':>7}"
    for one in wanted:
        yield line(one, results[one.part], results[one.whole])


def dataset_specs(root: Path, frames: Sequence[str], stride: int = 10) -> list[dict[str, Any]]:
    """One data set a stretch, so that blocks of clips don't reach from one into another."""
    shared = {"name": "kitti", "root": root, "num_frames": NUM_PAST + NUM_FUTURE, "stride": stride}
    sides_px = [SMALL_PX if stretch.startswith(SMALL) else SIZE_PX for stretch in frames]
    pairs = zip(frames, sides_px, strict=True)
    return [
        {**shared, "sequences": [stretch], "size_px": [side_px, side_px]}
        for stretch, side_px in pairs
    ]


@dataclass
class Results:
    """What a variant scored."""

    scores: list[FloatArray] = field(default_factory=list)  # [metrics] a clip
    stretches: list[int] = field(default_factory=list)  # a clip
    seconds: list[float] = field(default_factory=list)  # a clip, without scoring


def measure(
    wanted: Sequence[Variant], data: Sequence[Any], progress: Progress
) -> dict[str, Results]:
    """Every variant on every clip."""
    metrics = [registry.build("frame_metrics", name) for name in METRICS]
    parts = {
        one.part: (("pose_sources", one.pose_source), ("renderers", one.renderer)) for one in wanted
    }
    built = {
        part: [registry.build(role, spec) for role, spec in pair] for part, pair in parts.items()
    }
    results = {one.part: Results() for one in wanted}
    done, total = 0, len(wanted) * sum(map(len, data))
    for stretch, dataset in enumerate(data):
        for clip in (dataset[number] for number in range(len(dataset))):
            for part, (source, renderer) in built.items():
                start_s = time.perf_counter()
                context, target = clip.split(NUM_PAST, source.needs | renderer.needs)
                frames, actual = (
                    predict(context, source, renderer),
                    target.frames[np.array(SCORED_STEPS)],
                )
                results[part].seconds.append(time.perf_counter() - start_s)
                results[part].scores.append(
                    np.array([metric(frames, actual, None).mean() for metric in metrics])
                )
                results[part].stretches.append(stretch)
                done += 1
                progress(done, total)
    return results


def predict(context: Context, source: PoseSource, renderer: Renderer) -> ByteArray:
    """The predicted frames [N, H, W, 3] at the scored horizons."""
    from geovp_classic.predictors.geometric import GeometricPredictor

    predictor, steps = GeometricPredictor(source, renderer), np.array(SCORED_STEPS)
    observed = predictor.observe(context)
    motion = predictor.estimate(observed)
    scene = predictor.reconstruct(observed, motion.past)
    return scene.view(
        motion.futures[0, steps], context.times_s[NUM_PAST + steps], context.intrinsics
    ).frames


def line(variant: Variant, without: Results, whole: Results) -> str:
    """Return the part's gain in each metric with its interval, and its time."""
    from geovp_benchmarks.analysis.intervals import block_interval

    gains = np.array(whole.scores) - np.array(without.scores)
    methods = [f"{variant.part:<32}"]
    for number, digits in enumerate((3, 4, 4)):
        low, high = block_interval(gains[:, number], np.array(whole.stretches))
        methods.append(
            f"{gains[:, number].mean():+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]".rjust(
                27
            )
        )
    extra_ms = 1000 * float(np.median(np.array(whole.seconds) - np.array(without.seconds)))
    return "".join([*methods, f"{extra_ms:7.0f}"])

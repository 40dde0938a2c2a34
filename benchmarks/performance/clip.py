"""Processing time of one clip by stage, and peak memory.

10 frames are observed and 20 predicted, at 256x256, on a clip of the synthetic street or of KITTI,
from the crop or from uncropped frames.
"""

import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from geovp_benchmarks.running.profiling import peak_mb
from geovp_classic.pose_refinement.registration import Registration
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import Context, Prediction
from performance import read_clip

Frames = Literal["crop", "full"]


def predictor(frames: Frames) -> GeometricPredictor:
    """Return refined `chained` and `depth-fusion` at their defaults, but for the frames."""
    source = Refined(Chained(), (Registration(frames),))
    return GeometricPredictor(source, DepthFusion(frames=frames))


def stages(method: GeometricPredictor, context: Context) -> tuple[Prediction, dict[str, float]]:
    """Predict as the predictor does; return the seconds of each step as well."""
    seconds: dict[str, float] = {}

    def timed(name: str, step: Callable[..., Any], *inputs: Any) -> Any:
        start_s = time.process_time()
        result = step(*inputs)
        seconds[name] = time.process_time() - start_s
        return result

    observed = timed("observe", method.observe, context)
    motion = timed("estimate", method.estimate, observed)
    scene = timed("reconstruct", method.reconstruct, observed, motion.past)
    return timed("show", show, scene, motion, context), seconds


def lines(rounds: int, kitti: tuple[str, str] | None, frames: Frames) -> list[str]:
    """Return the medians of all stages and of their sum."""
    method = predictor(frames)
    clip = read_clip(kitti, num_frames=30, with_full=frames == "full")
    context, _ = clip.split(10, method.needs)
    warm_up, *seconds = [stages(method, context)[1] for _ in range(rounds + 1)]
    medians = {name: np.median([each[name] for each in seconds]) for name in warm_up}
    medians["all"] = np.median([sum(each.values()) for each in seconds])
    return [
        *(f"{name:<12}{1e3 * median:6.0f} ms" for name, median in medians.items()),
        f"first round {sum(warm_up.values()):.1f} s; peak memory {peak_mb():.0f} MB",
    ]

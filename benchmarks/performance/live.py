"""Processing time of a live prediction by stage, and its rate.

Frames of one sequence are pushed as they would arrive, and a view half a second ahead is requested
after each; tracking and reconstruction dominate.
"""

import time
from typing import Any

import numpy as np

from geovp_benchmarks.running.profiling import peak_mb
from geovp_classic import registry
from geovp_classic.streaming import LivePredictor


def lines(num_frames: int, kitti: tuple[str, str] | None, num_warm_up: int = 20) -> list[str]:
    """Return the medians of all stages in wall clock, after the warm-up."""
    spec: dict[str, Any] = {"name": "synthetic"}
    if kitti is not None:
        spec = {"name": "kitti", "root": kitti[0], "sequences": [kitti[1]]}
    clip = registry.build("datasets", {**spec, "num_frames": num_warm_up + num_frames})[0]
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    seconds: list[dict[str, float]] = []
    for frame, time_s in zip(clip.frames, clip.times_s, strict=True):
        start_s = time.perf_counter()
        report = live.push(frame, time_s)
        pushed_s = time.perf_counter()
        live.view(time_s + 0.5)
        ended_s = time.perf_counter()
        rest = {"view": ended_s - pushed_s, "all": ended_s - start_s}
        seconds.append({**report.seconds, **rest})
    medians = {
        name: np.median([each[name] for each in seconds[num_warm_up:] if name in each])
        for name in seconds[-1]
    }
    return [
        *(f"{name:<12}{1e3 * median:6.1f} ms" for name, median in medians.items()),
        f"{1 / medians['all']:.1f} frames per second; peak memory {peak_mb():.0f} MB",
    ]

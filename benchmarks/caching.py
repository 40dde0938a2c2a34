"""Results that several cells need, computed once per clip."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from geovp_benchmarks.profiling import StageProfiler
from geovp_classic.types import Trajectory


@dataclass(frozen=True)
class Cache:
    """Results for one clip that cells share: a motion per pose source, a scene per renderer and past."""

    calls: dict[Hashable, tuple[Future[Any], StageProfiler]] = field(default_factory=dict)  # done, and what they cost

    def get_or_compute(self, key: Hashable, compute: Callable[[], Any], profiler: StageProfiler, stage: str) -> Any:
        """The value, computed once per key, or the error it raised; every cell is charged its full cost."""
        if key not in self.calls:
            call, own = self.calls[key] = Future(), StageProfiler()
            with own.measure(stage):
                try:
                    call.set_result(compute())
                except Exception as error:  # raised for every cell that asks
                    call.set_exception(error)
        call, own = self.calls[key]
        profiler.add(stage, own.seconds[stage], own.peaks_mb[stage])
        return call.result()


def scene_key(renderer: str, past: Trajectory) -> Hashable:
    """Equal for equal pasts, also of different pose sources."""
    poses_and_times = past.world_from_cam.tobytes() + past.times_s.tobytes()
    return "scene", renderer, hashlib.sha256(poses_and_times).digest(), past.is_metric

"""What cells share is computed once: a motion per pose source and clip, a scene per renderer and past.

A cached result keeps its seconds and its peak of memory: every cell is charged what it would have cost alone. Errors
are cached as well.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

from benchmarks.profiling import StageProfiler
from geovp_classic.types import Trajectory


@dataclass(frozen=True)
class CachedCall:
    """What a call returned or raised, and what it took."""

    value: Any
    error: Exception | None
    profiler: StageProfiler


@dataclass(frozen=True)
class Cache:
    """The calls made for one clip, shared by all cells."""

    calls: dict[Hashable, CachedCall] = field(default_factory=dict)

    def get_or_compute(self, key: Hashable, compute: Callable[[], Any], profiler: StageProfiler, stage: str) -> Any:
        """The value, computed once per key and charged to the stage every time; its error is raised every time."""
        if key not in self.calls:
            self.calls[key] = _call(compute, stage)
        call = self.calls[key]
        profiler.add(stage, call.profiler.seconds[stage], call.profiler.peaks_mb[stage])
        if call.error is not None:
            raise call.error
        return call.value


def scene_key(renderer: str, past: Trajectory) -> Hashable:
    """The same for equal pasts, whichever pose source they came from."""
    poses_and_times = past.world_from_cam.tobytes() + past.times_s.tobytes()
    return "scene", renderer, hashlib.sha256(poses_and_times).digest(), past.is_metric


def _call(compute: Callable[[], Any], stage: str) -> CachedCall:
    profiler, value, raised = StageProfiler(), None, None
    with profiler.measure(stage):
        try:
            value = compute()
        except Exception as error:  # raised for every cell that asks
            raised = error
    return CachedCall(value, raised, profiler)

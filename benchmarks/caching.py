"""Results that several cells need, computed once per clip."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

from benchmarks.profiling import StageProfiler
from geovp_classic.types import Trajectory


@dataclass(frozen=True)
class CachedCall:
    """The value or error of a call, with its seconds and peak memory."""

    value: Any
    error: Exception | None
    profiler: StageProfiler


@dataclass(frozen=True)
class Cache:
    """Results for one clip that cells share: a motion per pose source, a scene per renderer and past."""

    calls: dict[Hashable, CachedCall] = field(default_factory=dict)

    def get_or_compute(self, key: Hashable, compute: Callable[[], Any], profiler: StageProfiler, stage: str) -> Any:
        """The value, computed once per key, or the error it raised; every cell is charged its full cost."""
        if key not in self.calls:
            own, value, raised = StageProfiler(), None, None
            with own.measure(stage):
                try:
                    value = compute()
                except Exception as error:  # raised for every cell that asks
                    raised = error
            self.calls[key] = CachedCall(value, raised, own)
        call = self.calls[key]
        profiler.add(stage, call.profiler.seconds[stage], call.profiler.peaks_mb[stage])
        if call.error is not None:
            raise call.error
        return call.value


def scene_key(renderer: str, past: Trajectory) -> Hashable:
    """Equal for equal pasts, also of different pose sources."""
    poses_and_times = past.world_from_cam.tobytes() + past.times_s.tobytes()
    return "scene", renderer, hashlib.sha256(poses_and_times).digest(), past.is_metric

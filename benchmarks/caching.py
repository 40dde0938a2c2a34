"""A motion is estimated once per pose source and clip, a scene built once per renderer and past, for all cells.

The cached components fulfil the same Protocols as those that they wrap. A cached result keeps its seconds and its peak
of memory: every cell is charged what it would have cost alone. Errors are cached as well.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

from benchmarks.profiling import StageProfiler
from geovp_classic.interfaces import PoseSource, Renderer, Scene
from geovp_classic.types import Context, FloatArray, Grant, Intrinsics, Motion, Trajectory, Views


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
        profiler.add(stage, call.profiler.seconds[stage], call.profiler.peaks[stage])
        if call.error is not None:
            raise call.error
        return call.value


@dataclass(frozen=True)
class CachedPoseSource:
    """A pose source whose motion for this clip is estimated once."""

    name: str
    source: PoseSource
    cache: Cache
    profiler: StageProfiler

    @property
    def needs(self) -> Grant:
        """What the wrapped one needs."""
        return self.source.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The motion of the wrapped one."""
        key = ("motion", self.name, num_samples)
        motion: Motion = self.cache.get_or_compute(
            key, lambda: self.source.estimate(context, num_samples), self.profiler, "motion"
        )
        return motion


@dataclass(frozen=True)
class CachedRenderer:
    """A renderer whose scene for this clip is built once per distinct past, whichever source that came from."""

    name: str
    renderer: Renderer
    cache: Cache
    profiler: StageProfiler

    @property
    def needs(self) -> Grant:
        """What the wrapped one needs."""
        return self.renderer.needs

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The scene of the wrapped one."""
        poses_and_times = past.world_from_cam.tobytes() + past.times_s.tobytes()
        key = ("scene", self.name, hashlib.sha256(poses_and_times).digest(), past.is_metric)
        scene: Scene = self.cache.get_or_compute(
            key, lambda: self.renderer.reconstruct(context, past), self.profiler, "reconstruct"
        )
        return ProfiledScene(scene, self.profiler)


@dataclass(frozen=True)
class ProfiledScene:
    """A scene whose views are charged."""

    scene: Scene
    profiler: StageProfiler

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The views of the wrapped one."""
        with self.profiler.measure("view"):
            return self.scene.view(world_from_cam, times_s, intrinsics)


def _call(compute: Callable[[], Any], stage: str) -> CachedCall:
    profiler, value, raised = StageProfiler(), None, None
    with profiler.measure(stage):
        try:
            value = compute()
        except Exception as error:  # raised for every cell that asks
            raised = error
    return CachedCall(value, raised, profiler)

"""Parts of a predictor that remember: a motion is estimated once per pose source, a scene built once per past.

They fulfil the same Protocols as the parts that they wrap, so that a predictor made of them is like any other. What is
remembered keeps its seconds and its peak of memory: every cell is charged what it would have cost alone. Failures are
remembered as well.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from benchmarks import peaks
from benchmarks.peaks import Peak
from geovp_classic.interfaces import PoseSource, Renderer, Scene
from geovp_classic.types import Context, FloatArray, Grant, Intrinsics, Motion, Trajectory, Views


@dataclass(frozen=True)
class Stopwatch:
    """Seconds and peak of memory per stage of one cell; stages follow one another, none lies within another."""

    seconds: dict[str, float] = field(default_factory=dict)
    peaks: dict[str, Peak] = field(default_factory=dict)

    def add(self, stage: str, seconds: float, peak: Peak) -> None:
        """Charge a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self.peaks[stage] = Peak.highest([self.peaks.get(stage, peak), peak])

    def peak_without(self, stage: str) -> Peak:
        """The highest of all other stages."""
        return Peak.highest(peak for other, peak in self.peaks.items() if other != stage)

    @contextmanager
    def time(self, stage: str) -> Iterator[None]:
        """Charge a stage with what happens inside."""
        begun, start = peaks.begin(), time.perf_counter()
        try:
            yield
        finally:
            self.add(stage, time.perf_counter() - start, peaks.reached(begun))


@dataclass(frozen=True)
class Outcome:
    """What a call gave or raised, and what it took."""

    value: Any
    error: Exception | None
    seconds: float
    peak: Peak


@dataclass(frozen=True)
class Memory:
    """The outcomes of calls for one clip, shared by all cells."""

    outcomes: dict[Hashable, Outcome] = field(default_factory=dict)

    def recall(self, key: Hashable, make: Callable[[], Any], watch: Stopwatch, stage: str) -> Any:
        """What `make` gives, called once per key; its error is raised every time."""
        if key not in self.outcomes:
            self.outcomes[key] = _outcome(make)
        outcome = self.outcomes[key]
        watch.add(stage, outcome.seconds, outcome.peak)
        if outcome.error is not None:
            raise outcome.error
        return outcome.value


@dataclass(frozen=True)
class RememberingPoseSource:
    """A pose source whose motion for this clip is estimated once."""

    name: str
    source: PoseSource
    memory: Memory
    watch: Stopwatch

    @property
    def needs(self) -> Grant:
        """What the wrapped one needs."""
        return self.source.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The motion of the wrapped one."""
        key = ("motion", self.name, num_samples)
        motion: Motion = self.memory.recall(
            key, lambda: self.source.estimate(context, num_samples), self.watch, "motion"
        )
        return motion


@dataclass(frozen=True)
class RememberingRenderer:
    """A renderer whose scene for this clip is built once per distinct past, whoever says where that was."""

    name: str
    renderer: Renderer
    memory: Memory
    watch: Stopwatch

    @property
    def needs(self) -> Grant:
        """What the wrapped one needs."""
        return self.renderer.needs

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The scene of the wrapped one."""
        key = ("scene", self.name, _content(past))
        make: Callable[[], Scene] = lambda: self.renderer.reconstruct(context, past)  # noqa: E731
        return TimedScene(self.memory.recall(key, make, self.watch, "reconstruct"), self.watch)


@dataclass(frozen=True)
class TimedScene:
    """A scene whose viewing is timed."""

    scene: Scene
    watch: Stopwatch

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The views of the wrapped one."""
        with self.watch.time("view"):
            return self.scene.view(world_from_cam, times_s, intrinsics)


def _outcome(make: Callable[[], Any]) -> Outcome:
    begun, start = peaks.begin(), time.perf_counter()
    try:
        return Outcome(make(), None, time.perf_counter() - start, peaks.reached(begun))
    except Exception as error:  # remembered, then raised for every cell that asks
        return Outcome(None, error, time.perf_counter() - start, peaks.reached(begun))


def _content(past: Trajectory) -> tuple[str, bool]:
    poses_and_times = past.world_from_cam.tobytes() + past.times_s.tobytes()
    return hashlib.sha256(poses_and_times).hexdigest(), past.is_metric

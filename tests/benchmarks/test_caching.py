"""What is shared between cells is computed once, charged to each, and never mixed up."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest

from benchmarks.caching import Cache, CachedRenderer
from benchmarks.profiling import StageProfiler
from geovp_classic.errors import Incompatible
from geovp_classic.interfaces import Scene
from geovp_classic.types import Context, Grant, Intrinsics, Trajectory

CONTEXT = Context(np.zeros((2, 4, 4, 3), np.uint8), np.arange(3.0), Intrinsics(4.0, 4.0, 1.5, 1.5, 4, 4))


@dataclass(frozen=True)
class Counting:
    """A renderer that counts."""

    pasts: list[Trajectory] = field(default_factory=list)
    needs: ClassVar[Grant] = Grant.CAMERA_HEIGHT

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        self.pasts.append(past)
        raise Incompatible(f"scene {len(self.pasts)} cannot be built")


def past(step_m: float, is_metric: bool = True) -> Trajectory:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 2, 3] = step_m
    return Trajectory(poses, np.arange(2.0), is_metric)


def test_every_cell_is_charged_what_it_would_have_cost_alone() -> None:
    memory, watches, calls = Cache(), [StageProfiler(), StageProfiler()], []
    values = [memory.get_or_compute("key", lambda: calls.append(0) or 7, watch, "motion") for watch in watches]
    assert (values, len(calls)) == ([7, 7], 1)
    assert watches[0].seconds == watches[1].seconds
    assert watches[0].seconds["motion"] > 0


def test_a_failure_is_remembered_like_a_result() -> None:
    renderer, memory = Counting(), Cache()
    for _ in range(2):
        with pytest.raises(Incompatible, match="scene 1 cannot be built"):
            CachedRenderer("a", renderer, memory, StageProfiler()).reconstruct(CONTEXT, past(1.0))
    assert len(renderer.pasts) == 1


def test_another_past_unit_or_renderer_is_another_scene() -> None:
    renderer, memory = Counting(), Cache()
    for name, trajectory in (("a", past(1.0)), ("a", past(2.0)), ("a", past(1.0, is_metric=False)), ("b", past(1.0))):
        with pytest.raises(Incompatible):
            CachedRenderer(name, renderer, memory, StageProfiler()).reconstruct(CONTEXT, trajectory)
    assert len(renderer.pasts) == 4


def test_a_wrapped_part_asks_for_no_more_than_the_part() -> None:
    assert CachedRenderer("a", Counting(), Cache(), StageProfiler()).needs == Grant.CAMERA_HEIGHT

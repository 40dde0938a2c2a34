"""What is shared between methods is computed once, charged to each, and never mixed up."""

import numpy as np
import pytest

from geovp_benchmarks.running.built_matrix import Cache, scene_key
from geovp_benchmarks.running.profiling import StageProfiler
from geovp_classic.errors import Incompatible
from geovp_classic.types import Trajectory


def past(step_m: float, is_metric: bool = True) -> Trajectory:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 2, 3] = step_m
    return Trajectory(poses, np.arange(2.0), is_metric)


def test_every_method_is_charged_what_it_would_have_cost_alone() -> None:
    cache, profilers, calls = Cache(), [StageProfiler(), StageProfiler()], []
    values = [
        cache.get_or_compute("key", lambda: calls.append(0) or 7, each, "motion")
        for each in profilers
    ]
    assert (values, len(calls)) == ([7, 7], 1)
    assert profilers[0].seconds == profilers[1].seconds
    assert profilers[0].seconds["motion"] > 0


def test_an_error_is_cached_like_a_result() -> None:
    cache, calls = Cache(), []

    def fail() -> None:
        calls.append(0)
        raise Incompatible(f"scene {len(calls)} cannot be built")

    for _ in range(2):
        with pytest.raises(Incompatible, match="scene 1 cannot be built"):
            cache.get_or_compute("key", fail, StageProfiler(), "reconstruct")


def test_another_past_unit_or_renderer_is_another_scene() -> None:
    asked = (
        ("a", past(1.0)),
        ("a", past(2.0)),
        ("a", past(1.0, is_metric=False)),
        ("b", past(1.0)),
        ("a", past(1.0)),
    )
    keys = [scene_key(name, trajectory) for name, trajectory in asked]
    assert len(set(keys)) == 4
    assert keys[-1] == keys[0]

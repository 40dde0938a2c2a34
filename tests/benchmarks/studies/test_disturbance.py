"""What is done to clips, and what is left of a method then."""

import argparse
from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.studies import disturbance
from geovp_benchmarks.studies.disturbance import NUM_PAST, disturbed, gain_db
from geovp_benchmarks.studies.disturbance.kinds import DISTURBANCES
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Grant

EVERYTHING = Grant.PAST_POSES | Grant.FUTURE_POSES


@pytest.fixture(scope="module")
def clip() -> Clip:
    data = registry.build("datasets", {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]})
    found: Clip = data[0]
    return found


@pytest.mark.parametrize("name", DISTURBANCES)
@pytest.mark.parametrize("level", range(4))
def test_every_disturbance_gives_a_clip(clip: Clip, name: str, level: int) -> None:
    context, target = disturbed(clip, DISTURBANCES[name], level, EVERYTHING)
    assert (context.num_past, len(target.frames), target.frames.shape[1:]) == (NUM_PAST, 20, (64, 64, 3))
    changed = (context.frames != clip.frames[:NUM_PAST]).any() or context.intrinsics != clip.intrinsics
    changed |= (context.times_s != clip.times_s).any()
    assert bool(changed) is (name != "none")


def test_what_passes_leaves_the_future_alone_and_what_lasts_does_not(clip: Clip) -> None:
    black, _ = disturbed(clip, DISTURBANCES["black frames"], 0, EVERYTHING)
    assert np.flatnonzero((black.frames == 0).all(axis=(1, 2, 3))).tolist() == [5]
    for name, lasts in (("black frames", False), ("swapped frames", False), ("dim", True), ("hood", True)):
        _, target = disturbed(clip, DISTURBANCES[name], 1, EVERYTHING)
        assert (target.frames == clip.frames[NUM_PAST:]).all() != lasts


def test_a_standing_camera_stands_in_its_poses_too(clip: Clip) -> None:
    context, target = disturbed(clip, DISTURBANCES["standing"], 0, EVERYTHING)
    assert (target.frames == context.frames[-1]).all()
    assert context.future is not None
    assert (context.future.world_from_cam == context.future.world_from_cam[0]).all()
    source = registry.build("pose_sources", {"name": "ground-truth"})
    assert gain_db(clip, "standing", 0, source, registry.build("renderers", "depth-fusion")) == 0


def test_a_black_frame_costs_fusion_little(clip: Clip) -> None:
    parts = registry.build("pose_sources", {"name": "ground-truth"}), registry.build("renderers", "depth-fusion")
    assert gain_db(clip, "black frames", 0, *parts) > gain_db(clip, "none", 0, *parts) - 0.5


def test_a_mistyped_name_is_answered_with_the_nearest() -> None:
    chosen = argparse.Namespace(root=Path("x"), frames=["03"], stride=1, only=["blakc frames"])
    with pytest.raises(BadData, match="did you mean 'black frames'"):
        next(disturbance.run(chosen, lambda *_: None))

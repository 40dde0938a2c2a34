"""Corruptions of clips, and the gains of methods on them."""

from pathlib import Path

import numpy as np
import pytest
from kitti_files import write_kitti

from geovp_classic import registry
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import Clip
from studies.corruption import corrupted, gains_db
from studies.corruption.kinds import CORRUPTIONS
from tests.benchmarks.conftest import Says

METHODS = {
    "true crop": GeometricPredictor(
        registry.build("pose_sources", "ground-truth"), registry.build("renderers", "depth-fusion")
    )
}


@pytest.fixture(scope="module")
def clip() -> Clip:
    data = registry.build(
        "datasets", {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]}
    )
    found: Clip = data[0]
    return found


def test_what_passes_leaves_the_future_alone_and_what_lasts_does_not(clip: Clip) -> None:
    black, _ = corrupted(clip, CORRUPTIONS["black frames"], 0)
    assert np.flatnonzero((black.frames == 0).all(axis=(1, 2, 3))).tolist() == [5]
    for name, lasts in (
        ("black frames", False),
        ("swapped frames", False),
        ("dim", True),
        ("hood", True),
    ):
        _, target = corrupted(clip, CORRUPTIONS[name], 1)
        assert (target.frames == clip.frames[10:]).all() != lasts


def test_a_stationary_camera_has_stationary_poses(clip: Clip) -> None:
    context, target = corrupted(clip, CORRUPTIONS["stationary"], 0)
    assert (target.frames == context.frames[-1]).all()
    assert (context.future.world_from_cam == context.future.world_from_cam[0]).all()
    assert gains_db(clip, CORRUPTIONS["stationary"], 0, METHODS) == [0]


def test_the_command_prints_a_table(tmp_path: Path, printed: Says) -> None:
    spec = {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]}
    write_kitti(tmp_path, "03", registry.build("datasets", spec)[0])
    words = ["study", "corruption", tmp_path, "03", "--only", "stationary"]
    lines = printed(*words).splitlines()
    assert lines[-1].split() == ["|", "stationary", "1", *["|", "0.0"] * 6, "|"]


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_all_severities_of_a_corruption_change_the_clip(clip: Clip, name: str) -> None:
    for severity in range(CORRUPTIONS[name].severities):
        context, target = corrupted(clip, CORRUPTIONS[name], severity)
        assert context.num_past == 10
        assert target.frames.shape == (20, 64, 64, 3)
        changed = (context.frames != clip.frames[:10]).any()
        changed |= context.intrinsics != clip.intrinsics
        changed |= (context.times_s != clip.times_s).any()
        assert bool(changed) is (name != "none")

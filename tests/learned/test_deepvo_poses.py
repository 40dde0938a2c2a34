"""DeepVO as a component: its promises, its world, and the weights that come with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import street
import torch

from geovp_benchmarks.checks.contracts import check
from geovp_classic import registry
from geovp_classic.types import PrivilegedInput
from geovp_learned import checkpoints
from geovp_learned.deepvo.network import Architecture, PoseNetwork
from geovp_learned.deepvo.poses import DeepVo, DeepVoOdometry
from geovp_learned.deepvo.train import DeepVoTraining

TINY = Architecture(size_px=(64, 64), encoder_width=1 / 16, lstm_size=12)


def written(folder: Path, architecture: Architecture = TINY) -> Path:
    torch.manual_seed(0)
    file = folder / "deepvo.safetensors"
    networks = {"poses": PoseNetwork(architecture)}
    checkpoints.write(file, "deepvo", DeepVoTraining(architecture), networks, {})
    return file


def test_with_a_head_in_3d_it_keeps_every_promise_as_the_shipped_one_does_in_2d(
    tmp_path: Path,
) -> None:
    file = written(tmp_path, replace(TINY, head="3d"))
    for role in ("pose_sources", "odometries"):
        component = registry.build(role, {"name": "deepvo", "weights": str(file)})
        broken = [finding for finding in check(role, component) if not finding.passed]
        assert not broken, broken


def test_the_odometry_is_the_past_of_the_pose_source(tmp_path: Path) -> None:
    file = written(tmp_path)
    context, _ = street.clip().split(6, PrivilegedInput.NONE)
    past, tracked = DeepVoOdometry(file).track(context)
    np.testing.assert_array_equal(
        past.world_from_cam, DeepVo(file).estimate(context).past.world_from_cam
    )
    assert tracked.all()

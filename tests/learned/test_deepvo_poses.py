"""DeepVO as a component: its promises, its world, and the weights that come with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import street
import torch

from geovp_benchmarks.checks.contracts import check
from geovp_classic import registry
from geovp_classic.types import Context, PrivilegedInput
from geovp_learned import checkpoints
from geovp_learned.deepvo.network import Architecture, PoseNetwork
from geovp_learned.deepvo.poses import DeepVo, DeepVoOdometry
from geovp_learned.deepvo.train import DeepVoTraining
from geovp_learned.tensors import images_from_frames, seen_by

TINY = Architecture(size_px=(64, 64), encoder_width=1 / 16, lstm_size=12)


def written(folder: Path, architecture: Architecture = TINY) -> Path:
    torch.manual_seed(0)
    file = folder / "deepvo.safetensors"
    networks = {"poses": PoseNetwork(architecture)}
    checkpoints.write(file, "deepvo", DeepVoTraining(architecture), networks, {})
    return file


def context(num_past: int = 6) -> Context:
    return street.clip().split(num_past, PrivilegedInput.NONE)[0]


def test_with_a_head_in_3d_it_keeps_every_promise_as_the_shipped_one_does_in_2d(
    tmp_path: Path,
) -> None:
    file = written(tmp_path, replace(TINY, head="3d"))
    for role in ("pose_sources", "odometries"):
        component = registry.build(role, {"name": "deepvo", "weights": str(file)})
        broken = [finding for finding in check(role, component) if not finding.passed]
        assert not broken, broken


def test_a_flat_network_stays_in_the_first_cameras_plane(tmp_path: Path) -> None:
    motion = DeepVo(written(tmp_path)).estimate(context())
    for poses in (motion.past.world_from_cam, motion.futures[0]):
        np.testing.assert_array_equal(poses[:, 1, 3], 0.0)
        np.testing.assert_array_equal(poses[:, 1, :3], np.tile([0.0, 1.0, 0.0], (len(poses), 1)))


def test_the_odometry_is_the_past_of_the_pose_source(tmp_path: Path) -> None:
    file = written(tmp_path)
    past, tracked = DeepVoOdometry(file).track(context())
    np.testing.assert_array_equal(
        past.world_from_cam, DeepVo(file).estimate(context()).past.world_from_cam
    )
    assert tracked.all()


def test_another_camera_of_the_same_street_looks_alike() -> None:
    """Brought to the network's camera, half the resolution says the same."""
    whole = context()
    camera = whole.intrinsics.resized(64, 64)
    small = replace(
        whole,
        frames=whole.frames.reshape(6, 64, 2, 64, 2, 3).mean((2, 4)).astype(np.uint8),
        intrinsics=camera,
    )
    narrow = replace(TINY, focal_widths=2.0)

    def seen(context: Context, architecture: Architecture) -> torch.Tensor:
        wanted = architecture.camera
        frames = [seen_by(frame, context.intrinsics, wanted) for frame in context.frames]
        return images_from_frames(np.stack(frames))

    difference = (seen(whole, narrow) - seen(small, narrow)).abs()
    assert float(difference.mean()) < 0.04
    assert (
        float(difference.mean())
        < float((seen(whole, narrow)[1:] - seen(whole, narrow)[:-1]).abs().mean()) / 2
    )

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from geovp_classic.types import Clip
from geovp_learned.methods import Batch
from geovp_learned.stored_clips import Window
from geovp_learned.synsin import pairs
from geovp_learned.synsin.train import SynSinTraining
from geovp_learned.tensors import frames_from_images, grey, images_from_frames


def scene(clip: Clip, **changes: Any) -> Batch:
    return pairs.frame_pairs(Window(pairs.prepare(clip), 3), [1, 4], **changes)


def test_a_scene_holds_later_frames_and_the_motion_to_them(clip: Clip) -> None:
    drawn = scene(clip)
    assert torch.equal(drawn["frames"], images_from_frames(clip.frames[3]))
    assert torch.equal(drawn["targets"], images_from_frames(clip.frames[[4, 7]]))
    poses = clip.trajectory.world_from_cam
    np.testing.assert_allclose(poses[7] @ drawn["cam_from_last"][1].numpy(), poses[3], atol=1e-5)
    # four steps of half a metre come nearer
    assert float(drawn["cam_from_last"][1, 2, 3]) == pytest.approx(-2.0, abs=0.05)


def projected(drawn: Batch, number: int, point: torch.Tensor) -> torch.Tensor:
    """The pixel of a point of the last camera's frame in one of the later views."""
    motion = drawn["cam_from_last"][number]
    seen = motion[:3, :3] @ point + motion[:3, 3]
    focal_px, centre_px = drawn["intrinsics"].chunk(2)
    return focal_px * seen[:2] / seen[2] + centre_px


def test_a_mirrored_scene_shows_mirrored_points_in_mirrored_pixels(clip: Clip) -> None:
    """The principal point is two pixels beside the middle of the image."""
    clip = replace(clip, intrinsics=replace(clip.intrinsics, cx_px=17.5))
    plain, mirrored = scene(clip), scene(clip, mirrored=True)
    point = torch.tensor([1.2, -0.4, 9.0])
    for number in range(2):
        u, v = projected(plain, number, point)
        other = projected(mirrored, number, point * torch.tensor([-1, 1, 1]))
        torch.testing.assert_close(other, torch.stack([31 - u, v]))
    for name in ("frames", "targets"):
        assert torch.equal(mirrored[name], plain[name].flip(-1))


def luma(drawn: Batch) -> torch.Tensor:
    """Grey frames, so that colour does not matter."""
    return torch.from_numpy(grey(frames_from_images(drawn["frames"])))


def test_examples_are_mirrored_and_grey_as_often_as_given(
    method: SynSinTraining, clip: Clip
) -> None:
    method = replace(method, mirror_probability=0.75, grey_probability=0.25)
    example = Window(pairs.prepare(clip), 3)
    drawn = [method.example(example, np.random.default_rng(seed)) for seed in range(200)]
    left, right = (luma(scene(clip, mirrored=flag)) for flag in (False, True))
    mirrored = sum(torch.equal(luma(each), right) for each in drawn)
    assert not torch.equal(left, right)
    grey = sum(bool((each["frames"] == each["frames"][:1]).all()) for each in drawn)
    assert 130 <= mirrored <= 170
    assert 30 <= grey <= 70

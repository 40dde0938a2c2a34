import os

import numpy as np
import pytest
import torch

from geovp_classic.types import Clip
from geovp_learned.lpips import WEIGHTS_VARIABLE, Lpips, Net
from geovp_learned.synsin import losses, pairs
from geovp_learned.synsin.pairs import Example
from geovp_learned.tensors import images_from_frames, sample_images


def seen_from(clip: Clip, horizons: list[int]) -> list[torch.Tensor]:
    """What the reprojection loss takes, of the third frame and later ones, with its true inverse
    depths.
    """
    batch = pairs.batch([pairs.frame_pairs(Example(clip, 2), horizons)])
    names = ("inverse_depths", "frames", "targets", "cam_from_last", "intrinsics")
    return [torch.nan_to_num(batch[name]) for name in names]


def test_depth_counts_where_it_is_known_in_units_of_a_twentieth() -> None:
    known = torch.tensor([[[0.1, torch.nan], [0.0, torch.nan]]])
    guess = torch.tensor([[[0.2, 9.0], [0.05, 9.0]]], requires_grad=True)
    loss = losses.depth_loss(guess, known)  # 20 * (0.1 + 0.05) / 2
    assert float(loss.detach()) == pytest.approx(1.5)
    loss.backward()
    np.testing.assert_allclose(guess.grad[0].numpy(), [[10, 0], [10, 0]])
    assert float(losses.depth_loss(guess, torch.full_like(known, torch.nan)).detach()) == 0


@pytest.mark.parametrize("net", ["alex", "squeeze"])
def test_content_is_lpips_with_a_gradient(net: Net) -> None:
    if not os.environ.get(WEIGHTS_VARIABLE):
        pytest.skip(f"{WEIGHTS_VARIABLE} is not set: needs LPIPS's weights")
    rng = np.random.default_rng(0)
    made, real = rng.integers(0, 256, (2, 2, 64, 64, 3), dtype=np.uint8)
    frames = images_from_frames(made).requires_grad_()
    loss = losses.content_loss(frames, images_from_frames(real), net)
    assert float(loss.detach()) == pytest.approx(float(Lpips(net)(made, real).mean()), abs=1e-5)
    loss.backward()
    assert frames.grad.abs().max() > 0


def test_later_frames_read_at_the_true_depth_look_like_the_first(clip: Clip) -> None:
    truth, *motion = seen_from(clip, [1, 2])
    at_truth, *wrong = (
        float(losses.reprojection_loss(factor * truth, *motion)) for factor in (1.0, 0.6, 1.5)
    )
    assert at_truth < 0.7 * min(wrong)


def test_its_gradient_leads_from_a_plane_to_the_true_depth(clip: Clip) -> None:
    truth, *motion = seen_from(clip, [1, 2])
    guess = torch.full_like(truth, 0.05).requires_grad_()
    (slope,) = torch.autograd.grad(losses.reprojection_loss(guess, *motion), [guess])
    downhill = float(
        torch.nn.functional.cosine_similarity(
            -slope.flatten(), (truth - guess).detach().flatten(), dim=0
        )
    )
    assert downhill > 0.2


def test_an_image_is_sampled_at_its_own_pixels_unchanged_and_its_border_goes_on() -> None:
    frames = torch.rand(1, 3, 4, 5)
    v, u = torch.meshgrid(torch.arange(4.0), torch.arange(5.0), indexing="ij")
    torch.testing.assert_close(sample_images(frames, torch.stack([u, v], dim=2)[None]), frames)
    between = sample_images(frames, torch.tensor([[[[1.5, 2.0], [-0.1, 2.0], [1.0, 3.1]]]]))
    torch.testing.assert_close(between[0, :, 0, 0], (frames[0, :, 2, 1] + frames[0, :, 2, 2]) / 2)
    torch.testing.assert_close(
        between[0, :, 0, 1:], torch.stack([frames[0, :, 2, 0], frames[0, :, 3, 1]], dim=1)
    )


def test_roughness_is_slope_but_where_the_image_has_an_edge() -> None:
    step = torch.cat([torch.full((1, 4, 4), 0.1), torch.full((1, 4, 4), 0.3)], dim=2)  # mean 0.2
    flat, edge = torch.zeros(1, 3, 4, 8), torch.zeros(1, 3, 4, 8)
    edge[..., 4:] = 1
    # one of seven columns of slopes is 0.2 / 0.2 = 1; no slope from row to row
    assert float(losses.smoothness_loss(step, flat)) == pytest.approx(1 / 7)
    assert float(losses.smoothness_loss(step, edge)) == pytest.approx(np.exp(-10) / 7, rel=1e-4)
    assert float(losses.smoothness_loss(torch.full_like(step, 0.1), edge)) == 0

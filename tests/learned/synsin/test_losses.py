from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import default_collate

from geovp_classic.types import Clip
from geovp_learned.lpips import WEIGHTS_VARIABLE, Lpips
from geovp_learned.stored_clips import Window
from geovp_learned.synsin import losses, pairs
from geovp_learned.tensors import images_from_frames


def test_depth_counts_where_it_is_known_in_units_of_a_twentieth() -> None:
    known = torch.tensor([[[0.1, torch.nan], [0.0, torch.nan]]])
    guess = torch.tensor([[[0.2, 9.0], [0.05, 9.0]]], requires_grad=True)
    loss = losses.depth_loss(guess, known)  # 20 * (0.1 + 0.05) / 2
    assert float(loss.detach()) == pytest.approx(1.5)
    loss.backward()
    np.testing.assert_allclose(guess.grad[0].numpy(), [[10, 0], [10, 0]])
    assert float(losses.depth_loss(guess, torch.full_like(known, torch.nan)).detach()) == 0


def test_content_is_lpips_with_a_gradient(
    lpips_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(WEIGHTS_VARIABLE, str(lpips_folder))
    rng = np.random.default_rng(0)
    made, real = rng.integers(0, 256, (2, 2, 64, 64, 3), dtype=np.uint8)
    frames = images_from_frames(made).requires_grad_()
    loss = losses.content_loss(frames, images_from_frames(real), "squeeze")
    assert float(loss.detach()) == pytest.approx(
        float(Lpips("squeeze")(made, real).mean()), abs=1e-5
    )
    loss.backward()
    assert frames.grad.abs().max() > 0


def test_later_frames_fit_at_the_true_depth_and_the_gradient_leads_there(clip: Clip) -> None:
    batch = default_collate([pairs.frame_pairs(Window(pairs.prepare(clip), 2), [1, 2])])
    truth = torch.nan_to_num(batch["inverse_depths"])
    motion = [batch[name] for name in ("frames", "targets", "cam_from_last", "intrinsics")]
    at_truth, *wrong = (
        float(losses.reprojection_loss(factor * truth, *motion)) for factor in (1.0, 0.6, 1.5)
    )
    assert at_truth < 0.7 * min(wrong)
    guess = torch.full_like(truth, 0.05).requires_grad_()
    (slope,) = torch.autograd.grad(losses.reprojection_loss(guess, *motion), [guess])
    downhill = torch.nn.functional.cosine_similarity(
        -slope.flatten(), (truth - guess).detach().flatten(), dim=0
    )
    assert float(downhill) > 0.2


def test_roughness_is_slope_but_where_the_image_has_an_edge() -> None:
    step = torch.cat([torch.full((1, 4, 4), 0.1), torch.full((1, 4, 4), 0.3)], dim=2)  # mean 0.2
    flat, edge = torch.zeros(1, 3, 4, 8), torch.zeros(1, 3, 4, 8)
    edge[..., 4:] = 1
    # one of seven columns of slopes is 0.2 / 0.2 = 1; no slope from row to row
    assert float(losses.smoothness_loss(step, flat)) == pytest.approx(1 / 7)
    assert float(losses.smoothness_loss(step, edge)) == pytest.approx(np.exp(-10) / 7, rel=1e-4)
    assert float(losses.smoothness_loss(torch.full_like(step, 0.1), edge)) == 0

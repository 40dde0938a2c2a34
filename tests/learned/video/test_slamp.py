"""SLAMP's two branches: what the motion branch sees, and where skips come from."""

import pytest
import torch
from torch import Tensor

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.slamp import Architecture, Rollout, SlampNetwork, SlampTraining, warp

ARCHITECTURE = Architecture(AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2, mask_width=4)


def network() -> SlampNetwork:
    torch.manual_seed(0)
    return SlampNetwork(ARCHITECTURE).eval()


def test_what_is_shown_is_made_of_both_branches_by_the_mask() -> None:
    own, frames = network(), torch.rand(4, 3, 8, 8)
    rollout = Rollout(own, frames)
    codes = [torch.randn(4, 8), torch.randn(4, 8)]
    shown = rollout.decode(codes)
    flow_px = own.flow_decoder(codes[1], rollout.skips)
    torch.testing.assert_close(shown.appearance, own.pixel_decoder(codes[0], rollout.skips))
    torch.testing.assert_close(shown.motion, warp(frames, flow_px).clamp(0, 1))
    mask = own.mask_decoder(torch.cat([shown.appearance, shown.motion], dim=1))
    torch.testing.assert_close(shown.images, mask * shown.appearance + (1 - mask) * shown.motion)


def test_the_motion_branch_sees_each_frame_after_the_one_before() -> None:
    own, seen, images = network(), list[Tensor](), torch.rand(1, 3, 3, 8, 8)
    own.motion_encoder.register_forward_hook(lambda module, given, out: seen.append(given[0]))
    with torch.no_grad():
        own(images, 2)
    first, second, third = images.unbind(1)
    pairs = [(first, first), (first, second), (second, third)]  # nothing moved before the first
    torch.testing.assert_close(torch.cat(seen), torch.cat([torch.cat(p, dim=1) for p in pairs]))


def test_skips_are_means_over_all_frames_so_far() -> None:
    own, frames = network(), torch.rand(3, 2, 3, 8, 8)
    with torch.no_grad():
        rollout = Rollout(own, frames[0])
        for frame in frames[1:]:
            rollout.go_on(own.look(frame), rollout.motion)
        expected = torch.stack([own.look(frame).skips[0] for frame in frames]).mean(0)
    torch.testing.assert_close(rollout.skips[0], expected)


@pytest.mark.parametrize(("epoch", "probability"), [(0, 25 / 26), (50, 25 / (25 + 7.389056))])
def test_scheduled_sampling_fades_the_real_frame_out(
    epoch: int, probability: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With k = 25, k / (k + exp(e / k)) is 25 / 26, and after 50 epochs 25 / (25 + exp(2))."""
    method = SlampTraining(num_past=2, architecture=ARCHITECTURE, sampling_constant=25.0)
    asked: list[float] = []
    forward = SlampNetwork.forward

    def noted(own: SlampNetwork, images: Tensor, num_past: int, real: float) -> object:
        asked.append(real)
        return forward(own, images, num_past, real)

    monkeypatch.setattr(SlampNetwork, "forward", noted)
    method.losses(network(), torch.rand(1, 3, 3, 8, 8), epoch * 1000)
    assert asked == [pytest.approx(probability)]

from functools import partial

import pytest
import torch

from geovp_learned.blocks import NoisyNorm, ResidualBlock, UNet


@pytest.mark.parametrize(("resample", "side"), [("keep", 8), ("up", 16), ("down", 4)])
def test_a_residual_block_keeps_doubles_or_halves_the_size(resample: str, side: int) -> None:
    block = ResidualBlock(6, 10, partial(NoisyNorm, noise_size=3), resample)
    assert block(torch.rand(2, 6, 8, 8), torch.randn(2, 3)).shape == (2, 10, side, side)


def test_noise_scales_and_shifts_what_is_normalised() -> None:
    norm = NoisyNorm(2, noise_size=1)
    with torch.no_grad():
        norm.gain_and_offset.weight.copy_(
            torch.tensor([[0.5], [0.0], [0.0], [3.0]])
        )  # gains, then offsets
    maps = torch.randn(4, 2, 6, 6)
    plain = norm(maps, torch.zeros(4, 1))
    assert plain.mean(dim=(0, 2, 3)).abs().max() < 1e-5
    assert plain.std(dim=(0, 2, 3)).tolist() == pytest.approx([1, 1], abs=0.01)
    noisy = norm(maps, torch.ones(4, 1))
    torch.testing.assert_close(noisy[:, 0], 1.5 * plain[:, 0])
    torch.testing.assert_close(noisy[:, 1], plain[:, 1] + 3)


def test_a_u_net_gives_its_inputs_size_and_sees_far_and_near() -> None:
    torch.manual_seed(0)
    net = UNet(2, (8, 16, 16), 3).eval()
    maps = torch.rand(1, 2, 24, 32)
    result = net(maps)
    assert result.shape == (1, 3, 24, 32)
    for row, column in ((5, 5), (23, 31)):  # one pixel changes itself, and pixels far away
        other = maps.clone()
        other[0, :, row, column] += 1
        change = (net(other) - result).abs().sum(dim=1)[0]
        assert change[row, column] > 1e-4
        assert change[12, 16] > 0

"""Warping by flows whose outcome one can write down."""

import pytest
import torch

from geovp_learned.video.slamp import warp


def steps(right_px: float, down_px: float) -> "torch.Tensor":
    return torch.tensor([right_px, down_px])[None, :, None, None].expand(1, 2, 5, 7)


def test_a_flow_of_whole_pixels_moves_pixels_exactly() -> None:
    image = torch.rand(1, 3, 5, 7)
    moved = warp(image, steps(2.0, -1.0))
    # (row, column) shows (row - 1, column + 2)
    torch.testing.assert_close(moved[..., 1:, :5], image[..., :4, 2:], atol=1e-5, rtol=0)


def test_what_lies_outside_is_black() -> None:
    """Also where a quarter of the sampled pixel is still inside: flow_utils.warp keeps whole ones."""
    image = torch.ones(1, 3, 5, 7)
    moved = warp(image, steps(1.75, 0.0))
    torch.testing.assert_close(moved[..., :5], image[..., :5])
    assert not moved[..., 5:].any()


def test_the_flows_gradient_is_the_images_slope() -> None:
    image = 3.0 * torch.arange(7.0).expand(1, 1, 5, 7)
    flow_px = torch.full((1, 2, 5, 7), 0.25, requires_grad=True)
    warp(image, flow_px)[0, 0, 2, 3].backward()
    torch.testing.assert_close(flow_px.grad[0, :, 2, 3], torch.tensor([3.0, 0.0]))
    assert float(flow_px.grad.abs().sum()) == pytest.approx(
        3.0
    )  # no other pixel's flow matters to it

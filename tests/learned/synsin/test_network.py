import numpy as np
import pytest
import torch
from torch import Tensor

from geovp_classic.types import Clip
from geovp_learned.synsin import pairs, residual
from geovp_learned.synsin.network import Generator
from geovp_learned.synsin.splatting import pull_push
from geovp_learned.synsin.train import SynSinTraining
from geovp_learned.tensors import images_from_frames

STILL = torch.eye(4)[None, None]


@pytest.fixture
def generator(method: SynSinTraining) -> Generator:
    torch.manual_seed(0)
    return residual.ResidualGenerator(method.architecture).eval()


def test_untrained_it_sees_everything_about_twenty_metres_away(
    generator: Generator, clip: Clip
) -> None:
    cloud = generator.encode(
        images_from_frames(clip.frames[:2]),
        pairs.intrinsics_tensor(clip.intrinsics).repeat(2, 1),
        torch.zeros(2, 0),
    )
    assert cloud.inverse_depths.shape == (2, 32 * 32)
    np.testing.assert_allclose(cloud.inverse_depths.detach().numpy(), 1 / 20, rtol=0.05)
    np.testing.assert_array_equal(
        cloud.features[0, :, :3].detach().numpy(), clip.frames[0].reshape(-1, 3) / np.float32(255)
    )


def test_untrained_a_camera_that_stands_still_sees_the_frame_again(
    generator: Generator, clip: Clip
) -> None:
    frames = images_from_frames(clip.frames[:1])
    images, _ = generator(frames, pairs.intrinsics_tensor(clip.intrinsics), STILL)
    np.testing.assert_allclose(images.frames.detach().numpy(), frames.numpy(), atol=1e-5)


@pytest.mark.parametrize(("height", "width"), [(37, 50), (64, 20)])
def test_frames_may_have_any_size(generator: Generator, height: int, width: int) -> None:
    camera = torch.tensor([[40.0, 40.0, width / 2, height / 2]])
    images, inverse_depths = generator(
        torch.rand(1, 3, height, width), camera, STILL.repeat(1, 2, 1, 1)
    )
    assert images.frames.shape == (2, 3, height, width)
    assert inverse_depths.shape == (1, height, width)
    assert ((inverse_depths > 0) & (inverse_depths < 1 / residual.NEAREST_M)).all()


def test_driving_ahead_uses_the_inverse_depth_of_the_cloud(generator: Generator) -> None:
    # everything at 20 m: after 10 m, what was 4 pixels right of the centre is 8 pixels right of it,
    # at 10 m
    frame = torch.zeros(1, 3, 33, 33)
    frame[:, :, 16, 20] = 1
    camera, ahead = torch.tensor([[40.0, 40.0, 16.0, 16.0]]), STILL.clone()
    ahead[0, 0, 2, 3] = -10
    with torch.no_grad():
        for parameter in generator.depth_network.unet.head.parameters():
            parameter.zero_()
        generator.depth_network.unet.head.bias.fill_(
            float(torch.logit(torch.tensor(residual.NEAREST_M / 20)))
        )
        images, _ = generator(frame, camera, ahead)
    assert int(images.frames[0, 0].argmax()) == 16 * 33 + 24
    assert float(images.inverse_depths[0, 0, 16, 24]) == pytest.approx(0.1, rel=1e-3)


def test_only_a_share_of_the_images_gradient_reaches_depth(
    generator: Generator, clip: Clip
) -> None:
    ahead = STILL.clone()
    ahead[0, 0, 2, 3] = -1.0
    inputs = (images_from_frames(clip.frames[:1]), pairs.intrinsics_tensor(clip.intrinsics), ahead)

    def slope(share: float) -> Tensor:
        torch.manual_seed(0)
        images, _ = generator(*inputs, share)
        return torch.autograd.grad(
            images.frames.square().sum(), [generator.depth_network.unet.head.weight]
        )[0]

    whole = slope(1.0)
    torch.testing.assert_close(slope(0.25), 0.25 * whole, rtol=1e-3, atol=1e-6)
    assert whole.abs().max() > 0


def test_pull_push_keeps_what_is_solid_and_fills_the_rest_from_around() -> None:
    image = torch.rand(1, 3, 9, 13, generator=torch.Generator().manual_seed(0))
    solid = torch.ones(1, 1, 9, 13)
    torch.testing.assert_close(pull_push(image, solid), image)
    flat = torch.full_like(image, 0.6)
    seen = (torch.rand(1, 1, 9, 13, generator=torch.Generator().manual_seed(1)) < 0.1).float()
    assert 0 < seen.sum() < 20
    torch.testing.assert_close(pull_push(flat * seen, seen), flat)


def test_depth_depends_on_the_focal_length(generator: Generator, clip: Clip) -> None:
    frames, camera = images_from_frames(clip.frames[:1]), pairs.intrinsics_tensor(clip.intrinsics)
    wide, long = (
        generator.encode(frames, factor * camera, torch.zeros(1, 0)).inverse_depths
        for factor in (1, 2)
    )
    assert not torch.equal(wide, long)

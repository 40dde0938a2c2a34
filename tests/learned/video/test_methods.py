"""What holds for SVG, SRVP and SLAMP alike."""

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.utils.data import default_collate

from geovp_classic.types import ByteArray
from geovp_learned.stored_clips import Window
from geovp_learned.tensors import images_from_frames
from geovp_learned.video.training import VideoTraining

PAST, FUTURE = 3, 3


def trained(
    method: VideoTraining, images: Tensor, num_steps: int
) -> tuple[nn.Module, list[dict[str, float]]]:
    """The network after some steps on the same images, ready to predict, and the losses of every
    step.
    """
    torch.manual_seed(0)
    networks = method.build()
    optimiser = method.optimisers(networks)["video"]
    history = []
    for _ in range(num_steps):
        losses = method.losses(networks["video"], images)
        optimiser.zero_grad()
        losses["total"].backward()
        optimiser.step()
        history.append({name: float(loss.detach()) for name, loss in losses.items()})
    return networks["video"].eval(), history


def error(made: Tensor, real: Tensor) -> float:
    return float(((made - real) ** 2).mean())


def test_it_learns_one_clip_by_heart(method: VideoTraining, street_window: ByteArray) -> None:
    # Two clips: batch normalisation sees one value of each in the encoder's last layer
    clips = np.stack([street_window, street_window[:, :, ::-1]])
    images = images_from_frames(clips)
    network, history = trained(method, images, num_steps=80)
    assert history[-1]["error"] < 0.2 * history[0]["error"]
    noise = torch.randn(
        1, PAST + FUTURE, network.noise_size, generator=torch.Generator().manual_seed(0)
    )
    with torch.no_grad():
        made = network.predict(images[:, :PAST], noise)
    copied = error(images[:, PAST - 1 : PAST].expand(-1, FUTURE, -1, -1, -1), images[:, PAST:])
    assert error(made, images[:, PAST:]) < 0.5 * copied


def test_predictions_depend_on_nothing_but_past_and_noise(method: VideoTraining) -> None:
    torch.manual_seed(0)
    network = method.build()["video"].eval()
    random = torch.Generator().manual_seed(1)
    seen = torch.rand(2, PAST, 3, 16, 16, generator=random)
    noise = torch.randn(2, PAST + 4, network.noise_size, generator=random)
    with torch.no_grad():
        both = network.predict(seen, noise)
        alone = network.predict(seen[1:], noise[1:])
        fewer = network.predict(seen, noise[:, : PAST + 2])
    assert both.shape == (2, 4, 3, 16, 16)
    # Nothing leaks across the batch in evaluation mode, nor from the future.
    torch.testing.assert_close(both[1:], alone, atol=1e-6, rtol=0)
    torch.testing.assert_close(both[:, :2], fewer, atol=1e-6, rtol=0)


def test_validation_compares_with_the_last_frame_at_the_networks_size(
    method: VideoTraining, street_window: ByteArray
) -> None:
    still = np.repeat(street_window[:1], 6, axis=0)
    moved = still.copy()
    moved[PAST:] = still[PAST:] // 2
    networks = {name: network.eval() for name, network in method.build().items()}
    batch = default_collate(
        [method.validation_example(Window({"frames": frames}, 0)) for frames in (still, moved)]
    )
    with torch.no_grad():
        numbers = method.validation_step(networks, batch)
    scores = {name: float(number) for name, number in numbers.items()}
    halved = float(((still[0] / 255.0 - moved[-1] / 255.0) ** 2).mean())
    assert scores["copy_last"] == pytest.approx(
        (80.0 - 10 * np.log10(halved)) / 2, abs=1e-3
    )  # PSNR ends at 80 dB
    assert scores["score"] == -scores["psnr"]

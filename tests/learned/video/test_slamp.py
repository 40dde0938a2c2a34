"""SLAMP's two branches and its mask."""

from dataclasses import replace

import torch

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.slamp import Architecture, SlampNetwork, SlampTraining, _frame_pairs, warp

ARCHITECTURE = Architecture(
    AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2, mask_width=4, flow_unit_px=2.0
)


def test_what_is_shown_is_made_of_both_branches_by_the_mask() -> None:
    torch.manual_seed(0)
    network, previous = SlampNetwork(ARCHITECTURE), torch.rand(4, 3, 8, 8)
    maps, flow = torch.randn(4, 3, 8, 8), torch.randn(4, 2, 8, 8)
    shown = network._blend(maps, flow, previous, previous)
    torch.testing.assert_close(shown.appearance, maps.sigmoid())
    torch.testing.assert_close(shown.motion, warp(previous, 2.0 * flow))
    masks = network.mask(torch.cat([shown.appearance, shown.motion], dim=1)).sigmoid()
    blended = masks * shown.appearance + (1 - masks) * shown.motion
    torch.testing.assert_close(shown.images, blended)


def test_the_motion_branch_moves_the_real_frame_before() -> None:
    torch.manual_seed(0)
    network, images = (
        SlampNetwork(replace(ARCHITECTURE, flow_unit_px=0.0)),
        torch.rand(2, 4, 3, 8, 8),
    )
    torch.testing.assert_close(network(images, 2).prediction.motion, images[:, :-1])


def test_the_motion_branch_sees_each_frame_beside_the_one_before() -> None:
    images = torch.rand(1, 3, 3, 8, 8)
    pairs = _frame_pairs(images)
    torch.testing.assert_close(pairs[:, 2], torch.cat([images[:, 1], images[:, 2]], dim=1))
    torch.testing.assert_close(pairs[:, 0, :3], pairs[:, 0, 3:])  # nothing moved before the first


def test_an_untrained_residual_network_copies_the_last_frame() -> None:
    coding = AutoencoderConfig("dcgan", 8, 4, 8, residual=True)
    network = SlampNetwork(Architecture(coding, 8, latent_size=2, mask_width=4)).eval()
    observed = torch.rand(1, 3, 3, 8, 8) * 0.8 + 0.1
    with torch.no_grad():
        made = network.predict(
            observed.expand(2, -1, -1, -1, -1), torch.randn(2, 4, network.noise_size)
        )
    torch.testing.assert_close(made, observed[:, -1:].expand(2, 4, -1, -1, -1), atol=1e-4, rtol=0)


def test_the_loss_is_the_weighted_sum_of_its_parts() -> None:
    torch.manual_seed(0)
    method = SlampTraining(
        num_past=2, architecture=ARCHITECTURE, beta=0.5, appearance_weight=2.0, motion_weight=3.0
    )
    parts = method.losses(method.build()["video"], torch.rand(2, 4, 3, 8, 8))
    wanted = parts["error"] + 2 * parts["appearance"] + 3 * parts["motion"] + 0.5 * parts["nats"]
    torch.testing.assert_close(parts["total"], wanted)
    assert all(float(part.detach()) > 0 for part in parts.values())

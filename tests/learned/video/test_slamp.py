"""SLAMP's two branches and its mask."""

import torch

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.slamp import Architecture, SlampNetwork, SlampTraining, _frame_pairs, warp

ARCHITECTURE = Architecture(
    AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2, mask_width=4, flow_unit_px=2.0
)


def test_what_is_shown_is_made_of_both_branches_by_the_mask() -> None:
    torch.manual_seed(0)
    images = torch.rand(2, 4, 3, 8, 8)
    shown = SlampNetwork(ARCHITECTURE)(images, 2).prediction
    blended = shown.masks * shown.appearance + (1 - shown.masks) * shown.motion
    torch.testing.assert_close(shown.images, blended)
    moved = warp(images[:, :-1].flatten(0, 1), shown.flow_px.flatten(0, 1))
    torch.testing.assert_close(shown.motion.flatten(0, 1), moved)  # of the real frame before
    assert shown.masks.shape == (2, 3, 1, 8, 8)


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

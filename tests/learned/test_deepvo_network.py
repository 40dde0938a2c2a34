"""DeepVO's networks: shapes, what depends on what, and that they can learn at all."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import street
import torch

from geovp_classic.errors import BadData
from geovp_learned.deepvo.network import Architecture, PoseNetwork, encoder
from geovp_learned.deepvo.train import DeepVoTraining
from tests.learned.originals import digest, numbers, random_images, seed_weights

TINY = Architecture(size_px=(64, 64), encoder_width=1 / 16, lstm_size=12, dropout=0.0)


def test_a_decoder_started_from_poses_sees_nothing_else() -> None:
    torch.manual_seed(0)
    net = PoseNetwork(replace(TINY, decoder_start="poses")).eval()
    past = torch.tensor([[[0.0, 1.0, 0.01], [0.0, 1.0, 0.02]]])
    state = (torch.rand(1, 1, 12), torch.rand(1, 1, 12))
    future = net.future(state, past, 3)
    torch.testing.assert_close(future, net.future((2 * state[0], state[1]), past, 3))
    assert not torch.allclose(future, net.future(state, 2 * past, 3))


FEATURES = numbers(
    """0.081241 0.131702 0.023903 0.277641 -0.010126 0.248813 -0.01452 0.271886 0.076222 0.038447 0.057999 0.426845
    0.323884 -0.017255 0.012034 -0.046847 -0.026197 -0.014454 0.33401 -0.019077 0.488856 0.241503 -0.027332 -0.019196"""
)


def test_flownets_weights_make_the_encoder_of_deepvo(tmp_path: Path) -> None:
    """The layers of FlowNetS-BN go in by order; the numbers are those of `encode_image` of
    ChiWeiHsiao/DeepVO-pytorch, computed as `originals` says, with its 14,616,320 parameters.
    """
    flownet = encoder(1.0, 0.0)
    seed_weights(flownet)
    state = flownet.state_dict()
    stored = {f"conv{position}.{key}": value for position, (key, value) in enumerate(state.items())}
    file = tmp_path / "flownets_bn.pth.tar"
    torch.save({"state_dict": {**stored, "deconv5.0.weight": torch.ones(1)}}, file)
    architecture = Architecture(size_px=(128, 64))
    method = DeepVoTraining(architecture, flownet=file)
    networks = method.build()
    assert isinstance(method.optimisers(networks)["poses"], torch.optim.Adagrad)
    loaded = networks["poses"].encoder.eval()
    with torch.no_grad():
        features = loaded(random_images(2, 6, 64, 128) - 0.5)
    assert sum(parameter.numel() for parameter in loaded.parameters()) == 14_616_320
    assert digest(features) == pytest.approx(FEATURES, abs=1e-4)
    with pytest.raises(BadData, match="does not fit the encoder"):
        DeepVoTraining(replace(architecture, encoder_width=0.5), flownet=file).build()


def test_a_window_has_the_frames_of_the_past_and_all_motions() -> None:
    method = DeepVoTraining(TINY, num_past=4, num_future=3, grey_probability=1.0)
    clip = street.clip()
    examples = method.examples([method.prepare(clip)], training=True)
    assert [window.first for window in examples] == [0, 1, 2, 3]  # 7 of 10 frames
    coloured = method.validation_example(examples[2])
    grey = method.example(examples[2], np.random.default_rng(0))
    assert coloured["images"].shape == (4, 3, 64, 64)
    assert not torch.equal(coloured["images"][:, 0], coloured["images"][:, 2])
    assert torch.equal(grey["images"][:, 0], grey["images"][:, 2])
    poses = clip.trajectory.world_from_cam
    after_first = poses[2] @ coloured["motions"][0].numpy()
    np.testing.assert_allclose(after_first, poses[3], atol=1e-4)

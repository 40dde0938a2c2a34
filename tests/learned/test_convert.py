"""Files in the formats of the authors, with pickled modules, become weights files that predict."""

import argparse
import json
import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import street
import torch
from torch import Tensor, nn

from geovp_classic import registry
from geovp_classic.types import Intrinsics, PrivilegedInput
from geovp_learned import checkpoints, inert_pickle
from geovp_learned.__main__ import main
from geovp_learned.convert import convert
from geovp_learned.synsin.generator import Generator
from geovp_learned.synsin.network import Architecture as SynSinArchitecture
from geovp_learned.video import slamp, srvp, svg
from geovp_learned.video.autoencoder import AutoencoderConfig

CODING = AutoencoderConfig("vgg", 16, 8, 8)
GREY = AutoencoderConfig("dcgan", 16, 8, 8, 1)


def svg_file(path: Path) -> nn.Module:
    network = svg.SvgNetwork(svg.Architecture(GREY, 8, latent_size=3))
    options = argparse.Namespace(last_frame_skip=False, n_past=3, n_future=2, optimizer=print)
    content = {**dict(network.named_children()), "opt": options}
    # The format of torch before 1.6, in which SVG's files are
    torch.save(content, path, _use_new_zipfile_serialization=False)
    return network


SKIPS = {"running_avg": True, "last_frame_skip": True, "motion_skip": False}
SLAMP_OPTIONS = {**SKIPS, "dataset": "kitti", "n_past": 3, "n_future": 2}


def slamp_file(path: Path) -> nn.Module:
    network = slamp.SlampNetwork(slamp.Architecture(CODING, 8, latent_size=3, mask_width=8))
    options = argparse.Namespace(**SLAMP_OPTIONS)
    torch.save({**dict(network.named_children()), "opt": options, "epoch": 7}, path)
    return network


def slamp_kitti_file(path: Path) -> nn.Module:
    coding = AutoencoderConfig(code_size=4)
    network = slamp.SlampNetwork(slamp.Architecture(coding, 4, latent_size=3, form="kitti"))
    for module in network.modules():
        if isinstance(module, slamp.GaussianLstm):
            module.embed = nn.Conv2d(4, 4, 3)  # as theirs, which are never used
    # Their options are a dictionary here
    torch.save({**dict(network.named_children()), "opt": SLAMP_OPTIONS}, path)
    return network


def srvp_file(path: Path) -> nn.Module:
    network = srvp.SrvpNetwork(
        srvp.Architecture(
            CODING,
            inference_size=6,
            residual_size=6,
            state_size=4,
            latent_size=3,
            first_frames=2,
            steps_per_frame=1,
        )
    )
    renamed = {
        key.replace("encoder.c", "encoder.conv.").replace("decoder.upc", "decoder.conv."): value
        for key, value in network.state_dict().items()
    }
    torch.save(renamed, path)
    sizes = {"nx": 16, "nc": 3, "nf": 8, "nhx": 8, "ny": 4, "nz": 3, "nt_inf": 2, "nh_inf": 6}
    layers = {"nlayers_inf": 3, "nh_res": 6, "nlayers_res": 4, "archi": "vgg", "skipco": True}
    steps = {"n_euler_steps": 1, "nt_cond": 3, "seq_len": 5, "obs_scale": 0.2}
    path.with_name("config.json").write_text(json.dumps({**sizes, **layers, **steps}))
    return network


OPTIONS = {
    "model_type": "zbuffer_pts",
    "refine_model_type": "resnet_256W8UpDown64",
    "accumulation": "alphacomposite",
    "norm_G": "sync:spectral_batch",
    "radius": 4,
    "pp_pixel": 128,
    "tau": 1.0,
    "rad_pow": 2,
    "ngf": 8,
    "dataset": "kitti",
    "use_inverse_depth": True,
    "min_z": 1.0,
    "max_z": 50.0,
}
THEIRS = (
    ("feature_network.blocks.", "encoder.gblocks."),
    ("refinement_network.blocks.", "projector.eblocks."),
    ("depth_network.", "pts_regressor."),
    ("parametrizations.weight.original", "weight_orig"),
    ("parametrizations.weight.0._", "weight_"),
    (".bn.running_", ".bn.stored_"),
)


def synsin_file(path: Path, **changes: Any) -> nn.Module:
    """`ngf` is smaller than theirs; the features of a point are always 64."""
    network = Generator(SynSinArchitecture(width=8, focal_px=718.9))
    state = {}
    for key, value in network.state_dict().items():
        for ours, theirs in THEIRS:
            key = key.replace(ours, theirs)
        if "gblocks" not in key or "batches_tracked" not in key:
            state[f"model.module.{key}"] = value
    state["netD.whatever"] = torch.zeros(1)
    torch.save({"state_dict": state, "opts": argparse.Namespace(**{**OPTIONS, **changes})}, path)
    return network


FILES: dict[str, Callable[[Path], nn.Module]] = {
    "svg": svg_file,
    "slamp": slamp_file,
    "slamp-kitti": slamp_kitti_file,
    "srvp": srvp_file,
    "synsin": synsin_file,
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_the_authors_loads_and_predicts(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    method, file = name.partition("-")[0], tmp_path / "theirs.pth"
    role = "renderers" if method == "synsin" else "predictors"
    wanted = FILES[name](file).state_dict()
    assert main(["convert", str(file), "--method", method]) == 0
    said = capsys.readouterr().out
    dropped = {"synsin": "netD.whatever", "slamp-kitti": "prior_app.embed.weight"}
    assert dropped.get(name, "dropped: nothing") in said
    weights = file.with_suffix(".safetensors")
    assert "official weights, converted from `theirs.pth`" in weights.with_suffix(".md").read_text()
    component = registry.build(role, {"name": method, "weights": str(weights)})
    assert "official weights, converted from theirs.pth" in component.weights_note
    given: dict[str, Tensor] = component.load()[0].state_dict()
    assert all(torch.equal(value, wanted[key]) for key, value in given.items())
    context, _ = street.clip().split(4, ~PrivilegedInput.NONE)
    if role == "predictors":
        frames = component.predict(context, num_samples=2).frames
        assert frames.shape[:2] == (2, context.num_future)
    else:
        assert "1 unit = 50 m" in component.weights_note
        # Half the focal length that the network knows, so that it sees twice the size
        camera = Intrinsics(359.45, 359.45, 15.5, 15.5, 32, 32)
        small = replace(context, frames=context.frames[:, :32, :32], intrinsics=camera)
        scene = component.reconstruct(small, context.past)
        assert scene.cloud.features.shape[1] == 64 * 64
        last = context.past.world_from_cam[-1:]
        assert scene.view(last, context.times_s[3:4], camera).frames.shape == (1, 32, 32, 3)


def test_depth_ranges_come_from_the_options(tmp_path: Path) -> None:
    file, out = tmp_path / "theirs.pth", tmp_path / "ours.safetensors"
    synsin_file(file, dataset="realestate", use_inverse_depth=False, max_z=100.0)
    convert(file, "synsin", out)
    architecture = checkpoints.read_tensors(out)[0]["settings"]["architecture"]
    assert (architecture["unit_m"], architecture["focal_px"]) == (1.0, 0.0)
    assert architecture["depth_range"] == [1.0, 100.0]


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        ("svg", {"opt": {"last_frame_skip": False}}, "'n_past'"),
        ("slamp", {"opt": SKIPS}, "'n_past'"),
        ("srvp", None, "config.json describes another encoder"),  # a list in place of tensors
        (
            "synsin",
            {"opts": {**OPTIONS, "dataset": "replica"}},
            "dataset 'replica', expected kitti",
        ),
    ],
)
def test_other_files_are_refused_in_a_sentence(
    name: str, changes: Any, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "theirs.pth"
    FILES[name](file)
    content = torch.load(file, weights_only=False)
    torch.save({**content, **changes} if changes else [], file)
    assert main(["convert", str(file), "--method", name]) == 2
    assert f"published files of {name} ({reason}" in capsys.readouterr().err


class Evil:
    """Makes a folder when it is unpickled by Python's own reader."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def test_nothing_in_a_file_is_executed(tmp_path: Path) -> None:
    victim, file = tmp_path / "victim", tmp_path / "theirs.pth"
    for is_zip in (True, False):
        torch.save({"opt": Evil(victim)}, file, _use_new_zipfile_serialization=is_zip)
        content = inert_pickle.load(file)
        assert isinstance(content["opt"], inert_pickle.Inert)
        assert not victim.exists()
    pickle.loads(pickle.dumps(Evil(victim)))
    assert victim.exists()  # as it would otherwise

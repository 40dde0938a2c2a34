"""Official weights of SynSin, SVG, SRVP and SLAMP as weights files of this package.

Sizes are read from the tensors, other settings from the options that the authors store with them.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from geovp_classic import atomic, files
from geovp_learned import checkpoints, inert_pickle, model_cards
from geovp_learned.synsin.network import Architecture as SynSinArchitecture
from geovp_learned.synsin.train import SynSinTraining
from geovp_learned.video import slamp, srvp, svg
from geovp_learned.video.autoencoder import INNERMOST_PX, AutoencoderConfig

Tensors = dict[str, Tensor]
Converted = tuple[Any, Tensors, str]  # training settings, tensors under our names, units

SYNSIN_DATASETS = {  # metres of a unit, focal length (0: varies) and what is known of both
    "kitti": (50.0, 718.9, "1 unit = 50 m; images of 256x256 pixels with a focal length of 718.9"),
    "realestate": (1.0, 0.0, "the unit is that of RealEstate10K's poses, not a metre"),
    "mp3d": (1.0, 128.0, "1 unit = 1 m; images of 256x256 pixels with a field of view of 90 deg"),
}
SYNSIN_NAMES = (  # of the authors and ours
    (r"^(model\.)?(module\.)?", ""),
    (r"^encoder\.gblocks\.", "feature_network.blocks."),
    (r"^projector\.eblocks\.", "refinement_network.blocks."),
    (r"^pts_regressor\.", "depth_network."),
    (r"\.weight_orig$", ".parametrizations.weight.original"),
    (r"\.weight_([uv])$", r".parametrizations.weight.0._\1"),
    (r"\.stored_(mean|var)$", r".running_\1"),
)


def convert(file: Path, method: str, out: Path) -> list[str]:
    """Write the authors' weights as safetensors with a model card; return the names of the tensors
    that were dropped.

    Raise BadData if the file is not one of the method's, or if shapes differ.
    """
    content = inert_pickle.load(file)
    expected = "give a file named in docs/guide/official-weights.md (SRVP's beside its config.json)"
    with files.checked(f"{file} has other entries than the published files of {method}", expected):
        settings, given, units = READERS[method](file, content)
        name, network = next(iter(settings.build().items()))
    wanted = network.state_dict()
    # Files of torch before 0.4.1 do not count batches
    counters = {key: value for key, value in wanted.items() if key.endswith("batches_tracked")}
    tensors = {**counters, **{key: value for key, value in given.items() if key in wanted}}
    checkpoints.restore(file, network, tensors, "")
    origin = {"file": file.name, "sha256": checkpoints.fingerprint(file), "units": units}
    history = {"origin": origin}
    checkpoints.write(out, method, settings, {name: network}, history, use_halves=False)
    card = model_cards.model_card(out).encode()
    atomic.write_bytes(out.with_suffix(".md"), card)
    return sorted(set(given) - set(wanted))


def _svg(_: Path, content: Any) -> Converted:
    tensors = _modules(content, "opt", "encoder", "decoder", "posterior", "prior")
    options = inert_pickle.options(content["opt"])
    architecture = svg.Architecture(
        _coding(tensors, "encoder"),
        last_frame_skip=bool(options["last_frame_skip"]),
        **_recurrent_sizes(tensors, "frame_predictor", "posterior"),
    )
    past, future = options["n_past"], options["n_future"]
    return svg.SvgTraining(architecture, past, future), tensors, "pixels in [0, 1]"


def _slamp(_: Path, content: Any) -> Converted:
    tensors = _modules(content, "opt", "pixel_encoder", "flow_decoder", "mask_decoder")
    tensors = {key.replace(".layers.", ".main."): value for key, value in tensors.items()}
    options = inert_pickle.options(content["opt"])
    if options.get("motion_skip") or not (options["running_avg"] and options["last_frame_skip"]):
        raise ValueError("not trained with --last_frame_skip --running_avg, without --motion_skip")
    form: Any = options["dataset"] if "img_encoder" in content else "generic"
    if form == "generic":
        coding = _coding(tensors, "pixel_encoder")
    else:
        code_size = len(tensors["pixel_encoder.c3.1.main.1.bias"])
        coding = AutoencoderConfig(code_size=code_size)
    architecture = slamp.Architecture(
        coding,
        mask_width=len(tensors["mask_decoder.c1.0.main.0.weight"]),
        form=form,
        **_recurrent_sizes(tensors, "static_frame_predictor", "posterior_app"),
    )
    past, future = options["n_past"], options["n_future"]
    return slamp.SlampTraining(architecture, past, future), tensors, "pixels in [0, 1]"


def _srvp(file: Path, content: Any) -> Converted:
    given = inert_pickle.state_dict(content)
    options = files.read_json(file.with_name("config.json"))
    architecture = srvp.Architecture(
        AutoencoderConfig(
            options["archi"], options["nx"], options["nf"], options["nhx"], options["nc"]
        ),
        use_skips=bool(options["skipco"]),
        inference_size=options["nh_inf"],
        inference_layers=options["nlayers_inf"],
        residual_size=options["nh_res"],
        residual_layers=options["nlayers_res"],
        state_size=options["ny"],
        latent_size=options["nz"],
        first_frames=options["nt_inf"],
        steps_per_frame=options["n_euler_steps"],
    )
    past, length = options["nt_cond"], options["seq_len"]
    settings = srvp.SrvpTraining(
        architecture, past, length - past, observation_std=options.get("obs_scale", 1.0)
    )
    network = settings.build()["video"]
    tensors = {key: value for key, value in given.items() if not key.startswith(("enc", "dec"))}
    for part in ("encoder", "decoder"):
        # Their layers have other names, but come in the same order
        theirs = [key for key in given if key.startswith(part)]
        ours = [key for key in network.state_dict() if key.startswith(part)]
        if [key.rpartition(".")[2] for key in theirs] != [key.rpartition(".")[2] for key in ours]:
            raise ValueError(f"config.json describes another {part}")
        tensors |= {key: given[name] for key, name in zip(ours, theirs, strict=True)}
    return settings, tensors, "pixels in [0, 1]"


def _synsin(_: Path, content: Any) -> Converted:
    if not {"state_dict", "opts"} <= set(content):
        raise ValueError("no state_dict and opts")
    # The options must be those of the paper's model.
    options = inert_pickle.options(content["opts"])
    wanted = {
        "model_type": "zbuffer_pts",
        "refine_model_type": "resnet_256W8UpDown64",
        "accumulation": "alphacomposite",
        "norm_G": "sync:spectral_batch",
        "radius": 4,
        "pp_pixel": 128,
        "tau": 1.0,
        "rad_pow": 2,
    }
    differing = [name for name, value in wanted.items() if options.get(name) != value]
    if differing:
        raise ValueError(f"another {', '.join(differing)} than the paper's SynSin")
    # Unit, camera and range of depth belong to the data set and the options.
    if (dataset := options["dataset"]) not in SYNSIN_DATASETS:
        raise ValueError(f"dataset {dataset!r}, expected {', '.join(SYNSIN_DATASETS)}")
    unit_m, focal_px, units = SYNSIN_DATASETS[dataset]
    is_inverse = options.get("use_inverse_depth", False)
    depth_range = (0.0, 0.0) if is_inverse else (options["min_z"], options["max_z"])
    # Only names of tensors differ.
    tensors = {}
    for key, value in inert_pickle.state_dict(content["state_dict"]).items():
        for pattern, replacement in SYNSIN_NAMES:
            key = re.sub(pattern, replacement, key)
        tensors[key] = value
    architecture = SynSinArchitecture(
        width=options["ngf"], unit_m=unit_m, depth_range=depth_range, focal_px=focal_px
    )
    depths = "inverse depths of .01 to 10.01" if is_inverse else "depths of {} to {}"
    units = f"{units}; {depths.format(*depth_range)} units; images in [-1, 1] inside"
    return SynSinTraining(architecture), tensors, units


READERS: Mapping[str, Callable[[Path, Any], Converted]] = {
    "svg": _svg,
    "slamp": _slamp,
    "srvp": _srvp,
    "synsin": _synsin,
}


def _modules(content: Any, *names: str) -> Tensors:
    """Return the tensors of all modules in a file; raise ValueError if it lacks a name."""
    missing = [name for name in names if name not in content]
    if missing:
        raise ValueError(f"no {', '.join(missing)}")
    return {
        f"{name}.{key}": value
        for name, module in content.items()
        if isinstance(module, inert_pickle.Inert)
        for key, value in inert_pickle.state_dict(module).items()
    }


def _coding(tensors: Tensors, encoder: str) -> AutoencoderConfig:
    """Read the sizes of an encoder from its tensors."""
    prefix = f"{encoder}.c"
    stages = {
        int(key.removeprefix(prefix).split(".")[0]) for key in tensors if key.startswith(prefix)
    }
    is_vgg = f"{encoder}.c1.0.main.0.weight" in tensors
    first = tensors.get(
        f"{encoder}.c1.0.main.0.weight" if is_vgg else f"{encoder}.c1.main.0.weight"
    )
    if first is None:
        raise ValueError(f"no layers of an {encoder}")
    sizes: Any = {
        "style": "vgg" if is_vgg else "dcgan",
        "size_px": INNERMOST_PX << len(stages) - 1,
        "width": first.shape[0],
        "code_size": len(tensors[f"{encoder}.c{max(stages)}.1.weight"]),
        "colours": first.shape[1],
    }
    return AutoencoderConfig(**sizes)


def _recurrent_sizes(tensors: Tensors, predictor: str, posterior: str) -> dict[str, int]:
    latent_size, hidden_size = tensors[f"{posterior}.mu_net.weight"].shape[:2]
    layers = {
        name: len({key.split(".")[2] for key in tensors if key.startswith(f"{name}.lstm.")})
        for name in (predictor, posterior)
    }
    return {
        "hidden_size": hidden_size,
        "predictor_layers": layers[predictor],
        "latent_layers": layers[posterior],
        "latent_size": latent_size,
    }

"""Depth networks of Hugging Face transformers, such as Depth Anything, DPT and ZoeDepth."""

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from transformers import AutoModelForDepthEstimation
from transformers.utils.hub import cached_file

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray
from geovp_learned import checkpoints, devices
from geovp_learned.pretrained.depth import NetworkDepth, normalised, note_on_weights

ADVICE = "give a local folder, or a hub id and the revision of a depth network with safetensors"


@dataclass(frozen=True, kw_only=True)
class HuggingFaceDepth(NetworkDepth):
    """Depth by a network of transformers: a local folder, or an id of the hub.

    An id needs a pinned `revision`, the hash of a commit. Networks with metric output, such as
    ZoeDepth and Depth Pro, need `values = "depth"`; `align = false` then takes their metres.
    Images are prepared as preprocessor_config.json says. `fingerprint` identifies the files of a
    local folder in results; when given, other files are refused.
    """

    model: str
    revision: str = ""
    fingerprint: str = ""

    def __post_init__(self) -> None:
        is_local = Path(self.model).is_dir()
        if not is_local and not re.fullmatch(r"[0-9a-f]{40}", self.revision):
            raise BadData(
                f"{self.model} is not a folder, and revision is {self.revision!r}: give a local "
                "folder, or the 40 digits of a commit of the hub"
            )
        if is_local:
            fingerprint = checkpoints.fingerprint(Path(self.model), self.fingerprint)
            object.__setattr__(self, "fingerprint", fingerprint)
        object.__setattr__(self, "device", devices.resolved(self.device))
        self.load()

    def load(self) -> tuple[torch.nn.Module, dict[str, Any]]:
        """Return the network and the settings of its image processor."""
        return load(self.model, self.revision, self.fingerprint, self.device)

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables."""
        version = self.fingerprint or self.revision
        weights = f"huggingface weights {self.model} {version}"
        return note_on_weights(weights, devices.described(self.device))

    @torch.inference_mode()
    def predict(self, frames: ByteArray) -> FloatArray:
        """Return the predicted depth [N, H', W'] of all frames in one batch."""
        network, processor = self.load()
        size_px = input_size(processor, frames.shape[2], frames.shape[1])
        mean, std = (0.0,) * 3, (1.0,) * 3
        if processor.get("do_normalize", True):
            mean = processor.get("image_mean", (0.5,) * 3)
            std = processor.get("image_std", (0.5,) * 3)
        images = torch.from_numpy(normalised(frames, size_px, mean, std).copy())
        depth = network(pixel_values=images.to(self.device)).predicted_depth
        return depth.float().cpu().numpy()


def input_size(processor: dict[str, Any], width_px: int, height_px: int) -> tuple[int, int]:
    """Return the size (width, height) to which an image processor resizes a frame.

    With `keep_aspect_ratio`, the side that changes less determines the scale.
    """
    size = processor["size"]
    if "shortest_edge" in size:
        scale_u = scale_v = size["shortest_edge"] / min(width_px, height_px)
    else:
        scale_u = size["width"] / width_px
        scale_v = size["height"] / height_px
    if processor.get("keep_aspect_ratio"):
        scale_u = scale_v = min(scale_u, scale_v, key=lambda scale: abs(1 - scale))
    multiple = processor.get("ensure_multiple_of") or 1
    return (
        max(1, round(width_px * scale_u / multiple)) * multiple,
        max(1, round(height_px * scale_v / multiple)) * multiple,
    )


@functools.lru_cache(maxsize=2)
def load(
    model: str, revision: str, fingerprint: str, device: str
) -> tuple[torch.nn.Module, dict[str, Any]]:
    """Return the network and the settings of its image processor, once per process.

    Nothing in the files is executed. Raises BadData if they cannot be read or downloaded. The
    fingerprint only distinguishes files of one folder at different times.
    """
    pinned = {"revision": revision} if revision else {"local_files_only": True}
    with files.checked(f"{model} cannot be loaded", ADVICE):
        network = AutoModelForDepthEstimation.from_pretrained(
            model, use_safetensors=True, trust_remote_code=False, **pinned
        )
        settings = cached_file(model, "preprocessor_config.json", **pinned)
    processor = files.read_json(Path(str(settings)))
    return network.eval().to(device), processor

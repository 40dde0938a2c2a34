"""Depth networks of Hugging Face transformers, such as Depth Anything, DPT and ZoeDepth."""

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from transformers import AutoImageProcessor, AutoModelForDepthEstimation

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray
from geovp_learned import checkpoints, devices
from geovp_learned.pretrained.depth import NetworkDepth, note_on_weights

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
        folder = Path(self.model) if Path(self.model).is_dir() else None
        if folder is None and not re.fullmatch(r"[0-9a-f]{40}", self.revision):
            raise BadData(
                f"{self.model} is not a folder, and revision is {self.revision!r}: give a local "
                "folder, or the 40 digits of a commit of the hub"
            )
        checkpoints.identify(self, folder)
        load(self)

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables."""
        version = self.fingerprint or self.revision
        weights = f"huggingface weights {self.model} {version}"
        return note_on_weights(weights, devices.described(self.device))

    @torch.inference_mode()
    def predict(self, frames: ByteArray) -> FloatArray:
        """Return the predicted depth [N, H', W'] of all frames in one batch."""
        network, processor = load(self)
        images = processor(list(frames), return_tensors="pt")["pixel_values"]
        depth = network(pixel_values=images.to(self.device)).predicted_depth
        return depth.float().cpu().numpy()


@functools.lru_cache(maxsize=2)
def load(depth: HuggingFaceDepth) -> tuple[Any, Any]:
    """Return the network and its image processor, once per process.

    Nothing in the files is executed. Raises BadData if they cannot be read or downloaded.
    """
    model, revision = depth.model, depth.revision
    pinned = {"revision": revision} if revision else {"local_files_only": True}
    with files.checked(f"{model} cannot be loaded", ADVICE):
        network = AutoModelForDepthEstimation.from_pretrained(
            model, use_safetensors=True, trust_remote_code=False, **pinned
        )
        processor = AutoImageProcessor.from_pretrained(model, do_pad=False, **pinned)
    return network.eval().to(depth.device), processor

"""FVD and FID: the Frechet distance between features of real and predicted clips, by the user's
network.

No weights are part of the package. The network is a TorchScript file (.pt) or an ONNX file, from
the field `weights` or from an environment variable.
"""

import functools
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic import files
from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.types import ByteArray, FloatArray
from geovp_learned import checkpoints


@dataclass(frozen=True)
class FeatureDistance:
    """Frechet distance of the features of a network.

    A TorchScript file that has an option `return_features`, as those of StyleGAN-V and StyleGAN2,
    scales its input itself: it gets grey levels in the size of the frames. Any other file gets
    values in [-1, 1] at `size_px`.
    """

    weights: Path | None = None  # None: the file of the environment variable
    size_px: tuple[int, int] = (224, 224)  # (width, height) of the network's input
    max_samples: int = 5  # of a clip, each in a set of its own
    device: str = "cpu"
    fingerprint: str = ""  # identifies the network in results; another one is refused when given

    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = False
    bounds: ClassVar[tuple[float, float]] = (0.0, math.inf)
    variable: ClassVar[str] = ""
    compared: ClassVar[str] = ""  # in words

    def __post_init__(self) -> None:
        checkpoints.identify(self, self.file)

    @property
    def file(self) -> Path:
        """Return the file of the network; raise MissingExtra if there is none."""
        given = self.weights or os.environ.get(self.variable)
        if not given:
            raise MissingExtra(
                f"its feature network is not given: set {self.variable} to a TorchScript or ONNX "
                "file (docs/concepts/metrics.md)"
            )
        return Path(given).expanduser()

    @property
    def protocol(self) -> str:
        """Return the definition in words."""
        return (
            f"Frechet distance between {self.compared}; features by {self.file.name} "
            f"{self.fingerprint}; mean over the first {self.max_samples} samples, or all if fewer; "
            "interval by block bootstrap of the clips' influence; falls with the number of clips"
        )

    def _features(self, images: ByteArray) -> FloatArray:
        """Return the features [D] of images [T, H, W, 3]; raise BadData for another output."""
        with files.checked(f"{self.file} cannot be run", "give another network or size_px"):
            run = load_network(self.file, self.device, self.size_px)
            output = run(torch.from_numpy(images).to(self.device).float().permute(3, 0, 1, 2))
        if output.ndim != 2 or len(output) != 1:
            raise BadData(
                f"{self.file} returns features of shape {output.shape}, expected [1, D]: give a "
                "network whose last layer is a mean over time and pixels"
            )
        return output[0].astype(float)


@dataclass(frozen=True)
class Fvd(FeatureDistance):
    """Frechet video distance (Unterthiner et al. 2019) of whole clips, observed frames included.

    The network maps clips [N, 3, T, H, W] to features [N, D]; in the paper it is I3D, with 400.
    """

    variable = "GEOVP_I3D_WEIGHTS"
    compared = "real and predicted clips, observed frames included"

    def features(self, observed: ByteArray, future: ByteArray) -> FloatArray:
        """Return the features [D] of all frames of a clip."""
        return self._features(np.concatenate([observed, future]))


@dataclass(frozen=True)
class Fid(FeatureDistance):
    """Frechet inception distance (Heusel et al. 2017) of one predicted frame of each clip.

    The network maps images [N, 3, H, W] to features [N, D]; in the paper it is Inception, with
    2048.
    """

    size_px: tuple[int, int] = (299, 299)
    step: int = -1  # index of the predicted frame

    variable = "GEOVP_INCEPTION_WEIGHTS"
    compared = "single real and predicted frames"

    def features(self, observed: ByteArray, future: ByteArray) -> FloatArray:
        """Return the features [D] of a predicted frame."""
        return self._features(future[[self.step]])


@functools.lru_cache(maxsize=4)
def load_network(
    file: Path, device: str, size_px: tuple[int, int]
) -> Callable[[Tensor], FloatArray]:
    """Return a function from grey levels [3, T, H, W] to features [1, D], once per process."""

    def scaled(levels: Tensor) -> Tensor:
        """Return an image [1, 3, H, W], or a clip [1, 3, T, H, W], in [-1, 1] at the input size."""
        images = functional.interpolate(
            levels.transpose(0, 1) / 127.5 - 1, size_px[::-1], mode="bilinear"
        )
        return images if len(images) == 1 else images.transpose(0, 1)[None]

    if file.suffix == ".onnx":
        from geovp_learned.pretrained import onnx  # onnxruntime is another extra

        session = onnx.session(onnx.OnnxFile(path=file, device=device))
        name = session.get_inputs()[0].name
        return lambda levels: np.asarray(
            session.run(None, {name: scaled(levels).numpy(force=True)})[0]
        )
    network: Any = torch.jit.load(file, map_location=device).eval()
    arguments = [argument.name for argument in network.forward.schema.arguments]
    options = {name: True for name in ("rescale", "resize", "return_features") if name in arguments}

    @torch.no_grad()
    def run(levels: Tensor) -> FloatArray:
        if "return_features" not in options:
            return np.asarray(network(scaled(levels)).numpy(force=True))
        clip = levels.squeeze(1)  # an image
        return np.asarray(network(clip[None], **options).numpy(force=True))

    return run

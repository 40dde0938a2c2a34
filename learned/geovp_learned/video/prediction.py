"""SVG, SRVP and SLAMP as components: resize the clip to the network, predict a few samples at a
time, resize back.
"""

import hashlib
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import Incompatible
from geovp_classic.types import ByteArray, Context, Prediction
from geovp_learned import checkpoints, devices
from geovp_learned.tensors import frames_from_images, grey, images_from_frames
from geovp_learned.video.training import resize

# Pixels of the frames in one batch of samples, which decide on memory and speed, not on results.
# The authors' networks take 2.5 to 5 kB per pixel (in single precision, measured on a CPU). On one
# thread of a CPU memory matters: 0.2 GB. A GPU needs many pixels to be busy: 256 samples at 64x64,
# or 16 at 256x256, take 5 GB, which all GPUs for training have.
CPU_PIXELS = 10 * 64 * 64
GPU_PIXELS = 256 * 64 * 64


@dataclass(frozen=True)
class VideoPredictor(checkpoints.Pretrained):
    """Samples of future frames; the base class of SVG, SRVP and SLAMP.

    Frames of any size are resized to the network's square and back. Of the observed frames the last
    are used, as many as in training: with more, results get worse (SVG, shown ten instead of five,
    lost 1.3 dB). A sample depends on `seed`, the frames used and its own number alone, so the first
    samples of a hundred are those of fewer.
    """

    seed: int = 0

    @property
    def input_note(self) -> str:
        """Describe the network's square, and the frames it looks at."""
        settings = self.load()[1]
        height_px, width_px = settings.architecture.size_px
        return (
            f"works at {width_px}x{height_px} on the last {settings.num_past} frames, resized to "
            "the clip's size"
        )

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predict frames [S, F, H, W, 3]; raise Incompatible for fewer than two observed frames."""
        if context.num_past < 2:
            raise Incompatible(
                f"{self.method} goes by motion, the past has one frame: give num_past of 2 or more"
            )
        network, settings = self.load()
        size_px, recent = settings.architecture.size_px, context.recent(settings.num_past)
        height_px, width_px = context.frames.shape[1:3]
        frames = resize(recent.frames, size_px[1], size_px[0])
        is_grey = settings.architecture.coding.colours == 1
        observed = images_from_frames(grey(frames)[..., :1] if is_grey else frames)
        observed = observed.to(self.device)
        noise = noise_of(recent, self.seed, num_samples, network.noise_size).to(self.device)
        pixels_at_once = GPU_PIXELS if self.device.startswith("cuda") else CPU_PIXELS
        samples: list[ByteArray] = []
        with torch.inference_mode(), devices.one_thread():
            for chunk in noise.split(max(1, pixels_at_once // math.prod(size_px))):
                images = network.predict(observed.expand(len(chunk), -1, -1, -1, -1), chunk)
                predicted = frames_from_images(images.expand(-1, -1, 3, -1, -1))
                samples += [resize(each, width_px, height_px) for each in predicted]
        return Prediction(np.stack(samples))


class Svg(VideoPredictor):
    """SVG-LP (Denton and Fergus 2018) with given weights; see `VideoPredictor` for the settings."""

    method = "svg"


class SvgTiny(Svg):
    """SVG-LP with a quarter of the channels and short training; see `VideoPredictor`."""

    shipped = "svg-tiny"


class Srvp(VideoPredictor):
    """SRVP (Franceschi et al. 2020) with given weights; see `VideoPredictor` for the settings."""

    method = "srvp"


class SrvpTiny(Srvp):
    """SRVP with a quarter of the channels and short training; see `VideoPredictor`."""

    shipped = "srvp-tiny"


class Slamp(VideoPredictor):
    """SLAMP (Akan et al. 2021) with given weights; see `VideoPredictor` for the settings."""

    method = "slamp"


class SlampTiny(Slamp):
    """SLAMP with a quarter of the channels and short training; see `VideoPredictor`."""

    shipped = "slamp-tiny"


def noise_of(context: Context, seed: int, num_samples: int, size: int) -> Tensor:
    """Draw standard normal numbers [S, P + F, size], seeded by seed, frames and sample number."""
    clip = int.from_bytes(hashlib.sha256(context.frames.tobytes()).digest()[:8], "big")
    shape = (context.num_past + context.num_future, size)
    rows = [
        np.random.default_rng([seed, clip, sample]).standard_normal(shape, np.float32)
        for sample in range(num_samples)
    ]
    return torch.from_numpy(np.stack(rows))

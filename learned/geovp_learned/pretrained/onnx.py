"""ONNX files as a depth source and as an inpainter."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import onnxruntime

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.rendering.inpainting import inpaint_each
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views
from geovp_learned import checkpoints
from geovp_learned.pretrained.depth import NetworkDepth, normalised, note_on_weights

PROVIDER_OF_DEVICE = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}


@dataclass(frozen=True, kw_only=True)
class OnnxDepth(NetworkDepth):
    """Depth by an ONNX file that maps images [N, 3, H, W] or [N, H, W, 3] to maps [N, H, W].

    `fingerprint` identifies the file in results; when given, another file is refused.
    """

    path: Path
    size_px: tuple[int, int] | None = None  # (width, height) of the input; None: as in the file
    # Of red, green and blue in [0, 1]; many networks want those of ImageNet
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    output: int = 0  # index
    fingerprint: str = ""

    def __post_init__(self) -> None:
        fingerprint = checkpoints.fingerprint(self.path, self.fingerprint)
        object.__setattr__(self, "fingerprint", fingerprint)
        session_of(self.path, fingerprint, self.device)

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables."""
        return note_on_weights(f"onnx weights {self.path.name} {self.fingerprint}", self.device)

    def predict(self, frames: ByteArray) -> FloatArray:
        """Return the output [N, H', W']; raise BadData if the file does not fit the settings."""
        session = session_of(self.path, self.fingerprint, self.device)
        (image,) = (image_input(self.path, tensor) for tensor in session.get_inputs())
        images = normalised(frames, image.resolve(self.path, self.size_px), self.mean, self.std)
        if image.is_channel_last:
            images = np.moveaxis(images, 1, -1)
        batches = [images] if image.has_free_batch else np.split(images, len(images))
        with files.checked(f"{self.path} cannot be run", "adapt size_px and output to the file"):
            outputs = [
                session.run(None, {image.name: np.ascontiguousarray(batch)})[self.output]
                for batch in batches
            ]
            maps = np.concatenate(outputs).astype(np.float32)
            channel_axis = -1 if image.is_channel_last else 1
            return maps if maps.ndim == 3 else maps.squeeze(channel_axis)


@dataclass(frozen=True, kw_only=True)
class OnnxInpainter:
    """Inpainting by an ONNX file that maps an image and a mask to an image, as LaMa does.

    The image [1, 3, H, W] is in [0, 1]; the mask [1, 1, H, W] is 1 in holes. Covered pixels stay.
    """

    path: Path
    size_px: tuple[int, int] | None = None  # (width, height) of the input; None: as in the file
    output_max: float = 1.0  # of a white pixel; 255 for some files
    device: str = "cpu"
    fingerprint: str = ""

    def __post_init__(self) -> None:
        fingerprint = checkpoints.fingerprint(self.path, self.fingerprint)
        object.__setattr__(self, "fingerprint", fingerprint)
        session_of(self.path, fingerprint, self.device)

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables."""
        return note_on_weights(f"onnx weights {self.path.name} {self.fingerprint}", self.device)

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3]; a frame without covered pixels becomes the last one."""
        return inpaint_each(views, last, self._inpaint_frame)

    def _inpaint_frame(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        session = session_of(self.path, self.fingerprint, self.device)
        first, second = session.get_inputs()
        is_image_first = 3 in first.shape
        image_tensor, mask_tensor = (first, second) if is_image_first else (second, first)
        size_px = image_input(self.path, image_tensor).resolve(self.path, self.size_px)
        visible = np.where(covered[..., None], frame, np.uint8(0))
        image = normalised(visible[None], size_px, (0.0,) * 3, (1.0,) * 3)
        hole = cv2.resize((~covered).astype(np.float32), size_px, interpolation=cv2.INTER_LINEAR)
        mask = (hole > 0).astype(np.float32)[None, None]
        with files.checked(f"{self.path} cannot be run", "adapt size_px to the file"):
            feed = {image_tensor.name: image, mask_tensor.name: mask}
            (inpainted,) = session.run(None, feed)[0]
        colours = np.moveaxis(inpainted, 0, -1) * (255 / self.output_max)
        rounded = np.clip(np.rint(colours), 0, 255).astype(np.uint8)
        resized = pinhole.resize(rounded, (frame.shape[1], frame.shape[0]))
        return np.where(covered[..., None], frame, resized)


class ImageInput(NamedTuple):
    """Input of a network that takes images."""

    name: str
    is_channel_last: bool
    has_free_batch: bool
    size_px: tuple[int, int] | None  # (width, height); None if any size is accepted

    def resolve(self, path: Path, size_px: tuple[int, int] | None) -> tuple[int, int]:
        """Return the size (width, height) to use, given the user's; raise BadData without one."""
        size_px = size_px or self.size_px
        if size_px is None:
            raise BadData(f"{path} accepts images of any size: give size_px = [width, height]")
        return size_px


def image_input(path: Path, tensor: onnxruntime.NodeArg) -> ImageInput:
    """Describe an input; raise BadData unless it has four axes, one of them with 3 channels."""
    shape = tensor.shape
    if len(shape) != 4 or 3 not in (shape[1], shape[3]):
        raise BadData(
            f"{path}: input {tensor.name} has shape {shape}, expected [N, 3, H, W] or [N, H, W, 3]"
        )
    is_channel_last = shape[1] != 3
    height_px, width_px = shape[1:3] if is_channel_last else shape[2:4]
    is_fixed = isinstance(height_px, int) and isinstance(width_px, int)
    return ImageInput(
        tensor.name,
        is_channel_last,
        not isinstance(shape[0], int),
        (width_px, height_px) if is_fixed else None,
    )


@functools.lru_cache(maxsize=4)
def session_of(path: Path, fingerprint: str, device: str) -> onnxruntime.InferenceSession:
    """Open an ONNX file once per process; raise BadData if it is damaged or the device is missing.

    `device` is "cpu", "cuda" or "auto", which is a GPU where onnxruntime has one.
    """
    available = onnxruntime.get_available_providers()
    kind, _, number = device.partition(":")
    if kind == "auto":
        kind = "cuda" if PROVIDER_OF_DEVICE["cuda"] in available else "cpu"
    provider = PROVIDER_OF_DEVICE.get(kind, kind)
    if provider not in available:
        raise BadData(
            f"device {device!r}: onnxruntime has {', '.join(available)}: give 'cpu' or 'auto', or "
            "install onnxruntime-gpu"
        )
    options = [{"device_id": number}] if number else None
    with files.checked(f"{path} cannot be loaded", "give a whole ONNX file"):
        return onnxruntime.InferenceSession(str(path), None, [provider], options)

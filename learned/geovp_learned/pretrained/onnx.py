"""ONNX files as a depth source and as an inpainter."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnxruntime

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.rendering.inpainting import inpaint_each
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views
from geovp_learned import checkpoints
from geovp_learned.pretrained.depth import NetworkDepth, note_on_weights


@dataclass(frozen=True, kw_only=True)
class OnnxFile:
    """An ONNX file with an image as its input.

    `fingerprint` identifies the file in results; when given, another file is refused.
    """

    path: Path
    size_px: tuple[int, int] | None = None  # (width, height) of the input; None: as in the file
    device: str = "cpu"
    fingerprint: str = ""

    def __post_init__(self) -> None:
        fingerprint = checkpoints.fingerprint(self.path, self.fingerprint)
        object.__setattr__(self, "fingerprint", fingerprint)
        session(self)

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables."""
        return note_on_weights(f"onnx weights {self.path.name} {self.fingerprint}", self.device)

    def input_size(self, shape: Sequence[int | str]) -> tuple[int, int]:
        """Return the size (width, height) of an input of this shape; raise BadData unless it has
        four axes, 3 channels, and a size.
        """
        if len(shape) != 4 or 3 not in (shape[1], shape[3]):
            raise BadData(
                f"{self.path}: the input has shape {shape}, expected [N, 3, H, W] or [N, H, W, 3]"
            )
        height_px, width_px = shape[2:] if shape[1] == 3 else shape[1:3]
        if self.size_px is not None:
            return self.size_px
        if isinstance(height_px, int) and isinstance(width_px, int):
            return width_px, height_px
        raise BadData(f"{self.path} accepts images of any size: give size_px = [width, height]")


@dataclass(frozen=True, kw_only=True)
class OnnxDepth(OnnxFile, NetworkDepth):
    """Depth by an ONNX file that maps images [N, 3, H, W] or [N, H, W, 3] to maps [N, H, W].

    The other settings are those of `OnnxFile` and `NetworkDepth`.
    """

    # Of red, green and blue in [0, 1]; many networks want those of ImageNet
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    output: int = 0  # index

    def predict(self, frames: ByteArray) -> FloatArray:
        """Return the output [N, H', W']; raise BadData if the file does not fit the settings."""
        (tensor,) = session(self).get_inputs()
        images = normalised(frames, self.input_size(tensor.shape), self.mean, self.std)
        channel_axis = 1 if tensor.shape[1] == 3 else -1
        images = np.ascontiguousarray(np.moveaxis(images, 1, channel_axis))
        num_batches = len(images) if isinstance(tensor.shape[0], int) else 1
        with files.checked(f"{self.path} cannot be run", "adapt size_px and output to the file"):
            outputs = [
                session(self).run(None, {tensor.name: batch})[self.output]
                for batch in np.split(images, num_batches)
            ]
            maps = np.concatenate(outputs).astype(np.float32)
            return maps if maps.ndim == 3 else maps.squeeze(channel_axis)


@dataclass(frozen=True, kw_only=True)
class OnnxInpainter(OnnxFile):
    """Inpainting by an ONNX file that maps an image and a mask to an image, as LaMa does.

    The image [1, 3, H, W] is in [0, 1]; the mask [1, 1, H, W] is 1 in holes. Covered pixels stay.
    The other settings are those of `OnnxFile`.
    """

    output_max: float = 1.0  # of a white pixel; 255 for some files

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3]; a frame without covered pixels becomes the last one."""
        return inpaint_each(views, last, self._inpaint_frame)

    def _inpaint_frame(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        inputs = session(self).get_inputs()
        image_input, mask_input = sorted(inputs, key=lambda tensor: 3 not in tensor.shape)
        size_px = self.input_size(image_input.shape)
        visible = np.where(covered[..., None], frame, np.uint8(0))
        image = normalised(visible[None], size_px)
        hole = cv2.resize((~covered).astype(np.float32), size_px)
        mask = (hole > 0).astype(np.float32)[None, None]
        with files.checked(f"{self.path} cannot be run", "adapt size_px to the file"):
            feed = {image_input.name: image, mask_input.name: mask}
            (inpainted,) = session(self).run(None, feed)[0]
        colours = np.rint(np.moveaxis(inpainted, 0, -1) * (255 / self.output_max))
        resized = pinhole.resize(
            colours.clip(0, 255).astype(np.uint8), (frame.shape[1], frame.shape[0])
        )
        return np.where(covered[..., None], frame, resized)


def normalised(
    frames: ByteArray,  # [N, H, W, 3]
    size_px: tuple[int, int],  # (width, height)
    mean: tuple[float, ...] = (0.0,),  # of the red, green and blue in [0, 1]
    std: tuple[float, ...] = (1.0,),
) -> FloatArray:
    """Return images [N, 3, H', W'] float32 of a network's size, mean and standard deviation."""
    resized = np.stack([pinhole.resize(frame, size_px) for frame in frames])
    images = (resized / np.float32(255) - np.array(mean)) / np.array(std)
    return np.moveaxis(images.astype(np.float32), -1, 1)


@functools.lru_cache(maxsize=4)
def session(file: OnnxFile) -> onnxruntime.InferenceSession:
    """Open an ONNX file once per process; raise BadData if it is damaged or the device is missing.

    `device` is "cpu", "cuda" or "auto", which is a GPU where onnxruntime has one.
    """
    available = onnxruntime.get_available_providers()
    kind, _, number = file.device.partition(":")
    if kind == "auto":
        kind = "cuda" if "CUDAExecutionProvider" in available else "cpu"
    provider = f"{kind.upper()}ExecutionProvider"
    if provider not in available:
        raise BadData(
            f"device {file.device!r}: onnxruntime has {', '.join(available)}: give 'cpu' or "
            "'auto', or install onnxruntime-gpu"
        )
    options = [{"device_id": number}] if number else None
    with files.checked(f"{file.path} cannot be loaded", "give a whole ONNX file"):
        return onnxruntime.InferenceSession(str(file.path), None, [provider], options)

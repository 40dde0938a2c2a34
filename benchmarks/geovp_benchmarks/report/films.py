"""The kept clips as films: one image that holds the frames of a method side by side."""

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from geovp_benchmarks.plots import clips
from geovp_benchmarks.plots.material import Material
from geovp_classic.types import BoolArray, ByteArray

MAX_BYTES = 6_500_000  # of all films, 8.7 MB in base64: a page stays below 10 MB
BITS_PER_PIXEL = 0.6  # of frames of a street at quality 50, measured on KITTI
MAX_SHEET_PX = 16383  # width of a WebP image


@dataclass(frozen=True)
class Format:
    """What of the frames is shown, so that all films of a page together have `MAX_BYTES`."""

    stride: int  # each n-th frame from the last observed one on
    width_px: int
    max_bytes: int  # of a film, unless it has more at the lowest quality

    @classmethod
    def of(cls, num_films: int, num_frames: int, height_per_width: float) -> "Format":
        """Return smaller frames if there are many, and below 150 pixels also fewer frames."""
        max_bytes = MAX_BYTES // max(num_films, 1)
        for stride in (1, 2, 4):
            num_shown = math.ceil(num_frames / stride)
            pixels = 8 * max_bytes / BITS_PER_PIXEL / num_shown
            width_px = min(math.isqrt(int(pixels / height_per_width)), 208)
            if width_px >= 150:
                break
        return cls(stride, min(width_px, MAX_SHEET_PX // num_shown), max_bytes)


@dataclass(frozen=True)
class Film:
    """The last observed frame and the future frames of a method, or of the ground truth."""

    name: str
    notes: Sequence[str]
    num_frames: int
    image: bytes  # WebP
    mask: bytes | None  # PNG


def of_clip(material: Material, name: str, shown: Format) -> Iterator[Film]:
    """Yield the ground truth, then the predictions of a clip."""
    clip, last = material.results.clips().read(name), material.protocol["num_past"] - 1
    yield encode("ground truth", [], clip.frames[last:], None, shown)
    for method, prediction in material.predictions(name, material.methods):
        frames = np.concatenate([clip.frames[last : last + 1], prediction.frames[0]])
        covered = prediction.covered
        if covered is not None:
            covered = np.pad(covered[0], ((1, 0), (0, 0), (0, 0)), constant_values=True)
        yield encode(method.label, clips.notes(material, method, name), frames, covered, shown)


def encode(
    name: str,
    notes: Sequence[str],
    frames: ByteArray,
    covered: BoolArray | None,  # [K, H, W], False where pixels are inpainted
    shown: Format,
) -> Film:
    """Return frames [K, H, W, 3] as WebP, and inpainted pixels as PNG, transparent elsewhere."""
    frames, mask = frames[:: shown.stride], None
    sheet = _side_by_side(frames, shown)
    for quality in (50, 35, 20):
        image = _encoded(sheet, "WEBP", quality=quality)
        if len(image) <= shown.max_bytes:
            break
    if covered is not None:
        values = np.where(covered[:: shown.stride], 0, 255).astype(np.uint8)
        is_inpainted = _side_by_side(values, shown).point(lambda value: value >= 128)
        tints = Image.frombytes("P", is_inpainted.size, is_inpainted.tobytes())
        tints.putpalette([0, 0, 0, 214, 39, 160])  # pink, which streets do not have
        mask = _encoded(tints, "PNG", transparency=0, bits=1)
    return Film(name, notes, len(frames), image, mask)


def _side_by_side(frames: ByteArray, shown: Format) -> Image.Image:
    """Return frames [K, H, W, ...] as one image."""
    sheet = Image.fromarray(np.concatenate(list(frames), axis=1))
    sheet.thumbnail((len(frames) * shown.width_px, sheet.height))
    return sheet


def _encoded(image: Image.Image, kind: str, **settings: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **settings)
    return buffer.getvalue()

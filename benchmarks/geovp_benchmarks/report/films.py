"""The kept clips as films: one image that holds all frames of a method side by side."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image

from geovp_benchmarks.plots import kept_clips
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.plots.strips import INPAINTED
from geovp_benchmarks.report.findings import Headline
from geovp_classic.types import BoolArray, ByteArray


@dataclass(frozen=True)
class Film:
    """The last observed frame and all future frames of a method, or of the ground truth."""

    name: str
    notes: Sequence[str]
    num_frames: int
    aspect_ratio: float
    image: bytes  # WebP
    mask: bytes | None  # PNG that tints inpainted pixels


@dataclass(frozen=True)
class ShownClip:
    """A kept clip with its films; the first film is the ground truth."""

    name: str
    score: float  # of the method that orders the clips; NaN where there is none
    films: Sequence[Film]


def shown_clips(material: Material, headline: Headline) -> list[ShownClip]:
    """Return the kept clips that have predictions, those with the worst score first."""
    names = [name for name, _ in material.results.clips()]
    is_higher_better = headline.column is None or headline.column.higher_is_better
    sign = 1.0 if is_higher_better else -1.0
    names.sort(key=lambda name: np.nan_to_num(sign * headline.score(name), nan=np.inf))
    clips = [ShownClip(name, headline.score(name), _films(material, name)) for name in names]
    return [clip for clip in clips if len(clip.films) > 1]


def encode_film(frames: ByteArray, width_px: int = 208, quality: int = 60) -> bytes:
    """Encode frames [K, H, W, 3] from left to right as WebP, each at most `width_px` wide."""
    sheet = np.concatenate([_small(frame, width_px) for frame in frames], axis=1)
    buffer = io.BytesIO()
    Image.fromarray(sheet).save(buffer, "WEBP", quality=quality)
    return buffer.getvalue()


def encode_mask(covered: BoolArray, width_px: int = 208) -> bytes:
    """Encode uncovered pixels [K, H, W] from left to right as PNG, transparent elsewhere."""
    inpainted = np.where(covered, np.uint8(0), np.uint8(255))
    sheet = np.concatenate([_small(frame, width_px) > 127 for frame in inpainted], axis=1)
    image = Image.fromarray(sheet.astype(np.uint8), "P")
    image.putpalette([0, 0, 0, *INPAINTED])
    buffer = io.BytesIO()
    image.save(buffer, "PNG", transparency=0, bits=1)
    return buffer.getvalue()


def _films(material: Material, name: str) -> list[Film]:
    clip, past = material.results.clip(name), material.protocol["num_past"]
    films = [_film("ground truth", [], clip.frames[past - 1 :])]
    for method in material.methods:
        if name not in dict(material.results.predictions(method.name)):
            continue
        prediction = material.results.prediction(method.name, name)
        frames = np.concatenate([clip.frames[past - 1 : past], prediction.frames[0]])
        covered = None
        if prediction.covered is not None and not prediction.covered[0].all():
            covered = np.pad(prediction.covered[0], ((1, 0), (0, 0), (0, 0)), constant_values=True)
        notes = kept_clips.notes(material, method, name, len(prediction.frames))
        films.append(_film(method.label, notes, frames, covered))
    return films


def _film(
    name: str, notes: Sequence[str], frames: ByteArray, covered: BoolArray | None = None
) -> Film:
    num_frames, height_px, width_px = frames.shape[:3]
    mask = None if covered is None else encode_mask(covered)
    return Film(name, notes, num_frames, width_px / height_px, encode_film(frames), mask)


def _small(image: ByteArray, width_px: int) -> ByteArray:
    """Shrink an image to a width."""
    scale = min(1.0, width_px / image.shape[1])
    size_px = round(image.shape[1] * scale), max(1, round(image.shape[0] * scale))
    return np.asarray(cv2.resize(image, size_px, interpolation=cv2.INTER_AREA), np.uint8)

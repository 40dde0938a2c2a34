"""The kept clips as films: one image that holds all frames of a method side by side."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from PIL import Image

from geovp_benchmarks.plots import clips
from geovp_benchmarks.plots.material import Material
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
    mask: bytes | None = None  # PNG that tints inpainted pixels


@dataclass(frozen=True)
class ShownClip:
    """A kept clip with its films; the first film is the ground truth."""

    name: str
    score: float  # of the method that orders the clips; NaN where there is none
    films: Sequence[Film]


def shown_clips(material: Material, headline: Headline | None) -> list[ShownClip]:
    """Return the kept clips that have predictions, those with the worst score first."""
    shown = []
    for name in material.clips:
        films = _films(material, name)
        if len(films) > 1:
            shown.append(ShownClip(name, headline.score(name) if headline else np.nan, films))
    sign = 1 if headline is None or headline.column.higher_is_better else -1
    return sorted(shown, key=lambda clip: np.nan_to_num(sign * clip.score, nan=np.inf))


def encode_film(frames: ByteArray) -> bytes:
    """Encode frames [K, H, W, 3] from left to right as WebP."""
    return _encode(_sheet(frames), "WEBP")


def encode_mask(covered: BoolArray) -> bytes:
    """Encode uncovered pixels [K, H, W] from left to right as PNG, transparent elsewhere."""
    is_inpainted = _sheet(np.where(covered, np.uint8(0), np.uint8(255))) > 127
    pink = np.array([214, 39, 160, 255], np.uint8)  # a colour that streets do not have
    return _encode(is_inpainted[..., None] * pink, "PNG")


def _encode(image: ByteArray, kind: str) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, kind, quality=60)  # of WebP
    return buffer.getvalue()


def _films(material: Material, name: str) -> list[Film]:
    clip, last = material.results.clip(name), material.protocol["num_past"] - 1
    films = [_film("ground truth", [], clip.frames[last:])]
    for method, prediction in material.predictions(name, material.methods):
        frames = np.concatenate([clip.frames[last : last + 1], prediction.frames[0]])
        film = _film(method.label, clips.notes(material, method, name), frames)
        if prediction.covered is not None:
            covered = np.pad(prediction.covered[0], ((1, 0), (0, 0), (0, 0)), constant_values=True)
            film = replace(film, mask=encode_mask(covered))
        films.append(film)
    return films


def _film(name: str, notes: Sequence[str], frames: ByteArray) -> Film:
    num_frames, height_px, width_px = frames.shape[:3]
    return Film(name, notes, num_frames, width_px / height_px, encode_film(frames))


def _sheet(frames: ByteArray, width_px: int = 208) -> ByteArray:
    """Return frames [K, H, W, ...] side by side, each at most `width_px` wide."""
    num_frames, full_height_px, full_width_px = frames.shape[:3]
    scale = min(1.0, width_px / full_width_px)
    size_px = num_frames * round(scale * full_width_px), max(1, round(scale * full_height_px))
    sheet = np.concatenate(list(frames), axis=1)
    return np.asarray(cv2.resize(sheet, size_px, interpolation=cv2.INTER_AREA), np.uint8)

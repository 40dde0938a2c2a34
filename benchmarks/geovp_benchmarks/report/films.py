"""The kept clips as films: one image that holds all frames of a method side by side."""

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

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
    frames: ByteArray  # [K, H, W, 3]
    covered: BoolArray | None = None  # [K, H, W], False where pixels are inpainted

    @property
    def image(self) -> bytes:
        """Return the frames from left to right as WebP."""
        return _encoded(_sheet(self.frames), "WEBP", quality=60)

    @property
    def mask(self) -> bytes | None:
        """Return an image as PNG that tints inpainted pixels and is transparent elsewhere."""
        if self.covered is None:
            return None
        grey = _sheet(np.where(self.covered, np.uint8(0), np.uint8(255)))
        tint = Image.new("RGBA", grey.size, (214, 39, 160))  # pink, which streets do not have
        tint.putalpha(grey.point(lambda value: 255 * (value > 127)))
        return _encoded(tint, "PNG")


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
        films = list(_films(material, name))
        if len(films) > 1:
            shown.append(ShownClip(name, headline.score(name) if headline else math.nan, films))
    sign = 1 if headline is None or headline.column.higher_is_better else -1
    return sorted(shown, key=lambda clip: np.nan_to_num(sign * clip.score, nan=np.inf))


def _films(material: Material, name: str) -> Iterator[Film]:
    """Yield the ground truth, then the predictions of a clip."""
    clip, last = material.results.clips().read(name), material.protocol["num_past"] - 1
    yield Film("ground truth", [], clip.frames[last:])
    for method, prediction in material.predictions(name, material.methods):
        frames = np.concatenate([clip.frames[last : last + 1], prediction.frames[0]])
        covered = prediction.covered
        if covered is not None:
            covered = np.pad(covered[0], ((1, 0), (0, 0), (0, 0)), constant_values=True)
        yield Film(method.label, clips.notes(material, method, name), frames, covered)


def _sheet(frames: ByteArray, width_px: int = 208) -> Image.Image:
    """Return frames [K, H, W, ...] side by side, each at most `width_px` wide."""
    sheet = Image.fromarray(np.concatenate(list(frames), axis=1))
    sheet.thumbnail((len(frames) * width_px, sheet.height))
    return sheet


def _encoded(image: Image.Image, kind: str, **settings: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **settings)
    return buffer.getvalue()

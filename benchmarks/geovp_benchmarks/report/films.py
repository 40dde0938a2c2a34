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
from geovp_benchmarks.report.findings import Findings
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
        """Return the frames as WebP."""
        return _encoded(self.frames, "WEBP", quality=60)

    @property
    def mask(self) -> bytes | None:
        """Return an image as PNG that tints inpainted pixels and is transparent elsewhere."""
        if self.covered is None:
            return None
        pink = np.array([214, 39, 160, 255], np.uint8)  # which streets do not have
        return _encoded(np.where(self.covered[..., None], np.uint8(0), pink), "PNG")


@dataclass(frozen=True)
class ShownClip:
    """A kept clip with its films; the first film is the ground truth."""

    name: str
    score: float  # of the method that orders the clips; NaN where there is none
    films: Sequence[Film]


def shown_clips(material: Material, findings: Findings | None) -> list[ShownClip]:
    """Return the kept clips that have predictions, those with the worst score first."""
    scores = findings.clip_scores if findings else {}
    sign = 1 if findings is None or findings.column.higher_is_better else -1
    shown = []
    for name in material.clips:
        films = list(_films(material, name))
        if len(films) > 1:
            shown.append(ShownClip(name, scores.get(name, math.nan), films))
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


def _encoded(frames: ByteArray, kind: str, width_px: int = 208, **settings: Any) -> bytes:
    """Return frames [K, H, W, ...] side by side, each at most `width_px` wide, as a file."""
    sheet = Image.fromarray(np.concatenate(list(frames), axis=1))
    sheet.thumbnail((len(frames) * width_px, sheet.height))
    buffer = io.BytesIO()
    sheet.save(buffer, kind, **settings)
    return buffer.getvalue()

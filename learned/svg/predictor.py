"""SVG as a component."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from learned.video.prediction import VideoPredictor


@dataclass(frozen=True)
class Svg(VideoPredictor):
    """SVG's samples; see `VideoPredictor` for the settings."""

    method: ClassVar[str] = "svg"

"""SLAMP as a component."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from learned.video.prediction import VideoPredictor


@dataclass(frozen=True)
class Slamp(VideoPredictor):
    """SLAMP's samples; see `VideoPredictor` for the settings."""

    method: ClassVar[str] = "slamp"

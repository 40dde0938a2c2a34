"""How bright the coming pictures will be: cameras on vehicles set their exposure anew for every frame.

What the camera has just shown comes out a fifth brighter or darker a second later, because sky or shadow has come into
view. Two things tell: exposure goes on changing for a moment as it did in the last frames (a damped trend, Gardner &
McKenzie 1985), and the control behind it holds the mean of the picture, so that a part of what would make the picture
brighter or darker is taken back. How much a camera does so shows in the observed frames: a fixed exposure stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.interfaces import Scene
from geovp_classic.render import surface
from geovp_classic.render.pace import seconds_of
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

WIDTH_PX = 128  # of the smaller pictures that are compared
DARKEST, BRIGHTEST = 20.0, 235.0  # grey values outside say nothing
MIN_SHARE = 0.02  # of the picture that must be comparable
TREND_STEPS = 2  # how many steps back the trend is taken from
MEMORY_S = 0.1  # how long a trend goes on
HELD = 0.5  # the share of a change of the mean that exposure control takes back
STEADY = 0.008  # log gain from frame to frame (RMS) at which half of that is believed of a camera
LARGEST_GAIN = 2.0


@dataclass(frozen=True)
class Exposure:
    """What the observed frames tell about the camera's exposure."""

    log_gains: FloatArray  # [P], how much brighter the last frame shows the same things than each frame
    log_rate_hz: float  # how fast the logarithm of the brightness of things changed in the end
    held: float  # the share of a change of the mean that is taken back

    @classmethod
    def of(
        cls,
        sources: Sequence[surface.Source],  # P, the last observed frame last
        inverse_depth: FloatArray,  # [H, W] of the last one
        seconds: FloatArray,  # [P], 0 for the last one
    ) -> Exposure:
        """The exposure as the things in the last frame tell; steady where there is one frame only."""
        gains = _log_gains(sources, inverse_depth)
        before = slice(-1 - TREND_STEPS, -1)
        span = float((seconds[before] ** 2).sum())
        rate = -float((seconds[before] * gains[before]).sum()) / span if span > 0 else 0.0
        variance = float((np.diff(gains) ** 2).mean()) if len(gains) > 1 else 0.0
        return cls(gains, rate, HELD * variance / (variance + STEADY**2))

    def matched(self, sources: Sequence[surface.Source]) -> list[surface.Source]:
        """The sources [P], each as bright as the last frame would show it."""
        return [
            replace(one, frame=_times(one.frame, gain), detail=None if one.detail is None else _times(one.detail, gain))
            for one, gain in zip(sources, np.exp(self.log_gains), strict=True)
        ]

    def forecast(
        self,
        frames: ByteArray,  # [F, H, W, 3] as bright as the last observed one would show them
        level: float,  # the mean of the last observed frame
        seconds: FloatArray,  # [F] since then
    ) -> ByteArray:
        """The frames as bright as the camera will probably show them."""
        trend = self.log_rate_hz * MEMORY_S * (1 - np.exp(-seconds / MEMORY_S))
        exposed = np.empty_like(frames)
        for step, (frame, log_gain) in enumerate(zip(frames, trend, strict=True)):
            mean = float(np.mean(cv2.mean(frame)[:3]))
            change = np.log(max(level, 1.0) / max(mean, 1.0)) - log_gain
            gain = np.exp(log_gain + self.held * change)
            exposed[step] = _times(frame, float(np.clip(gain, 1 / LARGEST_GAIN, LARGEST_GAIN)))
        return exposed


@dataclass(frozen=True)
class Exposed:
    """A scene as the camera will show it; the k-th pose is taken to be the camera's at the k-th future time."""

    scene: Scene
    last: surface.Source  # the last observed frame
    exposure: Exposure
    seconds: FloatArray  # [F] since the last observed frame

    def view(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> Views:
        """The scene from the poses [F, 4, 4]."""
        views = self.scene.view(world_from_cam, intrinsics)
        u, v = np.ascontiguousarray(np.moveaxis(surface.own_pixels(self.last, intrinsics), -1, 0))
        seen = cv2.remap(self.last.frame, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        seconds = seconds_of(self.seconds, len(world_from_cam))
        return replace(views, frames=self.exposure.forecast(views.frames, float(np.mean(seen)), seconds))


def _log_gains(sources: Sequence[surface.Source], inverse_depth: FloatArray) -> FloatArray:
    """The median over what is neither black nor white in both frames; 0 where too little is comparable."""
    last = sources[-1]
    scale = min(1.0, WIDTH_PX / last.camera.width_px)
    width, height = (max(1, round(side * scale)) for side in (last.camera.width_px, last.camera.height_px))
    camera = last.camera.resized(width, height)
    depth = cv2.resize(inverse_depth.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)
    pictures = [_small(source.frame, (width, height)) for source in sources]
    gains = np.zeros(len(sources))
    for step, source in enumerate(sources[:-1]):
        small = replace(source, camera=camera)
        pixels, ratio = surface.source_pixels(small, np.asarray(depth), last.world_from_source, camera)
        u, v = np.ascontiguousarray(np.moveaxis(pixels, -1, 0))
        was = np.asarray(cv2.remap(pictures[step], u, v, cv2.INTER_LINEAR))  # outside: 0, too dark
        comparable = ratio > 0
        for one in (was, pictures[-1]):
            comparable &= (one > DARKEST) & (one < BRIGHTEST)
        if comparable.mean() >= MIN_SHARE:
            gains[step] = np.median(np.log(pictures[-1][comparable] / was[comparable]))
    return gains


def _small(frame: ByteArray, size_px: tuple[int, int]) -> FloatArray:
    """The frame in grey, smaller and without its finest detail, which no depth is exact enough for."""
    grey = cv2.resize(
        cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2GRAY), size_px, interpolation=cv2.INTER_AREA
    )
    return np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.5))


def _times(frame: ByteArray, gain: float) -> ByteArray:
    """The frame, brighter or darker."""
    table = np.clip(np.arange(256) * gain + 0.5, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(frame, table))

"""Auto exposure: how bright the future frames will be.

Cameras on vehicles set their exposure anew for every frame; sky or shadow that comes into view
makes the same surfaces a fifth brighter or darker a second later. The control loop holds the mean
of the camera's whole image, with a lag of some tenths of a second. Where the future whole image can
be rendered (uncropped frames), so can its mean. Of a square crop only the crop's own mean is known,
which is held less exactly; its last level counts as the set point. How strongly a camera reacts
shows in the observed frames: a fixed exposure stays. Saturated pixels hardly darken.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.interfaces import Scene
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering import patches
from geovp_classic.rendering.grey_images import is_grey
from geovp_classic.rendering.image_sampler import resampled
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

WIDTH_PX = 128  # of the smaller images that are compared
DARKEST, BRIGHTEST = 20.0, 235.0  # grey values outside are not compared
DARK_SHARE = 0.3  # of an image's mean: what dim images have above it is not too dark
MIN_SHARE = 0.02  # of the image that must be comparable
TREND_STEPS = 2  # how many steps back the speed of the exposure is taken from
# RMS log gain from frame to frame at which the confidence in an active control is one half
STEADY_LOG_GAIN = 0.008
LARGEST_RATE_HZ, JUMP_HZ = (
    1.5,
    3.0,
)  # log gain per second: of a control that goes on; beyond it a change is a jump
HELD = 0.3  # log step of the mean from its level beyond which the level counts for little
LARGEST_LOG_GAIN = math.log(2)
SATURATED = 235.0  # grey values above this one are partly saturated
SATURATED_SHARE = 0.3  # of a darkening (in log steps) that saturated pixels show
SATURATED_BLUR_PX = 1.5
CONTROL_STEP_S, MOST_STEPS = (
    0.1,
    600,
)  # between two steps of the control, as between two frames; it has long settled then
METER_PX = 64  # height of the whole images that the future mean is taken from
GREYS = np.arange(256.0)
SATURATION = np.clip((GREYS - SATURATED) / (255 - SATURATED), 0, 1) ** 2


@dataclass(frozen=True)
class Exposure:
    """The exposure of the observed frames, relative to the last one."""

    seconds: FloatArray  # [P] since the last frame
    log_gains: (
        FloatArray  # [P], how much brighter the last frame shows the same surfaces than each frame
    )
    log_rate_hz: float  # speed of the log brightness of the same surfaces at the last frame
    log_level: float  # the logarithm of the mean of an image, on average over the observed ones
    # that the exposure is controlled: 0 for one that does not change, towards 1 for a lively one
    confidence: float

    @classmethod
    def of(
        cls,
        sources: Sequence[patches.Source],  # P, the last observed frame last
        inverse_depth: FloatArray,  # [H, W] of the last one
        seconds: FloatArray,  # [P], 0 for the last one
    ) -> Self:
        """The exposure from the surfaces that the last frame shows; constant for a single frame.

        A jump is not made by the control: it is taken out of level, speed and confidence.
        """
        gains = _log_gains(sources, inverse_depth)
        steps = np.diff(gains, append=0.0)
        jumps = np.where(np.abs(steps) > JUMP_HZ * np.diff(seconds, append=0.0), steps, 0.0)
        jumped = -np.cumsum(jumps[::-1])[
            ::-1
        ]  # log gain of all jumps between each frame and the last one
        before, controlled = slice(-1 - TREND_STEPS, -1), gains - jumped
        span = float((seconds[before] ** 2).sum())
        rate = -float((seconds[before] * controlled[before]).sum()) / span if span > 0 else 0.0
        rate = float(np.clip(rate, -LARGEST_RATE_HZ, LARGEST_RATE_HZ))
        variance = float((np.diff(controlled) ** 2).mean()) if len(gains) > 1 else 0.0
        levels = np.array([_log_mean(source.frame) for source in sources]) + jumped
        off = (
            float(np.mean(levels)) - levels[-1]
        )  # a level that the camera left for good is no longer held
        level = float(levels[-1] + off / (1 + (off / HELD) ** 4))
        return cls(seconds, gains, rate, level, variance / (variance + STEADY_LOG_GAIN**2))

    def match(self, sources: Sequence[patches.Source]) -> list[patches.Source]:
        """The sources [P], each as bright as the last frame would show it."""

        def matched(step: int) -> patches.Source:
            one, gain = sources[step], float(self.log_gains[step])
            detail = None if one.detail is None else apply_log_gain(one.detail, gain)
            return replace(one, frame=apply_log_gain(one.frame, gain), detail=detail)

        return parallel_map(matched, range(len(sources)))


@dataclass(frozen=True)
class ExposureControl:
    """A second-order control loop with inertia that draws the mean of the image towards a level."""

    inertia_s: float = 0.11  # time constant of the speed of the log exposure
    pull_hz: float = 3.3  # target speed per log step of the mean from its level

    def __post_init__(self) -> None:
        if not (self.inertia_s > 0 and self.pull_hz > 0):
            raise BadData(
                f"exposure: inertia_s {self.inertia_s} and pull_hz {self.pull_hz} must be positive"
            )

    def log_gain(
        self,
        measured: Exposure,
        since_s: float,  # the last observed frame; negative before it
        histogram: FloatArray,  # [256] of the image then, at the exposure of the last observed one
        last: FloatArray,  # [256] of the last observed one
        log_level: float,  # the logarithm of the mean that the control holds
    ) -> float:
        """By how much brighter the image is than the last frame's exposure would show it.

        At past times interpolated between the measured gains, at future ones simulated, while the
        histogram changes linearly from the last frame's to that of the image then.
        """
        if since_s <= 0:
            return float(-np.interp(since_s, measured.seconds, measured.log_gains))
        gain, speed_hz, off = (
            0.0,
            measured.log_rate_hz,
            _log(float(last @ tone_curve(0.0))) - log_level,
        )
        num_steps = min(max(1, round(since_s / CONTROL_STEP_S)), MOST_STEPS)
        dt_s = since_s / num_steps
        lasting = math.exp(-dt_s / self.inertia_s)
        for share in np.arange(1, num_steps + 1) / num_steps:
            speed_hz = (
                lasting * speed_hz
                - (1 - lasting) * measured.confidence * min(self.pull_hz, 1 / dt_s) * off
            )
            gain = min(max(gain + speed_hz * dt_s, -LARGEST_LOG_GAIN), LARGEST_LOG_GAIN)
            off = _log(float((last + share * (histogram - last)) @ tone_curve(gain))) - log_level
        return gain


@dataclass(frozen=True)
class ExposedScene:
    """A scene at the exposure that its camera has at each time."""

    scene: Scene
    last: patches.Source  # the last observed frame
    exposure: Exposure
    control: ExposureControl
    last_s: float  # the time of the last observed frame
    # whether the observed frames are the camera's whole images, whose mean the control holds
    whole: bool

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F]."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if self.whole:
            metered, now = self._metered(world_from_cam, times_s), self.last.frame
        else:
            metered, now = views.frames, resampled(self.last, intrinsics)
        level, last = self.exposure.log_level if self.whole else _log_mean(now), _histogram(now)

        def expose(step: int) -> ByteArray:
            since_s = float(times_s[step]) - self.last_s
            gain = self.control.log_gain(
                self.exposure, since_s, _histogram(metered[step]), last, level
            )
            return apply_log_gain(views.frames[step], gain)

        return replace(views, frames=np.stack(parallel_map(expose, range(len(times_s)))))

    def _metered(self, world_from_cam: FloatArray, times_s: FloatArray) -> ByteArray:
        """The camera's whole images [F, h, w, 3], small: their means are what its control holds."""
        camera = self.last.camera
        scale = min(1.0, METER_PX / camera.height_px)
        meter = camera.resized(
            *(max(1, round(side * scale)) for side in (camera.width_px, camera.height_px))
        )
        return self.scene.view(world_from_cam, times_s, meter).frames


def _log_gains(sources: Sequence[patches.Source], inverse_depth: FloatArray) -> FloatArray:
    """Log gains [P] to the last frame: medians over pixels neither dark nor saturated in both; 0
    for too few.
    """
    last = sources[-1]
    scale = min(1.0, WIDTH_PX / last.camera.width_px)
    width, height = (
        max(1, round(side * scale)) for side in (last.camera.width_px, last.camera.height_px)
    )
    camera = last.camera.resized(width, height)
    depth = cv2.resize(
        inverse_depth.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST
    )
    images = parallel_map(lambda source: _small(source.frame, (width, height)), sources)

    def gain(step: int) -> float:
        small = replace(sources[step], camera=camera)
        pixels, ratio = patches.source_pixels(
            small, np.asarray(depth), last.world_from_source, camera
        )
        u, v = np.ascontiguousarray(np.moveaxis(pixels, -1, 0))
        was = np.asarray(cv2.remap(images[step], u, v, cv2.INTER_LINEAR))
        comparable = (ratio > 0) & (was > 0)  # outside it is 0
        for one, image in ((was, images[step]), (images[-1], images[-1])):
            comparable &= (one > min(DARKEST, DARK_SHARE * float(image.mean()))) & (one < BRIGHTEST)
        if comparable.mean() < MIN_SHARE:
            return 0.0
        return float(np.median(np.log(images[-1][comparable] / was[comparable])))

    return np.array([*parallel_map(gain, range(len(sources) - 1)), 0.0])


def _small(frame: ByteArray, size_px: tuple[int, int]) -> FloatArray:
    """The frame in grey, smaller and without its finest detail, for which no depth is
    exact enough.
    """
    grey = cv2.resize(
        cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2GRAY),
        size_px,
        interpolation=cv2.INTER_AREA,
    )
    return np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.5))


def tone_curve(log_gain: float) -> FloatArray:
    """New values [256] of the grey values 0..255, at most 255; saturated ones darken less."""
    return np.minimum(GREYS * math.exp(log_gain) + SATURATION * _highlight_offset(log_gain), 255)


def apply_log_gain(frame: ByteArray, log_gain: float) -> ByteArray:
    """The frame after the tone curve; saturation is blurred, so that texture in white areas is not
    amplified.
    """
    if is_grey(frame):  # takes a third of the time
        return np.asarray(
            cv2.cvtColor(_apply_log_gain(frame[..., 0], log_gain), cv2.COLOR_GRAY2RGB), np.uint8
        )
    return _apply_log_gain(frame, log_gain)


def _apply_log_gain(frame: ByteArray, log_gain: float) -> ByteArray:
    offset = _highlight_offset(log_gain)
    darker = np.minimum(GREYS * math.exp(log_gain) + 0.5, 255).astype(np.uint8)
    plain: ByteArray = np.asarray(cv2.LUT(frame, darker), np.uint8)
    if offset < 0.5 or not (frame > SATURATED).any():
        return plain
    white = cv2.GaussianBlur(
        cv2.LUT(frame, SATURATION.astype(np.float32)), (0, 0), SATURATED_BLUR_PX
    )
    return np.asarray(cv2.add(plain, (offset * white + 0.5).astype(np.uint8)))


def _highlight_offset(log_gain: float) -> float:
    """How much brighter a saturated pixel stays than 255 times the gain."""
    return (
        255 * (math.exp(SATURATED_SHARE * log_gain) - math.exp(log_gain)) if log_gain < 0 else 0.0
    )


def _histogram(frame: ByteArray) -> FloatArray:
    """The shares [256] of the grey values, of all channels together."""
    counts = cv2.calcHist([frame.reshape(len(frame), -1)], [0], None, [256], [0, 256])
    return np.asarray(counts, np.float64).ravel() / frame.size


def _log_mean(frame: ByteArray) -> float:
    return _log(float(np.mean(cv2.mean(frame)[:3])))


def _log(mean: float) -> float:
    return math.log(max(mean, 1.0))

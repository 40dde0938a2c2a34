"""Auto exposure: how bright the future frames will be.

Cameras on vehicles adjust their exposure for every frame; sky or shadow that comes into view
makes the same surfaces a fifth brighter or darker a second later. The control loop holds the mean
of the camera's whole image, with a lag of some tenths of a second. Where the future whole image can
be rendered (uncropped frames), so can its mean. Of a square crop only the crop's own mean is known,
which is held less exactly; its last level counts as the set point. The gains between observed
frames show how strongly a camera reacts: a fixed exposure stays.
"""

import functools
import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.interfaces import Scene
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering.source import Source, resampled
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Trajectory, Views


@dataclass(frozen=True)
class ToneCurve:
    """Response of grey values to a change of exposure; partly saturated pixels darken less."""

    # 16-235 is the range of video (ITU-R BT.601); above it cameras compress highlights.
    min_saturated_grey: float = 235.0
    # Fraction of a darkening, in log steps, that saturated pixels show: those of KITTI 00, 03 and
    # raw0095 that darken by 35 % elsewhere lose 9 %, which is .2; set by hand above it.
    saturated_gain_fraction: float = 0.3
    # Saturation is blurred, so that texture in white areas is not amplified. Set by hand.
    saturation_blur_px: float = 1.5

    def values(self, log_gain: float) -> FloatArray:
        """Return new values [256], at most 255, of the grey values 0 to 255."""
        brighter = np.arange(256) * math.exp(log_gain)
        return np.minimum(brighter + self._highlight(log_gain) * self._saturation, 255)

    def apply(self, frame: ByteArray, log_gain: float) -> ByteArray:
        """Return the frame [H, W, 3] or [H, W] after a change of exposure."""
        brighter = np.arange(256) * math.exp(log_gain)
        table = np.minimum(brighter + 0.5, 255).astype(np.uint8)
        scaled = cv2.LUT(frame, table)
        highlight = self._highlight(log_gain)
        if highlight < 0.5:
            return scaled
        saturation = cv2.LUT(frame, self._saturation.astype(np.float32))
        blurred = cv2.GaussianBlur(saturation, (0, 0), self.saturation_blur_px)
        return cv2.add(scaled, highlight * blurred, dtype=cv2.CV_8U)

    @functools.cached_property
    def _saturation(self) -> FloatArray:
        """Return how saturated each grey value [256] is, from 0 to 1."""
        lowest = self.min_saturated_grey
        fraction = (np.arange(256) - lowest) / (255 - lowest)
        return np.clip(fraction, 0, 1) ** 2

    def _highlight(self, log_gain: float) -> float:
        """Return how much brighter a saturated pixel stays than 255 times the gain."""
        if log_gain >= 0:
            return 0.0
        saturated_gain = math.exp(self.saturated_gain_fraction * log_gain)
        return 255 * (saturated_gain - math.exp(log_gain))


@dataclass(frozen=True)
class Exposure:
    """Exposure of the observed frames relative to the last one."""

    seconds: FloatArray  # [P], since the last frame; not positive
    log_gains: FloatArray  # [P], how much brighter the last frame shows the surfaces of each frame
    log_rate_hz: float  # rate of change of the log brightness at the last frame
    log_level: float  # mean log brightness of the observed images
    confidence: float  # that the exposure is controlled, from 0 (constant) to 1
    # Between the least and the largest observed log gain, without jumps
    log_range: float = math.inf
    tone_curve: ToneCurve = ToneCurve()

    def match(self, source: Source, step: int) -> Source:
        """Return the source of an observed step as bright as the last frame would show it."""
        log_gain = float(self.log_gains[step])
        frame = self.tone_curve.apply(source.frame, log_gain)
        return replace(source, frame=frame)


@dataclass(frozen=True)
class ExposureEstimator:
    """Estimation of the exposure from surfaces that the last and earlier frames show."""

    # Of the images that are compared. Medians over their 10^4 pixels are exact enough.
    width_px: int = 128
    blur_px: float = 1.5  # of them; no depth is exact enough for finer detail
    # Darker pixels are not compared: rounding to 8 bits is 1/40 of the smallest.
    min_grey: float = 20.0
    # Nor those below this fraction of a dim image's mean. Set by hand.
    min_mean_fraction: float = 0.3
    max_grey: float = 235.0  # nor partly saturated ones, as in `ToneCurve`
    # Of the image; with fewer pixels, some 300, the gain is 1.
    min_valid_fraction: float = 0.02
    num_trend_steps: int = 2  # from which the rate is estimated: as few as suppress noise
    max_rate_hz: float = 1.5  # log gain per second of a control: half of a jump's
    # A faster change is a jump, which no control makes: for such a rate, a pull of 3.3 Hz takes a
    # mean that is 2.5 times off.
    min_jump_hz: float = 3.0
    # RMS log gain in a tenth of a second at confidence one half: a grey value at a mean of 128.
    steady_log_gain: float = 0.008
    steady_s: float = 0.1
    tone_curve: ToneCurve = ToneCurve()

    def estimate(
        self,
        greys: ByteArray,  # [P, H, W]
        camera: Intrinsics,
        past: Trajectory,  # [P]
        inverse_depth: FloatArray,  # [H, W] of the last frame
    ) -> Exposure:
        """Return the exposure; it is constant for a single frame."""
        seconds = past.times_s - past.times_s[-1]
        gains = self._log_gains(greys, camera, past.world_from_cam, inverse_depth)

        # Jumps are separated from what the control did. A frame before a jump has its gain in all.
        changes = np.diff(gains, append=0.0)
        durations = np.diff(seconds, append=0.0)
        is_jump = np.abs(changes) > self.min_jump_hz * durations
        jumps = np.where(is_jump, changes, 0.0)
        later_jumps = np.cumsum(jumps[::-1])
        jumped = -later_jumps[::-1]  # log gain of all jumps since each frame

        # The control holds the mean; observed means are as bright as after the last jump.
        levels = [_log(float(grey.mean())) for grey in greys] + jumped
        level = float(levels.mean())
        if len(greys) == 1:
            return Exposure(seconds, gains, 0.0, level, 0.0, 0.0, self.tone_curve)

        # The present rate: a line through the last frame, by least squares.
        controlled = gains - jumped
        trend = slice(-1 - self.num_trend_steps, -1)
        t = seconds[trend]
        slope = -float((t * controlled[trend]).sum() / (t**2).sum())
        rate = float(np.clip(slope, -self.max_rate_hz, self.max_rate_hz))

        # A camera whose gain hardly varies has a fixed exposure, at any rate of frames.
        num_steps = max(1, round(-seconds[0] / self.steady_s))
        even_s = np.linspace(seconds[0], 0, num_steps + 1)
        variance = float((np.diff(np.interp(even_s, seconds, controlled)) ** 2).mean())
        confidence = variance / (variance + self.steady_log_gain**2)
        log_range = float(np.ptp(controlled))
        return Exposure(seconds, gains, rate, level, confidence, log_range, self.tone_curve)

    def _log_gains(
        self,
        greys: ByteArray,
        camera: Intrinsics,
        world_from_cam: FloatArray,
        inverse_depth: FloatArray,
    ) -> FloatArray:
        """Return log gains [P] to the last frame, as medians over comparable pixels."""
        # Small, blurred images: gains are the same over large areas, and depth is inexact.
        small = _shrunk(camera, self.width_px / camera.width_px)
        nearest = cv2.resize(inverse_depth, small.size_px, interpolation=cv2.INTER_NEAREST_EXACT)
        small_inverse_depth = nearest.astype(np.float32)
        images = []
        for grey in greys:
            resized = cv2.resize(grey, small.size_px, interpolation=cv2.INTER_AREA)
            images.append(cv2.GaussianBlur(resized.astype(np.float32), (0, 0), self.blur_px))
        is_valid = self._is_comparable(images[-1], images[-1])

        def log_gain(step: int) -> float:
            # The surfaces of the last frame, as the earlier one shows them.
            cam_from_last = se3.inverse(world_from_cam[step]) @ world_from_cam[-1]
            pixels, depth_ratio = Epipolar.of(small, cam_from_last).project(small_inverse_depth)
            u, v = cv2.split(pixels)
            warped = cv2.remap(images[step], u, v, cv2.INTER_LINEAR)  # 0 outside
            is_used = is_valid & (depth_ratio > 0) & self._is_comparable(warped, images[step])
            # The median is robust to moving objects and to wrong depth.
            if is_used.mean() < self.min_valid_fraction:
                return 0.0
            brightness_ratio = images[-1][is_used] / warped[is_used]
            return float(np.median(np.log(brightness_ratio)))

        gains = parallel_map(log_gain, range(len(greys) - 1))
        return np.array([*gains, 0.0])

    def _is_comparable(self, warped: FloatArray, image: FloatArray) -> BoolArray:
        """Return where [h, w] a warped image is neither dark nor saturated."""
        mean = float(image.mean())
        darkest = min(self.min_grey, self.min_mean_fraction * mean)
        return (warped > darkest) & (warped < self.max_grey)


@dataclass(frozen=True)
class ExposureControl:
    """A second-order control loop with inertia that draws the mean of the image to a level."""

    # Chosen on KITTI 00 [0, 569) and raw0095, checked on val (03 [0, 180) and 00 [600, 725)):
    inertia_s: float = 0.11  # time constant of the rate of the log exposure
    pull_hz: float = 3.3  # target rate per log step of the mean from its level
    step_s: float = 0.1  # of the simulation, as between two frames
    max_log_gain: float = math.log(2)  # one stop, either way
    # Of the observed range, either way. Smaller factors cost more on KITTI's train and val, where
    # 1, 2 and 3 cost .031, .013 and .003 dB, and on videos of other cameras.
    max_range_factor: float = 3.0
    # Height of the whole images whose future mean is rendered: 10^4 pixels suffice for a mean.
    meter_px: int = 64

    def __post_init__(self) -> None:
        if not (self.inertia_s > 0 and self.pull_hz > 0):
            raise BadData(
                f"exposure: inertia_s {self.inertia_s} and pull_hz {self.pull_hz} must be positive"
            )

    def log_gain(
        self,
        observed: Exposure,
        since_s: float,  # the last observed frame; negative before it
        histogram: FloatArray,  # [256] of the image then, at the exposure of the last observed one
        last: FloatArray,  # [256] of the last observed one
        log_level: float,  # the logarithm of the mean that the control holds
    ) -> float:
        """Return how much brighter the image is than the last frame's exposure would show it.

        Past gains are interpolated between the observed ones. Future gains are simulated, while
        the histogram changes linearly from the last frame's to that of the image then.
        """
        if since_s <= 0:
            return float(-np.interp(since_s, observed.seconds, observed.log_gains))
        # Each step, the rate relaxes to its target with the inertia's time constant: the target
        # pulls the mean back to its level, no faster than the simulation can follow.
        num_steps = max(1, round(since_s / self.step_s))
        dt_s = since_s / num_steps
        decay = math.exp(-dt_s / self.inertia_s)
        pull_hz = observed.confidence * min(self.pull_hz, 1 / dt_s)
        # The exposure changes little more than it was observed to change.
        max_log_gain = min(self.max_log_gain, self.max_range_factor * observed.log_range)
        gain = 0.0
        rate_hz = observed.log_rate_hz
        error = _log(float(last @ observed.tone_curve.values(0.0))) - log_level
        for fraction in np.arange(1, num_steps + 1) / num_steps:
            rate_hz = decay * rate_hz - (1 - decay) * pull_hz * error
            gain = gain + rate_hz * dt_s
            gain = min(max(gain, -max_log_gain), max_log_gain)
            # What the camera meters then, at its exposure then.
            mixed = last + fraction * (histogram - last)
            error = _log(float(mixed @ observed.tone_curve.values(gain))) - log_level
        return gain


@dataclass(frozen=True)
class ExposedScene:
    """A scene at the exposure that its camera has at each time."""

    scene: Scene
    last: Source  # the last observed frame
    exposure: Exposure
    control: ExposureControl
    last_s: float  # the time of the last observed frame
    is_whole: bool  # whether that is the camera's whole image, whose mean the control holds

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4] at the times [F]."""
        # The control holds the mean of the whole image, if that is known, else that of the view.
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        since_s = times_s - self.last_s
        metered, last = views.frames, self.last.frame
        level = self.exposure.log_level
        if not self.is_whole:
            last = resampled(self.last, intrinsics)
            level = _log(float(pinhole.grey8(last).mean()))
        elif (since_s > 0).any():  # gains of the past were observed
            camera = self.last.camera
            meter = _shrunk(camera, self.control.meter_px / camera.height_px)
            metered = self.scene.view(world_from_cam, times_s, meter).frames
        histogram = _histogram(last)

        def expose(step: int) -> ByteArray:
            gain = self.control.log_gain(
                self.exposure,
                float(since_s[step]),
                _histogram(metered[step]),
                histogram,
                level,
            )
            return self.exposure.tone_curve.apply(views.frames[step], gain)

        frames = parallel_map(expose, range(len(times_s)))
        return replace(views, frames=np.stack(frames))


def _shrunk(camera: Intrinsics, scale: float) -> Intrinsics:
    """Return the camera of images at a scale of at most 1."""
    scale = min(1.0, scale)
    width_px = max(1, round(camera.width_px * scale))
    height_px = max(1, round(camera.height_px * scale))
    return camera.resized(width_px, height_px)


def _histogram(frame: ByteArray) -> FloatArray:
    """Return the fractions [256] of the grey values of a frame."""
    grey = pinhole.grey8(frame)
    counts = cv2.calcHist([grey], [0], None, [256], (0, 256)).ravel()
    return counts / np.float64(grey.size)


def _log(mean: float) -> float:
    return math.log(max(mean, 1.0))

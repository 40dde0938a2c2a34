"""Metres per unit of the odometry from the road and the camera's height above it, or from a prior
of speeds.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.road import (
    RoadFit,
    align,
    correlation,
    level_plane,
    road_samples,
    road_window,
    sample,
    smoothed,
)
from geovp_classic.odometry.speed_prior import SpeedPrior
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, PrivilegedInput

COARSE_PX, FINE_PX = (
    2.0,
    1.0,
)  # blur of the images while the height is searched, and once it is known
SEARCHED_HEIGHTS = np.geomspace(0.15, 40.0, 60)  # in lengths of the motion
SEARCHED_PITCHES_RAD = np.radians([0.0, -2.0, 2.0])
STEEPEST_RAD = np.radians(20.0)  # pitch of a camera whose road is looked for
MIN_SAMPLES = 50
UNKNOWN_TILT_RAD = np.radians(1.0)  # of pitch and roll before the first measurement
MIN_CORRELATION = 0.5
CLEAR_CORRELATION = 0.85  # ends the search
MAX_RELATIVE_SIGMA = (
    0.05  # of the height by the images' noise alone; above it the road has no texture
)
GATE = 3.0  # standard deviations beyond which a measurement is rejected
MAX_REJECTED = 6  # measurements in a row, before the search starts anew
MIN_CONSISTENT = (
    3  # rejected measurements in a row that agree with each other are accepted after all
)


@dataclass(frozen=True)
class GroundPlane:
    """Metres from the camera's known height: the road ahead is aligned from image to image.

    Height above the road in units of the odometry, pitch and roll are measured together at every
    keyframe and smoothed over time; the smoothing assumes that the unit drifts by `drift` a
    keyframe, more while turning, and that one measurement has an error of `error`, more while
    turning, because then the road ahead is not the one driven on. Where no road is found in a clip,
    its mean speed is assumed from `prior`, and the trajectory's `scale_uncertainty` is the spread
    of that; with none the clip has no metres.
    """

    drift: float = 0.002
    drift_per_rad: float = 0.08
    error: float = 0.06
    error_per_rad: float = 12.0
    wobble_rad: float = 0.02  # of pitch and roll from image to image
    prior: SpeedPrior | None = field(default_factory=SpeedPrior)

    needs = PrivilegedInput.CAMERA_HEIGHT
    is_metric = True

    def estimator(
        self, intrinsics: Intrinsics, camera_height_m: float | None, pitch_rad: float = 0.0
    ) -> ScaleEstimator:
        """An estimator for one camera; Incompatible when its height is not known."""
        if camera_height_m is None or not camera_height_m > 0:
            raise Incompatible(
                "the ground-plane scale needs the camera's height above the road, which this "
                "clip lacks: "
                "give the data set's camera_height_m (`geovp predict --camera-height`) or use "
                "the scale 'unit-speed'"
            )
        return GroundPlaneEstimator(self, intrinsics, camera_height_m, pitch_rad)


@dataclass
class GroundPlaneEstimator:
    """A Kalman filter of the logarithm of the camera's height in units of the odometry, and of
    pitch and roll.
    """

    settings: GroundPlane
    camera: Intrinsics
    camera_height_m: float
    pitch_rad: float = 0.0
    log_height: float = 0.0
    variance: float = np.inf
    roll_rad: float = 0.0
    num_measurements: int = 0
    rejected: list[float] = field(default_factory=list)  # logarithms of heights, in a row
    lens: Lens = field(init=False)  # of the window
    pixels: FloatArray = field(init=False)  # [N, 2] of the window
    window: tuple[slice, slice] = field(init=False)  # rows, columns

    def __post_init__(self) -> None:
        """Choose the window of the image that shows the road."""
        self.pitch_rad = float(np.clip(self.pitch_rad, -STEEPEST_RAD, STEEPEST_RAD))
        self.lens, self.window = Lens(self.camera), (slice(0), slice(0))
        self.pixels = road_samples(self.lens, level_plane(1.0, self.pitch_rad))
        if len(self.pixels) >= MIN_SAMPLES:
            rows, columns = self.window = road_window(self.pixels, self.camera)
            self.pixels -= (columns.start, rows.start)
            shape = (columns.stop - columns.start, rows.stop - rows.start)
            self.lens = Lens(self.camera.cropped(columns.start, rows.start, *shape))

    @property
    def unit(self) -> float:
        """Metres per unit of the odometry; 1 while unknown."""
        return (
            float(self.camera_height_m / np.exp(self.log_height))
            if np.isfinite(self.variance)
            else 1.0
        )

    @property
    def confidence(self) -> float:
        """From 0 (unknown) to 1: one minus the relative standard deviation of the unit,
        times five.
        """
        return float(np.clip(1 - 5 * self.uncertainty, 0, 1))

    @property
    def uncertainty(self) -> float:
        """Relative standard deviation of the unit; infinite while unknown."""
        return float(np.sqrt(self.variance))

    def finalize(self, length: float, duration_s: float) -> None:
        """Assume the prior's median speed where no road was found on a path of that length."""
        prior = self.settings.prior
        if prior is not None and self.confidence == 0 and length > 0:
            metres_per_unit = prior.median_m_s * duration_s / length
            self.log_height, self.variance = (
                float(np.log(self.camera_height_m / metres_per_unit)),
                prior.spread**2,
            )

    def restart(self) -> None:
        """The odometry's unit has changed: forget the height, keep pitch and roll."""
        self.variance, self.rejected = np.inf, []

    def update(
        self, before: ByteArray, now: ByteArray, before_from_now: FloatArray, radial: float = 0.0
    ) -> None:
        """Take two grey images [H, W] and the motion between them [4, 4], in units of the
        odometry.
        """
        if np.linalg.norm(before_from_now[:3, 3]) < 1e-6 or len(self.pixels) < MIN_SAMPLES:
            return
        before, now = before[self.window], now[self.window]
        self.lens = replace(self.lens, radial=radial)
        turn_rad = float(se3.rotation_angle_rad(before_from_now))
        searching = not np.isfinite(self.variance)
        if searching and not self._search(before, now, before_from_now):
            return
        self.variance += (self.settings.drift + self.settings.drift_per_rad * turn_rad) ** 2
        fit = self._measure(
            before, now, before_from_now, (COARSE_PX, FINE_PX) if searching else (FINE_PX,)
        )
        if fit is not None:
            self._correct(fit, turn_rad)
        elif searching:
            self.variance = np.inf

    def _search(self, before: ByteArray, now: ByteArray, before_from_now: FloatArray) -> bool:
        """Find the height by exhaustive search, for pitches within two degrees of the
        current one.
        """
        images = [smoothed(grey, 1.5) - smoothed(grey, 6.0) for grey in (before, now)]
        length, pixels = float(np.linalg.norm(before_from_now[:3, 3])), self.pixels[::3]
        values, rays = sample(images[1], pixels), homogeneous(self.lens.rays(pixels))
        best, best_correlation = None, MIN_CORRELATION
        for pitch_rad in SEARCHED_PITCHES_RAD + self.pitch_rad:
            for height in SEARCHED_HEIGHTS * length:
                plane = level_plane(height, pitch_rad, self.roll_rad)
                found = correlation(images[0], values, before_from_now, self.lens, rays, plane)
                if found > best_correlation:
                    best, best_correlation = (float(np.log(height)), float(pitch_rad)), found
            if best_correlation > CLEAR_CORRELATION:
                break
        if best is None:
            return False
        (self.log_height, self.pitch_rad), self.variance = best, 0.1**2
        return True

    def _measure(
        self,
        before: ByteArray,
        now: ByteArray,
        before_from_now: FloatArray,
        blurs_px: tuple[float, ...],
    ) -> RoadFit | None:
        """The road's plane; None when the road cannot be seen or has no texture."""
        fit: RoadFit | None = None
        plane = level_plane(float(np.exp(self.log_height)), self.pitch_rad, self.roll_rad)
        prior_information = self._prior_information(plane)
        for blur_px in blurs_px:
            a, b = smoothed(before, blur_px), smoothed(now, blur_px)
            fit = align(a, b, before_from_now, self.lens, self.pixels, plane, prior_information)
            if fit is None:
                return None
            plane = fit.plane
        assert fit is not None
        sigma = 1 / np.sqrt(max(float(plane @ fit.information @ plane), 1e-12))
        return fit if fit.correlation > MIN_CORRELATION and sigma < MAX_RELATIVE_SIGMA else None

    def _prior_information(self, plane: FloatArray) -> FloatArray:
        """Inverse covariance [3, 3] of the plane before a measurement: loose in height, tighter in
        pitch and roll.
        """
        size, normal = float(np.linalg.norm(plane)), plane / np.linalg.norm(plane)
        tilt_rad = self.settings.wobble_rad + UNKNOWN_TILT_RAD / (1 + self.num_measurements)
        loose, tight = (0.3 * size) ** 2, (tilt_rad * size) ** 2
        along = np.outer(normal, normal)
        return along / loose + (np.eye(3) - along) / tight

    def _correct(self, fit: RoadFit, turn_rad: float) -> None:
        """The filter's correction by one measurement."""
        size = float(np.linalg.norm(fit.plane))
        noise = (self.settings.error + self.settings.error_per_rad * turn_rad) ** 2
        innovation = -np.log(size) - self.log_height
        if abs(innovation) > GATE * np.sqrt(self.variance + noise):
            self._reject(self.log_height + innovation, noise)
            return
        gain = self.variance / (self.variance + noise)
        self.log_height += gain * innovation
        self.variance *= 1 - gain
        self.rejected, self.num_measurements = [], self.num_measurements + 1
        normal = fit.plane / size
        rate = max(0.05, 1 / (1 + self.num_measurements)) * self.settings.error**2 / noise
        self.pitch_rad += rate * (float(np.arcsin(-normal[2])) - self.pitch_rad)
        self.roll_rad += rate * (float(np.arctan2(normal[0], normal[1])) - self.roll_rad)

    def _reject(self, log_height: float, noise: float) -> None:
        """Keep a rejected measurement: several that agree replace the estimate, too many in a row
        restart it.
        """
        self.rejected.append(log_height)
        latest = np.array(self.rejected[-MIN_CONSISTENT:])
        if len(latest) == MIN_CONSISTENT and np.ptp(latest) < GATE * np.sqrt(noise):
            self.log_height, self.variance, self.rejected = (
                float(np.median(latest)),
                noise / MIN_CONSISTENT,
                [],
            )
        elif len(self.rejected) > MAX_REJECTED:
            self.restart()

"""Metric scale of an odometry from the road and the camera's height above it."""

from dataclasses import dataclass, field, replace

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.road import RoadAligner, blur, level_plane
from geovp_classic.odometry.speed_prior import SpeedPrior
from geovp_classic.types import (
    ByteArray,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
)


@dataclass(frozen=True)
class GroundPlane:
    """Metres from the camera's known height: the road ahead is aligned from image to image.

    The logarithm of the height in units of the odometry, pitch and roll are measured together at
    every keyframe, and smoothed over time. In turns, the road ahead is not the one driven on.
    """

    drift: float = 0.002  # of the unit from keyframe to keyframe, relative
    drift_per_rad: float = 0.08  # in addition, by the rotation
    error: float = 0.06  # relative standard deviation of a measurement
    error_per_rad: float = 12.0
    wobble_rad: float = 0.02  # of pitch and roll from image to image
    initial_tilt_rad: float = (
        0.0175  # uncertainty of pitch and roll before the first measurement
    )
    max_pitch_deg: float = 20.0  # of a camera with a visible road
    # assumed if a clip shows no road; "none": the clip has no metric scale
    prior: SpeedPrior | None = field(default_factory=SpeedPrior)
    road: RoadAligner = field(default_factory=RoadAligner)
    min_samples: int = 50  # of the road in the image
    gate: float = (
        3.0  # standard deviations from which a measurement is rejected
    )
    max_rejected: int = (
        2  # measurements in a row, before the search is repeated
    )

    needs = PrivilegedInput.CAMERA_HEIGHT
    is_metric = True

    def estimator(
        self,
        intrinsics: Intrinsics,
        camera_height_m: float | None,
        pitch_rad: float = 0.0,
    ) -> ScaleEstimator:
        """Return an estimator for one camera; raise Incompatible if its height is unknown."""
        if camera_height_m is None or not camera_height_m > 0:
            raise Incompatible(
                "the ground-plane scale needs the camera's height above the road, which this clip "
                "lacks: give the data set's camera_height_m (`geovp predict --camera-height`) or "
                "use the scale 'unit-speed'"
            )
        max_pitch_rad = np.radians(self.max_pitch_deg)
        pitch_rad = float(np.clip(pitch_rad, -max_pitch_rad, max_pitch_rad))
        return GroundPlaneEstimator(
            self, intrinsics, camera_height_m, pitch_rad
        )


class GroundPlaneEstimator:
    """Kalman filter of the logarithm of the camera's height in units of the odometry."""

    def __init__(
        self,
        settings: GroundPlane,
        camera: Intrinsics,
        camera_height_m: float,
        pitch_rad: float,
    ) -> None:
        self.settings = settings
        self.camera_height_m = camera_height_m
        self.pitch_rad = pitch_rad
        self.roll_rad = 0.0
        self.log_height = 0.0
        self.variance = np.inf
        self.num_measurements = 0
        self.num_rejected = 0  # measurements in a row
        self.lens = Lens(camera)  # of the rows that show the road
        self.pixels = settings.road.samples(
            self.lens, level_plane(1.0, pitch_rad)
        )  # [N, 2]
        self.top_px = 0  # of the rows that show the road
        if len(self.pixels):
            self.top_px = max(0, int(self.pixels[:, 1].min()) - 24)
            self.pixels[:, 1] -= self.top_px
            height_px = camera.height_px - self.top_px
            self.lens = Lens(
                camera.cropped(0, self.top_px, camera.width_px, height_px)
            )

    @property
    def unit(self) -> float:
        """Return metres per unit of the odometry; 1 while unknown."""
        if not np.isfinite(self.variance):
            return 1.0
        return float(self.camera_height_m / np.exp(self.log_height))

    @property
    def confidence(self) -> float:
        """Return 1 for a known unit down to 0 for a relative deviation of a fifth or more."""
        return float(np.clip(1 - 5 * self.uncertainty, 0, 1))

    @property
    def uncertainty(self) -> float:
        """Return the relative standard deviation of the unit; infinite while unknown."""
        return float(np.sqrt(self.variance))

    def finalize(self, length: float, duration_s: float) -> None:
        """Assume the prior's median speed if no road was found."""
        prior = self.settings.prior
        if prior is not None and self.confidence == 0 and length > 0:
            metres_per_unit = prior.median_m_s * duration_s / length
            self.log_height = float(
                np.log(self.camera_height_m / metres_per_unit)
            )
            self.variance = prior.spread**2

    def restart(self) -> None:
        """Forget the height after a change of the odometry's unit; keep pitch and roll."""
        self.variance = np.inf
        self.num_rejected = 0

    def update(
        self,
        before: ByteArray,
        now: ByteArray,
        before_from_now: FloatArray,
        radial: float = 0.0,
    ) -> None:
        """Measure the height from two grey images [H, W] and the motion between them [4, 4]."""
        length = float(np.linalg.norm(before_from_now[:3, 3]))
        if length < 1e-6 or len(self.pixels) < self.settings.min_samples:
            return
        self.lens = replace(self.lens, radial=radial)
        images = (before[self.top_px :], now[self.top_px :])
        road = self.settings.road
        blurs_px = [road.blur_px]
        is_new = not np.isfinite(self.variance)
        if is_new:
            plane = road.search(
                images,
                before_from_now,
                self.lens,
                self.pixels[::3],
                self.pitch_rad,
                self.roll_rad,
            )
            if plane is None:
                return
            self.log_height = -float(np.log(np.linalg.norm(plane)))
            self.pitch_rad = pitch(plane)
            self.variance = 0.1**2
            blurs_px = [2 * road.blur_px, road.blur_px]
        plane = level_plane(
            float(np.exp(self.log_height)), self.pitch_rad, self.roll_rad
        )
        information = self._prior_information(plane)
        for blur_px in blurs_px:
            blurred = (blur(images[0], blur_px), blur(images[1], blur_px))
            plane = road.align(
                blurred,
                before_from_now,
                self.lens,
                self.pixels,
                plane,
                information,
            )
            if plane is None:
                break
        turn_rad = float(se3.rotation_angle_rad(before_from_now))
        self.variance += (
            self.settings.drift + self.settings.drift_per_rad * turn_rad
        ) ** 2
        if plane is not None:
            self._correct(plane, turn_rad)
        elif is_new:
            self.variance = np.inf

    def _prior_information(self, plane: FloatArray) -> FloatArray:
        """Return the inverse covariance [3, 3] of the plane before a measurement.

        It is loose in height (30 %), and tighter in pitch and roll.
        """
        size = float(np.linalg.norm(plane))
        along = np.outer(plane, plane) / size**2
        initial_rad = self.settings.initial_tilt_rad / (
            1 + self.num_measurements
        )
        tilt_rad = self.settings.wobble_rad + initial_rad
        return (
            along / (0.3 * size) ** 2
            + (np.eye(3) - along) / (tilt_rad * size) ** 2
        )

    def _correct(self, plane: FloatArray, turn_rad: float) -> None:
        """Correct the filter by a measured plane, unless it fails the gate."""
        measured = -float(np.log(np.linalg.norm(plane)))
        variance = (
            self.settings.error + self.settings.error_per_rad * turn_rad
        ) ** 2
        innovation = measured - self.log_height
        if abs(innovation) > self.settings.gate * np.sqrt(
            self.variance + variance
        ):
            self.num_rejected += 1
            if self.num_rejected > self.settings.max_rejected:
                self.restart()
            return
        gain = self.variance / (self.variance + variance)
        self.log_height += gain * innovation
        self.variance *= 1 - gain
        self.num_rejected = 0
        self.num_measurements += 1
        rate = (
            max(0.05, 1 / (1 + self.num_measurements))
            * self.settings.error**2
            / variance
        )
        self.pitch_rad += rate * (pitch(plane) - self.pitch_rad)
        self.roll_rad += rate * (
            float(np.arctan2(plane[0], plane[1])) - self.roll_rad
        )


def pitch(plane: FloatArray) -> float:
    """Return the angle in radians by which the camera looks up from a plane."""
    return float(np.arcsin(-plane[2] / np.linalg.norm(plane)))

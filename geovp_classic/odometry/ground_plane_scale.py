"""Metric scale of an odometry from the road and the camera's height above it."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.odometry.random_walk import RandomWalk
from geovp_classic.odometry.road import RoadAligner, RoadMeasurement, RoadPair, level_plane
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, PrivilegedInput
from geovp_classic.types.speed_prior import MIN_SPREAD, SpeedPrior


@dataclass(frozen=True)
class GroundPlane:
    """Metres from the camera's known height: the road ahead is aligned from image to image.

    Every pair of images measures the height in units of the odometry, from scratch. A random walk
    is then fitted to all measurements. Constants were chosen on train and val drives.
    """

    # Relative standard deviation of a measurement that also covers its correlation with the next
    # ones; chosen on train and val. The walk estimates the true one, with this as its prior.
    error: float = 0.05
    # In addition, by the alignment's own, which assumes independent pixels: blurred and sampled
    # ones of one texture are not. Chosen on train and val.
    alignment_error_ratio: float = 4.0
    # Relative increase by the rotation: in turns, the road ahead is not the one driven on. At 4
    # degrees per image, errors are half as large again. Chosen on train and val.
    error_per_rad: float = 8.0
    # Relative error that all measurements share: of pitch, and by roads that are not flat. A
    # thousandth of a radian of pitch is 1 % at 10 heights.
    systematic_error: float = 0.02
    walk: RandomWalk = RandomWalk()  # of the height
    # Remembered, of an endless drive; None: all
    max_pairs: int | None = None
    # Relative increase of the walk's steps by the rotation: the map's unit drifts most in turns,
    # where new points replace all others. Chosen on train and val.
    step_per_rad: float = 20.0
    # Search around the last heights, in logarithms: a third more or less, in steps below
    # `error` that the alignment converges from.
    search_range: float = 0.3
    search_step: float = 0.03
    num_recent: int = 5  # heights, whose median tolerates two outliers
    # First search: heights in lengths of the motion. At KITTI's height of 1.65 m, they cover steps
    # from 4 cm to 11 m, in 80 ratios of 7 %. Pitches around the expected one, in degrees: two
    # standard deviations of `initial_tilt_rad`.
    min_height: float = 0.15
    max_height: float = 40.0
    num_heights: int = 80
    pitches_deg: tuple[float, ...] = (0.0, -2.0, 2.0)
    # It ends the first search: noise of a fifth of the texture's deviation leaves .96, a wrong
    # plane about `RoadAligner.min_correlation`.
    sufficient_correlation: float = 0.85
    # Pairs in a row, before the first search is repeated: a shadow or a bump spoils the two pairs
    # that its image is part of.
    max_missed: int = 2
    # Standard deviation of pitch and roll from image to image, a quarter of a degree
    wobble_rad: float = 0.004
    # Standard deviation of pitch and roll before the first measurement: a degree, of the mounting
    initial_tilt_rad: float = 0.0175
    # Of the running means of pitch and roll, which follow the load and the road over 20 images
    min_tilt_rate: float = 0.05
    # Of a camera that sees the road: with 40 degrees of vertical field of view, one that looks up
    # farther does not.
    max_pitch_deg: float = 20.0
    # Rows above the highest sample that are read as well, for its motion and the local mean
    margin_px: int = 24
    # assumed if a clip shows no road; "none": the clip has no metric scale
    prior: SpeedPrior | None = SpeedPrior()
    road: RoadAligner = RoadAligner()
    # Of the road in the image: 17 per unknown of a plane
    min_samples: int = 50

    needs = PrivilegedInput.CAMERA_HEIGHT
    is_metric = True

    def estimator(
        self,
        intrinsics: Intrinsics,
        camera_height_m: float | None,
        pitch_rad: float = 0.0,
    ) -> ScaleEstimator:
        """Return an estimator for one camera; raise Incompatible if its height is unknown."""
        if camera_height_m is None:
            raise Incompatible(
                "the ground-plane scale needs the camera's height above the road, which this clip "
                "lacks: give the data set's camera_height_m (`geovp predict --camera-height`) or "
                "use the scale 'unit-speed'"
            )
        max_pitch_rad = np.radians(self.max_pitch_deg)
        pitch_rad = float(np.clip(pitch_rad, -max_pitch_rad, max_pitch_rad))
        return GroundPlaneEstimator(self, intrinsics, camera_height_m, pitch_rad)


class GroundPlaneEstimator:
    """Camera heights in units of the odometry, and a random walk through them."""

    def __init__(
        self,
        settings: GroundPlane,
        camera: Intrinsics,
        camera_height_m: float,
        pitch_rad: float,
    ) -> None:
        self.settings = settings
        self.camera_height_m = camera_height_m
        self.unit = 1.0
        self.units: FloatArray = np.zeros(0)
        self.uncertainty = np.inf
        self.pitch_rad = pitch_rad
        self.roll_rad = 0.0
        # one per update: the logarithm of a height (NaN: none), its deviation, and the relative
        # step of the walk to it
        self._measurements: deque[tuple[float, float, float]] = deque(maxlen=settings.max_pairs)
        self._recent: list[float] = []  # logarithms of measured heights
        self._num_measured = 0
        self._num_missed = 0  # in a row
        self._is_restarted = False
        self._pixels = settings.road.samples(camera, level_plane(pitch_rad))  # [N, 2]
        top_px = self._pixels[:, 1].min(initial=camera.height_px)
        # Read only the rows that show the road
        self._top_px = max(0, int(top_px) - settings.margin_px)
        self._pixels[:, 1] -= self._top_px
        height_px = camera.height_px - self._top_px
        self._camera = camera.cropped(0, self._top_px, camera.width_px, height_px)

    def finalize(self, length: float, duration_s: float) -> None:
        """Fit the walk, or assume the prior's median speed if no road was found."""
        self.uncertainty = np.inf
        if any(np.isfinite(height) for height, *_ in self._measurements):
            measured, _, step_ratios = measurements = np.array(self._measurements).T
            log_heights, deviations = self.settings.walk.smooth(*measurements)
            # Heights between restarts are unrelated: without a measurement they are unknown
            segments = np.cumsum(np.isinf(step_ratios))
            is_known = np.isin(segments, segments[np.isfinite(measured)])
            variance = float(np.mean(deviations[is_known] ** 2))
            self.uncertainty = float(np.sqrt(variance + self.settings.systematic_error**2))
            self.units = np.where(is_known, self.camera_height_m / np.exp(log_heights), np.nan)
            self.unit = float(np.exp(np.log(self.units[is_known]).mean()))
        if self.uncertainty <= MIN_SPREAD:
            return
        # No road was found: assume a speed
        prior = self.settings.prior
        self.unit = 1.0
        self.uncertainty = np.inf
        if prior is not None and length > 0:
            self.unit = prior.median_m_s * duration_s / length
            self.uncertainty = prior.spread
        self.units = np.full(len(self._measurements), np.nan)

    def restart(self) -> None:
        """Forget the height after a change of the odometry's unit; keep pitch and roll."""
        self._recent = []
        self._is_restarted = True

    def update(
        self,
        before: ByteArray,
        now: ByteArray,
        before_from_now: FloatArray,
    ) -> None:
        """Measure the height from two grey images [H, W] and the motion between them [4, 4]."""
        # The walk's step: larger in a turn, unrelated after a restart
        settings = self.settings
        turn_rad = float(se3.rotation_angle_rad(before_from_now))
        step_ratio = 1 + settings.step_per_rad * turn_rad
        if self._is_restarted:
            step_ratio = np.inf
            self._is_restarted = False
        # Align the road in both images
        road = settings.road
        pair = RoadPair(
            road.blurred(before[self._top_px :]),
            road.blurred(now[self._top_px :]),
            before_from_now,
            self._camera,
        )
        measured = self._measure(pair)
        if measured is None:
            self._measurements.append((np.nan, np.inf, step_ratio))
            self._num_missed += 1
            if self._num_missed > settings.max_missed:
                self._recent = []
            return
        # Height and its uncertainty: m = n / h, so that log h = -log |m|
        log_height = -float(np.log(np.linalg.norm(measured.plane)))
        turn_ratio = 1 + settings.error_per_rad * turn_rad
        deviation = turn_ratio * np.hypot(
            settings.error, settings.alignment_error_ratio * measured.deviation
        )
        self._measurements.append((log_height, float(deviation), step_ratio))
        self._recent = [*self._recent, log_height][-settings.num_recent :]
        self._num_missed = 0
        self._num_measured += 1
        # Running means of pitch and roll, which turns hardly change
        rate = max(settings.min_tilt_rate, 1 / self._num_measured)
        rate /= turn_ratio**2
        self.pitch_rad += rate * (pitch(measured.plane) - self.pitch_rad)
        roll_rad = float(np.arctan2(measured.plane[0], measured.plane[1]))
        self.roll_rad += rate * (roll_rad - self.roll_rad)

    def _measure(self, pair: RoadPair) -> RoadMeasurement | None:
        """Return the plane of the road; None if it is not visible."""
        length = float(np.linalg.norm(pair.before_from_now[:3, 3]))
        if length < 1e-6 or len(self._pixels) < self.settings.min_samples:
            return None
        # Height to start from: of a full search, or of the last pairs
        road = self.settings.road
        if not self._recent:
            first = self._search_all(pair, length)
            if first is None:
                return None
            log_height = -float(np.log(np.linalg.norm(first)))
            self.pitch_rad = pitch(first)
        else:
            log_height = float(np.median(self._recent))
        # Search near it with the expected tilt
        width = self.settings.search_range
        log_heights = log_height + np.arange(-width, width, self.settings.search_step)
        expected = level_plane(self.pitch_rad, self.roll_rad)
        planes = expected / np.exp(log_heights)[:, None]
        start, correlation = road.search(pair, self._pixels, planes)
        if correlation < road.min_correlation:
            return None
        # Align height and tilt
        initial_rad = self.settings.initial_tilt_rad / (1 + self._num_measured)
        tilt_rad = self.settings.wobble_rad + initial_rad
        return road.align(pair, self._pixels, start, tilt_rad)

    def _search_all(self, pair: RoadPair, length: float) -> FloatArray | None:
        """Return the plane [3] among all heights and pitches."""
        settings = self.settings
        heights = length * np.geomspace(
            settings.min_height, settings.max_height, settings.num_heights
        )
        best = None
        best_correlation = settings.road.min_correlation
        pitches_deg = (0.0,) if self._num_measured else settings.pitches_deg
        for offset_rad in np.radians(pitches_deg):
            pitch_rad = self.pitch_rad + offset_rad
            planes = level_plane(pitch_rad, self.roll_rad)
            planes = planes / heights[:, None]
            plane, correlation = settings.road.search(pair, self._pixels, planes)
            if correlation > best_correlation:
                best = plane
                best_correlation = correlation
            if correlation > settings.sufficient_correlation:
                break
        return best


def pitch(plane: FloatArray) -> float:
    """Return the angle in radians by which the camera looks up from a plane."""
    return float(np.arcsin(-plane[2] / np.linalg.norm(plane)))

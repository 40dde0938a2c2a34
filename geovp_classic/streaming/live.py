"""The live predictor: push frames as they arrive, ask for the view at any time."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from scipy.interpolate import interp1d

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.forecasting.selected import Selected
from geovp_classic.geometry import pinhole, planar, se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.observation import Observed, observations_of
from geovp_classic.odometry.monocular import MonocularRun
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import ShownScene, Verdict
from geovp_classic.streaming.commands import Command, commanded_poses
from geovp_classic.streaming.settings import LiveSettings
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    ShownBy,
    Trajectory,
)

Status = Literal["used", "duplicate", "blank", "late", "restarted"]


@dataclass(frozen=True)
class PushReport:
    """What became of a frame, and the seconds that each stage took."""

    status: Status
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LiveView:
    """What the camera sees at the present: predicted, or its newest frame with a warning."""

    frame: ByteArray  # [H, W, 3]
    covered: BoolArray  # [H, W]; False: inpainted
    confidence: float  # in [0, 1]
    warning: str | None  # why no prediction is shown
    age_s: float  # of the newest frame
    # Planned track of the camera on the ground, in pixels; empty without metres
    path_px: FloatArray  # [M, 2], NaN behind the camera
    path_sides_px: FloatArray  # [2, M, 2], the left and right edge of its uncertainty
    caution: str | None = None  # why the shown prediction may be wrong
    moving: BoolArray | None = None  # [H, W]; True: shown as moving on its own

    @property
    def is_predicted(self) -> bool:
        """Return whether the frame is a prediction."""
        return self.warning is None


@dataclass(frozen=True)
class _Frame:
    image: ByteArray  # [H, W, 3]
    time_s: float


@dataclass(frozen=True)
class _Present:
    """A scene with the motion in it; all in the world frame of its odometry."""

    scene: ShownScene
    past: Trajectory
    tracked: BoolArray
    times_s: FloatArray  # [F], from the last frame on
    futures: FloatArray  # [S, F, 4, 4], the central one first
    vehicle_from_cam: FloatArray  # [4, 4]

    def pose(self, times_s: FloatArray) -> FloatArray:
        """Return the poses [F, 4, 4] of the central future."""
        return se3.interpolate(self.futures[0], self.times_s, times_s)


@dataclass(frozen=True)
class _State:
    """What a view is made of.

    A push replaces it as a whole, so that a view in another thread sees the old or the new one.
    """

    newest: _Frame | None = None  # usable or not
    is_blank: bool = False  # the newest frame
    present: _Present | None = None


class LivePredictor:
    """Prediction of the present of a delayed camera, frame by frame, in bounded memory.

    Each frame is tracked, measured and reconstructed once; the scene of the last frame replaces
    the one before. One thread may push while others ask for views.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        camera_height_m: float | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        self.intrinsics = intrinsics
        self.settings = (settings or LiveSettings()).for_camera(camera_height_m)
        self._height_m = camera_height_m
        self._predictor = GeometricPredictor(
            Chained(self.settings.odometry, self.settings.forecaster),
            self.settings.renderer,
            self.settings.observer,
        )
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._restart([])
        self._state = _State()

    def _restart(self, window: list[_Frame]) -> None:
        """Forget all frames but some usable ones, and what was tracked and tested with others."""
        self._window = window
        self._odometry: MonocularRun | None = None
        self._tested: list[_Present] = []  # since the one whose prediction is tested next
        self._tests: list[dict[ShownBy, float]] = []  # errors of tested predictions
        self._forecaster: Forecaster | None = None  # chosen at the last test

    def push(self, frame: ByteArray, time_s: float) -> PushReport:
        """Add a frame [H, W, 3] uint8 of the camera, taken at a time.

        A late frame is ignored: one that is not newer than the last one. Raise BadData for
        another shape.
        """
        self._check(frame, time_s)
        added = _Frame(np.array(frame), float(time_s))
        seconds: dict[str, float] = {}
        status = self._admit(added)
        if status == "late":
            return PushReport(status)

        # Observe the remembered frames; one that shows nothing new is not remembered
        with _timed("observe", seconds):
            self._window = [*self._window, added][-self.settings.num_frames :]
            observed, is_usable = self._observe()
        if not is_usable[-1]:
            return PushReport(self._forget_newest(), seconds)
        if not is_usable.all():  # the others lie before a cut
            observed = self._keep(is_usable)
            status = "restarted"

        # Track the camera up to the new frame, or from the new frame on if it is lost
        with _timed("track", seconds):
            odometry = self._track(observed)
            if odometry.is_lost:
                observed = self._keep(slice(-1, None))
                status = "restarted"
                odometry = self._track(observed)
        with _timed("scale", seconds):
            past, tracked = odometry.past()

        # Reconstruct and forecast; views show the new scene from now on
        with _timed("scene", seconds):
            scene = self._predictor.reconstruct(observed, past)
        with _timed("forecast", seconds):
            times_s, futures = self._forecast(past)
        with _timed("hindcast", seconds):
            hindcast = self.settings.hindcast
            self._test(added, scene.mask)
            is_judged = len(self._tests) == self.settings.num_tests
            verdict = hindcast.verdict(self._tests) if is_judged else Verdict()
            scene = replace(scene, image_motion=hindcast.image_motion, verdict=verdict)
        plane = planar.level_vehicle_from_cam(odometry.pitch_rad)
        present = _Present(scene, past, tracked, times_s, futures, plane)
        if self._tested or len(past) >= self.settings.hindcast_steps:
            self._tested.append(present)
        self._state = _State(added, False, present)
        return PushReport(status, seconds)

    def _test(self, added: _Frame, mask: BoolArray) -> None:
        """Compare a new frame with what was predicted for its time, once in `hindcast_steps`."""
        settings = self.settings
        if len(self._tested) < settings.hindcast_steps:
            return
        earlier = self._tested[0]
        self._tested = []
        self._forecaster = None  # is chosen again, too
        size_px = settings.hindcast.frame_size(self.intrinsics)
        times_s = np.array([added.time_s])
        camera = self.intrinsics.resized(*size_px)
        predicted = earlier.scene.each(earlier.pose(times_s), times_s, camera)
        actual = pinhole.resize(added.image, size_px)[None]
        mask = cv2.resize(mask.astype(np.uint8), size_px, interpolation=cv2.INTER_NEAREST) > 0
        test = {
            way: settings.hindcast.error(frames, actual, mask) for way, frames in predicted.items()
        }
        self._tests = [*self._tests, test][-settings.num_tests :]

    def _admit(self, added: _Frame) -> Status:
        """Admit a frame by its time; forget all others after a gap or a jump of the clock.

        Until the frame is reconstructed, views then show it with a warning.
        """
        newest = self._state.newest
        if newest is None:
            return "used"
        elapsed_s = added.time_s - newest.time_s
        if -self.settings.max_gap_s < elapsed_s <= 0:
            return "late"
        if 0 < elapsed_s <= self.settings.max_gap_s:
            return "used"
        self._restart([])
        self._state = _State(added)
        return "restarted"

    def _forget_newest(self) -> Status:
        """Forget the newest frame, which is unusable, and return why; views show its age."""
        unusable = self._window.pop()
        contrast = self.settings.observer.screening.min_contrast
        is_blank = bool(pinhole.grey8(unusable.image).std() <= contrast)
        self._state = replace(self._state, newest=unusable, is_blank=is_blank)
        return "blank" if is_blank else "duplicate"

    def view(
        self,
        time_s: float,
        commands: Sequence[Command] = (),
        last_from_present: FloatArray | None = None,  # [4, 4]
    ) -> LiveView:
        """Return what the camera sees at a time, after the forecast motion since the last frame.

        Commands replace the forecast, and so does a motion in metres that is known otherwise, such
        as from an IMU. Raise Incompatible before the first frame, or where these need the camera's
        height.
        """
        state = self._state  # one that a push in another thread does not change
        if state.newest is None:
            raise Incompatible("there is no frame yet: push one before the first view")
        is_metric = bool(commands) or last_from_present is not None
        if is_metric and self._height_m is None:
            raise Incompatible(
                "the motion is given in metres, but the scale is unknown: give the camera's height "
                "above the road"
            )
        late = LiveView(
            frame=state.newest.image,
            covered=np.ones(state.newest.image.shape[:2], bool),
            confidence=0.0,
            warning=self._warning(state, time_s, is_metric),
            age_s=time_s - state.newest.time_s,
            path_px=np.zeros((0, 2)),
            path_sides_px=np.zeros((2, 0, 2)),
        )
        present = state.present
        if late.warning is not None or present is None:
            return late

        # Render the scene from the present pose; copies of the last frame count as seen
        path, times_s = self._path(present, time_s, commands, last_from_present)
        # A given motion is not that of the image
        scene = replace(present.scene, verdict=Verdict()) if is_metric else present.scene
        views = scene.view(path[:1], times_s[:1], self.intrinsics)
        covered = (views.covered | scene.copied(path[:1], self.intrinsics))[0]
        if covered.mean() < self.settings.min_covered:
            unseen = 100 * (1 - covered.mean())
            warning = f"{unseen:.0f} % of the view was never seen"
            return replace(late, warning=warning)

        if self._height_m is not None and present.past.is_metric:
            path_px, sides_px = self._drawn_path(present, path, times_s, is_metric)
            late = replace(late, path_px=path_px, path_sides_px=sides_px)
        agreement = present.scene.verdict.agreement * present.tracked.mean()
        confidence = float(covered.mean() * agreement)
        return replace(
            late,
            frame=views.frames[0],
            covered=covered,
            confidence=confidence,
            caution=self._caution(present, late.age_s, confidence),
            moving=None if views.moving is None else views.moving[0],
        )

    def _path(
        self,
        present: _Present,
        time_s: float,
        commands: Sequence[Command],
        last_from_present: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the poses [F, 4, 4] and times [F] of the path from a time on."""
        settings = self.settings
        start_s = float(present.past.times_s[-1])
        now_s = max(time_s, start_s)
        times_s = now_s + np.arange(0, settings.path_s, settings.path_step_s)
        if last_from_present is not None:
            path = present.past.world_from_cam[-1] @ last_from_present[None]
            return path, times_s[:1]
        if not commands:
            return present.pose(times_s), times_s
        path = commanded_poses(
            commands,
            present.past.world_from_cam[-1],
            present.vehicle_from_cam,
            start_s,
            times_s,
        )
        return path, times_s

    def _check(self, frame: ByteArray, time_s: float) -> None:
        camera = self.intrinsics
        shape = (camera.height_px, camera.width_px, 3)
        if np.shape(frame) != shape or frame.dtype != np.uint8:
            raise BadData(
                f"the frame is {frame.dtype} {np.shape(frame)}, expected uint8 {shape}: resize it, "
                "or give the intrinsics of this size"
            )
        if not np.isfinite(time_s):
            raise BadData(f"the frame's time is {time_s}, expected seconds")

    def _observe(self) -> tuple[Observed, BoolArray]:
        """Observe the remembered frames; return also which of them are usable [P]."""
        times_s = [frame.time_s for frame in self._window]
        context = Context(
            frames=np.stack([frame.image for frame in self._window]),
            times_s=np.array([*times_s, times_s[-1] + self.settings.path_step_s]),
            intrinsics=self.intrinsics,
            camera_height_m=self._height_m,
        )
        observed = self._predictor.observe(context)
        return observed, observations_of(observed.context, "crop").is_usable

    def _keep(self, frames: BoolArray | slice) -> Observed:
        """Forget the other frames [P], and what was tracked through them; observe again."""
        numbers = np.arange(len(self._window))[frames]
        self._restart([self._window[number] for number in numbers])
        return self._observe()[0]

    def _track(self, observed: Observed) -> MonocularRun:
        """Track the newest frame; all frames again if the scene's window in the image changed."""
        observations = observations_of(observed.context, "crop")
        camera = observations.intrinsics
        odometry = self._odometry
        new = slice(-1, None)
        if odometry is None or odometry.camera != camera:
            settings = self.settings
            odometry = self._odometry = MonocularRun(
                settings.odometry,
                camera,
                self._height_m,
                settings.num_frames,
                settings.min_frames,
            )
            new = slice(None)
        for frame, grey in zip(self._window[new], observations.greys[new], strict=True):
            odometry.push(self.settings.odometry.image(grey, frame.time_s, observations.mask))
        return odometry

    def _forecast(self, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return times [F] from the last frame on, and futures [S, F, 4, 4], the central first."""
        # Times up to the end of the path that is planned at the latest view
        settings = self.settings
        end_s = settings.max_ahead_s + settings.path_s
        ahead_s = np.arange(0, end_s + settings.path_step_s, settings.path_step_s)
        times_s = past.times_s[-1] + ahead_s

        # The forecaster is chosen in each frame until the memory is full, then after each test
        forecaster = self._forecaster
        if forecaster is None or len(past) < settings.num_frames:
            forecaster = settings.forecaster
            if isinstance(forecaster, Selected):
                forecaster = forecaster.select(past)
            self._forecaster = forecaster

        # The central future is shown; the spread of the others is the uncertainty of the path
        futures = forecaster.forecast(past, times_s[1:])[:1]
        if past.is_metric and len(past) >= settings.min_frames:
            samples = forecaster.forecast(past, times_s[1:], settings.num_path_samples)
            futures = np.concatenate([futures, samples])

        # All futures start at the last frame, so that views between the two can be interpolated
        shape = (len(futures), 1, 4, 4)
        last = np.broadcast_to(past.world_from_cam[-1], shape)
        return times_s, np.concatenate([last, futures], axis=1)

    def _warning(self, state: _State, time_s: float, is_given: bool) -> str | None:
        """Return why no prediction is to be trusted at a time."""
        present, settings = state.present, self.settings
        num_frames = 0 if present is None else len(present.past)
        if present is None or num_frames < settings.min_frames:
            return f"too few usable frames since the start: {num_frames}"
        if state.is_blank:
            return "the newest frame is blank"
        ahead_s = time_s - present.past.times_s[-1]
        if ahead_s > settings.max_ahead_s:
            return f"the last usable frame is {ahead_s:.1f} s old"
        if present.tracked.mean() < settings.min_tracked:
            return "the camera's motion could not be tracked"
        if present.scene.verdict.shown_by == "last-frame":
            return "the scene does not predict the newest frames"
        if is_given and not present.past.is_metric:
            return "the scale of the scene is unknown"
        return None

    def _caution(self, present: _Present, age_s: float, confidence: float) -> str | None:
        """Return why a shown prediction may be wrong."""
        settings = self.settings
        if present.scene.verdict.shown_by == "image-motion":
            return "the motion of the image is continued, since the scene predicts it worse"
        if age_s > settings.max_sure_age_s:
            return f"the newest image is {age_s:.1f} s old"
        if confidence < settings.min_sure_confidence:
            return f"the confidence is {100 * confidence:.0f} %"
        return None

    def _drawn_path(
        self,
        present: _Present,
        path: FloatArray,  # [M, 4, 4], from the present on
        times_s: FloatArray,  # [M]
        is_given: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the path on the ground [M, 2] and its sides [2, M, 2] in pixels of the present.

        Its uncertainty is one standard deviation of the sampled futures, if it is forecast,
        but at least half the width of the vehicle.
        """
        # Half the width of the path: that of the vehicle, or the spread of the futures sideways
        right = path[:, :3, 0]
        half_m = np.full(len(path), self.settings.vehicle_width_m / 2)
        if not is_given and len(present.futures) > 1:
            sampled = interp1d(present.times_s, present.futures[1:, :, :3, 3], axis=1)(times_s)
            lateral = ((sampled - path[:, :3, 3]) * right).sum(axis=-1)
            half_m = np.maximum(half_m, np.sqrt((lateral**2).mean(axis=0)))

        # The path and its sides lie on the ground, below the camera
        last = present.past.world_from_cam[-1]
        down = last[:3, :3] @ present.vehicle_from_cam[1, :3]
        assert self._height_m is not None
        ground = path[:, :3, 3] + self._height_m * down
        offset = half_m[:, None] * right
        points = np.stack([ground, ground - offset, ground + offset])

        # Project them into the present view
        in_view = se3.transform(se3.inverse(path[0]), points)
        pixels, depth = pinhole.project(in_view, self.intrinsics)
        is_ahead = depth > self.settings.min_path_depth_m
        pixels = np.where(is_ahead[..., None], pixels, np.nan)
        return pixels[0], pixels[1:]


@contextmanager
def _timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Store the seconds that a stage takes."""
    start_s = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - start_s

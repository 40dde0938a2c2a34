"""The live predictor: push frames as they arrive, ask for the view at any time."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Self

import numpy as np

from geovp_classic.errors import BadData, Incompatible, check_kind
from geovp_classic.odometry.monocular import MonocularRun
from geovp_classic.odometry.unit_scale import UnitSpeed
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import HindcastVerdict
from geovp_classic.streaming.commands import Command
from geovp_classic.streaming.live_hindcast import LiveHindcast
from geovp_classic.streaming.present import LiveState, Present, forecast
from geovp_classic.streaming.recent_frames import Frame, RecentFrames, Status
from geovp_classic.streaming.settings import LiveSettings
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics
from geovp_classic.types.arrays import checked_rigid


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

    @classmethod
    def late(cls, image: ByteArray, age_s: float, warning: str | None) -> Self:
        """Return a view that shows the newest frame [H, W, 3] without a planned track."""
        covered = np.ones(image.shape[:2], bool)
        return cls(image, covered, 0.0, warning, age_s, np.zeros((0, 2)), np.zeros((2, 0, 2)))

    @property
    def is_predicted(self) -> bool:
        """Return whether the frame is a prediction."""
        return self.warning is None


class LivePredictor:
    """Prediction of the present of a delayed camera, frame by frame, in bounded memory.

    Each frame is tracked, measured and reconstructed once; the scene of the last frame replaces
    the one before.

    One thread may push and reset while others ask for views, without a lock. A push ends with one
    assignment of `_state`, and a view reads it once: it sees the state before or after the push.
    All other attributes that change belong to the thread that pushes.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        camera_height_m: float | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        check_kind("intrinsics", intrinsics, Intrinsics, "Intrinsics")
        check_kind("camera_height_m", camera_height_m, (Real, type(None)), "a number or None")
        check_kind("settings", settings, (LiveSettings, type(None)), "LiveSettings or None")
        if camera_height_m is not None and not 0 < camera_height_m < np.inf:
            raise BadData(f"camera_height_m is {camera_height_m}, expected a positive number")
        self.intrinsics = intrinsics
        self.settings = settings or LiveSettings()
        if camera_height_m is None:  # no metric scale
            odometry = replace(self.settings.odometry, scale=UnitSpeed())
            self.settings = replace(self.settings, odometry=odometry)
        self._height_m = camera_height_m
        self._predictor = GeometricPredictor(
            Chained(self.settings.odometry, self.settings.forecaster),
            self.settings.renderer,
            self.settings.observer,
        )
        self._frames = RecentFrames(
            self._predictor, intrinsics, camera_height_m, self.settings.num_frames
        )
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._forget()
        self._state = LiveState()

    def push(self, frame: ByteArray, time_s: float) -> PushReport:
        """Add a frame [H, W, 3] uint8 of the camera, taken at a time.

        A late frame is ignored: one that is not newer than the last one. Raise BadData for
        another shape.
        """
        self._check(frame, time_s)
        image = np.array(frame)
        image.flags.writeable = False  # a view may show it
        added = Frame(image, float(time_s))
        seconds: dict[str, float] = {}

        # Ignore a late frame; after a gap, views show the new one until it is reconstructed
        newest, max_gap_s = self._state.newest, self.settings.max_gap_s
        elapsed_s = max_gap_s if newest is None else added.time_s - newest.time_s
        is_after_gap = abs(elapsed_s) > max_gap_s
        if is_after_gap:
            self._forget()
            self._state = LiveState(added)
        elif elapsed_s <= 0:
            return PushReport("late")

        # Observe the last frames; one that shows nothing new is not remembered
        with _timed("observe", seconds):
            status = self._frames.add(added)
        if status in ("blank", "duplicate"):
            self._state = replace(self._state, newest=added, is_blank=status == "blank")
            return PushReport(status, seconds)
        if status == "restarted":  # by a cut
            self._forget_motion()

        # Track the camera up to the new frame, or from the new frame on if it is lost
        with _timed("track", seconds):
            odometry = self._track()
            if odometry.is_lost:
                status = "restarted"
                self._frames.keep(slice(-1, None))
                self._forget_motion()
                odometry = self._track()
        with _timed("scale", seconds):
            past, tracked = odometry.past()

        # Reconstruct the scene, forecast the motion, and decide what is shown
        with _timed("scene", seconds):
            scene = self._predictor.reconstruct(self._frames.observed, past)
        with _timed("forecast", seconds):
            forecaster = self._hindcast.forecaster(past)
            times_s, futures = forecast(forecaster, past, self.settings)
        with _timed("hindcast", seconds):
            scene = self._hindcast.judge(scene, added)
        present = Present(self.settings, scene, past, tracked, times_s, futures)
        self._hindcast.remember(present)

        # Views show it from now on
        self._state = LiveState(added, False, present)
        return PushReport("restarted" if is_after_gap else status, seconds)

    def view(
        self,
        time_s: float,
        commands: Sequence[Command] = (),
        last_from_present: FloatArray | None = None,  # [4, 4]
    ) -> LiveView:
        """Return what the camera sees at a time, after the forecast motion since the last frame.

        Commands replace the forecast, and so does a motion in metres that is known otherwise, such
        as from an IMU. The frame of a view is read-only. Raise Incompatible before the first
        frame, or where these need the camera's height; BadData for other input.
        """
        state = self._state
        newest, present = state.newest, state.present
        if newest is None:
            raise Incompatible("there is no frame yet: push one before the first view")
        is_given = bool(commands) or last_from_present is not None
        _check_time("view", time_s)
        if is_given and self._height_m is None:
            raise Incompatible(
                "the motion is given in metres, but the scale is unknown: give the camera's height "
                "above the road"
            )
        if last_from_present is not None:
            last_from_present = checked_rigid("last_from_present", last_from_present, 2)

        # Without a prediction that is to be trusted, show the newest frame
        warning = state.warning(self.settings, time_s, is_given)
        late = LiveView.late(newest.image, time_s - newest.time_s, warning)
        if late.warning is not None or present is None:
            return late

        # Render the scene from the present pose; copies of the last frame count as seen
        path, times_s = present.path(time_s, commands, last_from_present)
        # A given motion is not that of the image
        scene = replace(present.scene, verdict=HindcastVerdict()) if is_given else present.scene
        views = scene.view(path[:1], times_s[:1], self.intrinsics)
        covered = (views.covered | scene.copied(path[:1], self.intrinsics))[0]
        if covered.mean() < self.settings.min_covered:
            unseen = 100 * (1 - covered.mean())
            return replace(late, warning=f"{unseen:.0f} % of the view was never seen")

        # Draw the planned path, and state how sure the prediction is
        if self._height_m is not None and present.past.is_metric:
            path_px, sides_px = present.drawn_path(path, times_s, is_given, self._height_m)
            late = replace(late, path_px=path_px, path_sides_px=sides_px)
        agreement = present.scene.verdict.agreement * present.tracked.mean()
        confidence = float(covered.mean() * agreement)
        return replace(
            late,
            frame=views.frames[0],
            covered=covered,
            confidence=confidence,
            caution=present.caution(late.age_s, confidence, is_given),
            moving=None if views.moving is None else views.moving[0],
        )

    def _check(self, frame: ByteArray, time_s: float) -> None:
        camera = self.intrinsics
        shape = (camera.height_px, camera.width_px, 3)
        image = np.asarray(frame)
        if image.shape != shape or image.dtype != np.uint8:
            raise BadData(
                f"the frame is {image.dtype} {image.shape}, expected uint8 {shape}: convert or "
                "resize it, or give the intrinsics of its size"
            )
        _check_time("frame", time_s)

    def _forget(self) -> None:
        """Forget the remembered frames, and the motion through them."""
        self._frames.frames = []
        self._forget_motion()

    def _forget_motion(self) -> None:
        """Forget what was tracked, and what was tested with it."""
        self._odometry: MonocularRun | None = None
        self._hindcast = LiveHindcast(self.settings)

    def _track(self) -> MonocularRun:
        """Track the newest frame; all frames again if the scene's window in the image changed."""
        settings = self.settings
        observations = self._frames.observations
        camera = observations.intrinsics
        new = slice(-1, None)
        if self._odometry is None or self._odometry.camera != camera:
            self._odometry = MonocularRun(
                settings.odometry,
                camera,
                self._height_m,
                settings.num_frames,
                settings.min_frames,
            )
            new = slice(None)
        for frame, grey in zip(self._frames.frames[new], observations.greys[new], strict=True):
            image = settings.odometry.image(grey, frame.time_s, observations.mask)
            self._odometry.push(image)
        return self._odometry


def _check_time(of: str, time_s: object) -> None:
    if not isinstance(time_s, Real) or not np.isfinite(float(time_s)):
        raise BadData(f"the time of the {of} is {time_s}, expected seconds")


@contextmanager
def _timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Store the seconds that a stage takes."""
    start_s = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - start_s

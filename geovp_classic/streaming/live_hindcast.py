"""Hindcast of a stream: predictions are compared with the frames that follow, one at a time."""

from dataclasses import replace

import numpy as np

from geovp_classic.forecasting.selected import Selected
from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import Forecaster
from geovp_classic.predictors.hindcast import HindcastVerdict, ShownScene
from geovp_classic.streaming.present import Present
from geovp_classic.streaming.recent_frames import Frame
from geovp_classic.streaming.settings import LiveSettings
from geovp_classic.types import ShownBy, Trajectory


class LiveHindcast:
    """Choice of the forecaster, and of what is shown, with each tested prediction."""

    def __init__(self, settings: LiveSettings) -> None:
        self._settings = settings
        self._tested: Present | None = None  # whose prediction is tested next
        self._num_frames = 0  # from that on
        self._errors: list[dict[ShownBy, float]] = []  # of the last tested predictions
        self._forecaster: Forecaster | None = None  # chosen after the last test

    def forecaster(self, past: Trajectory) -> Forecaster:
        """Return the forecaster: chosen anew until the memory is full, then after each test."""
        settings = self._settings
        if self._forecaster is None or len(past) < settings.num_frames:
            self._forecaster = settings.forecaster
            if isinstance(settings.forecaster, Selected):
                self._forecaster = settings.forecaster.select(past)
        return self._forecaster

    def judge(self, scene: ShownScene, newest: Frame) -> ShownScene:
        """Return the scene of the newest frame with the verdict of the last tests."""
        settings, hindcast = self._settings, self._settings.hindcast
        if self._tested is not None and self._num_frames == settings.hindcast_steps:
            errors = self._test(self._tested, scene, newest)
            self._errors = [*self._errors, errors][-settings.num_tests :]
            self._tested = None
            self._forecaster = None
        is_judged = len(self._errors) == settings.num_tests
        verdict = hindcast.verdict(self._errors) if is_judged else HindcastVerdict()
        return replace(scene, image_motion=hindcast.image_motion, verdict=verdict)

    def remember(self, present: Present) -> None:
        """Remember a prediction that is tested after `hindcast_steps` frames, if none is."""
        if self._tested is None and len(present.past) >= self._settings.hindcast_steps:
            self._tested = present
            self._num_frames = 0
        self._num_frames += 1

    def _test(self, earlier: Present, scene: ShownScene, newest: Frame) -> dict[ShownBy, float]:
        """Return the errors of what was predicted for the newest frame, by each way to show it."""
        hindcast = self._settings.hindcast
        camera = scene.context.intrinsics
        size_px = hindcast.frame_size(camera)
        times_s = np.array([newest.time_s])
        poses = earlier.poses(times_s)
        predicted = earlier.scene.each(poses, times_s, camera.resized(*size_px))
        actual = pinhole.resize(newest.image, size_px)[None]
        mask = pinhole.resize_mask(scene.mask, size_px)
        return {way: hindcast.error(frames, actual, mask) for way, frames in predicted.items()}

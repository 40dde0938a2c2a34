"""A display session: takes images, delays them, predicts the present and shows it."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_benchmarks.display import drawing
from geovp_benchmarks.display.channel import Channel, InFlight, Sent
from geovp_benchmarks.display.commands import Driver
from geovp_benchmarks.display.source import Source
from geovp_benchmarks.plots.video import labelled, write_mp4
from geovp_benchmarks.progress import tracked
from geovp_classic.data.atomic import atomic_write
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.streaming import Command, LivePredictor
from geovp_classic.types import ByteArray

TICK_S = 0.04  # between two views of a driver
Publish = Callable[["Shown"], None]


@dataclass(frozen=True)
class Shown:
    """What the display shows at an instant."""

    panels: dict[str, ByteArray]  # [H, W, 3] each, by name
    warning: str | None  # why the late image is shown in place of a prediction
    age_s: float | None  # of the late image
    confidence: float  # in [0, 1]
    is_dimming: bool = False  # of inpainted pixels


class Session:
    """The state of a display: images on their way, the predictor, and how its views are drawn."""

    def __init__(
        self,
        source: Source,
        channel: Channel,
        planned: Sequence[Command] = (),  # with the times of the recording
        driver: Driver | None = None,
    ) -> None:
        """Check the source; raise Incompatible for commands without the camera's height."""
        self.source = source
        self.channel = channel
        self.planned = planned
        self.driver = driver
        self.is_dimming = False  # of inpainted pixels
        height_m = source.recording.camera_height_m
        if height_m is None and (planned or driver is not None):
            raise Incompatible(
                "commands are in metres, but the scale is unknown: give --camera-height"
            )
        self.live = LivePredictor(source.intrinsics, height_m)
        self._restart()

    def render(self) -> Iterator[Shown]:
        """Yield a view of each frame of a recording, as fast as possible."""
        times_s, due_s = self.source.times_s, self.source.due_s()
        for step in tracked(range(len(times_s))):
            frame = self.source.read(step)
            self._in_flight.send(step, frame, times_s[step], due_s[step])
            for sent in self._in_flight.receive(due_s[step]):
                self._push(sent)
            yield self.draw_present(times_s[step], frame)

    def run(self, publish: Publish, stop: threading.Event) -> None:
        """Show views on the wall clock until `stop` is set; a recording starts again at its end.

        When views take longer than frames, frames are dropped.
        """
        play = self._capture if self.source.is_camera else self._replay
        while not stop.is_set():
            self._restart()
            is_done = threading.Event()
            with ThreadPoolExecutor(1) as pool:
                pushing = pool.submit(self._push_arrivals, is_done, stop)
                try:
                    play(publish, stop)
                finally:
                    is_done.set()
            pushing.result()

    def draw_present(self, now_s: float, true: ByteArray | None) -> Shown:
        """Predict the present and draw it next to the late image and the true present."""
        commands = self.planned if self.driver is None else self.driver.at(now_s)
        warning: str | None = "no image has arrived since the start"
        confidence, late = 0.0, self._late
        if late is None:
            panels = {"late image": np.zeros((*self.source.size_px[::-1], 3), np.uint8)}
        else:
            panels = {f"late image, {now_s - late.time_s:.2f} s old": late.frame}
        with suppress(Incompatible):  # before the first image, and while a push restarts
            view = self.live.view(now_s, commands)
            warning = view.warning
            if warning is None and view.age_s < 0:
                warning = "the clock jumped: the newest image is from the future"
            if warning is None:
                confidence = view.confidence
                panels["predicted present"] = drawing.draw_view(view, self.is_dimming)
        if warning is not None:
            (frame,) = panels.values()
            panels["late image, not predicted"] = drawing.draw_warning(frame, warning)
        if true is not None:
            panels["true present"] = true
        age_s = None if late is None else now_s - late.time_s
        return Shown(panels, warning, age_s, confidence, self.is_dimming)

    def _restart(self) -> None:
        """Forget all images and start the clock."""
        self.live.reset()
        self._in_flight = InFlight(self.channel)
        self._late: Sent | None = None  # the newest image that the predictor has
        self._start_s = time.monotonic()

    def _elapsed_s(self) -> float:
        return time.monotonic() - self._start_s

    def _replay(self, publish: Publish, stop: threading.Event) -> None:
        """Replay a recording once, with a view of each frame, or more often for a driver."""
        times_s, due_s = self.source.times_s, self.source.due_s()
        is_driven = self.driver is not None
        step = -1
        while not stop.is_set():
            elapsed_s = self._elapsed_s()
            newest = int(np.searchsorted(due_s, elapsed_s, side="right")) - 1
            if newest > step:  # frames between them are dropped
                step = newest
                frame = self.source.read(step)
                self._in_flight.send(step, frame, times_s[step], elapsed_s)
            ahead_s = elapsed_s - due_s[step] if is_driven else 0.0
            publish(self.draw_present(times_s[step] + ahead_s, frame))
            if step + 1 == len(times_s):
                return
            wait_s = due_s[step + 1] - self._elapsed_s()
            stop.wait(max(0.0, min(wait_s, TICK_S) if is_driven else wait_s))

    def _capture(self, publish: Publish, stop: threading.Event) -> None:
        """Show a view of each image of a camera."""
        for number in itertools.count():
            frame = self.source.read(0)
            if stop.is_set():
                return
            now_s = self._elapsed_s()
            self._in_flight.send(number, frame, now_s, now_s)
            publish(self.draw_present(now_s, frame))

    def _push(self, sent: Sent) -> None:
        """Give an image to the predictor, unless a later one has overtaken it."""
        if self._late is not None and sent.number < self._late.number:
            return
        if self.live.push(sent.frame, sent.time_s).status != "late":
            self._late = sent

    def _push_arrivals(self, is_done: threading.Event, stop: threading.Event) -> None:
        """Push images as they arrive; those that waited for the predictor are dropped.

        An exception sets `stop`.
        """
        try:
            while not is_done.is_set():
                arrived = self._in_flight.receive(self._elapsed_s())
                if arrived:
                    self._push(max(arrived, key=lambda sent: sent.number))
                else:
                    is_done.wait(0.005)
        except BaseException:
            stop.set()
            raise


def write_video(session: Session, path: Path) -> None:
    """Write all views of a recording side by side to an mp4 file."""
    if session.source.is_camera:
        raise BadData("--out needs a recording, and a camera has no end: give a video or a folder")
    frames = (
        np.concatenate([labelled(frame, name) for name, frame in shown.panels.items()], axis=1)
        for shown in session.render()
    )
    rate_hz = 1 / float(np.median(np.diff(session.source.times_s)))
    with atomic_write(path) as scratch:
        write_mp4(scratch, frames, rate_hz)

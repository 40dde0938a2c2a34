"""A display session: takes images, delays them, predicts the present and shows it."""

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geovp.display import drawing
from geovp.display.channel import Channel, Sent
from geovp.display.commands import Driver
from geovp.display.source import Source
from geovp.drawing.video import labelled, write_mp4
from geovp.progress import tracked
from geovp_classic.atomic import atomic_write
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.streaming import Command, LivePredictor
from geovp_classic.types import ByteArray

Publish = Callable[["Shown"], None]


@dataclass(frozen=True)
class Shown:
    """What the display shows at an instant."""

    panels: dict[str, ByteArray]  # [H, W, 3] each, by name
    warning: str | None  # why the late image is shown in place of a prediction
    caution: str | None  # why the shown prediction may be wrong
    age_s: float | None  # of the late image
    confidence: float  # in [0, 1]
    is_dimming: bool = False  # of inpainted pixels
    is_marking: bool = False  # of what moves on its own


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
        self.is_marking = False  # of what moves on its own
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
            self._channel.send(step, frame, times_s[step], due_s[step])
            for sent in self._channel.receive(due_s[step]):
                self._push(sent)
            yield self.draw_present(times_s[step], frame)

    def run(self, publish: Publish, stop: threading.Event) -> None:
        """Show views on the wall clock until `stop` is set; a recording starts again at its end.

        Images are pushed while others are shown; those that waited for the predictor are dropped.
        """
        with ThreadPoolExecutor(1) as pool:
            try:
                while not stop.is_set():
                    self._restart()
                    showing = pool.submit(self._show, publish, stop)
                    while not showing.done():
                        arrived = self._channel.receive(time.monotonic())
                        if arrived:
                            self._is_overrun = len(arrived) > 1
                            self._push(max(arrived, key=lambda sent: sent.number))
                        else:
                            time.sleep(0.005)
                    showing.result()
            finally:
                stop.set()  # no views after a failure

    def draw_present(self, now_s: float, true: ByteArray) -> Shown:
        """Predict the present and draw it next to the late image and the true present."""
        commands = self.planned if self.driver is None else self.driver.at(now_s)
        late, age_s, confidence = self._late, None, 0.0
        panels = {"late image": np.zeros_like(true)}
        if late is not None:
            age_s = now_s - late.time_s
            panels = {f"late image, {age_s:.2f} s old": late.frame}
        warning: str | None = "no image has arrived since the start"
        caution = None
        with suppress(Incompatible):  # before the first image, and while a push restarts
            view = self.live.view(now_s, commands)
            warning = view.warning
            if warning is None and view.age_s < 0:
                warning = "the clock jumped: the newest image is from the future"
            if warning is None:
                confidence, caution = view.confidence, view.caution
                if caution is None and self._is_overrun:
                    caution = "images arrive faster than they are processed"
                predicted = drawing.draw_view(view, self.is_dimming, self.is_marking)
                if caution is not None:
                    predicted = drawing.draw_border(predicted)
                panels["predicted present"] = predicted
        if warning is not None:
            (frame,) = panels.values()
            panels["late image, not predicted"] = drawing.draw_warning(frame, warning)
        panels["true present"] = true
        return Shown(panels, warning, caution, age_s, confidence, self.is_dimming, self.is_marking)

    def _restart(self) -> None:
        """Forget all images."""
        self.live.reset()
        self._channel = replace(self.channel)
        self._late: Sent | None = None  # the newest image that the predictor has
        self._is_overrun = False  # whether images had to be dropped

    def _show(self, publish: Publish, stop: threading.Event) -> None:
        """Send the images of the source, and show a view at the time of each.

        A driver, who waits for the effect of a command, has more views than images.
        """
        repeat_s, newest = math.inf if self.driver is None else 0.04, -1
        for number, time_s, frame in self.source.images(stop, repeat_s):
            if number > newest:
                self._channel.send(number, frame, time_s, time.monotonic())
                newest = number
            publish(self.draw_present(time_s, frame))

    def _push(self, sent: Sent) -> None:
        """Give an image to the predictor, unless a later one has overtaken it."""
        if self._late is not None and sent.number < self._late.number:
            return
        if self.live.push(sent.frame, sent.time_s).status != "late":
            self._late = sent


def write_video(session: Session, path: Path) -> None:
    """Write all views of a recording side by side to an mp4 file."""
    if session.source.is_camera:
        raise BadData("--out needs a recording, and a camera has no end: give a video or a folder")
    if path.suffix != ".mp4":
        raise BadData(f"--out {path} does not end in .mp4: give a file, such as display.mp4")
    frames = (
        np.concatenate([labelled(frame, name) for name, frame in shown.panels.items()], axis=1)
        for shown in session.render()
    )
    rate_hz = 1 / float(np.median(np.diff(session.source.times_s)))
    with atomic_write(path) as scratch:
        write_mp4(scratch, frames, rate_hz)

"""Images of a recording or of a camera at this computer, at the size of the display."""

import itertools
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from geovp.prediction.camera import find_camera
from geovp.prediction.prediction import read_recording
from geovp.prediction.request import PredictionRequest, output_size
from geovp.progress import logger
from geovp_classic import registry
from geovp_classic.data.formats import bags
from geovp_classic.data.frames.image_frames import FrameFiles
from geovp_classic.data.layouts import detection
from geovp_classic.data.recordings.windows import FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class Source:
    """Images that are replayed with the times of their recording, or captured now."""

    recording: Recording  # of one frame if it is a camera
    numbers: range  # of the frames that are replayed
    size_px: tuple[int, int]  # (width, height)
    is_camera: bool = False

    @classmethod
    def open(cls, request: PredictionRequest, sequence: str | None = None) -> Self:
        """Open a video, a folder of images, a data set, a bag, or a camera by its number.

        Raise BadData if the camera's intrinsics or the frame rate are missing, or if the data set
        has others.
        """
        path = request.path
        is_camera = str(path).isdecimal() and not path.exists()
        if is_camera:
            recording = _camera(request)
            numbers = range(1)
        elif (layout := detection.detect(path, is_part_allowed=True))[0] == "folder" or (
            bags.is_bag(path) and request.has_camera
        ):
            folders = layout[1].folders()  # one, or those of several sequences
            name = sequence or next(iter(folders))
            stretch = FrameRange(name) if name in folders else FrameRange.parse(name)
            if sequence is not None and path in folders.values():
                raise BadData(f"{path} has no sequences: remove --sequence")
            if stretch.sequence not in folders:
                raise BadData(f"{path} has no {sequence!r}: give a --sequence of {list(folders)}")
            request = replace(request, path=folders[stretch.sequence])
            recording, lens = read_recording(request)
            first = replace(request, first=0)  # all frames are replayed, from the first on
            recording = recording.selected(first.frame_numbers(recording.times_s))
            numbers = range(len(recording.frames))[stretch.first : stretch.last]
            if len(numbers) < 2:
                raise BadData(
                    f"the display needs 2 frames, and {path} has {len(numbers)} in use: give a "
                    "longer --sequence, a smaller --every or a larger --rate"
                )
            camera, recording = find_camera(recording, lens, len(numbers), request)
            for warning in camera.warnings():
                logger.warning(warning)
        else:
            recording, numbers = _sequence(request, sequence)
        # About 6 pushed frames per second on two cores.
        size_px = request.size_px or output_size(recording.intrinsics, max_side_px=480)
        return cls(recording, numbers, size_px, is_camera)

    @property
    def intrinsics(self) -> Intrinsics:
        """Return the camera of the displayed images."""
        return pinhole.centre_crop(self.recording.intrinsics, self.size_px)[1]

    @property
    def times_s(self) -> FloatArray:
        """Return when the replayed frames were taken [N]."""
        return self.recording.times_s[self.numbers]

    def images(
        self, stop: threading.Event, repeat_s: float
    ) -> Iterator[tuple[int, float, ByteArray]]:
        """Yield number, time and image until `stop` is set: of a camera, each as it comes.

        Images of a recording are yielded when they are due; overdue ones are dropped. The last one
        is repeated with the present time after each `repeat_s` without a new one.
        """
        start_s = time.monotonic()
        if self.is_camera:
            for number in itertools.count():
                frame = self.read(0)
                if stop.is_set():
                    return
                yield number, time.monotonic() - start_s, frame
        step, due_s = -1, start_s + self.due_s()
        while step + 1 < len(due_s):
            if stop.wait(min(due_s[step + 1] - time.monotonic(), repeat_s)):
                return
            now_s = time.monotonic()
            newest = int(np.searchsorted(due_s, now_s, side="right")) - 1
            ahead_s = now_s - due_s[step]
            if newest > step:
                step, ahead_s, frame = newest, 0.0, self.read(newest)
            yield step, self.times_s[step] + ahead_s, frame

    def read(self, step: int) -> ByteArray:
        """Return a replayed frame [H, W, 3]; of a camera, wait for the next image."""
        window, _ = pinhole.centre_crop(self.recording.intrinsics, self.size_px)
        frame = self.recording.frames.read(self.numbers[step])
        return pinhole.resize(frame[window], self.size_px)

    def due_s(self, max_gap_s: float = 1.0) -> FloatArray:
        """Return when each frame is replayed [N], in seconds since the start.

        Longer gaps and jumps of the recording's clock are not waited for.
        """
        steps_s = np.clip(np.diff(self.times_s), 0, max_gap_s)
        return np.concatenate([[0.0], np.cumsum(steps_s)])


def _camera(request: PredictionRequest) -> Recording:
    """Return a recording of one frame, which is always the next image of a camera."""
    if not request.has_camera:
        raise BadData("a camera needs its intrinsics: give --fov, --calibration or --intrinsics")
    request.refuse("a camera", "frame_rate_hz", "image_topic", "name_pattern", "image_bits")
    capture = cv2.VideoCapture(int(request.path.name))
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # older images would only add delay

    def read(path: Path) -> ByteArray:
        is_read, image = capture.read()
        if not is_read:
            raise BadData(
                f"camera {path} delivers no images: check that it is connected and that no other "
                "program uses it, or give another number"
            )
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    height_px, width_px = read(request.path).shape[:2]
    recording = Recording(
        f"camera {request.path}",
        FrameFiles((request.path,), ((width_px, height_px),), read),
        np.zeros(1),
        Intrinsics(width_px, width_px, 0.0, 0.0, width_px, height_px),  # a placeholder
        camera_height_m=request.camera_height_m,
    )
    return find_camera(recording, None, 1, request)[1]


def _sequence(request: PredictionRequest, sequence: str | None) -> tuple[Recording, range]:
    """Return a recording of a data set, by default the first, and the numbers of its frames."""
    if request.has_camera or request.distortion or request.frame_rate_hz:
        raise BadData(
            f"{request.path} has its own calibration and times: remove --fov, --intrinsics, "
            "--calibration, --distortion and --fps"
        )
    layout, dataset = detection.detect(request.path)
    table = {
        "name": layout,
        "root": request.path,
        "num_frames": 2,
        "sequences": sequence and [sequence],
        "frame_step": request.frame_step,
    }
    if layout == "rosbag":  # poses are not shown, and there may be several topics of them
        table |= {"pose_topic": "", "rate_hz": 10.0}
    for name in ("rate_hz", "camera_height_m", "image_topic", "image_bits", "name_pattern"):
        if not hasattr(dataset, name):
            request.refuse(f"a data set ({layout})", name)
        elif (value := getattr(request, name)) is not None:
            table[name] = value
    dataset = registry.build("datasets", table)
    stretch = dataset.ranges[0]
    recording = dataset.recordings[stretch.sequence]
    return recording, range(len(recording.frames))[stretch.first : stretch.last]

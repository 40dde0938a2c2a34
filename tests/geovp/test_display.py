"""`geovp display`: channel, commands, drawings and sessions."""

import os
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import av
import bag_files
import cv2
import numpy as np
import pytest
import street

from geovp.display import commands, drawing
from geovp.display.channel import Channel
from geovp.display.commands import Driver, read_commands
from geovp.display.session import Session, Shown
from geovp.display.source import Source
from geovp.prediction.prediction import read_recording
from geovp.prediction.request import PredictionRequest
from geovp_classic.data.recordings.windows import Recording
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.errors import BadData
from geovp_classic.streaming import Command
from geovp_classic.types import ByteArray, FloatArray
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import Frames, street_source, write_images

CLIP = street.clip(num_frames=24)
FRAME = np.full((60, 80, 3), 100, np.uint8)


def views(
    frames: ByteArray,
    channel: Channel,
    times_s: FloatArray | None = None,
    planned: Sequence[Command] = (),
) -> list[Shown]:
    session = Session(street_source(frames, times_s), channel, planned)
    return list(session.render())


def is_shown_late(shown: Shown) -> bool:
    """Return whether the second panel is the late image below its banner."""
    late, other = list(shown.panels.values())[:2]
    return bool((late[-30:-4, 4:-4] == other[-30:-4, 4:-4]).all())


class TestChannel:
    def test_jitter_reorders_and_nothing_arrives_early(self) -> None:
        channel = Channel(0.1, 0.5, loss=0.25)
        order = []
        for number in range(400):
            now_s = number * 0.1
            channel.send(number, FRAME, now_s, now_s)
            for sent in channel.receive(now_s):
                assert 0.1 <= now_s - sent.time_s <= 0.7
                order.append(sent.number)
        assert order != sorted(order)
        assert len(order) == len(set(order))
        assert abs(len(order) - 300) < 40  # with a standard deviation of 9


class TestCommands:
    def test_a_file_is_read(self, tmp_path: Path) -> None:
        path = tmp_path / "drive.csv"
        path.write_text("time_s,speed_m_s,yaw_rate_rad_s\n0,8,0\n1.5,7.5,-0.1\n")
        assert read_commands(path) == [Command(0, 8, 0), Command(1.5, 7.5, -0.1)]

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "a,b,c\n0,1,2\n",
            "@\n",
            "@\n0,8\n",
            "@\n0,nan,0\n",
            "@\n2,8,0\n1,8,0",
        ],
    )
    def test_another_file_is_refused(self, tmp_path: Path, text: str) -> None:
        path = tmp_path / "drive.csv"
        path.write_text(text.replace("@", "time_s,speed_m_s,yaw_rate_rad_s"))
        with pytest.raises(BadData, match="is not a file of commands"):
            read_commands(path)

    def test_a_driver_has_the_time_of_the_images(self, monkeypatch: pytest.MonkeyPatch) -> None:
        clock = [100.0]
        monkeypatch.setattr(commands.time, "monotonic", lambda: clock[0])
        driver = Driver(commands=deque(maxlen=3))
        assert driver.at(5.0) == []
        for speed_m_s in range(5):
            driver.steer(speed_m_s, 0.1)
            clock[0] += 1.0
        # The last of three commands was given a second ago.
        assert driver.at(5.0) == [Command(2, 2, 0.1), Command(3, 3, 0.1), Command(4, 4, 0.1)]
        clock[0] += 2.0
        assert driver.at(5.0) == []  # silent for too long


class TestDrawing:
    def test_a_path_colours_its_area_and_skips_what_is_behind(self) -> None:
        path_px = np.array([[np.nan, np.nan], [40, 59], [40, 30], [1e7, -1e7]])
        half_px = np.array([10.0, 0.0])
        sides_px = np.stack([path_px - half_px, path_px + half_px])
        drawn = drawing.draw_path(FRAME, path_px[:3], sides_px[:, :3])
        assert np.abs(drawn[45, 40].astype(int) - (64, 220, 120)).max() < 10
        assert drawn[45, 35, 1] > 100 > drawn[45, 35, 0]
        assert (drawn[:, :25] == 100).all()
        empty = drawing.draw_path(FRAME, np.zeros((0, 2)), np.zeros((2, 0, 2)))
        assert (empty == FRAME).all()
        assert (FRAME == 100).all()
        assert drawing.draw_warning(FRAME[:, :1], "late").shape == (60, 1, 3)


class TestSession:
    def test_the_present_is_predicted_better_than_the_late_image(self) -> None:
        shown = views(CLIP.frames, Channel(0.2))
        assert [view.warning is None for view in shown[-10:]] == [True] * 10
        assert list(shown[-1].panels)[1:] == ["predicted present", "true present"]
        assert shown[-1].age_s == pytest.approx(0.2)
        errors = np.array(
            [
                [np.abs(frame - true.astype(float)).mean() for frame in others]
                for *others, true in (view.panels.values() for view in shown[-10:])
            ]
        )
        late, predicted = errors.mean(axis=0)
        assert predicted < 0.8 * late

    def test_a_car_ahead_is_marked_on_request(self) -> None:
        clip = Synthetic(num_clips=14, num_frames=13, size_px=(192, 192))[13]
        recording = Recording(
            clip.name,
            Frames(clip.frames),
            clip.times_s,
            clip.intrinsics,
            camera_height_m=clip.camera_height_m,
        )
        session = Session(Source(recording, range(len(clip)), (192, 192)), Channel(0.2))
        *_, shown = session.render()
        assert shown.warning is None
        plain = shown.panels["predicted present"]
        session.is_dimming = True
        dimmed = session.draw_present(float(clip.times_s[-1]), clip.frames[-1]).panels
        assert dimmed["predicted present"].mean() < plain.mean()  # inpainted pixels are darker
        session.is_dimming = False
        session.is_marking = True
        marked = session.draw_present(float(clip.times_s[-1]), clip.frames[-1]).panels
        is_marked = (marked["predicted present"] != plain).any(axis=-1)
        # Regions are exact within half of a window of 7 px, and the line has 3 px.
        near_car = cv2.dilate(clip.moving[-1].astype(np.uint8), np.ones((15, 15))) > 0
        assert is_marked.sum() > 100  # the outline of a car of about 40 px
        assert (is_marked & near_car).sum() > 0.8 * is_marked.sum()

    def test_without_an_image_there_is_a_warning(self) -> None:
        shown = views(CLIP.frames[:6], Channel(1.0))
        assert {view.warning for view in shown} == {"no image has arrived since the start"}
        assert {view.age_s for view in shown} == {None}

    @pytest.mark.parametrize("jump_s", [-0.5, -100.0, 100.0])
    def test_after_a_jump_of_the_clock_the_late_image_is_shown(self, jump_s: float) -> None:
        times_s = CLIP.times_s[:18] + np.where(np.arange(18) < 8, 0, jump_s)
        shown = views(CLIP.frames[:18], Channel(0.1), times_s)
        assert shown[7].warning is None
        assert shown[8].warning is not None
        assert is_shown_late(shown[8])
        assert shown[-1].warning is None

    def test_commands_replace_the_forecast(self) -> None:
        stop = [Command(0.0, 0.0, 0.0)]
        late, predicted, true = views(CLIP.frames[:16], Channel(0.2), planned=stop)[
            -1
        ].panels.values()
        is_clear = (predicted == late).all(axis=-1)
        assert is_clear.mean() > 0.5 > (true == late).all(axis=-1).mean()

    def test_a_replay_keeps_to_the_clock_and_starts_again(self) -> None:
        session = Session(street_source(CLIP.frames[:5]), Channel(0.1))
        stop, shown = threading.Event(), []

        def publish(view: Shown) -> None:
            shown.append((time.monotonic(), view))
            if len(shown) > 5 and view.age_s is None:  # it started again
                stop.set()

        session.run(publish, stop)
        times_s = [time_s for time_s, _ in shown]
        assert 0.35 < times_s[-1] - times_s[0] < 2

    def test_a_failure_of_the_predictor_ends_the_session(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        session = Session(street_source(CLIP.frames), Channel(0.0))
        shown: list[Shown] = []

        def fail(*_: object) -> None:
            raise BadData("the road ended")

        monkeypatch.setattr(session.live, "push", fail)
        with pytest.raises(BadData, match="the road ended"):
            session.run(shown.append, threading.Event())
        assert len(shown) < len(CLIP.frames)  # at once, not at the end of the recording


class TestSource:
    def test_a_jump_of_the_clock_is_not_waited_for(self) -> None:
        source = street_source(CLIP.frames[:4], np.array([0, 0.1, 50.1, 50.0]))
        assert source.due_s() == pytest.approx([0, 0.1, 1.1, 1.1])

    def test_an_image_is_repeated_until_the_next(self) -> None:
        source = street_source(CLIP.frames[:3])
        shown = list(source.images(threading.Event(), repeat_s=0.02))
        numbers, times_s, _ = zip(*shown, strict=True)
        assert numbers.count(0) > 2
        assert numbers[-1] == 2
        assert (np.diff(times_s) > 0).all()

    def test_a_camera_delivers_its_next_image(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class Camera:
            images = [CLIP.frames[0][..., ::-1]] * 3

            def __init__(self, number: int) -> None:
                assert number == 0

            def set(self, *_: object) -> None: ...

            def read(self) -> tuple[bool, ByteArray | None]:
                return (True, self.images.pop()) if self.images else (False, None)

        monkeypatch.setattr(cv2, "VideoCapture", Camera)
        with pytest.raises(BadData, match="a camera needs its intrinsics"):
            Source.open(PredictionRequest(Path("0")))
        source = Source.open(PredictionRequest(Path("0"), fov_deg=70))
        assert source.is_camera
        assert (source.read(0) == CLIP.frames[0]).all()
        session = Session(source, Channel())
        with pytest.raises(BadData, match="delivers no images"):
            session.run(lambda _: None, threading.Event())

    def test_a_data_set_has_its_calibration(self, tmp_path: Path) -> None:
        folder = tmp_path / "sequences" / "07"
        write_images(folder / "image_0", CLIP.frames[:9])
        (folder / "calib.txt").write_text("P0: 150 0 63.5 0 0 150 63.5 0 0 0 1 0\n")
        (folder / "times.txt").write_text("\n".join(map(str, CLIP.times_s[:9])))
        source = Source.open(PredictionRequest(tmp_path, size_px=(64, 64)), "07[2:9)")
        assert source.times_s == pytest.approx(CLIP.times_s[2:9])
        assert source.read(0).shape == (64, 64, 3)
        assert source.intrinsics.fx_px == 75
        assert source.recording.camera_height_m == 1.65
        with pytest.raises(BadData, match="leave out image_topic"):
            Source.open(PredictionRequest(tmp_path, image_topic="/cam"))
        with pytest.raises(BadData, match="remove --fov"):
            Source.open(PredictionRequest(tmp_path, distortion=(0.1, 0)))


def test_sequences_of_the_input_are_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders of a folder are sequences; one is called like a part of another."""
    for name, step in (("a [0:1)", 0), ("b c", 4)):
        write_images(tmp_path / "multi" / name, CLIP.frames[step : step + 4])
    request = PredictionRequest(tmp_path / "multi", frame_rate_hz=10, fov_deg=70)
    for sequence, first, count in ((None, 0, 4), ("b c", 4, 4), ("a [0:1)[1:3)", 1, 2)):
        source = Source.open(request, sequence)
        assert len(source.times_s) == count
        assert (source.read(0) == CLIP.frames[first]).all()
    with pytest.raises(BadData, match=r"has no 'd': give a --sequence of \['a \[0:1\)', 'b c'\]"):
        Source.open(request, "d")
    with pytest.raises(BadData, match=r"several folders of images: .*/a \[0:1\), .*/b c$"):
        read_recording(request)
    monkeypatch.setattr(os, "access", lambda path, _: path.name != "b c")  # cannot be read
    assert len(read_recording(request)[0].times_s) == 4


def test_a_video_is_written(tmp_path: Path, printed: Says) -> None:
    write_images(tmp_path / "images", CLIP.frames[:8])
    out = tmp_path / "display.mp4"
    arguments = ["--fps", "10", "--fov", "70", "--latency", "0.1", "--size", "95x63"]
    assert printed("display", tmp_path / "images", *arguments, "--out", out).strip() == str(out)
    with av.open(str(out)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert np.shape(frames) == (8, 64, 3 * 95 + 1, 3)  # H.264 has even sizes


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--fps 10 --fov 70 --drive", "--camera-height"),
        ("--fps 10 --fov 70 --sequence 03", "remove --sequence"),
        ("--fov 70", "give --fps"),
        ("--fov 70 --fps 10 --every 3", "the display needs 2 frames"),
        ("--fov 70 --fps 10 --out x.gif", "does not end in .mp4"),
    ],
)
def test_a_mistake_gets_one_sentence(
    tmp_path: Path, refused: Says, words: str, message: str
) -> None:
    write_images(tmp_path / "images", CLIP.frames[:3])
    assert message in refused("display", tmp_path / "images", *words.split())


def test_settings_of_the_input_are_used(tmp_path: Path) -> None:
    """A bag has two topics, one with 12 of 16 bits."""
    made = bag_files.Messages(is_ros1=False)
    messages = bag_files.messages_of(made, CLIP)
    for topic, recorded_ns, _ in messages[:]:
        if topic == "/cam/image_raw":
            time_ns = recorded_ns - 3_000_000
            deep = np.full((*CLIP.frames.shape[1:3], 1), 16 * 50, np.uint16)
            messages.append(("/deep/image_raw", recorded_ns, made.image(time_ns, deep, "mono16")))
            messages.append(("/deep/camera_info", recorded_ns, made.info(time_ns, CLIP)))
    bag = bag_files.write_messages(tmp_path / "two", made, messages)
    with pytest.raises(BadData, match="give image_topic, one of /cam/image_raw, /deep/image_raw"):
        Source.open(PredictionRequest(bag))
    with pytest.raises(BadData, match="set image_bits"):
        Source.open(PredictionRequest(bag, image_topic="/deep/image_raw"))
    source = Source.open(PredictionRequest(bag, image_topic="/deep/image_raw", image_bits=12))
    assert (source.read(2) == 50).all()


def test_of_a_bag_at_30_hz_each_third_frame_is_shown(tmp_path: Path) -> None:
    bag = bag_files.write(tmp_path, "fast", replace(CLIP, times_s=CLIP.times_s / 3))
    assert len(Source.open(PredictionRequest(bag)).times_s) == len(CLIP) / 3
    assert len(Source.open(PredictionRequest(bag, rate_hz="native")).times_s) == len(CLIP)

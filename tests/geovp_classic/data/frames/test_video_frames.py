"""Videos are read as players show them: the frames that exist, at their times, upright, in proportion."""

import struct
import wave
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from av.stream import Disposition
from av.video.reformatter import ColorRange, Colorspace
from video_files import grey_levels, write_video

from geovp_classic.data.frames.video_frames import VideoFrames
from geovp_classic.data.layouts.folder import Folder
from geovp_classic.errors import BadData

# the corners of a picture are red, green, blue and black: R G above B K
CORNERS = np.zeros((48, 64, 3), np.uint8)
CORNERS[:24, :32, 0] = CORNERS[:24, 32:, 1] = CORNERS[24:, :32, 2] = 255


def levels(frames: VideoFrames) -> list[int]:
    """Return the grey level of each frame in the steps of 10 that they were written with."""
    return [round(float(frames.read(index).mean()) / 10) for index in range(len(frames))]


def corners(image: np.ndarray) -> str:
    """Return the colours of the corners, row by row."""
    names = {(1, 0, 0): "R", (0, 1, 0): "G", (0, 0, 1): "B", (0, 0, 0): "K"}
    pixels = (image[v, u] > 128 for v in (4, -5) for u in (4, -5))
    return "".join(names[tuple(pixel.astype(int))] for pixel in pixels)


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [
        ("a.mp4", "libx264", "yuv420p"),
        ("c.ts", "libx264", "yuv420p"),
        ("d.mkv", "ffv1", "yuv444p"),
        ("e.mov", "mjpeg", "yuvj420p"),
        ("f.avi", "mpeg4", "yuv420p"),
        ("g.mp4", "libx265", "yuv420p10le"),
        ("h.gif", "gif", "gray"),
    ],
)
def test_frames_come_by_number_in_any_order(
    name: str, codec: str, pixel_format: str, tmp_path: Path
) -> None:
    options = {"g": "5"} if codec in ("libx264", "mpeg4") else None
    path = tmp_path / name
    write_video(path, grey_levels(14), codec=codec, pixel_format=pixel_format, options=options)
    frames = VideoFrames(path)
    assert (len(frames), frames.size_px) == (14, (64, 48))
    np.testing.assert_allclose(frames.times_s, np.arange(14) / 10, atol=1e-3)
    for index in (13, 0, 3, 4, 1, 7, 12, 0):
        assert abs(int(frames.read(index)[24, 32, 0]) - 10 * index) <= 4


@pytest.mark.parametrize(
    ("name", "times_ms"),
    [
        # six frames at 25 Hz and four at 10 Hz: the mean rate, 16.9 Hz, is that of no frame
        ("a.mp4", [0, 40, 80, 120, 160, 200, 300, 400, 500, 600]),
        ("b.mkv", [0, 40, 80, 120, 160, 200, 300, 400, 500, 600]),
        ("d.avi", [0, 40, 80, 120, 160, 200, 300, 400, 500, 600]),  # with empty frames between them
        ("c.mkv", [0, 40, 80, 120, 120, 160, 260, 360]),  # of two with one time, the first is shown
        ("B-frames.avi", [0, 40, 80, 120, 160, 200, 300, 400, 500, 600]),
    ],
)
def test_times_are_those_of_presentation(name: str, times_ms: list[int], tmp_path: Path) -> None:
    """AVI has no times of presentation, and with B-frames none for the last frame."""
    images = grey_levels(len(times_ms))
    has_b_frames = name == "B-frames.avi"
    options = {"crf": "1", "bf": str(int(has_b_frames))}
    path = write_video(tmp_path / name, images, times_ms=times_ms, options=options)
    frames = VideoFrames(path)
    distinct_ms, first = np.unique(times_ms[: -has_b_frames or None], return_index=True)
    np.testing.assert_allclose(frames.times_s, distinct_ms / 1000, atol=1e-3)
    assert levels(frames) == first.tolist()


@pytest.mark.parametrize("name", ["packed.mp4", "empty.mkv"])
def test_packets_of_mpeg4_may_hold_two_frames_or_none(name: str, tmp_path: Path) -> None:
    """A packed video has packets I, PB, -, PB, -, ..., P; the other one I, P, -, P, -, ..., P."""
    is_packed = name == "packed.mp4"
    source = tmp_path / "a.avi"
    options = {"bf": str(int(is_packed)), "g": "20"}
    write_video(source, grey_levels(8), codec="mpeg4", rate=25, options=options)
    with av.open(str(source)) as video, av.open(str(tmp_path / name), "w") as output:
        stream = output.add_stream_from_template(video.streams.video[0])
        if is_packed:
            stream.codec_context.extradata += b"\0\0\1\xb2DivX503b1393p"
        first, *others = [bytes(packet) for packet in video.demux(video=0) if packet.size]
        contents = [first]
        for number in range(0, 7, 1 + is_packed):
            contents.append(b"".join(others[number : number + 1 + is_packed]))
            contents.append(b"\0\0\1\xb6\x50\x4f")  # a plane of type P that is not coded
        for number, content in enumerate(contents[:-1]):
            packet = av.Packet(content)
            packet.pts = packet.dts = number
            packet.stream, packet.time_base = stream, Fraction(1, 25)
            packet.is_keyframe = number == 0
            output.mux(packet)
    frames = VideoFrames(tmp_path / name)
    # the time of the last packed frame is unknown
    numbers = range(7) if is_packed else [0, 1, 3, 5, 7, 9, 11, 13]
    np.testing.assert_allclose(frames.times_s, np.divide(numbers, 25), atol=1e-3)
    assert levels(frames) == list(range(len(numbers)))


def test_recordings_that_were_put_together_follow_one_another(tmp_path: Path) -> None:
    """Six frames at 10 Hz, then six at 10, 10, 25, 25 and 25 Hz, whose clock begins again."""
    parts = (([0, 100, 200, 300, 400, 500], 0), ([50, 150, 250, 290, 330, 370], 6))
    contents = []
    for times_ms, first in parts:
        levels_of_part = grey_levels(12)[first : first + 6]
        path = write_video(
            tmp_path / "part.ts", levels_of_part, times_ms=times_ms, options={"bf": "0"}
        )
        contents.append(path.read_bytes())
    path.write_bytes(b"".join(contents))
    frames = VideoFrames(path)
    assert levels(frames) == list(range(12))
    # between them, a pause of 2 s and two usual steps, which no clip of a data set holds
    steps_s = [0.1] * 5 + [2.2] + [0.1] * 2 + [0.04] * 3
    np.testing.assert_allclose(np.diff(frames.times_s), steps_s, atol=1e-3)
    folder = Folder(path, intrinsics=(50, 50, 32, 24), num_frames=5, stride=1, size_px=(24, 24))
    assert folder.clip_names == ("part/000000", "part/000001")


def test_a_rate_that_no_camera_has_is_no_rate(tmp_path: Path) -> None:
    """The header of the stream states a million frames per second."""
    path = write_video(tmp_path / "a.avi", grey_levels(4), codec="mpeg4")
    content = bytearray(path.read_bytes())
    scale_and_rate = content.find(b"strh") + 28
    content[scale_and_rate : scale_and_rate + 8] = struct.pack("<II", 1, 10**6)
    path.write_bytes(content)
    with pytest.raises(BadData, match="does not state its rate: give frame_rate_hz"):
        VideoFrames(path).times_at(None)


def test_slow_motion_has_the_times_of_recording(tmp_path: Path) -> None:
    """Frames were recorded at 240 Hz and are shown at 30 Hz."""
    rate = {"com.android.capture.fps": "240.000000"}
    options = {"movflags": "use_metadata_tags"}
    path = tmp_path / "a.mp4"
    write_video(path, grey_levels(4), rate=30, metadata=rate, container_options=options)
    np.testing.assert_allclose(VideoFrames(path).times_s, np.arange(4) / 240)


def test_pixels_of_an_extreme_aspect_are_refused(tmp_path: Path) -> None:
    """Of 64x48 pixels, shown as 3,840,000x48."""
    path = write_video(tmp_path / "a.mp4", grey_levels(3), aspect=Fraction(4, 3))
    wide = b"pasp" + struct.pack(">II", 60000, 1)
    path.write_bytes(path.read_bytes().replace(b"pasp" + struct.pack(">II", 4, 3), wide))
    with pytest.raises(BadData, match="64x48 pixels of aspect 60000"):
        VideoFrames(path)


# Matroska states no numbers of frames
@pytest.mark.parametrize("name", ["a.mkv", "a.mp4"])
@pytest.mark.parametrize(("width_px", "count"), [(64, 1), (32, 4)])
def test_a_cover_picture_or_a_preview_is_not_the_video(
    name: str, width_px: int, count: int, tmp_path: Path
) -> None:
    path = tmp_path / name
    with av.open(str(path), "w") as output:
        cover, main = output.add_stream("mjpeg", rate=10), output.add_stream("libx264", rate=10)
        cover.pix_fmt = "yuvj420p"
        cover.height, cover.width, main.height, main.width = 48, width_px, 48, 64
        cover.disposition, main.disposition = Disposition.default, Disposition(0)
        for stream, images in ((cover, grey_levels(count)), (main, grey_levels(9))):
            for image in images:
                output.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
            output.mux(stream.encode())
    assert levels(VideoFrames(path)) == list(range(9))


def test_hidden_frames_of_vp8_do_not_count(tmp_path: Path) -> None:
    """Frame 2 becomes an alternate reference frame: the bit that shows it is cleared."""
    path = write_video(tmp_path / "a.webm", grey_levels(14), codec="libvpx", options={"g": "5"})
    with av.open(str(path)) as video:
        frame = [bytes(packet) for packet in video.demux(video=0)][2]
    hidden = bytes([frame[0] & ~0x10]) + frame[1:]
    path.write_bytes(path.read_bytes().replace(frame, hidden, 1))
    assert levels(VideoFrames(path)) == [0, 1, *range(3, 14)]


def test_a_stream_that_begins_inside_a_group_has_the_frames_from_its_first_key_frame_on(
    tmp_path: Path,
) -> None:
    """Groups of 8 frames; packets of a transport stream have 188 bytes."""
    options = {"g": "8", "bf": "0", "crf": "1"}
    path = write_video(tmp_path / "a.ts", grey_levels(24), options=options)
    whole = path.read_bytes()
    path.write_bytes(whole[: 188 * 3] + whole[188 * 8 :])  # the tables, and a part of group 0
    frames = VideoFrames(path)
    assert levels(frames) == list(range(8, 24))
    np.testing.assert_allclose(frames.times_s, np.arange(16) / 10)


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("a.mkv", "libx264"),
        ("a.ts", "libx264"),
        ("a.avi", "libx264"),
        ("a.webm", "libvpx-vp9"),
        ("a.webm", "libvpx"),
        ("a.mkv", "libx265"),
        ("a.mkv", "ffv1"),
        ("a.avi", "mpeg4"),
        ("a.mpg", "mpeg2video"),
    ],
)
@pytest.mark.parametrize("kept", [0.45, 0.8])
def test_no_frame_of_a_truncated_video_is_another_picture(
    name: str, codec: str, kept: float, tmp_path: Path
) -> None:
    """A moving picture: each frame is as in the whole video, and none comes after the end."""
    noise = np.random.default_rng(0).integers(0, 256, (48, 200, 3), np.uint8)
    wide = cv2.GaussianBlur(noise, (0, 0), 0.7)
    moving = [wide[:, 4 * step : 4 * step + 64] for step in range(30)]
    options = {"g": "10", "b": "3000000"}
    path = write_video(tmp_path / name, moving, codec=codec, rate=25, options=options)
    whole = VideoFrames(path)
    expected = np.stack([whole.read(index) for index in range(len(whole))]).astype(int)
    path.write_bytes(path.read_bytes()[: int(kept * path.stat().st_size)])
    cut = VideoFrames(path)
    assert 4 <= len(cut) < len(whole)
    for index in range(len(cut)):
        assert np.abs(cut.read(index) - expected[index]).mean() < 0.01


@pytest.mark.parametrize(
    ("codec", "options", "num_bytes"),
    [
        ("libx264", {"crf": "10"}, 3000),
        ("libvpx-vp9", {"crf": "20", "b": "0"}, 8),
        ("libx265", {"crf": "20", "x265-params": "log-level=none:hash=1"}, 8),
    ],
)
def test_damaged_frames_are_refused_by_number_and_time(
    codec: str, options: dict[str, str], num_bytes: int, tmp_path: Path
) -> None:
    """Bytes from packet 10 on are inverted: frames are right or refused, from key frame 8 on."""
    noise = np.random.default_rng(0).integers(0, 256, (24, 48, 64, 3), np.uint8)
    images = [cv2.GaussianBlur(image, (0, 0), 1.2) for image in noise]
    path = tmp_path / "a.mkv"
    write_video(path, images, codec=codec, rate=25, options={"g": "8", **options})
    whole = VideoFrames(path)
    expected = [whole.read(index) for index in range(24)]
    with av.open(str(path)) as container:
        packet = bytes(list(container.demux(video=0))[10])
    content = bytearray(path.read_bytes())
    middle = content.find(packet[-40:])
    for place in range(middle, middle + num_bytes):
        content[place] ^= 255
    path.write_bytes(content)
    frames = VideoFrames(path)
    missing = set(range(24))
    messages = ""
    for index, number in enumerate(np.rint(25 * frames.times_s).astype(int).tolist()):
        try:
            image = frames.read(index)
        except BadData as error:
            messages = str(error)
        else:
            assert np.abs(image.astype(int) - expected[number]).mean() < 1
            missing.remove(number)
    assert missing
    assert missing <= set(range(8, 24))
    assert codec == "libx264" or " s) is damaged" in messages


UNIT = 65536  # numbers of a display matrix are 16.16


@pytest.mark.parametrize(
    ("settings", "size_px", "expected"),
    [
        ({}, (64, 48), "RGBK"),
        ({"turn_deg": 90}, (48, 64), "GKRB"),
        ({"turn_deg": 180}, (64, 48), "KBGR"),
        ({"turn_deg": 270}, (48, 64), "BRKG"),
        # mirrored: left and right, above and below, rows and columns
        ({"matrix": [-UNIT, 0, 0, 0, UNIT, 0, 0, 0, 2**30]}, (64, 48), "GRKB"),
        ({"matrix": [UNIT, 0, 0, 0, -UNIT, 0, 0, 0, 2**30]}, (64, 48), "BKRG"),
        ({"matrix": [0, UNIT, 0, UNIT, 0, 0, 0, 0, 2**30]}, (48, 64), "RBGK"),
        # square pixels: 64 / 3 x 4 = 85 columns, and 48 x 2 = 96 rows
        ({"aspect": Fraction(4, 3)}, (85, 48), "RGBK"),
        ({"aspect": Fraction(1, 2)}, (64, 96), "RGBK"),
        ({"aspect": Fraction(4, 3), "turn_deg": 90}, (48, 85), "GKRB"),
    ],
)
def test_a_video_is_shown_upright_and_with_square_pixels(
    settings: dict[str, Any], size_px: tuple[int, int], expected: str, tmp_path: Path
) -> None:
    frames = VideoFrames(write_video(tmp_path / "a.mp4", [CORNERS] * 3, **settings))
    assert frames.size_px == size_px
    assert corners(frames.read(1)) == expected


def test_the_matrix_and_the_range_of_colours_are_those_that_the_video_states(
    tmp_path: Path,
) -> None:
    """BT.709 with full range: Y = .2126 R + .7152 G + .0722 B, Cb = 128 + (B - Y) / 1.8556."""
    red = [54, 99, 255]  # Y, Cb, Cr of (255, 0, 0); Cr = 128 + (R - Y) / 1.5748
    with av.open(str(tmp_path / "a.mkv"), "w") as output:
        stream = output.add_stream("ffv1", rate=10)
        stream.height, stream.width, stream.pix_fmt = 48, 64, "yuv444p"
        frame = av.VideoFrame(64, 48, "yuv444p")
        for plane, value in zip(frame.planes, red, strict=True):
            plane.update(bytes([value]) * plane.buffer_size)
        stream.codec_context.colorspace = frame.colorspace = Colorspace.ITU709
        stream.codec_context.color_range = frame.color_range = ColorRange.JPEG
        output.mux(stream.encode(frame))
        output.mux(stream.encode())
    image = VideoFrames(tmp_path / "a.mkv").read(0).astype(int)
    assert np.abs(image - [255, 0, 0]).max() <= 2


def test_an_interlaced_video_shows_one_field(tmp_path: Path) -> None:
    """The even rows are 200, the odd ones, recorded half a frame later, are 40."""
    comb = np.full((48, 64, 3), 200, np.uint8)
    comb[1::2] = 40
    options = {"crf": "1", "x264-params": "tff=1"}
    path = write_video(tmp_path / "a.mp4", [comb] * 3, options=options, pixel_format="yuv444p")
    image = VideoFrames(path).read(1)
    assert np.abs(image[:47].astype(int) - 200).max() <= 4


@pytest.mark.parametrize("name", ["12:30.mp4", "a b [1].mp4", "%03d.mp4"])
def test_names_are_taken_as_they_are(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_video(tmp_path / name, grey_levels(3))
    assert levels(VideoFrames(Path(name))) == [0, 1, 2]


def test_files_without_a_video_are_refused(tmp_path: Path) -> None:
    for name in ("text.mp4", "poses.txt"):
        (tmp_path / name).write_text(200 * "1 0 0 0 0 1 0 0 0 0 1 0\n")
    (tmp_path / "list.m3u8").write_text("#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n")
    with wave.open(str(tmp_path / "sound.wav"), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(8000))
    for name in ("text.mp4", "poses.txt", "list.m3u8", "sound.wav"):
        with pytest.raises(BadData, match=f"{name} cannot be decoded as a video"):
            VideoFrames(tmp_path / name)

"""Robot logs give the clips that they were written from."""

import os
import pickle
from pathlib import Path
from typing import Any

import bag_files
import numpy as np
import pytest
import street
from bag_files import START_NS, Edit, Messages

from geovp_benchmarks import cli
from geovp_classic import api
from geovp_classic.data.doctor import Doctor
from geovp_classic.data.findings import RAISE
from geovp_classic.data.formats import bags
from geovp_classic.data.layouts.rosbag import RosBag
from geovp_classic.errors import BadData
from geovp_classic.types import Clip

pytest.importorskip("rosbags", reason="needs the extra 'rosbag'")

CUT: dict[str, Any] = {"num_frames": 4, "stride": 3, "size_px": (128, 128)}
SHORT = street.clip(5)


def without(*names: str) -> Edit:
    """Return an edit that omits topics."""
    return lambda topic, message: None if topic in names else message


def assert_is(clip: Clip, expected: Clip, first: int) -> None:
    """Check that a clip is the frames first to first + 3."""
    steps = slice(first, first + 4)
    np.testing.assert_array_equal(clip.frames, expected.frames[steps])
    times_s = START_NS / 1e9 + 0.1 * np.arange(first, first + 4)
    np.testing.assert_allclose(clip.times_s, times_s, rtol=0, atol=1e-6)
    assert clip.intrinsics == expected.intrinsics
    np.testing.assert_allclose(
        clip.trajectory.world_from_cam, expected.trajectory.world_from_cam[steps], atol=1e-6
    )


@pytest.mark.parametrize("name", ["run.bag", "run", "run_mcap"])
@pytest.mark.parametrize("omitted", ["/odometry", "/tf"])
def test_each_kind_of_bag_gives_its_clip(tmp_path: Path, name: str, omitted: str) -> None:
    path = bag_files.write(tmp_path, name, street.clip(), without(omitted))
    data = RosBag(tmp_path, **CUT)
    assert data.clip_names == (f"{name}/000000", f"{name}/000003", f"{name}/000006")
    assert_is(data[1], street.clip(), 3)
    assert_is(pickle.loads(pickle.dumps(data))[0], street.clip(), 0)
    assert_is(api.open_clip({"name": "rosbag", "root": path, **CUT}, 2), street.clip(), 6)


# Y, U and V of (200, 90, 30) by BT.601 with limited range: Y = 16 + .257 R + .504 G + .098 B
Y, U, V = 116, 85, 181
# the repeated values of images of that colour, by encoding
PATTERNS: dict[str, Any] = {
    "rgb": [[[200, 90, 30]]],
    "bgr": [[[30, 90, 200]]],
    "rgba": [[[200, 90, 30, 7]]],
    "bgra": [[[30, 90, 200, 7]]],
    "8UC3": [[[30, 90, 200]]],
    "8UC4": [[[30, 90, 200, 7]]],
    "bayer_rggb": [[[200], [90]], [[90], [30]]],
    "bayer_bggr": [[[30], [90]], [[90], [200]]],
    "bayer_gbrg": [[[90], [30]], [[200], [90]]],
    "bayer_grbg": [[[90], [200]], [[30], [90]]],
    "uyvy": [[[U, Y], [V, Y]]],
    "yuv422": [[[U, Y], [V, Y]]],
    "yuyv": [[[Y, U], [Y, V]]],
    "yuv422_yuy2": [[[Y, U], [Y, V]]],
    "nv12": [[[U], [V]]],
    "nv21": [[[V], [U]]],
    "mono": [[[200]]],
    "8UC1": [[[200]]],
}
WITH_16_BITS = [name for name in PATTERNS if name.startswith(("rgb", "bgr", "bayer", "mono"))]


def encoded(name: str) -> np.ndarray:
    """Return the values [12, 16, K] of an image, [18, 16, 1] if colours follow the rows."""
    pattern = np.array(PATTERNS[name], np.uint8)
    values = np.tile(pattern, (12 // len(pattern), 16 // pattern.shape[1], 1))
    return np.concatenate([np.full_like(values, Y), values[:6]]) if "nv" in name else values


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize(
    ("name", "bits"),
    [
        *((name, "" if name[-1].isdigit() or name[0] in "uyn" else "8") for name in PATTERNS),
        *((name, "16") for name in WITH_16_BITS),
    ],
)
def test_images_are_decoded(name: str, bits: str, is_bigendian: bool) -> None:
    values = encoded(name)
    if bits == "16":  # of which 12 are in use
        values = (16 * values.astype("u2")).astype(">u2" if is_bigendian else "<u2")
    message = Messages(is_ros1=False).image(START_NS, values, name + bits)
    message.is_bigendian = is_bigendian
    message.height, message.width = 12, 16
    decoded = bags.decode(Path("image"), message, 12 if bits == "16" else None)
    colour = (200, 200, 200) if name in ("mono", "8UC1") else (200, 90, 30)
    tolerance = 3 if name[0] in "uyn" else 0
    np.testing.assert_allclose(decoded.astype(int), np.full((12, 16, 3), colour), atol=tolerance)


def test_an_image_of_an_odd_width_is_refused() -> None:
    message = Messages(is_ros1=False).image(START_NS, np.zeros((12, 15, 2), np.uint8), "yuyv")
    with pytest.raises(BadData, match="image is not an image"):
        bags.decode(Path("image"), message)


@pytest.mark.parametrize("stamp_ns", [0, START_NS])
def test_compressed_images_without_stamps_in_any_order(tmp_path: Path, stamp_ns: int) -> None:
    """Images are recorded in PNG, the last one first, all with one stamp: other times serve."""
    made = Messages(is_ros1=False)

    def compress(topic: str, message: Any) -> Any:
        if topic != "/cam/image_raw":
            return message
        frame = message.data.reshape(128, -1)[:, :384].reshape(128, 128, 3)
        return made.compressed(stamp_ns, frame)

    messages = bag_files.messages_of(made, SHORT, compress)
    bag_files.write_messages(tmp_path / "run", made, [*messages[::-1], *messages[:3]])
    clip = RosBag(tmp_path, **CUT, pose_topic="")[0]
    np.testing.assert_array_equal(clip.frames, SHORT.frames[:4])
    np.testing.assert_allclose(np.diff(clip.times_s), 0.1, atol=1e-6)
    assert clip.trajectory is None


def test_poses_are_interpolated_but_not_across_gaps(tmp_path: Path) -> None:
    """Poses 50 ms after each image, the one after the sixth NaN, as of a tracker that is lost."""
    clip = street.clip(20)
    made = Messages(is_ros1=True)
    messages = bag_files.messages_of(made, clip, without("/odometry", "/tf"))
    for step, pose in enumerate(clip.trajectory.world_from_cam):
        time_ns = START_NS + step * 100_000_000 + 50_000_000
        shift = np.zeros((4, 4))
        shift[0, 3] = np.nan if step == 5 else 0.0
        messages.append(("/slam", time_ns, made.pose(time_ns, "map", pose + shift)))
    bag_files.write_messages(tmp_path / "run.bag", made, messages)
    poses = RosBag(tmp_path, **CUT, max_gap_s=0.15).scan(tmp_path / "run.bag", RAISE).world_from_cam
    assert np.flatnonzero(np.isnan(poses[:, 0, 0])).tolist() == [0, 5, 6]
    between = (clip.trajectory.world_from_cam[8:18] + clip.trajectory.world_from_cam[9:19]) / 2
    np.testing.assert_allclose(poses[9:19, :3, 3], between[:, :3, 3], atol=1e-3)
    assert len(RosBag(tmp_path, **CUT)[0].frames) == 4


def test_the_camera_is_that_of_the_images(tmp_path: Path) -> None:
    """A camera of other images is not used, and rectified images have no distortion."""
    made = Messages(is_ros1=False)
    size_px = (128, 128)

    def camera(image_topic: str, info_topic: str, **info: Any) -> Any:
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        infos = {
            info_topic: made.info(START_NS, SHORT, **info),
            "/a/camera_info": made.info(0, SHORT),
        }
        messages = [(topic, START_NS, message) for topic, message in infos.items()]
        bag_files.write_messages(path, made, messages)
        return bags.Bag(path).camera(image_topic, size_px)

    lens = (-0.3, 0.1, 0.001, 0.002, 0.0)
    assert camera("/cam/image_raw/compressed", "/cam/camera_info", lens=lens).distortion == lens
    assert camera("/cam/image_rect", "/cam/camera_info", lens=lens).distortion == ()
    assert camera("/b/image_raw", "/cam/camera_info") is None
    assert camera("/b/image_raw", "/a/camera_info").pinhole == SHORT.intrinsics
    # the window of 64x64 pixels at (30, 20) is binned or resized to 128x128
    whole = SHORT.intrinsics
    for topic in ("/cam/image_raw", "/cam/image_rect"):
        shown = camera(topic, "/cam/camera_info", roi=(30, 20, 64, 64)).pinhole
        assert shown.fx_px == 2 * whole.fx_px
        assert shown.cx_px == 2 * (whole.cx_px - 30) + 0.5
        assert shown.cy_px == 2 * (whole.cy_px - 20) + 0.5


def edited(**fields: Any) -> Edit:
    """Return an edit that changes these fields of messages that have them."""

    def edit(topic: str, message: Any) -> Any:
        for name, value in fields.items():
            if hasattr(message, name):
                setattr(message, name, value)
        return message

    return edit


@pytest.mark.parametrize(
    ("edit", "settings", "sentence"),
    [
        (without("/cam/camera_info"), {}, "has no known camera: give intrinsics"),
        (edited(k=np.zeros(9)), {}, "has no known camera: give intrinsics"),
        (edited(d=np.zeros(3)), {}, "is not a calibration"),
        (edited(width=500), {}, "is not an image|about images of"),
        (edited(encoding="32FC3"), {}, "the encoding '32FC3', expected 8 or 16 bits of rgb, bgr"),
        (edited(step=1, data=np.zeros(7, np.uint8)), {}, "is not an image"),
        (edited(encoding="mono8"), {}, "rows have 388 values, mono8 has 128"),  # 3 x 128, padded
        (without("/cam/image_raw"), {}, "has no messages of type Image or CompressedImage"),
        (
            without(),
            {"image_topic": "/x"},
            "has no image topic '/x': give image_topic, one of /cam",
        ),
        (without(), {"pose_topic": "/x"}, "has no pose topic '/x': give pose_topic, one of /odom"),
        (without("/tf_static"), {"pose_topic": "/odometry"}, "tf does not connect to the camera"),
        (without("/tf_static", "/tf"), {}, "tf does not connect to the camera"),
    ],
)
def test_bad_input_gives_one_sentence(
    tmp_path: Path, edit: Edit, settings: dict[str, str], sentence: str
) -> None:
    path = bag_files.write(tmp_path, "run", SHORT, edit)
    with pytest.raises(BadData, match=sentence) as caught:
        RosBag(path, **CUT, **settings)
    assert "\n" not in str(caught.value)


def test_several_topics_are_listed(tmp_path: Path) -> None:
    made = Messages(is_ros1=False)
    messages = bag_files.messages_of(made, SHORT)
    messages += [(topic.replace("/cam/", "/rear/"), *more) for topic, *more in messages]
    path = bag_files.write_messages(tmp_path / "run", made, messages)
    sentence = "has 2 image topics: give image_topic, one of /cam/image_raw, /rear/image_raw"
    with pytest.raises(BadData, match=sentence):
        RosBag(path, **CUT)
    assert_is(RosBag(path, **CUT, image_topic="/rear/image_raw")[0], SHORT, 0)
    examined = Doctor().examine(path, deep=True)
    assert examined.is_sound
    assert examined.rows[0]["frames"] == "/cam/image_raw: 5, /rear/image_raw: 5"


@pytest.mark.parametrize(
    "form", ["bayer_rggb8; png compressed bgr8", "bayer_rggb16;png compressed"]
)
def test_compressed_mosaics_are_demosaicked(form: str) -> None:
    """The encoding is the part of the format before the semicolon, with or without its bits.

    A driver that demosaics before it compresses keeps the name of the encoding.
    """
    image = np.full((12, 16, 3), (200, 90, 30), np.uint8)
    for values in (encoded("bayer_rggb"), image):
        message = Messages(is_ros1=False).compressed(START_NS, values)
        message.format = form
        np.testing.assert_array_equal(bags.decode(Path("image"), message), image)


def test_clips_end_at_a_gap_and_equal_stamps_count_once(tmp_path: Path) -> None:
    """Twelve images at 10 Hz, three recorded twice; 4 s are lost after the sixth."""
    clip = street.clip(12)
    made = Messages(is_ros1=True)

    def delay(topic: str, message: Any) -> Any:
        stamp = message.header.stamp
        is_late = stamp.sec * 10**9 + stamp.nanosec > START_NS + 550_000_000
        stamp.sec += 4 * is_late
        return message

    edit = without("/tf", "/tf_static", "/odometry")
    messages = bag_files.messages_of(made, clip, lambda *each: edit(*each) and delay(*each))
    path = bag_files.write_messages(tmp_path / "run.bag", made, [*messages, *messages[:6]])
    data = RosBag(path, **CUT)
    assert data.clip_names == ("run.bag/000000", "run.bag/000006")
    np.testing.assert_array_equal(data[0].frames, clip.frames[:4])
    assert data[1].times_s[0] == pytest.approx(START_NS / 1e9 + 4.6, abs=1e-6)


def test_depth_topics_are_no_candidates(tmp_path: Path) -> None:
    made = Messages(is_ros1=False)
    messages = bag_files.messages_of(made, SHORT)
    for k in range(3):
        time_ns = START_NS + k * 10**8
        for encoding, kind in (("16UC1", np.uint16), ("32FC1", np.float32)):
            depth = made.image(time_ns, np.full((128, 128), 1500, kind), encoding)
            messages.append((f"/cam/depth/{encoding}", time_ns, depth))
        packed = made.compressed(time_ns, SHORT.frames[0])
        packed.format = "16UC1; compressedDepth png"
        messages.append(("/cam/depth/compressed", time_ns, packed))
    path = bag_files.write_messages(tmp_path / "run", made, messages)
    assert_is(RosBag(path, **CUT)[0], SHORT, 0)
    with pytest.raises(BadData, match=r"has no image topic .* one of /cam/image_raw"):
        RosBag(path, **CUT, image_topic="/cam/depth/compressed")
    with pytest.raises(BadData, match="is of a depth topic: give the image_topic"):
        bags.decode(Path("image"), packed)


@pytest.mark.parametrize("name", ["run.bag", "run_mcap/run_mcap.mcap", "run/run.db3"])
def test_a_truncated_bag_is_an_error(tmp_path: Path, name: str) -> None:
    bag_files.write(tmp_path, name.partition("/")[0], SHORT)
    path = tmp_path / name
    whole = path.read_bytes()
    for fraction in (0.0, 0.02, 0.5, 0.98):
        path.write_bytes(whole[: round(fraction * len(whole))])
        with pytest.raises(BadData, match="cannot be read as a bag"):
            RosBag(path, **CUT)
    assert Doctor().examine(path).rows[0]["errors"] == "1"
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(BadData, match="a pipe never ends"):
        RosBag(path, **CUT)


def test_commands_read_a_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`geovp poses` and `predict`."""
    path = bag_files.write(tmp_path, "run.bag", street.clip(12))
    args = ["--odometry", "ground-truth", "--clips", "5"]
    assert cli.main(["poses", str(path), "run.bag[0:12)", *args]) == 0
    assert "2 clips, 100.0% of frames tracked" in capsys.readouterr().out
    args = ["--past", "6", "--future", "3", "--first", "0", "--out", str(tmp_path / "predicted")]
    assert cli.main(["predict", str(path), *args]) == 0
    assert "camera (CameraInfo): focal length 150.0 px" in capsys.readouterr().err

"""`geovp predict`: everything is there and can be read back, mistakes get one sentence and leave
nothing behind.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import open3d as o3d
import pycolmap
import pytest
import street
from PIL import Image

from geovp.display.source import Source
from geovp.drawing import video
from geovp.prediction import exports, prediction
from geovp.prediction.camera import find_camera
from geovp.prediction.request import PredictionRequest, output_size
from geovp.provenance import code_hash
from geovp_benchmarks import cli
from geovp_classic.data.formats import pose_files
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics, Motion, Trajectory
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import write_images

CAMERA = street.clip().intrinsics
GIVEN = (CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
INTRINSICS = ["--intrinsics", *map(str, GIVEN)]
PINHOLE = " ".join(INTRINSICS)
SHORT = ["--past", "8", "--future", "3", "--size", "96"]


def predict(images: Path, words: str = "") -> list[str]:
    return ["predict", str(images), *INTRINSICS, "--fps", "10", *words.split()]


def predicted(images: Path, num_past: int, **more: Any) -> prediction.Predicted:
    """Return two predicted frames of 64x64 pixels."""
    settings = {"intrinsics": GIVEN, "num_future": 2, "size_px": (64, 64), **more}
    request = PredictionRequest(images, frame_rate_hz=10.0, num_past=num_past, **settings)
    return prediction.predict(request)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drive") / "images"
    write_images(folder, street.clip().frames)
    return folder


@pytest.fixture(scope="module")
def written(images: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("predicted") / "out"
    # In metres, the motion of the image would replace this short clip
    more = ["--camera-height", "1.65", "--first", "0", "--no-fallback", "--out", str(out)]
    assert cli.main([*predict(images), *more, *SHORT]) == 0
    return out


def test_cloud_and_model_hold_the_same_points(written: Path) -> None:
    cloud = o3d.io.read_point_cloud(str(written / "cloud.ply"))
    model = pycolmap.Reconstruction(str(written / "colmap" / "sparse" / "0"))
    assert len(cloud.points) == model.num_points3D() > 1000
    names = [image.name for image in model.images.values()]
    assert len(names) == 11
    assert all((written / "colmap" / "images" / name).is_file() for name in names)
    assert model.compute_mean_track_length() > 2


def projected(written: Path, name: str) -> tuple[FloatArray, FloatArray]:
    """Of the model's points that lie in an image of it: pixels [N, 2] and colours [N, 3]."""
    model = pycolmap.Reconstruction(str(written / "colmap" / "sparse" / "0"))
    image = model.find_image_with_name(name)
    pairs = ((image.project_point(p.xyz), p.color) for p in model.points3D.values())
    pixels, colours = map(
        np.array, zip(*(pair for pair in pairs if pair[0] is not None), strict=True)
    )
    inside = (pixels > 0.5).all(axis=1) & (pixels < 95.5).all(axis=1)
    return pixels[inside] - 0.5, colours[inside].astype(float)


@pytest.mark.parametrize("name", ["seen/000007.png", "frames/000008.png"])
def test_the_cloud_projects_onto_the_frames_that_the_model_poses(written: Path, name: str) -> None:
    pixels, colours = projected(written, Path(name).name)
    frame = cv2.imread(str(written / name))[..., ::-1].astype(float)
    u, v = np.rint(pixels).astype(int).T
    off = np.abs(frame[v, u] - colours).mean(axis=1)
    shuffled = np.abs(frame[v, u] - np.roll(colours, len(colours) // 2, axis=0)).mean(axis=1)
    assert len(off) > 1000
    assert np.median(off) < 6
    assert np.median(off) < 0.25 * np.median(shuffled)


def test_a_long_label_fits_a_narrow_frame() -> None:
    shown = video.labelled(np.zeros((480, 268, 3), np.uint8), "late image, 0.60 s old")
    assert shown[:, :-4].any()
    assert not shown[:, -4:].any()


def test_the_video_shows_observed_and_predicted_frames(written: Path) -> None:
    with av.open(str(written / "film.mp4")) as film:
        (stream,) = film.streams.video
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"  # plays in browsers
        assert (stream.width, stream.height) == (192, 96)  # predicted beside recorded
        assert stream.average_rate == 10
        shown = np.stack(
            [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        ).astype(int)
    assert len(shown) == 11
    seen = cv2.imread(str(written / "seen" / "000000.png"))[..., ::-1].astype(int)
    assert np.abs(shown[0, :70, :96] - seen[:70]).mean() < 6
    with Image.open(written / "film.gif") as moving:
        assert (moving.n_frames, moving.info["duration"]) == (11, 100)


def test_without_a_height_there_are_no_metres_and_no_truth_beyond_the_end(
    images: Path, tmp_path: Path
) -> None:
    latest = predicted(images, 8, size_px=(96, 96), num_samples=3)
    assert latest.numbers[0] == len(street.clip()) - 8
    assert len(latest.actual) == 0
    assert latest.scores == {}
    assert not latest.prediction.motion.past.is_metric
    assert "2 frames, 10 per second: 0.20 s ahead" in latest.summary()
    assert any("all samples are equal" in warning for warning in latest.warnings())
    exports.write(latest, tmp_path / "new" / "out")
    assert "not known in metres" in (tmp_path / "new" / "out" / "depths" / "scale.txt").read_text()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (PINHOLE, "give --fps"),
        (f"{PINHOLE} --fps 10 --past 99", "99 must be seen"),
        (f"{PINHOLE} --fps 10 --past 3 --first 7 --every 3", "last possible --first is 3"),
        (f"{PINHOLE} --fps 10 --past 8 --every 3", "or a smaller --every"),
        (f"{PINHOLE} --fps 10 --predictor copy-last --no-fallback", "need a pose source"),
        (f"{PINHOLE} --fps 10 --mask-mode replace", "give --mask"),
        (f"{PINHOLE} --fps 10 --predictor copy-last --renderer depth-fusion", "keep one"),
        (f"{PINHOLE} --fps 10 --method copy-last", "belong together"),
        ("--fps 10 --distortion 0.1 0", "belongs to --intrinsics or --fov"),
    ],
)
def test_mistakes_get_one_sentence_and_leave_nothing(
    images: Path, tmp_path: Path, refused: Says, words: str, says: str
) -> None:
    given = words if "--past" in words else f"{words} {' '.join(SHORT)}"
    assert says in refused("predict", images, *given.split(), "--out", tmp_path / "out")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("actual_s", "future_s"),
    [
        ((), (0.3, 0.4, 0.5)),
        ((0.301, 0.399), (0.3, 0.4, 0.5)),  # jitter of the container's unit
        ((0.3, 0.34), (0.3, 0.34, 0.44)),  # 25 Hz from there on
        ((0.5, 0.7, 0.9), (0.5, 0.7, 0.9)),
    ],
)
def test_predicted_frames_have_the_times_of_recorded_ones(
    actual_s: tuple[float, ...], future_s: tuple[float, ...]
) -> None:
    """Three frames are observed at 10 Hz, three are predicted."""
    times_s = prediction.times_of_clip(np.array([0, 0.1, 0.2, *actual_s]), 3, 3)
    np.testing.assert_allclose(times_s, [0, 0.1, 0.2, *future_s])


@pytest.mark.parametrize("words", ["", "--fps 10"])
def test_what_to_give_in_place_of_a_data_set_is_said(
    words: str, images: Path, tmp_path: Path, refused: Says
) -> None:
    """KITTI has its images three folders below; a folder of bags has bags."""
    shutil.copytree(images, tmp_path / "kitti/sequences/07/image_0")
    for name in ("bags/a.bag", "bags/b.mcap", "videos/c.mp4"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    for name, advice in (
        ("kitti", "a data set (kitti): give one recording, such as {}/sequences/07/image_0"),
        ("bags", "videos or bags: give one recording, such as {0}/a.bag, {0}/b.mcap"),
        ("videos", "videos or bags: give one recording, such as {}/c.mp4"),
    ):
        message = refused("predict", tmp_path / name, *words.split())
        assert advice.format(tmp_path / name) in message


@pytest.mark.parametrize(
    ("name", "words", "given"),
    [
        ("a.mp4", "--pattern *.png", "--pattern"),
        ("a.mp4", "--bits 12", "--bits"),
        ("a.mp4", "--topic /cam", "--topic"),
        ("a.bag", "--fps 10 --pattern *.png", "--fps, --pattern"),
    ],
)
def test_options_of_other_inputs_are_refused(
    name: str, words: str, given: str, tmp_path: Path, refused: Says
) -> None:
    (tmp_path / name).touch()
    message = refused("predict", tmp_path / name, *words.split())
    assert "leave out" in message
    assert given in message.partition("leave out")[2]


def test_a_folder_with_something_in_it_is_not_written_over(
    images: Path, tmp_path: Path, refused: Says
) -> None:
    said = refused("predict", "missing.mp4", "--out", "/proc/x/y")
    assert said.endswith("/proc/x: fix the path or make room and rerun")
    (tmp_path / "mine.txt").write_text("keep me")
    assert "holds something already" in refused(
        "predict", images, *INTRINSICS, "--fps", "10", "--out", tmp_path
    )
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_focal_length_that_motion_cannot_tell_is_assumed_with_a_warning(images: Path) -> None:
    found = predicted(images, 4, intrinsics=None)
    assert found.camera.source == "assumed"
    assert found.camera.intrinsics.fx_px == pytest.approx(64 / np.tan(np.radians(35)))
    assert any("70 degrees are assumed" in line for line in found.warnings())


def test_the_focal_length_of_photos_is_that_of_their_exif_data(tmp_path: Path) -> None:
    """36 mm of a film with a diagonal of 43.27 mm; that of 128x128 pixels is 181 px."""
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 36
    for number, frame in enumerate(street.clip().frames[:5]):
        Image.fromarray(frame).save(tmp_path / f"{number}.jpg", exif=exif)
    request = PredictionRequest(
        tmp_path, frame_rate_hz=10.0, num_past=4, num_future=1, size_px=(128, 128)
    )
    camera = prediction.predict(request).camera
    assert camera.source == "EXIF data"
    assert camera.intrinsics.fx_px == pytest.approx(36 * 128 * 2**0.5 / 43.27)


@pytest.mark.parametrize(
    ("camera", "is_warned"),
    [
        ({"fov_deg": 130.0}, True),
        ({"fov_deg": 100.0}, False),
        ({"intrinsics": (20.0, 20.0, 63.5, 63.5)}, False),  # 145 degrees, but given
        ({"calibration": "fisheye.yaml"}, False),
    ],
)
def test_a_wide_field_of_view_is_warned_of(
    camera: dict[str, Any], is_warned: bool, images: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A pinhole camera is assumed beyond 110 degrees, unless a file or numbers say so."""
    (images.parent / "fisheye.yaml").write_text(
        "cam0:\n  intrinsics: [60, 60, 63.5, 63.5]\n  resolution: [128, 128]\n"
        "  distortion_model: equidistant\n  distortion_coeffs: [0, 0, 0, 0]\n"
    )
    if "calibration" in camera:
        camera = {"calibration": images.parent / camera["calibration"]}
    request = PredictionRequest(images, frame_rate_hz=10.0, size_px=(64, 64), **camera)
    recording, lens = prediction.read_recording(request)
    warnings = list(find_camera(recording, lens, 4, request)[0].warnings())
    assert any("give --calibration with a fisheye model" in text for text in warnings) == is_warned
    Source.open(request)
    assert ("a pinhole camera of 130 degrees is assumed" in caplog.text) == is_warned


def test_a_hood_is_said_and_stays_in_place(images: Path, tmp_path: Path) -> None:
    for path in sorted(images.glob("*.png")):
        image = cv2.imread(str(path))
        image[-20:] = (90, 40, 30)
        cv2.imwrite(str(tmp_path / path.name), image)
    found = predicted(tmp_path, 10, size_px=(96, 96))
    assert found.about()["scene_mask_fraction"] == pytest.approx(20 / 128, abs=0.02)
    hood = found.prediction.frames[..., -13:, :, :].astype(int)
    assert np.abs(hood - (30, 40, 90)).max() <= 3
    exports.write(found, tmp_path / "out")
    strip = cv2.imread(str(tmp_path / "out" / "strip.png")).astype(int)
    assert (np.abs(strip - (200, 64, 255)).max(axis=2) < 20).sum() > 100  # its outline is pink


def test_the_json_says_where_everything_came_from(written: Path) -> None:
    about = json.loads((written / "predict.json").read_text())
    assert about["camera"]["source"] == "given"
    assert about["camera"]["intrinsics"]["fx_px"] == CAMERA.fx_px
    assert [about[name] for name in ("first", "observed", "predicted")] == [0, 8, 3]
    assert about["settings"]["size_px"] == [96, 96]
    assert about["predictor"]["pose_source"]["name"] == "refined"
    assert {"python", "numpy", "geovp"} <= about["versions"].keys()
    request = PredictionRequest(written, camera_height_m=1.65, has_fallback=False)
    assert about["code"] == code_hash([request.build()])
    assert replace(request, predictor="default").build().hindcast is None
    assert (about["tracked_frames"], about["is_metric"]) == (8, True)
    assert 0 < about["scale_uncertainty"] < 0.1  # the road was found
    assert (about["shown_by"], about["hindcast_errors"]) == ("geometry", {})  # without fallback
    # Of three predicted frames, two are recorded.
    real = cv2.resize(street.clip().frames[8][..., ::-1], (96, 96), interpolation=cv2.INTER_AREA)
    for name, image in (("predicted", "frames/000008.png"), ("copy-last", "seen/000007.png")):
        shown = cv2.imread(str(written / image)).astype(float)
        psnr = 10 * np.log10(255**2 / np.mean((shown - real) ** 2))
        (scores,) = about["scores"][name]["psnr"]
        assert (len(scores), scores[0]) == (2, pytest.approx(psnr, abs=0.01))


@pytest.mark.parametrize(
    ("width_px", "height_px", "expected"),
    [
        (1920, 1080, (640, 360)),
        (1242, 375, (640, 194)),  # 193.2 made even
        (321, 240, (320, 240)),
    ],
)
def test_frames_keep_the_aspect_unless_a_size_is_given(
    width_px: int, height_px: int, expected: tuple[int, int]
) -> None:
    assert output_size(Intrinsics(500, 500, 0, 0, width_px, height_px)) == expected


def test_a_camera_that_stands_gets_a_standing_prediction(tmp_path: Path, command: Command) -> None:
    write_images(tmp_path / "images", street.clip(2, 0.0).frames[[0] * 6])
    out = tmp_path / "out"
    given = predict(tmp_path / "images", "--past 6 --future 2 --size 96x64")
    assert "shown by the last frame\n" in command(*given, "--out", out).err
    assert "not known in metres" in (out / "depths/scale.txt").read_text()
    assert not (out / "cloud.ply").exists()
    assert {"strip.png", "film.mp4", "film.gif", "frames", "depths", "colmap"} <= {
        path.name for path in out.iterdir()
    }
    seen, ahead = (
        cv2.imread(str(out / name)).astype(int) for name in ("seen/000005.png", "frames/000007.png")
    )
    assert seen.shape == (64, 96, 3)
    assert np.abs(seen - ahead).mean() < 1


@pytest.mark.parametrize(("turn_deg", "says"), [(0.0, "stationary"), (1.0, "turns without moving")])
def test_a_camera_that_only_turns_is_not_called_stationary(
    tmp_path: Path, turn_deg: float, says: str
) -> None:
    # Eight views of one image, as of the middle 96 pixels of a camera that turns about its centre
    image, matrix = street.clip(2, 0.0).frames[0], CAMERA.matrix
    frames = []
    for step in range(8):
        turn = se3.exp(np.array([0, 0, 0, 0, np.radians(turn_deg * (step - 4)), 0]))[:3, :3]
        homography = matrix @ turn @ np.linalg.inv(matrix)
        frames.append(cv2.warpPerspective(image, homography, (128, 128))[16:-16, 16:-16])
    write_images(tmp_path, np.stack(frames))
    middle = (CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px - 16, CAMERA.cy_px - 16)
    warnings = [*predicted(tmp_path, 8, intrinsics=middle, size_px=(96, 96)).warnings()]
    assert any(says in each for each in warnings)
    assert sum("stationary" in each or "turns" in each for each in warnings) == 1


def test_components_by_name_and_table(images: Path, tmp_path: Path) -> None:
    given = predict(images, "--past 6 --future 2 --size 64")
    renderer = ["--renderer", '{ name = "depth-fusion", num_frames = 3 }']
    assert cli.main([*given, *renderer, "--out", str(tmp_path / "fusion")]) == 0
    about = json.loads((tmp_path / "fusion" / "predict.json").read_text())["predictor"]
    assert about["renderer"]["num_frames"] == 3
    assert cli.main([*given, "--predictor", "copy-last", "--out", str(tmp_path / "copy")]) == 0
    assert not (tmp_path / "copy" / "poses.tum.txt").exists()


def test_a_row_of_a_matrix(images: Path, tmp_path: Path, refused: Says) -> None:
    given = predict(images, "--past 6 --future 2 --size 64")
    method = ["--camera-height", "1.6", "--matrix", "fusion", "--method", "vo+prior + fusion"]
    assert cli.main([*given, *method, "--out", str(tmp_path / "a")]) == 0
    about = json.loads((tmp_path / "a" / "predict.json").read_text())["predictor"]
    assert about["pose_source"]["name"] == "chained"  # not refined
    assert about["renderer"]["name"] == "depth-fusion"
    assert "no method 'copy'" in refused(*given, "--matrix", "demo", "--method", "copy")
    # recorded poses, which a video does not have
    assert "needs" in refused(*given, "--matrix", "demo", "--method", "gt-3d + fusion")


def test_samples_get_folders_of_their_own(images: Path, tmp_path: Path) -> None:
    given = predict(images, "--past 8 --future 2 --size 96")
    source = '{ name = "chained", odometry = { name = "monocular", scale = "unit-speed" }, forecaster = "motion-prior" }'
    more = ["--samples", "3", "--pose-source", source, "--out", str(tmp_path / "out")]
    assert cli.main([*given, *more]) == 0
    folders = [tmp_path / "out", *(tmp_path / "out" / "samples" / n for n in ("001", "002"))]
    paths = [
        pose_files.read_trajectory(folder / "poses.tum.txt").world_from_cam for folder in folders
    ]
    np.testing.assert_allclose(paths[1][:8], paths[0][:8])  # the samples have one past
    assert np.abs(paths[1][8:] - paths[2][8:]).max() > 1e-4


@pytest.mark.parametrize(("turn_deg_s", "expected_deg"), [(1.0, 11.3), (6.0, None)])
def test_a_path_beside_the_axis_is_told_where_it_is_straight(
    turn_deg_s: float, expected_deg: float | None
) -> None:
    """The camera moves 0.2 m to the right for each metre ahead: arctan 0.2 is 11.3 degrees."""
    times_s = 0.1 * np.arange(10)
    twist = [1.0, 0, 5.0, 0, np.radians(turn_deg_s), 0]
    past = Trajectory(se3.exp(np.outer(times_s, twist)), times_s, is_metric=True)
    motion = Motion(past, past.world_from_cam[None], np.ones(10, bool))
    angle_deg = prediction.off_axis_deg(motion)
    assert angle_deg == (expected_deg and pytest.approx(expected_deg, abs=0.2))


LENS = (-0.2, 0.03, 0.002, -0.001)  # k1, k2, p1, p2: straight lines bulge outwards


def test_a_lens_by_file_is_the_one_by_numbers(images: Path, tmp_path: Path) -> None:
    """COLMAP's principal point counts from the corner of the image."""
    file = tmp_path / "cameras.txt"
    numbers = (CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px + 0.5, CAMERA.cy_px + 0.5, *LENS)
    size = f"{CAMERA.width_px} {CAMERA.height_px}"
    file.write_text(f"1 OPENCV {size} {' '.join(map(str, numbers))}\n")
    found = []
    for lens in ({"calibration": file}, {"intrinsics": GIVEN, "distortion": LENS}):
        request = PredictionRequest(images, frame_rate_hz=10.0, **lens)
        recording, recorded = prediction.read_recording(request)
        camera, straight = find_camera(recording, recorded, 4, request)
        assert camera.removed_distortion == LENS
        found.append(straight.frames.read(3))
    assert np.array_equal(*found)
    assert (found[0] != recording.frames.read(3)).any()


def test_frames_and_poses_are_numbered_as_in_the_recording(written: Path, images: Path) -> None:
    sparse = predicted(images, 4, first=1, frame_step=2)
    assert sparse.numbers.tolist() == [1, 3, 5, 7, 9, 11]
    names = {
        folder: sorted(path.name for path in (written / folder).iterdir())
        for folder in ("seen", "frames")
    }
    assert names["seen"] == [f"{n:06d}.png" for n in range(8)]
    assert names["frames"] == [f"{n:06d}.png" for n in range(8, 11)]
    stamped = pose_files.read_trajectory(written / "poses.tum.txt")
    plain = pose_files.read_kitti(written / "poses.kitti.txt")
    np.testing.assert_allclose(stamped.times_s, 0.1 * np.arange(11), atol=1e-9)
    np.testing.assert_allclose(stamped.world_from_cam, plain, atol=1e-6)

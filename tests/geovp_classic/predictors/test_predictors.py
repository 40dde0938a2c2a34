from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic.data import pose_files
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.recorded import Recorded
from geovp_classic.types import (
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    PrivilegedInput,
    Trajectory,
    Views,
)

NUM_PAST, NUM_FUTURE, HEIGHT, WIDTH = 4, 3, 6, 8
CAMERA = Intrinsics(10.0, 10.0, 3.5, 2.5, WIDTH, HEIGHT)


@pytest.fixture
def clip() -> Clip:
    rng = np.random.default_rng(1)
    times_s = 0.1 * np.arange(NUM_PAST + NUM_FUTURE)
    poses = se3.exp(np.outer(np.arange(7), [0, 0, 1.0, 0, 0.1, 0]))
    frames = rng.integers(0, 256, (NUM_PAST + NUM_FUTURE, HEIGHT, WIDTH, 3), dtype=np.uint8)
    depths = np.ones(frames.shape[:3], dtype=np.float32)
    return Clip(
        "03/000180",
        frames,
        times_s,
        CAMERA,
        Trajectory(poses, times_s, True),
        depths,
        camera_height_m=1.65,
    )


@pytest.fixture
def context(clip: Clip) -> Context:
    return clip.split(NUM_PAST, ~PrivilegedInput.NONE)[0]


@pytest.fixture
def frames() -> ByteArray:
    return np.random.default_rng(2).integers(0, 256, (NUM_FUTURE, HEIGHT, WIDTH, 3), dtype=np.uint8)


class TestCopyLast:
    def test_copies_the_last_frame(self, context: Context) -> None:
        prediction = CopyLast().predict(context.only(PrivilegedInput.NONE), num_samples=9)
        assert prediction.frames.shape == (1, NUM_FUTURE, HEIGHT, WIDTH, 3)
        assert (prediction.frames == context.frames[-1]).all()
        assert prediction.motion is None


class _Spread:
    """A pose source whose sample s stands s metres to the right; notes what it was shown."""

    needs = PrivilegedInput.CAMERA_HEIGHT

    def __init__(self) -> None:
        self.seen: list[Context] = []

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        self.seen.append(context)
        poses = np.tile(np.eye(4), (context.num_past, 1, 1))
        past = Trajectory(poses, context.times_s[: context.num_past], is_metric=False)
        futures = np.tile(np.eye(4), (num_samples, context.num_future, 1, 1))
        futures[:, :, 0, 3] = np.arange(num_samples)[:, None]
        return Motion(past, futures, np.ones(context.num_past, dtype=bool))


class _XAsGrey:
    """A renderer whose scene is grey level 10 x at position x, covered in the upper half."""

    needs = PrivilegedInput.PAST_DEPTHS

    def __init__(self) -> None:
        self.seen: list[Context] = []

    def reconstruct(self, context: Context, past: Trajectory) -> _XAsGrey:
        self.seen.append(context)
        self.past = past
        return self

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        shape = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        grey = np.broadcast_to(10 * world_from_cam[:, 0, 3, None, None, None], (*shape, 3)).astype(
            np.uint8
        )
        covered = np.zeros(shape, dtype=bool)
        covered[:, : intrinsics.height_px // 2] = True
        return Views(grey, covered, np.ones(shape, dtype=np.float32))


class TestGeometricPredictor:
    def test_needs_what_its_parts_need_and_shows_each_its_own_share(self, context: Context) -> None:
        source, renderer = _Spread(), _XAsGrey()
        predictor = GeometricPredictor(source, renderer)
        assert predictor.needs == PrivilegedInput.CAMERA_HEIGHT | PrivilegedInput.PAST_DEPTHS
        predictor.predict(context)
        (shown_source,), (shown_renderer,) = source.seen, renderer.seen
        assert shown_source.camera_height_m == 1.65
        assert shown_source.past_depths is None
        assert shown_renderer.past_depths is not None
        assert shown_renderer.camera_height_m is None
        assert all(shown.past is shown.future is None for shown in (shown_source, shown_renderer))

    def test_every_sample_is_seen_from_its_own_future(self, context: Context) -> None:
        prediction = GeometricPredictor(_Spread(), _XAsGrey()).predict(context, num_samples=5)
        assert prediction.frames.shape == (5, NUM_FUTURE, HEIGHT, WIDTH, 3)
        assert prediction.frames[:, 0, 0, 0, 0].tolist() == [0, 10, 20, 30, 40]
        assert prediction.covered.mean() == 0.5
        assert prediction.motion.futures.shape == (5, NUM_FUTURE, 4, 4)

    def test_the_renderer_is_told_the_past_of_the_source(self, context: Context) -> None:
        renderer = _XAsGrey()
        GeometricPredictor(GroundTruth(), renderer).predict(context)
        np.testing.assert_array_equal(renderer.past.world_from_cam, context.past.world_from_cam)


def write_images(folder: Path, frames: ByteArray) -> None:
    folder.mkdir(parents=True)
    for step, frame in enumerate(frames):
        cv2.imwrite(
            str(folder / f"{step + 8}.png"), frame[..., ::-1]
        )  # 8.png, 9.png, 10.png: numbers, not letters


class TestRecorded:
    def test_folder_of_images(self, tmp_path: Path, context: Context, frames: ByteArray) -> None:
        write_images(tmp_path / "03" / "000180", frames)
        prediction = Recorded(tmp_path).predict(context)
        np.testing.assert_array_equal(prediction.frames, frames[None])
        assert prediction.covered is None
        assert prediction.motion is None

    def test_folder_of_samples(self, tmp_path: Path, context: Context, frames: ByteArray) -> None:
        for sample in range(3):
            write_images(tmp_path / "03" / "000180" / f"sample{sample}", frames + np.uint8(sample))
        prediction = Recorded(tmp_path).predict(context, num_samples=2)
        np.testing.assert_array_equal(prediction.frames, np.stack([frames, frames + np.uint8(1)]))

    def test_npz(self, tmp_path: Path, context: Context, frames: ByteArray) -> None:
        (tmp_path / "03").mkdir()
        covered = frames[..., 0] > 100
        np.savez(tmp_path / "03" / "000180.npz", frames=frames, covered=covered)
        prediction = Recorded(tmp_path).predict(context, num_samples=100)
        np.testing.assert_array_equal(prediction.frames, frames[None])
        np.testing.assert_array_equal(prediction.covered, covered[None])

    def test_video(self, tmp_path: Path, context: Context) -> None:
        (tmp_path / "03").mkdir()
        camera = Intrinsics(50.0, 50.0, 31.5, 23.5, 64, 48)
        wide = replace(context, frames=np.zeros((NUM_PAST, 48, 64, 3), np.uint8), intrinsics=camera)
        writer = cv2.VideoWriter(
            str(tmp_path / "03" / "000180.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48)
        )
        for level in (40, 120, 200):
            writer.write(np.full((48, 64, 3), level, np.uint8))
        writer.release()
        levels = Recorded(tmp_path).predict(wide).frames[0].mean(axis=(1, 2, 3))
        np.testing.assert_allclose(levels, [40, 120, 200], atol=3)

    @pytest.mark.parametrize("suffix", ["kitti", "tum"])
    def test_poses(
        self, tmp_path: Path, context: Context, clip: Clip, frames: ByteArray, suffix: str
    ) -> None:
        write_images(tmp_path / "03" / "000180", frames)
        path = tmp_path / "poses" / "03" / "000180.txt"
        path.parent.mkdir(parents=True)
        (pose_files.write_kitti if suffix == "kitti" else pose_files.write_tum)(
            path, clip.trajectory
        )
        motion = (
            Recorded(tmp_path, poses=tmp_path / "poses", poses_are_metric=False)
            .predict(context)
            .motion
        )
        np.testing.assert_allclose(
            motion.futures[0], clip.trajectory.world_from_cam[NUM_PAST:], atol=1e-12
        )
        np.testing.assert_allclose(
            motion.past.world_from_cam, clip.trajectory.world_from_cam[:NUM_PAST], atol=1e-12
        )
        assert not motion.past.is_metric


class TestRecordedSaysWhatIsWrong:
    def test_no_folder(self, tmp_path: Path) -> None:
        with pytest.raises(BadData, match="nowhere is not a folder"):
            Recorded(tmp_path / "nowhere")

    @pytest.mark.parametrize(
        ("arrays", "message"),
        [
            (
                {"frames": np.zeros((2, HEIGHT, WIDTH, 3), np.uint8)},
                r"shape \(1, 2, 6, 8, 3\), expected uint8 of \(1, 3",
            ),
            ({"frames": np.zeros((NUM_FUTURE, 9, WIDTH, 3), np.uint8)}, r"\(1, 3, 9, 8, 3\)"),
            ({"frames": np.zeros((NUM_FUTURE, HEIGHT, WIDTH, 3))}, "float64 frames"),
            (
                {"frames": np.zeros((2, NUM_FUTURE, HEIGHT, WIDTH, 3), np.uint8)},
                r"expected uint8 of \(4, 3, 6, 8, 3\)",
            ),
            ({"images": np.zeros(3)}, "expected an npz file with an array 'frames'"),
            (
                {
                    "frames": np.zeros((NUM_FUTURE, HEIGHT, WIDTH, 3), np.uint8),
                    "covered": np.zeros((3, 6, 8)),
                },
                "float64 covered",
            ),
        ],
    )
    def test_arrays_of_another_size(
        self, tmp_path: Path, context: Context, arrays: dict[str, FloatArray], message: str
    ) -> None:
        (tmp_path / "03").mkdir()
        np.savez(tmp_path / "03" / "000180.npz", **arrays)
        with pytest.raises(BadData, match=message):
            Recorded(tmp_path).predict(context, num_samples=4)

    @pytest.mark.parametrize(
        ("files", "message"),
        [
            ({}, "03/000180 is missing"),
            (
                {"03/000180/8.png": "4x4", "03/000180.npz": "no"},
                r"000180\.npz and .*000180 both hold",
            ),
            ({"03/000180.npz": "no"}, r"000180\.npz cannot be read"),
            ({"03/000180/8.png": "4x4", "03/000180/9.png": "6x8"}, "expected images of one size"),
            ({"03/000180/notes.txt": "no"}, "holds nothing, expected images"),
        ],
    )
    def test_files_that_are_no_prediction(
        self, tmp_path: Path, context: Context, files: dict[str, str], message: str
    ) -> None:
        for name, content in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            if name.endswith(".png"):
                cv2.imwrite(
                    str(tmp_path / name), np.zeros((*map(int, content.split("x")), 3), np.uint8)
                )
            else:
                (tmp_path / name).write_text(content)
        with pytest.raises(BadData, match=message):
            Recorded(tmp_path).predict(context)

    def test_poses_missing_or_too_few(
        self, tmp_path: Path, context: Context, clip: Clip, frames: ByteArray
    ) -> None:
        write_images(tmp_path / "03" / "000180", frames)
        (tmp_path / "poses" / "03").mkdir(parents=True)
        predictor = Recorded(tmp_path, poses=tmp_path / "poses")
        with pytest.raises(BadData, match=r"000180\.txt is missing"):
            predictor.predict(context)
        pose_files.write_tum(tmp_path / "poses" / "03" / "000180.txt", clip.trajectory[:NUM_PAST])
        with pytest.raises(BadData, match="4 poses, expected 7"):
            predictor.predict(context)

    def test_a_clip_without_a_name(self, tmp_path: Path, context: Context) -> None:
        with pytest.raises(BadData, match="this clip has none"):
            Recorded(tmp_path).predict(replace(context, name=""))

"""Predictors: copy-last and recorded predictions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.recorded_predictions import RecordedPredictions
from geovp_classic.types import (
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
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


def write_images(folder: Path, frames: ByteArray) -> None:
    """Write 8.png, 9.png, 10.png, ...: their order is that of numbers, not of letters."""
    folder.mkdir(parents=True)
    for step, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{step + 8}.png"), frame[..., ::-1])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "03").mkdir()
    return tmp_path


class TestRecorded:
    def test_folder_of_images(self, folder: Path, context: Context, frames: ByteArray) -> None:
        write_images(folder / "03/000180", frames)
        prediction = RecordedPredictions(folder).predict(context)
        np.testing.assert_array_equal(prediction.frames, frames[None])
        assert prediction.covered is prediction.motion is None

    def test_npz(self, folder: Path, context: Context, frames: ByteArray) -> None:
        covered = frames[..., 0] > 100
        np.savez(folder / "03/000180.npz", frames=frames, covered=covered)
        prediction = RecordedPredictions(folder).predict(context, num_samples=100)
        np.testing.assert_array_equal(prediction.frames, frames[None])
        np.testing.assert_array_equal(prediction.covered, covered[None])

    @pytest.mark.parametrize("write", [pose_files.write_kitti, pose_files.write_tum])
    def test_poses(
        self,
        folder: Path,
        context: Context,
        clip: Clip,
        frames: ByteArray,
        write: Callable[[Path, Trajectory], None],
    ) -> None:
        write_images(folder / "03/000180", frames)
        write(folder / "03/000180.txt", clip.trajectory)
        recorded = RecordedPredictions(folder, poses=folder, poses_are_metric=False)
        motion = recorded.predict(context).motion
        poses = np.concatenate([motion.past.world_from_cam, motion.futures[0]])
        np.testing.assert_allclose(poses, clip.trajectory.world_from_cam, atol=1e-12)
        assert not motion.past.is_metric


RIGHT = np.zeros((NUM_FUTURE, HEIGHT, WIDTH, 3), np.uint8)


class TestInvalidRecords:
    @pytest.mark.parametrize(
        "arrays",
        [
            {"frames": RIGHT[:, 1:]},
            {"frames": np.stack([RIGHT, RIGHT])},  # two samples instead of four
            {"images": RIGHT},
            {"frames": RIGHT, "covered": np.zeros(RIGHT.shape[:3])},  # float64
        ],
    )
    def test_arrays_that_do_not_fit_the_clip(
        self, folder: Path, context: Context, arrays: dict[str, FloatArray]
    ) -> None:
        np.savez(folder / "03/000180.npz", **arrays)
        with pytest.raises(BadData, match=r"000180\.npz"):
            RecordedPredictions(folder).predict(context, num_samples=4)

    @pytest.mark.parametrize(
        ("names", "message"),
        [
            ([], "has 0 predictions of clip '03/000180'"),
            (["03/000180.npz"], r"000180\.npz cannot be read"),
            (["03/000180/8.png", "03/000180/9.png"], "expected one or more images of one size"),
        ],
    )
    def test_files_that_are_not_a_prediction(
        self, folder: Path, context: Context, names: list[str], message: str
    ) -> None:
        for size, name in enumerate(names, 1):
            path = folder / name
            path.parent.mkdir(exist_ok=True)
            path.write_text("no image")
            if path.suffix == ".png":
                cv2.imwrite(str(path), np.zeros((size, 4)))
        with pytest.raises(BadData, match=message):
            RecordedPredictions(folder).predict(context)

    def test_missing_poses(
        self, folder: Path, context: Context, clip: Clip, frames: ByteArray
    ) -> None:
        write_images(folder / "03/000180", frames)
        predictor = RecordedPredictions(folder, poses=folder)
        with pytest.raises(BadData, match=r"000180\.txt: does not exist"):
            predictor.predict(context)
        pose_files.write_tum(folder / "03/000180.txt", clip.trajectory[:NUM_PAST])
        with pytest.raises(BadData, match="4 poses for 7 frames, expected one each"):
            predictor.predict(context)

    def test_no_folder_or_no_name(self, folder: Path, context: Context) -> None:
        with pytest.raises(BadData, match="nowhere is not a folder"):
            RecordedPredictions(folder / "nowhere")
        with pytest.raises(BadData, match="predictions of clip ''"):
            RecordedPredictions(folder).predict(replace(context, name=""))

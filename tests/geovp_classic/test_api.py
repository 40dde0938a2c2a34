"""The public API: fast import, one call each to open, predict and evaluate, and typed."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import geovp
from geovp_classic.errors import BadData
from geovp_classic.pose_sources.stand_still import StandStill

ROOT = Path(__file__).parents[2]
CAMERA_HEIGHT = geovp.PrivilegedInput.CAMERA_HEIGHT
STREET = {"name": "synthetic", "num_frames": 8, "size_px": [64, 64]}


@pytest.fixture(scope="module")
def clip() -> geovp.Clip:
    return geovp.open_clip(STREET)


def test_the_import_is_light() -> None:
    code = (
        "import sys, geovp_classic as geovp; dir(geovp); geovp.__version__\n"
        "assert not {'numpy', 'cv2', 'numba', 'scipy', 'pydantic'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


class TestOpenClip:
    def test_by_a_table(self, clip: geovp.Clip) -> None:
        assert clip.name == "seed0-straight/000"
        assert clip.frames.shape == (8, 64, 64, 3)
        assert geovp.open_clip(STREET, index=1).name != clip.name

    def test_a_folder_in_the_layout_of_kitti(self, tmp_path: Path, clip: geovp.Clip) -> None:
        sequence = tmp_path / "sequences/04"
        (sequence / "image_0").mkdir(parents=True)
        for step in range(31):
            cv2.imwrite(str(sequence / f"image_0/{step:06d}.png"), clip.frames[step % 8])
        (sequence / "calib.txt").write_text("P0: 80 0 32 0 0 80 32 0 0 0 1 0\n")
        (sequence / "times.txt").write_text("".join(f"{0.1 * step}\n" for step in range(31)))
        opened = geovp.open_clip(str(tmp_path))
        assert (opened.name, len(opened), opened.trajectory) == ("04/000000", 30, None)


class TestPredict:
    def test_true_poses_beat_a_stationary_camera(self, clip: geovp.Clip) -> None:
        """Components are given as a name, an object and a table."""
        context, target = clip.split(6, ~geovp.PrivilegedInput.NONE)
        moving = geovp.predict(context, "ground-truth")
        stationary = geovp.predict(context, StandStill(), {"name": "ground-far-plane"})
        assert moving.frames.shape == stationary.frames.shape == (1, 2, 64, 64, 3)
        psnr, baseline = (geovp.evaluate(one, target)["psnr"] for one in (moving, stationary))
        assert psnr.mean() > baseline.mean()

    @pytest.mark.parametrize("needs", [geovp.PrivilegedInput.NONE, CAMERA_HEIGHT])
    def test_the_camera_height_makes_lengths_metric(self, needs: geovp.PrivilegedInput) -> None:
        clip = geovp.open_clip({**STREET, "num_frames": 12, "size_px": [128, 128]})
        context, _ = clip.split(10, needs)
        motion = geovp.predict(context).motion
        assert motion.past.is_metric == (needs is CAMERA_HEIGHT)

    def test_arguments_of_another_kind_are_explained(self, clip: geovp.Clip) -> None:
        context, _ = clip.split(6, geovp.PrivilegedInput.NONE)
        with pytest.raises(BadData, match="the first part of"):
            geovp.predict(clip)
        with pytest.raises(BadData, match="num_samples is 0"):
            geovp.predict(context, num_samples=0)
        for given in ({"num_samples": 2.5}, {"hindcast": False}, {"mask": 3}):
            with pytest.raises(BadData, match=next(iter(given)) + r" is .*, expected an? "):
                geovp.predict(context, **given)
        for source in (None, 3, ["synthetic"]):
            with pytest.raises(BadData, match=r"source is .*, expected a folder"):
                geovp.open_clip(source)
        with pytest.raises(BadData, match=r"camera_height_m is '1.4', expected a number"):
            replace(context, camera_height_m="1.4")
        with pytest.raises(BadData, match=r"num_past is 2.5, expected a whole number"):
            clip.split(2.5, geovp.PrivilegedInput.NONE)
        with pytest.raises(BadData, match="none of the renderers: give a name"):
            geovp.predict(context, renderer=StandStill())
        with pytest.raises(BadData, match="StandStill'> is none of the pose_sources"):
            geovp.predict(context, StandStill)
        with pytest.raises(BadData, match="cannot be read"):
            geovp.predict(context, mask="hood.png")


class TestEvaluate:
    def test_values_of_each_sample_and_step(self, clip: geovp.Clip) -> None:
        _, target = clip.split(6, geovp.PrivilegedInput.NONE)
        off_by_one = np.where(target.frames < 255, target.frames + 1, 254).astype(np.uint8)
        frames = np.stack([target.frames, off_by_one])
        psnr = geovp.evaluate(geovp.Prediction(frames), target, ["psnr"])["psnr"]
        assert psnr.shape == (2, 2)
        # an error of one grey level everywhere: 20 log10(255) = 48.13 dB
        np.testing.assert_allclose(psnr[1], 48.13, atol=0.005)
        assert (psnr[0] > 90).all()
        assert geovp.evaluate(geovp.Prediction(frames), target, "psnr").keys() == {"psnr"}

    def test_variants_of_a_metric_do_not_replace_each_other(self, clip: geovp.Clip) -> None:
        _, target = clip.split(6, geovp.PrivilegedInput.NONE)
        with pytest.raises(BadData, match="'ssim' is given twice"):
            geovp.evaluate(geovp.Prediction(target.frames[None]), target, ["ssim", "ssim"])

    def test_a_target_of_another_split_is_refused(self, clip: geovp.Clip) -> None:
        context, _ = clip.split(6, geovp.PrivilegedInput.NONE)
        copied = geovp.build("predictors", "copy-last").predict(context)
        with pytest.raises(BadData, match=r"\(2, 64, 64, 3\), expected .* \(3, 64, 64, 3\)"):
            geovp.evaluate(copied, clip.split(5, geovp.PrivilegedInput.NONE)[1])


SCRIPT = """
import geovp

clip: geovp.Clip = geovp.open_clip("synthetic")
context, target = clip.split(10, geovp.PrivilegedInput.NONE)
prediction = geovp.predict(context, pose_source={"name": "chained"})
psnr: float = float(geovp.evaluate(prediction, target)["psnr"].mean())
"""


def test_scripts_can_be_type_checked(tmp_path: Path) -> None:
    assert Path(geovp.__file__).with_name("py.typed").exists()
    (tmp_path / "right.py").write_text(SCRIPT)
    (tmp_path / "wrong.py").write_text(SCRIPT.replace('{"name": "chained"}', "3"))
    mypy = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "."]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    done = subprocess.run(mypy, cwd=tmp_path, env=environment, capture_output=True, text=True)
    (error, _) = done.stdout.splitlines()
    assert error.startswith('wrong.py:6: error: Argument "pose_source" to "predict" has')


class TestShow:
    def test_a_clip_is_a_row_from_the_first_frame_to_the_last(self, clip: geovp.Clip) -> None:
        """Four tiles of 64 pixels with a label of 14 pixels above and 2 pixels on each side."""
        strip = np.asarray(geovp.show(clip, num_frames=4))
        assert strip.shape == (14 + 64, 4 * (64 + 4), 3)
        np.testing.assert_array_equal(strip[14:, 2:66], clip.frames[0])
        np.testing.assert_array_equal(strip[14:, -66:-2], clip.frames[-1])
        assert (strip[:14] < 128).any()

    def test_contexts_and_targets_are_parts_of_the_row_of_a_clip(self, clip: geovp.Clip) -> None:
        context, target = clip.split(6, geovp.PrivilegedInput.NONE)
        strip = np.asarray(geovp.show(context, num_frames=6))
        assert strip.shape == (14 + 64, 6 * (64 + 4), 3)
        np.testing.assert_array_equal(strip[14:, -66:-2], clip.frames[5])
        strip = np.asarray(geovp.show(target, num_frames=2))
        np.testing.assert_array_equal(strip[14:, 2:66], clip.frames[6])
        with pytest.raises(BadData, match=r"num_frames is 2.5, expected a whole number"):
            geovp.show(context, num_frames=2.5)

    def test_frames_less_than_a_tenth_of_a_second_apart_have_different_labels(
        self, clip: geovp.Clip
    ) -> None:
        """At 0.00 and 0.03 s."""
        fast = replace(clip, times_s=0.03 * np.arange(8), trajectory=None)
        labels = np.asarray(geovp.show(fast, num_frames=8))[:14]
        assert (labels[:, :68] != labels[:, 68:136]).any()

    def test_a_prediction_has_a_row_per_sample(self) -> None:
        levels = np.arange(7, dtype=np.uint8)[:, None, None, None, None]
        frames = np.broadcast_to(levels, (7, 3, 16, 20, 3))
        strip = np.asarray(geovp.show(geovp.Prediction(frames)))
        assert strip.shape == (5 * (14 + 16), 3 * (20 + 4), 3)
        assert strip[20::30, 2, 0].tolist() == [0, 1, 2, 3, 4]

"""The public API: light to import, one call to open, predict and evaluate, types that an outside
script can check.
"""

import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import numpy as np
import pytest

import geovp_classic as geovp
from geovp_classic.errors import BadData, Incompatible, UnknownComponent
from geovp_classic.pose_sources.stand_still import StandStill

ROOT = Path(__file__).parents[2]
STREET = {"name": "synthetic", "num_frames": 8, "size_px": [64, 64]}


@pytest.fixture(scope="module")
def clip() -> geovp.Clip:
    return geovp.open_clip(STREET)


def test_importing_it_imports_nothing_heavy() -> None:
    code = (
        "import sys, geovp_classic as geovp; dir(geovp); geovp.__version__\n"
        "print(sorted({'numpy', 'cv2', 'numba', 'scipy', 'open3d'} & set(sys.modules)))"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "[]\n"
    )


def test_every_public_name_is_there_and_no_other() -> None:
    assert dir(geovp) == sorted(geovp.__all__)
    for name in geovp.__all__:
        assert getattr(geovp, name) is not None
    assert geovp.Clip.__module__.startswith("geovp_classic.types")
    with pytest.raises(AttributeError, match="no attribute 'Clipp'"):
        geovp.Clipp  # noqa: B018


def test_the_version_is_the_packages() -> None:
    assert (
        geovp.__version__
        == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    )


class TestOpenClip:
    def test_by_a_table_is_the_data_sets_own_clip(self, clip: geovp.Clip) -> None:
        assert clip.name == "seed0-straight/000"
        assert clip.frames.shape == (8, 64, 64, 3)
        second = geovp.open_clip(STREET, index=1)
        assert second.name != clip.name

    def test_a_folder_laid_out_as_kitti(self, tmp_path: Path, clip: geovp.Clip) -> None:
        import cv2

        images = tmp_path / "sequences/04/image_0"
        images.mkdir(parents=True)
        for step in range(31):
            cv2.imwrite(str(images / f"{step:06d}.png"), clip.frames[step % 8])
        (tmp_path / "sequences/04/calib.txt").write_text("P0: 80 0 32 0 0 80 32 0 0 0 1 0\n")
        (tmp_path / "sequences/04/times.txt").write_text(
            "".join(f"{0.1 * step}\n" for step in range(31))
        )
        opened = geovp.open_clip(str(tmp_path))
        assert (opened.name, len(opened), opened.trajectory) == ("04/000000", 30, None)

    def test_a_drive_of_kitti_raw(self, tmp_path: Path, clip: geovp.Clip, write_kitti_raw) -> None:  # noqa: ANN001
        long = geovp.open_clip({"name": "synthetic", "num_frames": 30, "size_px": [64, 64]})
        write_kitti_raw(tmp_path, 5, long)
        assert geovp.open_clip(tmp_path).name == "2011_09_26_drive_0005/000000"

    def test_a_mistake_is_one_sentence_that_says_what_to_give(self, tmp_path: Path) -> None:
        with pytest.raises(BadData, match="has 8 clips: give 0 to 7"):
            geovp.open_clip(STREET, index=8)
        with pytest.raises(BadData, match=r"neither a data set .* give a table such as"):
            geovp.open_clip(tmp_path)
        with pytest.raises(
            UnknownComponent, match="no field 'num_frame': did you mean 'num_frames'"
        ):
            geovp.open_clip({"name": "synthetic", "num_frame": 8})


class TestPredict:
    def test_parts_are_names_tables_or_components_and_true_poses_beat_standing_still(
        self, clip: geovp.Clip
    ) -> None:
        context, target = clip.split(6, ~geovp.PrivilegedInput.NONE)
        moving = geovp.predict(context, "ground-truth")
        standing = geovp.predict(context, StandStill(), {"name": "ground-far-plane"})
        assert moving.frames.shape == standing.frames.shape == (1, 2, 64, 64, 3)
        assert (
            geovp.evaluate(moving, target)["psnr"].mean()
            > geovp.evaluate(standing, target)["psnr"].mean()
        )

    @pytest.mark.parametrize(
        "grant", [geovp.PrivilegedInput.NONE, geovp.PrivilegedInput.CAMERA_HEIGHT]
    )
    def test_without_a_pose_source_lengths_are_metres_where_the_height_is_known(
        self, grant: geovp.PrivilegedInput
    ) -> None:
        clip = geovp.open_clip({**STREET, "num_frames": 12, "size_px": [128, 128]})
        context, _ = clip.split(10, grant)
        motion = geovp.predict(context).motion
        assert motion.past.is_metric == (grant is geovp.PrivilegedInput.CAMERA_HEIGHT)

    def test_a_part_without_its_grant_says_so(self, clip: geovp.Clip) -> None:
        context, _ = clip.split(6, geovp.PrivilegedInput.NONE)
        with pytest.raises(Incompatible, match="needs recorded past poses"):
            geovp.predict(context, "ground-truth")


class TestEvaluate:
    def test_values_of_every_sample_and_step(self, clip: geovp.Clip) -> None:
        _, target = clip.split(6, geovp.PrivilegedInput.NONE)
        off_by_one = np.stack(
            [target.frames, np.where(target.frames < 255, target.frames + 1, 254).astype(np.uint8)]
        )
        psnr = geovp.evaluate(geovp.Prediction(off_by_one), target, ["psnr"])["psnr"]
        assert psnr.shape == (2, 2)
        # an error of one grey level everywhere: 20 log10(255) = 48.13 dB
        np.testing.assert_allclose(psnr[1], 48.13, atol=0.005)
        assert (psnr[0] > 90).all()

    def test_a_target_of_another_split_is_refused(self, clip: geovp.Clip) -> None:
        context, _ = clip.split(6, geovp.PrivilegedInput.NONE)
        copied = geovp.build("predictors", "copy-last").predict(context)
        with pytest.raises(BadData, match=r"\(1, 2, 64, 64, 3\), the real ones \(3, 64, 64, 3\)"):
            geovp.evaluate(copied, clip.split(5, geovp.PrivilegedInput.NONE)[1])


def test_reprs_are_one_line_with_shapes(clip: geovp.Clip) -> None:
    context, target = clip.split(6, geovp.PrivilegedInput.PAST_POSES)
    assert repr(context.past) == "Trajectory(world_from_cam=[6, 4, 4], times_s=[6], is_metric=True)"
    for shown in (clip, context, target, geovp.Prediction(target.frames[None])):
        assert len(repr(shown)) < 600
        assert "\n" not in repr(shown)
    assert "frames=[8, 64, 64, 3]" in repr(clip)
    assert repr(geovp.Prediction(target.frames[None])) == "Prediction(frames=[1, 2, 64, 64, 3])"


SCRIPT = """
import geovp_classic as geovp

clip: geovp.Clip = geovp.open_clip("synthetic")
context, target = clip.split(10, geovp.PrivilegedInput.NONE)
prediction = geovp.predict(context, pose_source={"name": "chained"})
means: dict[str, float] = {name: float(one.mean()) for name, one in geovp.evaluate(prediction, target).items()}
"""


def test_a_strictly_typed_script_outside_finds_the_types_of_the_wheel(tmp_path: Path) -> None:
    source, environment = tmp_path / "source", tmp_path / "environment"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    for package in ("geovp_classic", "learned", "benchmarks"):
        shutil.copytree(
            ROOT / package,
            source / package,
            ignore=shutil.ignore_patterns("__pycache__", "weights"),
        )
    shutil.copytree(ROOT / "src", source / "src", symlinks=True)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    site = environment / "lib" / f"python{sysconfig.get_python_version()}" / "site-packages"
    (site / "libraries.pth").write_text(
        "\n".join(path for path in sys.path if path.endswith("site-packages"))
    )
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
    ]
    subprocess.run([*command, "--target", str(site), str(source)], check=True, cwd=tmp_path)
    installed = {
        path.name
        for path in site.iterdir()
        if path.is_dir() and not path.name.endswith(".dist-info")
    } - {"bin"}
    assert installed == {"geovp_classic", "geovp_benchmarks", "geovp_learned"}
    (tmp_path / "script.py").write_text(SCRIPT)
    mypy = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--python-executable",
        str(environment / "bin/python"),
    ]
    done = subprocess.run(
        [*mypy, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    (tmp_path / "wrong.py").write_text(
        SCRIPT.replace('pose_source={"name": "chained"}', "pose_source=3")
    )
    done = subprocess.run(
        [*mypy, "wrong.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert 'Argument "pose_source" to "predict" has incompatible type "int"' in done.stdout


class TestShow:
    def test_a_clip_is_one_row_of_frames_from_the_first_to_the_last(self, clip: geovp.Clip) -> None:
        """Eight frames of 64 pixels: the first, the last and two between, 4 pixels apart, below 14
        pixels of labels.
        """
        strip = np.asarray(geovp.show(clip, num_frames=4))
        assert strip.shape == (14 + 64, 4 * 64 + 3 * 4, 3)
        np.testing.assert_array_equal(strip[14:, :64], clip.frames[0])
        np.testing.assert_array_equal(strip[14:, -64:], clip.frames[-1])
        assert (strip[:14] < 128).any()  # words
        assert (strip[14:, 64:68] == 255).all()

    def test_a_prediction_has_a_row_a_sample(self) -> None:
        frames = np.zeros((7, 3, 16, 20, 3), np.uint8)
        frames += np.arange(7, dtype=np.uint8)[:, None, None, None, None]
        strip = np.asarray(geovp.show(geovp.Prediction(frames)))
        assert strip.shape == (14 + 5 * 16 + 4 * 4, 3 * 20 + 2 * 4, 3)
        assert [strip[14 + 20 * row, 0, 0] for row in range(5)] == [0, 1, 2, 3, 4]

    def test_no_frames_is_bad_data(self, clip: geovp.Clip) -> None:
        with pytest.raises(BadData, match="num_frames is 0: give 1 or more"):
            geovp.show(clip, num_frames=0)

"""Predictions of other software are scored next to methods, and methods are exported for it."""

from pathlib import Path

import numpy as np
import pytest

from geovp.drawing import video
from geovp_benchmarks.results.store import Results
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.types import ByteArray
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import content, write_images, write_matrix

SYNTHETIC = {"name": "synthetic", "num_clips": 2}


@pytest.fixture
def matrix(tmp_path: Path) -> Path:
    """Return a matrix of two synthetic clips of 32 pixels with copy-last and a geometric method."""
    tables = content(
        metrics={"frame": ["psnr"], "trajectory": []},
        predictors={"copy-last": "copy-last"},
        pose_sources={"gt-3d": "ground-truth"},
        renderers={"fusion": {"name": "depth-fusion", "depth": {"name": "given"}}},
    )
    tables["protocol"] |= {"dataset": SYNTHETIC, "size_px": [32, 32]}
    return write_matrix(tmp_path / "m.toml", tables)


def submit(folder: Path, name: str, frames: ByteArray, kind: str) -> None:
    """Write predicted frames [F, H, W, 3] of a clip."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "npz":
        np.savez(f"{path}.npz", frames=frames)
    elif kind == "png":
        write_images(path, frames)
    else:
        video.write_mp4(Path(f"{path}.mp4"), frames, 10.0)


@pytest.mark.parametrize("kind", ["npz", "png", "mp4"])
def test_submissions_become_rows_beside_the_others(
    kind: str, matrix: Path, tmp_path: Path, printed: Says
) -> None:
    out = tmp_path / "out"
    printed("run", matrix, "--out", out, "--no-report", "--methods", "copy-last")
    for clip in Synthetic(num_clips=2, num_frames=5, size_px=(32, 32)):
        submit(tmp_path / "theirs", clip.name, clip.frames[[2, 2]], kind)
    words = ["score", tmp_path / "theirs", "--protocol", matrix, "--out", out, "--label", "others"]
    text = printed(*words)
    assert "| copy-last" in text
    assert "| others" in text
    results = Results(out)
    ours, theirs = (results.means(name)["psnr"] for name in ("copy-last", "others"))
    if kind == "mp4":  # loses details
        assert np.abs(ours - theirs).max() < 3
    else:
        np.testing.assert_array_equal(ours, theirs)
    # Other frames in the same files
    for clip in Synthetic(num_clips=2, num_frames=5, size_px=(32, 32)):
        submit(tmp_path / "theirs", clip.name, clip.frames[3:], kind)
    printed(*words)
    assert (Results(out).means("others")["psnr"] > theirs).all()


def test_a_submission_replaces_no_other_method(
    matrix: Path, tmp_path: Path, printed: Says, refused: Says
) -> None:
    out = tmp_path / "out"
    printed("run", matrix, "--out", out, "--no-report")
    for clip in Synthetic(num_clips=2, num_frames=5, size_px=(32, 32)):
        for folder in ("a/theirs", "b/theirs"):
            submit(tmp_path / folder, clip.name, clip.frames[[2, 2]], "npz")
    words = ["--protocol", matrix, "--out", out]
    assert "| theirs" in printed("score", tmp_path / "a/theirs", *words)
    for label in ("theirs", "copy-last", "gt-3d--fusion"):
        assert "--label" in refused("score", tmp_path / "b/theirs", *words, "--label", label)


def test_missing_predictions_are_named(matrix: Path, tmp_path: Path, command: Command) -> None:
    (tmp_path / "theirs").mkdir()
    ended = command("score", tmp_path / "theirs", "--protocol", matrix, "--out", tmp_path / "out")
    assert ended.code == 1
    assert "has 0 predictions of clip" in ended.out


def test_conditions_are_views_masks_depths_poses_and_intrinsics(
    matrix: Path, tmp_path: Path, printed: Says, refused: Says
) -> None:
    out, folder = tmp_path / "out", tmp_path / "conditions"
    printed("run", matrix, "--out", out, "--no-report", "--keep", "all")
    words = ["export", out, "--format", "conditions", "--out", folder]
    assert "needs one --method" in refused(*words)
    paths = printed(*words, "--method", "gt-3d + fusion").split()
    assert len(paths) == 2
    results = Results(out)
    name = results.protocol()["clips"][0]
    clip = results.clips().read(name)
    arrays = np.load(folder / f"{name}.npz")
    kept = results.predictions(results.by_name()["gt-3d--fusion"]).read(name)
    mask = arrays["rendered_warp_masks"][0, :, 0, 0]
    np.testing.assert_array_equal(mask, kept.covered[0])
    images = np.moveaxis(arrays["rendered_warp_images"][0, :, 0], 1, -1)
    shown = np.rint((images + 1) * 127.5).astype(np.uint8)
    np.testing.assert_array_equal(shown[mask > 0], kept.frames[0][mask > 0])
    assert (images[mask == 0] == -1).all()
    assert arrays["depths"].shape == arrays["rendered_warp_masks"].shape == (1, 2, 1, 1, 32, 32)
    poses = clip.trajectory.world_from_cam
    expected = np.linalg.inv(poses[3:]) @ poses[2]
    np.testing.assert_allclose(arrays["w2cs"][0], expected, atol=1e-5)
    np.testing.assert_allclose(arrays["intrinsics"][0, 0], clip.intrinsics.matrix, rtol=1e-6)
    np.testing.assert_array_equal(arrays["observed"], clip.frames[:3])

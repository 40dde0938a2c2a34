"""`geovp reproduce fvs20` from nothing, on four short drives in KITTI raw's layout."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks import cli, plots
from geovp_benchmarks.matrix import papers, schema
from geovp_benchmarks.results.store import Results
from geovp_classic.atomic import write_bytes
from geovp_classic.data.synthetic.dataset import Synthetic
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import write_images

DRIVES = (60, 84, 93, 96)
# Methods with networks as published; the networks of the suite are others and have other labels
NOT_INCLUDED = {
    "thesis": {
        *("svg-1", "svg-100", "srvp-1", "srvp-100", "slamp-1", "slamp-100"),
        *("ours", "gt-2d", "gt-3d"),
    }
}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory, write_kitti_raw: Callable[..., Path]) -> Path:
    """Ten frames of the synthetic street, whole frames of 318x96, as each of the protocol's
    drives.
    """
    folder = tmp_path_factory.mktemp("raw")
    clip = Synthetic(num_clips=1, num_frames=10, size_px=(96, 96), with_full=True)[0]
    nothing = {"depths": None, "moving": None, "full": None}
    wide = dataclasses.replace(
        clip, frames=clip.full.frames, intrinsics=clip.full.intrinsics, **nothing
    )  # type: ignore[arg-type]
    for number in DRIVES:
        write_kitti_raw(folder, number, wide)
    return folder


@pytest.fixture(scope="module")
def done(root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Results]:
    """The exit code and the results of one clip."""
    out = tmp_path_factory.mktemp("out")
    with pytest.MonkeyPatch.context() as patch:  # what is in figures and LPIPS are tested elsewhere
        patch.delenv("GEOVP_LPIPS_WEIGHTS", raising=False)
        patch.setattr(plots.Page, "write", lambda page, path: write_bytes(path, b""))
        words = ["--root", str(root), "--out", str(out), "--limit", "1", "--keep", "0"]
        code = cli.main(["reproduce", "fvs20", *words])
    return code, Results(out)


def test_every_row_is_done_under_the_protocols_choices(done: tuple[int, Results]) -> None:
    code, results = done
    assert code == 0
    assert [method.label for method in results.methods()] == [
        "gt-3d + fusion",
        "gt-3d + ground-far-plane",
        "vo+prior + fusion",
        "vo+prior + ground-far-plane",
        "copy-last",
    ]
    shared = results.protocol()
    assert (shared["num_past"], shared["num_future"], shared["size_px"]) == (4, 5, [832, 256])
    assert shared["dataset"]["fit"] == "stretch"
    assert shared["clips"] == ["2011_09_26_drive_0060/000000"]


def test_printed_numbers_are_means_over_the_first_frames(done: tuple[int, Results]) -> None:
    text = (done[1].tables / "fvs20.md").read_text()
    steps = done[1].scores("copy-last").values["ms-ssim"][0, 0]
    expected = [steps[:k].mean() for k in (1, 3, 5)]
    line = next(line for line in text.splitlines() if line.startswith("| copy-last"))
    means = [float(entry) for entry in line.split("|")[3:6]]
    np.testing.assert_allclose(means, expected, atol=0.00005)


def test_true_poses_and_depth_beat_the_last_frame(done: tuple[int, Results]) -> None:
    means = {
        method.name: done[1].means(method.name)["ms-ssim"].mean() for method in done[1].methods()
    }
    assert means["gt-3d--fusion"] > means["copy-last"] + 0.2


@pytest.mark.parametrize("name", papers.names())
def test_without_its_data_a_paper_says_what_is_missing_and_where_it_comes_from(
    name: str, refused: Says, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("KITTI", "KITTI_RAW", "CITYSCAPES", "BAIR", "CALTECH"):
        monkeypatch.delenv(f"GEOVP_{variable}", raising=False)
    paper = papers.load(name)
    sentence = refused("reproduce", name)
    assert f"{name} needs {paper.data}" in sentence
    assert paper.where in sentence


@pytest.mark.parametrize("name", papers.names())
def test_the_methods_that_reproduce_a_paper_are_those_of_its_rows(name: str) -> None:
    paper, matrix = papers.load(name), schema.read(Path(name))
    labels = {method.label for method in matrix.methods}
    assert "copy-last" in labels
    absent = {row.method for row in paper.published.row if row.method} - labels
    assert absent == NOT_INCLUDED.get(name, set())
    assert {metric for row in paper.published.row for metric in row.numbers} <= set(
        paper.metrics["frame"]
    )


def test_svg18_runs_on_a_folder_of_extracted_videos(tmp_path: Path, printed: Says) -> None:
    frames = np.random.default_rng(0).integers(0, 256, (30, 64, 64, 3), np.uint8)
    for video in ("000", "001"):
        write_images(tmp_path / "bair" / video, frames)
    options = ["--root", tmp_path / "bair", "--methods", "copy-last", "--out", tmp_path / "out"]
    text = printed("reproduce", "svg18", *options, "--no-report")
    assert "Not comparable yet: the protocol has 256 clips" in text
    assert "| SLAMP" in text

"""The table of moving things: its counts, means and shares are those of the rows; bad arguments are told in a line."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import moving
from benchmarks.moving import MovingRow
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.errors import BadData
from geovp_classic.metrics.image import Psnr


def row(clip: str, things: int, pixels: tuple[int, int, int], psnr: tuple[float, float], cpu_s: float) -> MovingRow:
    scores = {"psnr": np.array(psnr), "psnr@moving": np.array([np.nan, np.nan])}
    return MovingRow(clip, things, *pixels, scores, np.array([1.0, 1.0 + cpu_s]))


ROWS = [
    row("a", 2, (100, 80, 60), (20.0, 21.0), 0.03),
    row("b", 0, (50, 0, 0), (10.0, 10.0), 0.01),
    row("c", 0, (0, 0, 0), (12.0, 12.0), 0.02),
]


def test_means_are_over_clips_with_things_and_over_all() -> None:
    lines = moving.table(ROWS).splitlines()
    assert lines[1].split() == ["a", "2", "0.50", "20.000", "->", "21.000", "nan", "->", "nan"]  # 60 / (100 + 80 - 60)
    assert lines[2].split()[:8] == ["mean", "of", "1", "clips", "2", "0.50", "20.000", "->"]
    # 60 / (150 + 80 - 60) = 0.35; (20 + 10 + 12) / 3 = 14
    assert lines[3].split()[:9] == ["mean", "of", "3", "clips", "2", "0.35", "14.000", "->", "14.333"]
    # 60 of 80 found pixels are right, 60 of 150 true ones are found.
    assert lines[4] == "moving pixels of the last frame: precision 0.75, recall 0.40, IoU 0.35"
    assert lines[5] == "carrying costs 20 ms of processor time a clip (median)"


def test_without_true_masks_there_is_no_overlap() -> None:
    lines = moving.table([row("d", 1, (0, 30, 0), (20.0, 19.0), 0.0)]).splitlines()
    assert lines[1].split()[:3] == ["d", "1", "-"]
    assert not any("precision" in line for line in lines)


def test_no_clip_gives_no_line_but_the_head() -> None:
    assert len(moving.table([]).splitlines()) == 2


def test_a_car_of_the_synthetic_street_is_measured() -> None:
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[5]
    assert clip.moving is not None
    (found,) = moving.measure([clip], {"psnr": Psnr()})
    assert (found.clip, found.num_things, found.true_px) == ("seed0/accelerate-000", 1, clip.moving[9].sum())
    assert found.both_px <= min(found.true_px, found.found_px)
    assert found.both_px > 0.65 * found.found_px
    assert set(found.scores) == {"psnr", "psnr@moving"}
    assert found.scores["psnr@moving"].shape == (2,)
    assert (found.cpu_s > 0).all()


def test_seeds_and_sequences_become_data_sets() -> None:
    assert moving.specs_of(["synthetic", "3", "4"]) == [
        {"name": "synthetic", "seed": 3, "num_clips": 8},
        {"name": "synthetic", "seed": 4, "num_clips": 8},
    ]
    large, small = moving.specs_of(["kitti", "data", "03[0:180)", "00[600:725)", "raw0095"])
    assert (large["sequences"], large["size_px"]) == (["03[0:180)", "raw0095"], [256, 256])
    assert (small["sequences"], small["size_px"]) == (["00[600:725)"], [128, 128])


@pytest.mark.parametrize("arguments", [[], ["synthetic"], ["synthetic", "one"], ["kitti", "data"], ["svhn", "1"]])
def test_bad_arguments_are_told_in_a_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert moving.main(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert "expected `synthetic SEED...` or `kitti ROOT SEQUENCE...`" in told.err


def test_a_folder_that_is_not_there_is_told_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert moving.main(["kitti", str(tmp_path / "nowhere"), "06"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_a_clip_without_poses_is_refused() -> None:
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[5]
    with pytest.raises(BadData, match="has no poses"):
        moving.measure([type(clip)(clip.name, clip.frames, clip.times_s, clip.intrinsics)], {})

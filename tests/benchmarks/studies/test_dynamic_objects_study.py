"""The table of dynamic objects: its counts, means and shares are those of the rows; mistakes get
one sentence.
"""

import numpy as np

from geovp_benchmarks.studies import dynamic_objects
from geovp_benchmarks.studies.dynamic_objects import ClipScores
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.metrics.image import Psnr


def row(
    clip: str,
    num_objects: int,
    pixels: tuple[int, int, int],
    psnr: tuple[float, float],
    cpu_s: float,
) -> ClipScores:
    scores = {"psnr": np.array(psnr), "psnr@moving": np.array([np.nan, np.nan])}
    return ClipScores(clip, num_objects, *pixels, scores, np.array([1.0, 1.0 + cpu_s]))


ROWS = [
    row("a", 2, (100, 80, 60), (20.0, 21.0), 0.03),
    row("b", 0, (50, 0, 0), (10.0, 10.0), 0.01),
    row("c", 0, (0, 0, 0), (12.0, 12.0), 0.02),
]


def test_means_are_over_clips_with_objects_and_over_all() -> None:
    lines = list(dynamic_objects.table(ROWS))
    assert lines[1].split() == [
        "a",
        "2",
        "0.50",
        "20.000",
        "->",
        "21.000",
        "nan",
        "->",
        "nan",
    ]  # 60 / (100 + 80 - 60)
    assert lines[2].split()[:8] == ["mean", "of", "1", "clips", "2", "0.50", "20.000", "->"]
    # 60 / (150 + 80 - 60) = 0.35; (20 + 10 + 12) / 3 = 14
    assert lines[3].split()[:9] == [
        "mean",
        "of",
        "3",
        "clips",
        "2",
        "0.35",
        "14.000",
        "->",
        "14.333",
    ]
    # 60 of 80 found pixels are right, 60 of 150 true ones are found.
    assert lines[4] == "moving pixels of the last frame: precision 0.75, recall 0.40, IoU 0.35"
    assert lines[5] == "dynamic objects cost 20 ms of processor time a clip (median)"


def test_without_true_masks_there_is_no_overlap() -> None:
    lines = list(dynamic_objects.table([row("d", 1, (0, 30, 0), (20.0, 19.0), 0.0)]))
    assert lines[1].split()[:3] == ["d", "1", "-"]
    assert not any("precision" in line for line in lines)


def test_a_car_of_the_synthetic_street_is_measured() -> None:
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[5]
    assert clip.moving is not None
    found = dynamic_objects.measure(clip, {"psnr": Psnr()})
    assert (found.clip, found.num_objects, found.moving_px) == (
        "seed0-accelerate/000",
        1,
        clip.moving[9].sum(),
    )
    assert found.overlap_px <= min(found.moving_px, found.detected_px)
    assert found.overlap_px > 0.65 * found.detected_px
    assert set(found.scores) == {"psnr", "psnr@moving"}
    assert found.scores["psnr@moving"].shape == (2,)
    assert (found.cpu_s > 0).all()


def test_seeds_and_sequences_become_data_sets() -> None:
    assert dynamic_objects.dataset_specs("synthetic", ["3", "4"]) == [
        {"name": "synthetic", "seed": 3, "num_clips": 8},
        {"name": "synthetic", "seed": 4, "num_clips": 8},
    ]
    specs = dynamic_objects.dataset_specs("kitti", ["data", "03[0:180)", "00[600:725)", "raw0095"])
    assert [spec["sequences"] for spec in specs] == [["03[0:180)"], ["00[600:725)"], ["raw0095"]]
    assert [spec["size_px"] for spec in specs] == [[256, 256], [128, 128], [256, 256]]

"""Measurements of speed: they run the real components, and compare like with like."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from performance import __main__ as page
from performance import clip, libraries, scoring, splat


def test_the_stages_of_a_clip_give_the_prediction_of_the_predictor() -> None:
    refined, renderer = clip.parts("crop")
    assert (refined, renderer) == (Refined(Chained()), DepthFusion())
    context, _ = Synthetic(num_clips=1, size_px=(96, 96))[0].split(
        10, refined.needs | renderer.needs
    )
    views, seconds = clip.one_clip(context)
    expected = GeometricPredictor(refined, renderer).predict(context)
    np.testing.assert_allclose(views.frames.astype(int), expected.frames[0], atol=1)
    assert len(seconds) == len(clip.STAGES)
    assert all(clock > 0 and processor >= 0 for clock, processor in seconds)


def test_medians_of_stages_and_of_their_sum() -> None:
    """Three rounds follow the warm-up: stages take 0.1, 0.1 and 0.3 s, sums 0.7, 0.7 and 2.1 s."""
    taken_s = np.full((4, 7, 2), 0.1)
    taken_s[0] = 1.5
    taken_s[3, :, 0] = 0.3
    taken_s[..., 1] = 0.2
    lines = clip.lines(taken_s)
    assert [float(word) for word in lines[1].split() if word.isdigit()] == [100, 200]
    assert [float(word) for word in lines[8].split() if word.isdigit()] == [700, 1400]


@pytest.mark.parametrize(
    "problem",
    [
        libraries.triangulation,
        libraries.resection,
        libraries.relative_pose,
        libraries.local_bundle_adjustment,
    ],
)
def test_our_solvers_are_about_as_accurate_as_those_of_libraries(
    problem: Callable[[libraries.Scene], libraries.Comparison],
) -> None:
    comparison = problem(libraries.Scene.random())
    ours, library = comparison.error(comparison.ours()), comparison.error(comparison.library())
    assert ours < 1.5 * library


def test_all_renderers_draw_the_same_street() -> None:
    scene, poses = splat.street()
    surface, dots, open3d = (draw(scene, poses[:2]) for draw in splat.RENDERERS.values())
    same = np.abs(dots - open3d) <= 0.01 * open3d
    assert same[open3d > 0].mean() > 0.98  # a point between two pixels may be rounded either way
    both = (surface > 0) & (dots > 0)
    assert both.mean() > 0.7
    assert np.median(np.abs(surface - dots)[both] / surface[both]) < 0.02
    assert (surface > 0).mean() > (dots > 0).mean()  # squares leave no gaps


def test_points_per_second_are_points_times_views_by_median_time() -> None:
    """1000 points, 20 views, 0.2 s."""
    lines = splat.lines({"splat": np.array([[0.5, 0.6], [0.1, 0.3], [0.2, 0.4]])}, 1000)
    assert lines[1] == "splat: 0.1 million points/s, 200 ms, of the processor 400 ms"


def test_metrics_are_timed_next_to_scikit_image(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "SIZE_PX", 32)
    scoring.main(["1"])
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["psnr", "ssim", "skimage's ssim", "lpips"]
    a, b = np.random.default_rng(0).integers(0, 256, (2, 1, 40, 40, 3), dtype=np.uint8)
    expected = structural_similarity(
        a[0], b[0], channel_axis=-1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert scoring.skimage_ssim(a, b)[0] == pytest.approx(expected)


def test_the_page_holds_all_measurements_and_its_command_without_private_paths(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls: list[Sequence[str]] = []

    def measurement(arguments: Sequence[str]) -> str:
        calls.append(arguments)
        print(f"measured {len(calls)}")
        return "first clips"

    for module in (page.clip, page.scoring, page.splat, page.libraries):
        monkeypatch.setattr(module, "main", measurement)
    monkeypatch.setattr(page, "first_clips", measurement)
    page.main(["3", "--kitti", "/data/kitti", "03[0:180)", "--out", str(tmp_path / "speed.md")])
    text = (tmp_path / "speed.md").read_text()
    assert (
        "PYTHONPATH=benchmarks python -m performance 3 --kitti path/to/kitti '03[0:180)'\n" in text
    )
    assert "/data" not in text
    assert calls[:2] == [
        ["3", "--kitti", "/data/kitti", "03[0:180)"],
        ["3", "--full", "--kitti", "/data/kitti", "03[0:180)"],
    ]
    assert text.count("## ") == len(calls) == 6


def test_a_new_process_finds_the_package_from_any_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    lines = page.first_clips(["--help"]).splitlines()
    assert [line.partition(":")[0] for line in lines] == ["after installation", "compiled before"]


@pytest.mark.parametrize(
    ("main", "arguments"),
    [
        (splat.main, ["often"]),
        (scoring.main, ["0"]),
        (clip.main, ["3", "--kitti", "root"]),
    ],
)
def test_bad_arguments_exit_with_code_2(
    main: Callable[[Sequence[str]], None], arguments: list[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(arguments)

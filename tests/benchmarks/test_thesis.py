"""The thesis's table: its names, its order, its numbers apart from ours."""

from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.results.store import Part, Results
from geovp_benchmarks.tables import thesis
from tests.benchmarks.made import scores, write_protocol, write_row

VO = {"name": "chained", "odometry": {"name": "monocular"}}
GT = {"name": "ground-truth"}
METHODS: dict[
    str, tuple[dict[str, Any], int, float]
] = {  # name: (components, samples, PSNR of the first sample)
    "copy-last": ({"predictor": {"name": "copy-last"}}, 1, 14.0),
    "crossed": ({"pose_source": GT, "renderer": {"name": "synsin"}}, 1, 13.0),
    "flat": (
        {
            "predictor": {
                "pose_source": {"name": "planar", "source": GT},
                "renderer": {"name": "synsin"},
            }
        },
        1,
        12.5,
    ),
    "vo": (
        {
            "predictor": {
                "name": "geometric",
                "pose_source": VO,
                "renderer": {"name": "depth-fusion"},
            }
        },
        1,
        17.0,
    ),
    "deep": (
        {"predictor": {"pose_source": {"name": "deepvo"}, "renderer": {"name": "synsin"}}},
        1,
        11.0,
    ),
    "svg-4": ({"predictor": {"name": "svg"}}, 4, 12.0),
    "svg-1": ({"predictor": {"name": "svg"}}, 1, 12.0),
}


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """Two clips; each sample has 1 dB more than the one before it, and an LPIPS of a hundredth of
    its PSNR.
    """
    results = Results(tmp_path / "thesis")
    protocol = {
        "name": "thesis",
        "dataset_name": "kitti",
        "dataset": {"name": "kitti", "split": "test"},
        "metrics": {},
    }
    write_protocol(results, [*METHODS, "slamp-1"], "xy", **protocol, size_px=[256, 256])
    for name, (components, samples, psnr) in METHODS.items():
        lines = [
            (clip, sample, 1, metric, (psnr + sample + offset) * scale)
            for clip, offset in (("x", 0.0), ("y", 0.5))
            for sample in range(samples)
            for metric, scale in (("psnr", 1.0), ("lpips", 0.01))
        ]
        privileged_inputs = ["CAMERA_HEIGHT"] if name == "vo" else []
        write_row(
            results,
            name,
            lines,
            components=components,
            num_samples=samples,
            privileged_inputs=privileged_inputs,
        )
    absent = {"components": {"predictor": {"name": "slamp"}}, "fingerprint": ""}
    write_row(results, "slamp-1", **absent, status="skipped", reason="no weights")
    return results


def rows_of(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[entry.strip() for entry in line.strip("|").split("|")] for line in lines]


def blocks(results: Results) -> tuple[str, str]:
    ours, heading, published = thesis.markdown(results).partition("## Published, not measured here")
    assert heading
    return ours, published


def test_rows_have_the_thesiss_names_and_order_and_ours_come_after(results: Results) -> None:
    ours = rows_of(blocks(results)[0])
    assert ours[0] == ["Models", "PSNR (↑)", "SSIM (↑)", "LPIPS (↓)"]
    names = [
        "SVG - 1 Sample",
        "SVG - 4 Samples",
        "Ours",
        "GT 2D Pose + SynSin",
        "GT 3D Pose + SynSin",
    ]
    assert [row[0] for row in ours[2:]] == [*names, "copy-last", "vo [h]"]


def test_samples_are_scored_by_the_best_of_each_column(results: Results) -> None:
    rows = {row[0]: row[1:] for row in rows_of(blocks(results)[0])}
    # Clips have 12.0 and 12.5: mean 12.25 (LPIPS .1225), s = 0.354, / sqrt(2) = 0.25. The best PSNR
    # of four is 3 dB
    # above, the best LPIPS is the first sample's.
    assert rows["SVG - 1 Sample"] == ["12.250 ± 0.250", "-", "0.122 ± 0.003"]
    assert rows["SVG - 4 Samples"] == ["15.250 ± 0.250", "-", "0.122 ± 0.003"]
    assert rows["vo [h]"][0] == "**17.250 ± 0.250**"
    assert rows["Ours"][2] == "**0.113 ± 0.003**"


def test_published_numbers_stand_apart_with_their_source(results: Results) -> None:
    ours, published = blocks(results)
    rows = rows_of(published)
    assert len(rows) == 2 + 9
    assert rows[5] == [
        "SRVP - 100 Samples",
        "**13.504 ± 0.070**",
        "**0.433 ± 0.003**",
        "0.698 ± 0.003",
    ]
    assert rows[-1] == ["GT 3D Pose + SynSin", "12.897 ± 0.107", "0.393 ± 0.004", "0.380 ± 0.006"]
    assert "Table 4.1 of the thesis" in published
    assert "13.504" not in ours


MARKDOWN = """
| Models              | PSNR (↑)           | SSIM (↑)          | LPIPS (↓)         |
| ------------------- | ------------------ | ----------------- | ----------------- |
| SVG - 1 Sample      | 12.244 ± 0.076     | 0.396 ± 0.003     | 0.663 ± 0.004     |
| SVG - 100 Samples   | 12.268 ± 0.076     | 0.397 ± 0.003     | 0.661 ± 0.004     |
| SRVP - 1 Sample     | 12.482 ± 0.068     | 0.407 ± 0.003     | 0.727 ± 0.003     |
| SRVP - 100 Samples  | **13.504 ± 0.070** | **0.433 ± 0.003** | 0.698 ± 0.003     |
| SLAMP - 1 Sample    | 12.539 ± 0.080     | 0.402 ± 0.003     | 0.595 ± 0.004     |
| SLAMP - 100 Samples | 12.714 ± 0.082     | 0.408 ± 0.003     | 0.588 ± 0.004     |
| Ours                | 11.301 ± 0.091     | 0.337 ± 0.004     | **0.452 ± 0.006** |
| GT 2D Pose + SynSin | 12.727 ± 0.108     | 0.386 ± 0.004     | 0.380 ± 0.006     |
| GT 3D Pose + SynSin | 12.897 ± 0.107     | 0.393 ± 0.004     | 0.380 ± 0.006     |
"""  # the thesis's page, its bold cells included
LATEX = r"""
\begin{tabular}{lccc}
\toprule
Models & PSNR ($\uparrow$) & SSIM ($\uparrow$) & LPIPS ($\downarrow$) \\
\midrule
SVG - 1 Sample & 12.244 $\pm$ 0.076 & 0.396 $\pm$ 0.003 & 0.663 $\pm$ 0.004 \\
SVG - 100 Samples & 12.268 $\pm$ 0.076 & 0.397 $\pm$ 0.003 & 0.661 $\pm$ 0.004 \\
SRVP - 1 Sample & 12.482 $\pm$ 0.068 & 0.407 $\pm$ 0.003 & 0.727 $\pm$ 0.003 \\
SRVP - 100 Samples & \textbf{13.504 $\pm$ 0.070} & \textbf{0.433 $\pm$ 0.003} & 0.698 $\pm$ 0.003 \\
SLAMP - 1 Sample & 12.539 $\pm$ 0.080 & 0.402 $\pm$ 0.003 & 0.595 $\pm$ 0.004 \\
SLAMP - 100 Samples & 12.714 $\pm$ 0.082 & 0.408 $\pm$ 0.003 & 0.588 $\pm$ 0.004 \\
Ours & 11.301 $\pm$ 0.091 & 0.337 $\pm$ 0.004 & \textbf{0.452 $\pm$ 0.006} \\
GT 2D Pose + SynSin & 12.727 $\pm$ 0.108 & 0.386 $\pm$ 0.004 & 0.380 $\pm$ 0.006 \\
GT 3D Pose + SynSin & 12.897 $\pm$ 0.107 & 0.393 $\pm$ 0.004 & 0.380 $\pm$ 0.006 \\
\bottomrule
\end{tabular}
"""


def test_the_published_block_has_the_thesiss_bold_cells_and_no_others(results: Results) -> None:
    assert MARKDOWN in blocks(results)[1]
    ours, published = thesis.latex(results).split(r"\caption{Published, not measured here.}")
    assert LATEX in published
    assert "Table 4.1 of the thesis" in published
    assert r"SVG - 4 Samples & 15.250 $\pm$ 0.250 & - & 0.122 $\pm$ 0.003 \\" in ours
    assert (
        published.count(r"\begin") == published.count(r"\end") - 1 == 1
    )  # its table begins above the caption


def test_true_poses_never_compete_but_the_cameras_height_does(results: Results) -> None:
    for name in ("crossed", "flat"):
        method = results.method(name)
        assert method is not None
        results.write_method(
            name, {**method.record, "privileged_inputs": ["PAST_POSES", "FUTURE_POSES"]}
        )
    best = [
        ("x", 0, 1, "psnr", 40.0),
        ("x", 0, 1, "lpips", 0.01),
        ("y", 0, 1, "psnr", 41.0),
        ("y", 0, 1, "lpips", 0.02),
    ]
    results.write_part("crossed", scores(best), Part(("x", "y"), "f", {}, {}, 0.0))
    rows = {row[0]: row[1:] for row in rows_of(blocks(results)[0])}
    assert rows["GT 3D Pose + SynSin"] == [
        "40.500 ± 0.500",
        "-",
        "0.015 ± 0.005",
    ]  # the best by far, not in bold
    assert rows["vo [h]"][0] == "**17.250 ± 0.250**"
    assert rows["Ours"][2] == "**0.113 ± 0.003**"


@pytest.mark.parametrize("name", ["thesis", "thesis-colour"])
def test_the_matrices_that_come_with_it_have_every_row_of_the_thesis(name: str) -> None:
    own = schema.read(Path(thesis.__file__).parents[1] / "configs" / f"{name}.toml")
    samples = {(own.predictors[str(plan.predictor)].name, plan.num_samples) for plan in own.methods}
    assert {(name, count) for name in ("svg", "srvp", "slamp") for count in (1, 100)} <= samples
    sources = [
        entry.spec["pose_source"]["name"]
        for entry in own.predictors.values()
        if "pose_source" in entry.spec
    ]
    refined = ["refined"] * 4  # the rows of fusion without any true pose
    assert sources[:7] == ["deepvo", "planar", "ground-truth", *refined]
    crossed = {
        f"{poses}+{renderer}"
        for poses in ("gt-3d", "gt-3d-registered")
        for renderer in ("fusion", "ground-far-plane")
    }
    assert crossed | {"gt-3d-registered+synsin-small", "gt-2d-refined+synsin-small"} <= set(
        own.predictors
    )
    drawn = [
        own.predictors[f"vo+{forecast}+fusion-10"].num_samples
        for forecast in ("ctrv", "prior", "representative")
    ]
    assert drawn == [10, 10, 10]
    assert "copy-last" in own.predictors

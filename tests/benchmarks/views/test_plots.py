"""Figures show the stored scores, and can be told apart in colour, in grey and by name."""

import logging
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from geovp.drawing.page import Page
from geovp.drawing.strip import draw_strip
from geovp_benchmarks import plots
from geovp_benchmarks.plots import Options, clips
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray
from tests.benchmarks.made import write_protocol, write_row
from tests.benchmarks.views.conftest import CLIPS, KEPT

CLIP = "01-a-b-0-9-x-y"


def draw(folder: Path, options: Options) -> dict[str, Page]:
    return {page.stem: page for page, _ in plots.write_all(Results(folder), options)}


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return draw(folder, Options())


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    """Return the results folder without figures."""
    return Path(shutil.copytree(folder, tmp_path / "r", ignore=shutil.ignore_patterns("plots")))


def texts(page: Page) -> str:
    return "\n".join(text.get_text() for text in page.figure.findobj(Text))  # type: ignore[arg-type]


def legend(page: Page) -> list[str]:
    return [text.get_text().replace("\n", " ") for text in page.figure.legends[0].get_texts()]


def lines(page: Page) -> list[FloatArray]:
    return [np.asarray(line.get_ydata(), float) for line in page.figure.axes[0].lines]


class TestFiles:
    def test_a_figure_per_metric_and_two_per_kept_clip(
        self, folder: Path, pages: dict[str, Page]
    ) -> None:
        names = ["horizon-psnr", "horizon-translation-error", f"strip-{CLIP}", f"paths-{CLIP}"]
        # final-gap has a value at the last step alone: no curve
        assert pages.keys() == {*names, "horizon-psnr-covered"}
        files = {path.name for path in (folder / "plots").iterdir()}
        both = {f"{name}.{kind}" for name in names for kind in ("png", "svg")}
        assert files == {*both, "horizon-psnr-covered.svg"}

    def test_outdated_figures_go_and_foreign_files_stay(
        self, copied: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        shutil.rmtree(copied / "clips")
        (copied / "plots").mkdir()
        old, foreign = copied / "plots" / "horizon-ssim-2.png", copied / "plots" / "mine.png"
        old.touch()
        foreign.touch()
        caplog.set_level(logging.DEBUG, "geovp.steps")
        list(plots.write_all(Results(copied), Options()))
        assert not old.exists()
        assert foreign.exists()
        assert caplog.messages == [f"{done} of 4" for done in range(1, 5)]  # metrics


class TestHorizon:
    def test_means_and_bars_are_the_statistics(self, pages: dict[str, Page]) -> None:
        """PSNR of three clips at step 3 is 17, 18, 19: mean 18, with the interval of tables."""
        page = pages["horizon-psnr"]
        np.testing.assert_allclose(lines(page)[0], 21.0 - np.arange(1, 7))
        bars = [bar for group in page.figure.axes[0].collections for bar in group.get_segments()]
        (_, low), (_, high) = bars[0]
        expected = Intervals().interval(np.array([17.0, 18.0, 19.0]), CLIPS)
        np.testing.assert_allclose([low, high], [expected.low, expected.high])
        assert expected.low < 18 - 1 / np.sqrt(3)  # wider than one standard error
        bars = [bar for bar in bars if len(bar)]
        assert len(bars) == 2 * 4  # in the middle and at the end; _vo has too few clips
        lefts = [bar[0][0] for bar in bars[::2]]
        assert sorted(set(lefts)) == lefts  # beside one another

    def test_samples_give_a_mean_and_a_best_line(self, pages: dict[str, Page]) -> None:
        """Samples 0, 1, 2 score 0, 1, 2 dB more than a method with a single one."""
        page = pages["horizon-psnr"]
        assert legend(page)[2:4] == ["kalman + far, mean of 3", "kalman + far, best of 3"]
        single, _, mean, best, _ = lines(page)
        np.testing.assert_allclose(mean - single, 1.0)
        np.testing.assert_allclose(best - single, 2.0)

    def test_a_pose_metric_has_one_line_per_pose_source(self, pages: dict[str, Page]) -> None:
        words = legend(pages["horizon-translation-error"])
        assert words[0] == "gt"
        assert not [word for word in words if "far" in word or "copy-last" in word]

    def test_steps_without_a_value_end_the_line(self, pages: dict[str, Page]) -> None:
        page = pages["horizon-psnr-covered"]
        np.testing.assert_allclose(lines(page)[0], [29, 28, 27, 26, np.nan, np.nan])
        assert "copy-last" not in legend(page)

    def test_differences_are_paired(self, copied: Path) -> None:
        """All have the scores of copy-last, but samples 1 and 2 are 1 and 2 dB better.

        Clips a and b alone are common with _vo. Figures without poses of copy-last are left out.
        """
        against = draw(copied, Options(against="copy-last"))
        assert against.keys() == {"against-horizon-psnr"}
        label = against["against-horizon-psnr"].figure.axes[0].get_ylabel()
        assert " ".join(label.split()) == "difference in PSNR (dB) ↑"
        page = against["against-horizon-psnr"]
        labels = [label.partition(" (")[0] for label in legend(page)]
        gains = dict(zip(labels, (line[-1] for line in lines(page)[:4]), strict=True))
        expected = {"gt + far": 0, "_vo + far": 0}
        expected |= {"kalman + far, mean of 3": 1, "kalman + far, best of 3": 2}
        assert gains == pytest.approx(expected)
        bars = [bar for group in page.figure.axes[0].collections for bar in group.get_segments()]
        np.testing.assert_allclose(bars[-1][:, 1], 2.0)  # the same gain on each clip

    @pytest.mark.parametrize(("other_s", "mean_s"), [(0.1039, 0.10365), (0.12, None)])
    def test_seconds_need_clips_of_one_rate(
        self, tmp_path: Path, other_s: float, mean_s: float | None
    ) -> None:
        """Two drives of KITTI, and two cameras."""
        results = Results(tmp_path)
        write_protocol(results, ["m"], "xy")
        rows = [(clip, 0, 1, "psnr", 20.0) for clip in "xy"]
        write_row(results, "m", rows, {"x": {"interval_s": 0.1034}, "y": {"interval_s": other_s}})
        assert Material(results, Options()).step_s == (mean_s and pytest.approx(mean_s))

    @pytest.mark.parametrize("width_in", [None, 2.5, 3.3])
    def test_the_legend_lies_inside_the_figure(self, copied: Path, width_in: float | None) -> None:
        shutil.rmtree(copied / "clips")
        for page in draw(copied, Options(width_in=width_in)).values():
            page.figure.canvas.draw()
            box, whole = page.figure.legends[0].get_window_extent(), page.figure.bbox
            assert whole.x0 <= box.x0 < box.x1 <= whole.x1
            assert whole.y0 <= box.y0 < box.y1 <= page.figure.axes[0].get_window_extent().y0

    def test_long_words_on_the_axis_are_wrapped(
        self, copied: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The axis of a figure of 3.3 in has room for 23 letters."""
        monkeypatch.setattr(stored_facts, "title", lambda metric: "PSNR, disoccluded pixels")
        [page] = draw(copied, Options(width_in=3.3, against="copy-last")).values()
        (axes,) = page.figure.axes
        label = axes.get_ylabel().replace("\N{NO-BREAK SPACE}", " ").splitlines()
        assert label == ["difference in PSNR,", "disoccluded", "pixels (dB) ↑"]

    def test_few_methods_with_copy_last_and_the_best_without_truth(self, copied: Path) -> None:
        """Kalman is 1 dB better than the others and has no privileged input."""
        page = draw(copied, Options(max_methods=2, width_in=3.0))["horizon-psnr"]
        assert [label.split(",")[0] for label in legend(page)] == ["kalman + far"] * 2 + [
            "copy-last"
        ]
        page = draw(copied, Options(max_methods=2))["horizon-psnr"]
        assert "2 of 4 methods" in texts(page).replace("\n", " ")


class TestStrips:
    def test_rows_hold_the_frames_and_are_named_and_scored(self, pages: dict[str, Page]) -> None:
        """Truth is 202 + step, predictions 10 * row + step; 16.5 dB is the mean of 19 .. 14."""
        axes = pages[f"strip-{CLIP}"].figure.axes
        assert [panel.get_title(loc="left") for panel in axes] == [
            "ground truth",
            "gt + far: PSNR 16.5 dB",
            "_vo + far: PSNR 16.5 dB",
            "kalman + far: sample 1 of 3, PSNR 16.5 dB",
            "copy-last: PSNR 16.5 dB",
        ]
        for first, panel in zip((202, 0, 10, 20, 30), axes, strict=True):
            sheet = np.asarray(panel.images[0].get_array())
            np.testing.assert_array_equal(sheet[8, 8::17, 0], first + np.arange(1, 7))
        heads = [label.get_text() for label in axes[-1].get_xticklabels()]
        assert heads[4] == "+5, 0.5 s"

    def test_30_frames_per_second_are_labelled_in_hundredths(self) -> None:
        page = Page("strip")
        draw_strip(page, {"row": np.zeros((6, 4, 4, 3), np.uint8)}, np.arange(1, 7) / 30, 6.0)
        heads = [label.get_text() for label in page.figure.axes[0].get_xticklabels()]
        assert heads[:3] == ["+1, 0.03 s", "+2, 0.07 s", "+3, 0.10 s"]

    def test_a_kept_clip_of_another_protocol_has_none(self, copied: Path) -> None:
        results = Results(copied)
        results.write_protocol({**results.protocol(), "clips": ["b", "c"]})
        assert {name.partition("-")[0] for name in draw(copied, Options())} == {"horizon"}


class TestPaths:
    def test_paths_are_drawn_true_to_scale(self, pages: dict[str, Page]) -> None:
        """1 m a step for six steps; 1.2 m a step; scale-free ones get the true past's length."""
        page = pages[f"paths-{CLIP}"]
        axes = page.figure.axes[0]
        assert axes.get_aspect() == 1.0
        names = ["past", "ground truth", "gt", "_vo (scaled to the true path)", "kalman"]
        assert legend(page) == [*names, "last observed camera"]
        x = [np.asarray(line.get_xdata(), float) for line in axes.lines]
        ends = [round(float(path[-1]), 6) for path in x if len(path) == 7]
        assert ends == [6.0, 6.0, 6.0, 7.2, 7.2, 7.2]  # each of three samples has its line

    def test_forward_is_z_and_left_is_minus_x_of_the_last_camera(self) -> None:
        """The camera looks along the world's x axis; then 2 m ahead and 1 m to its right."""
        yaw = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
        poses = se3.compose(yaw, np.array([[5.0, 0, 0], [7.0, 0, -1.0]]))
        np.testing.assert_allclose(clips._from_above(poses, 0), [[0, 0], [2, -1]], atol=1e-12)

    def test_a_clip_without_poses_has_no_paths(self, copied: Path) -> None:
        results = Results(copied)
        results.clips().write(KEPT, replace(results.clips().read(KEPT), trajectory=None))
        kinds = {name.partition("-")[0] for name in draw(copied, Options())}
        assert kinds == {"horizon", "strip"}


class TestPaper:
    """`geovp plot --format pdf --width 3.3in`."""

    def test_a_pdf_has_the_width_legible_text_and_no_type_3_font(self, copied: Path) -> None:
        """72 points an inch."""
        for page in draw(copied, Options(format="pdf", width_in=3.3)).values():
            content = (copied / "plots" / f"{page.stem}.pdf").read_bytes()
            (width_pt,) = re.findall(rb"MediaBox \[ ?0 0 ([\d.]+)", content)
            assert float(width_pt) == pytest.approx(3.3 * 72, abs=0.1)
            assert b"/Type3" not in content
            assert b"/FontFile2" in content
            shown = [text for text in page.figure.findobj(Text) if text.get_text()]  # type: ignore[arg-type]
            assert min(text.get_fontsize() for text in shown) >= 6
            assert page.title not in texts(page).split("\n")

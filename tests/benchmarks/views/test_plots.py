"""Figures say what the rows say, look the same every time, and can be told apart in colour, in grey
and by name.
"""

import io
import itertools
import re
import shutil
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from geovp_benchmarks import plots
from geovp_benchmarks.analysis import intervals
from geovp_benchmarks.plots import Page, curves, strips, style, trajectories
from geovp_benchmarks.plots.layout import width_in
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables.table_model import Choice
from geovp_classic.geometry import se3

SIDE = 16
CLIP = "01-a-b-0-9-x-y"
HEADING = style.Heading("t", "s")


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return {page.name: page for page in plots.figures(Results(folder))}


@pytest.fixture(scope="module")
def written(folder: Path) -> list[Path]:
    return [path for _, files in plots.write_all(Results(folder)) for path in files]


@pytest.fixture(scope="module")
def narrow(folder: Path) -> dict[str, Page]:
    return {
        page.kind: page
        for page in plots.figures(Results(folder), layout=plots.Layout(("pdf",), 3.3, False))
    }


def texts(figure: Figure) -> str:
    return "\n".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))  # type: ignore[attr-defined]


class TestWriteAll:
    def test_one_page_per_metric_and_per_kept_clip(self, written: list[Path]) -> None:
        names = [
            "horizon-psnr",
            "horizon-translation-error",
            "samples-psnr",
            "samples-translation-error",
        ]
        names += ["strip-01-a-b-0-9-x-y", "paths-01-a-b-0-9-x-y"]
        both = {f"{name}.{kind}" for name in names for kind in ("png", "svg")}
        assert not any(
            "final-gap" in path.name for path in written
        )  # known at the last step alone: no curve
        assert {path.name for path in written} == both | {
            "inpainted-01-a-b-0-9-x-y.png",
            "horizon-psnr-covered.svg",
        }
        assert all(path.stat().st_size > 0 for path in written)

    def test_words_are_words_in_the_svg(self, folder: Path, written: list[Path]) -> None:
        svg = (folder / "plots" / "horizon-psnr.svg").read_text()
        for word in (
            "gt + far",
            "_vo + far (only 2 of 3 clips)",
            "kalman + far, best of 3",
            "copy-last",
            "0.5 s",
        ):
            assert word in svg
        assert "PSNR (dB)    ↑ higher is better" in svg
        assert "mean of 3 clips, with 95 % intervals" in svg
        assert (
            "↓ lower is better" in (folder / "plots" / "horizon-translation-error.svg").read_text()
        )
        assert "a/b[0:9) &lt;x&gt; &amp; $y" in (folder / "plots" / f"strip-{CLIP}.svg").read_text()

    def test_chosen_methods_and_metrics_alone_are_drawn(self, folder: Path) -> None:
        choice = Choice(("copy-last",), ("psnr",))
        (page,) = (
            page for page in plots.figures(Results(folder), choice=choice) if page.kind == "horizon"
        )
        assert page.subject == "psnr"
        (line,) = (line for line in page.figure.axes[0].lines if len(line.get_xdata()) == 6)
        assert "copy-last" in {text.get_text() for text in page.figure.findobj(Text)}
        np.testing.assert_array_equal(line.get_xdata(), np.arange(1, 7))

    def test_outdated_figures_go_and_foreign_files_stay(self, folder: Path, tmp_path: Path) -> None:
        shutil.copytree(
            folder,
            tmp_path / "r",
            ignore=lambda at, names: {"predictions", "clips", "plots"} & {*names},
        )
        (tmp_path / "r" / "plots").mkdir()
        old, foreign = (
            tmp_path / "r" / "plots" / "horizon-ssim-2.png",
            tmp_path / "r" / "plots" / "mine.png",
        )
        old.touch()
        foreign.touch()
        told: list[tuple[int, int]] = []
        list(
            plots.write_all(Results(tmp_path / "r"), lambda done, total: told.append((done, total)))
        )
        assert not old.exists()
        assert foreign.exists()
        assert told == [
            (done, 5) for done in range(1, 6)
        ]  # three metrics over horizon, two over samples


class TestCurves:
    def test_means_and_bars_are_the_statistics(self, pages: dict[str, Page]) -> None:
        """PSNR of three clips at step 3 is 17, 18, 19: mean 18, with the interval of tables."""
        axes = pages["horizon-psnr"].figure.axes[0]
        line, bars = axes.lines[0], axes.collections[0]
        np.testing.assert_allclose(line.get_ydata(), 21.0 - np.arange(1, 7))
        (_, low), (_, high) = bars.get_segments()[0]
        expected = intervals.interval(np.array([17.0, 18.0, 19.0]), np.array(["a", "", ""]))
        np.testing.assert_allclose([low, high], [expected.low, expected.high])
        assert expected.low < 18 - 1 / np.sqrt(3)  # wider than one standard error
        lefts = [bars.get_segments()[0][0][0] for bars in axes.collections]
        assert sorted(set(lefts)) == lefts  # beside one another
        assert all(len(bars.get_segments()) == 2 for bars in axes.collections)

    def test_equal_lines_show_beside_each_other(self) -> None:
        line = curves.Curve.of("a", np.ones((4, 6)), ["x"] * 4, (0, 2), style.GROUND_TRUTH)
        labels = curves.AxisLabels("t", "", None, None)
        figure = curves.draw([line, replace(line, label="b")], labels, HEADING, style.Layout())
        below, above = figure.axes[0].lines
        assert below.get_linewidth() > above.get_linewidth()

    def test_at_most_twelve_lines_and_a_legend_inside_the_figure(
        self, pages: dict[str, Page], folder: Path
    ) -> None:
        layout = style.Layout(max_lines=2, width_in=3.0)
        (page,) = (
            page
            for page in plots.figures(Results(folder), layout=layout)
            if page.name == "horizon-psnr"
        )
        assert "best 2 of 5 lines" in texts(page.figure).replace("\n", " ")
        for drawn in (page, pages["horizon-psnr"]):
            plots.rendered(drawn, "png")
            figure = drawn.figure
            (legend,) = figure.legends
            box, whole = legend.get_window_extent(), figure.bbox
            assert whole.x0 <= box.x0 < box.x1 <= whole.x1
            assert whole.y0 <= box.y0 < box.y1 <= figure.axes[0].get_window_extent().y0

    def test_many_lines_have_no_intervals(self, folder: Path) -> None:
        layout = style.Layout(max_intervals=4)  # for five lines
        (page,) = (
            page
            for page in plots.figures(Results(folder), layout=layout)
            if page.name == "horizon-psnr"
        )
        axes = page.figure.axes[0]
        assert len(axes.collections) == 0
        np.testing.assert_allclose(axes.lines[0].get_ydata(), 21.0 - np.arange(1, 7))
        assert "intervals" not in texts(page.figure)

    def test_samples_give_a_mean_and_a_best_line(self, pages: dict[str, Page]) -> None:
        """Samples 0, 1, 2 score 0, 1, 2 dB more: their mean is 1 dB above a single guess, the best
        2 dB.
        """
        lines = pages["horizon-psnr"].figure.axes[0].lines
        single, mean, best = (np.asarray(lines[i].get_ydata()) for i in (0, 2, 3))
        np.testing.assert_allclose(mean - single, 1.0)
        np.testing.assert_allclose(best - single, 2.0)

    def test_the_best_of_k_has_a_line_for_every_method_with_samples(
        self, pages: dict[str, Page]
    ) -> None:
        """The first sample has 21 - step, 17.5 dB on average; the others 1 and 2 dB more: of pairs
        (1 + 2 + 2) / 3.
        """
        axes = pages["samples-psnr"].figure.axes[0]
        line = axes.lines[0]
        np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3])
        np.testing.assert_allclose(line.get_ydata(), 17.5 + np.array([1.0, 5 / 3, 2.0]))
        assert axes.get_xlabel() == "number of samples k"
        assert "over clips" in texts(pages["samples-psnr"].figure)
        assert "gt" not in texts(pages["samples-psnr"].figure).split()

    def test_a_pose_metric_has_one_line_per_pose_source(self, pages: dict[str, Page]) -> None:
        words = texts(pages["horizon-translation-error"].figure)
        assert "gt" in words.split("\n")
        assert "far" not in words
        assert "copy-last" not in words

    def test_steps_without_a_value_end_the_line(self, pages: dict[str, Page]) -> None:
        figure = pages["horizon-psnr-covered"].figure
        np.testing.assert_allclose(
            figure.axes[0].lines[0].get_ydata(), [29, 28, 27, 26, np.nan, np.nan]
        )
        assert "copy-last" not in texts(figure)


@pytest.mark.parametrize(("width", "count"), [(None, 5), (3.3, 3)])
def test_no_words_of_a_strip_lie_upon_others(width: float | None, count: int) -> None:
    frame = np.zeros((64, 64, 3), np.uint8)
    frames = np.stack([frame] * count)
    truth = strips.Truth(frame, frames, range(1, count + 1), np.arange(1.0, count + 1))
    label, note = "vo+prior-refined + ground-far-plane", "PSNR 20 dB\nSSIM 0.5"
    rows = [strips.Strip(label, "" if width else note, frames) for _ in range(3)]
    with matplotlib.style.context(style.SHEET):
        figure = strips.draw(truth, rows, HEADING, style.Layout(width_in=width))
        figure.canvas.draw()
    shown = [text.get_window_extent() for text in figure.axes[0].texts if text.get_text()]
    assert not [(a, b) for a, b in itertools.combinations(shown, 2) if a.overlaps(b)]


class TestStrips:
    def test_the_sheet_holds_the_frames_of_the_horizons(self, pages: dict[str, Page]) -> None:
        """Six future frames: horizons 1 and 5. Truth is 200 + step from 0, the predictions 10 * row
        + horizon.
        """
        (drawn,) = pages[f"strip-{CLIP}"].figure.axes[0].images
        sheet = np.asarray(drawn.get_array())
        gap = 1
        assert sheet.shape == (5 * SIDE + 4 * gap, 3 * SIDE + 2 * gap, 3)
        corner = sheet[:: SIDE + gap, :: SIDE + gap, 0]
        np.testing.assert_array_equal(
            corner, [[202, 203, 207], [255, 1, 5], [255, 11, 15], [255, 21, 25], [255, 31, 35]]
        )

    def test_the_file_shows_them_the_right_way_up(self) -> None:
        """Red above green."""
        frame = np.zeros((300, 300, 3), np.uint8)
        frame[:150, :, 0], frame[150:, :, 1] = 255, 255
        truth = strips.Truth(frame, frame[None], [1], np.array([0.1]))
        strip = strips.Strip("m", "", frame[None])
        figure = strips.draw(truth, [strip], HEADING, style.Layout())
        page = Page("x", "strip", "c", "", figure, ("png",))
        image = np.asarray(Image.open(io.BytesIO(plots.rendered(page, "png"))).convert("RGB"))
        red, green = ((image == colour).all(axis=2) for colour in ([255, 0, 0], [0, 255, 0]))
        assert red.sum() == pytest.approx(green.sum(), rel=0.02)
        assert np.argwhere(red)[0, 0] < np.argwhere(green)[0, 0]

    def test_rows_are_named_and_scored(self, pages: dict[str, Page]) -> None:
        """Sample 0 of the first clip: the mean of 19 .. 14 dB is 16.5 dB."""
        words = texts(pages[f"strip-{CLIP}"].figure)
        for word in (
            "ground truth",
            "last\nobserved",
            "+5\n0.5 s",
            "gt + far",
            "PSNR 16.5 dB",
        ):
            assert word in words
        assert "sample 1 of 3" in words

    def test_only_inpainted_pixels_are_tinted(self) -> None:
        frames = np.full((1, 2, 2, 3), 100, np.uint8)
        covered = np.array([[[True, False], [True, True]]])
        tinted = strips.mark_inpainted(strips.Strip("x", "", frames, covered)).frames
        np.testing.assert_array_equal(tinted[covered], 100)
        np.testing.assert_array_equal(
            tinted[~covered], [(0.35 * 100 + 0.65 * np.array(strips.INPAINTED)).astype(int)]
        )


class TestTrajectories:
    def test_forward_is_z_and_left_is_minus_x_of_the_last_camera(self) -> None:
        """The last camera looks along the world's x axis; 2 m ahead of it and 1 m to its right,
        where z is -1.
        """
        yaw = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
        world_from_last = se3.compose(yaw, np.array([5.0, 0, 0]))
        there = se3.compose(yaw, np.array([7.0, 0, -1]))
        np.testing.assert_allclose(
            trajectories.from_above(there, world_from_last), [2.0, -1.0], atol=1e-12
        )

    def test_paths_are_drawn_true_to_scale(self, pages: dict[str, Page]) -> None:
        """1 m a step for six steps; 1.2 m a step; scale-free ones get the true past's length."""
        figure = pages[f"paths-{CLIP}"].figure
        axes = figure.axes[0]
        assert axes.get_aspect() == 1.0
        (legend,) = figure.legends
        names = [text.get_text() for text in legend.get_texts()]
        assert names == [
            "past",
            "ground truth",
            "gt",
            "_vo (scaled to the true path)",
            "kalman",
            "last observed camera",
        ]
        ends = {
            round(float(np.asarray(line.get_xdata())[-1]), 6)
            for line in axes.lines
            if len(line.get_xdata()) == 7
        }
        assert ends == {6.0, 7.2}

    def test_a_clip_without_poses_has_no_paths(self, folder: Path, tmp_path: Path) -> None:
        shutil.copytree(folder, tmp_path / "r", ignore=lambda at, names: {"plots"} & {*names})
        results = Results(tmp_path / "r")
        clip = results.clip(results.clips()[0][0])
        results.write_clip(type(clip)(clip.name, clip.frames, clip.times_s, clip.intrinsics))
        drawn = [
            page.kind for page in plots.figures(results) if page.kind not in ("horizon", "samples")
        ]
        assert drawn == ["strip", "inpainted"]


class TestLayout:
    """`geovp plot --format pdf --width 3.3in --no-title`."""

    @pytest.mark.parametrize("kind", ["horizon", "strip", "paths"])
    def test_a_pdf_has_the_width_and_no_type_3_font(
        self, narrow: dict[str, Page], kind: str
    ) -> None:
        """72 points an inch; text is laid out a little differently on paper and on screen."""
        content = plots.rendered(narrow[kind], "pdf")
        (width_pt,) = re.findall(rb"MediaBox \[ ?0 0 ([\d.]+)", content)
        assert float(width_pt) == pytest.approx(3.3 * 72, abs=2)
        assert b"/Type3" not in content
        assert b"/FontFile2" in content
        assert narrow[kind].formats == ("pdf",)

    @pytest.mark.parametrize(
        ("text", "inches"), [("3.3in", 3.3), ("84mm", 3.307), ("240pt", 3.321), ("3.5", 3.5)]
    )
    def test_lengths(self, text: str, inches: float) -> None:
        assert width_in(text) == pytest.approx(inches, abs=1e-3)

    def test_only_the_format_asked_for_is_written(self, folder: Path, tmp_path: Path) -> None:
        shutil.copytree(
            folder, tmp_path / "r", ignore=lambda at, names: {"clips", "plots"} & {*names}
        )
        kept = tmp_path / "r" / "plots" / "horizon-psnr.png"
        kept.parent.mkdir()
        kept.touch()
        files = [
            path
            for _, each in plots.write_all(Results(tmp_path / "r"), layout=plots.Layout(("svg",)))
            for path in each
        ]
        assert {path.suffix for path in files} == {".svg"}
        assert kept.exists()


class TestStyle:
    def test_colour_says_the_pose_source_and_dash_the_renderer(self) -> None:
        a_r, a_q, b_r, b_q = style.line_styles([("a", "r"), ("a", "q"), ("b", "r"), ("b", "q")])
        assert a_r.colour == a_q.colour != b_r.colour == b_q.colour
        assert a_r.dash == b_r.dash != a_q.dash == b_q.dash

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
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from geovp_benchmarks import intervals, plots
from geovp_benchmarks.plots import Page, curves, kept_clips, strips, style, trajectories
from geovp_benchmarks.plots.layout import width_in
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.store import Results
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from tests.benchmarks.made import write_protocol, write_row
from tests.benchmarks.views.conftest import FACTS, KEPT

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
            "invented-01-a-b-0-9-x-y.png",
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
        assert "mean of 3 clips, bars: 95 % intervals (block bootstrap)" in svg
        assert (
            "↓ lower is better" in (folder / "plots" / "horizon-translation-error.svg").read_text()
        )
        assert "a/b[0:9) &lt;x&gt; &amp; $y" in (folder / "plots" / f"strip-{CLIP}.svg").read_text()

    @pytest.mark.parametrize("kind", ["png", "svg"])
    def test_the_same_rows_give_the_same_bytes(
        self, folder: Path, written: list[Path], kind: str
    ) -> None:
        page = next(
            page for page in plots.figures(Results(folder)) if page.subject == "translation-error"
        )
        assert plots.rendered(page, kind) == (folder / "plots" / f"{page.name}.{kind}").read_bytes()

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

    def test_figures_for_print_outlive_a_report(self, folder: Path, tmp_path: Path) -> None:
        shutil.copytree(
            folder,
            tmp_path / "r",
            ignore=lambda at, names: {"predictions", "clips", "plots"} & {*names},
        )
        results = Results(tmp_path / "r")
        printed = [
            p for _, files in plots.write_all(results, layout=plots.Layout(("pdf",))) for p in files
        ]
        list(plots.write_all(results))
        assert len(printed) > 1
        assert all(path.exists() for path in printed)

    def test_nothing_global_is_left_behind(self, folder: Path, written: list[Path]) -> None:
        before = dict(matplotlib.rcParams)
        next(plots.figures(Results(folder)))
        assert dict(matplotlib.rcParams) == before


class TestCurves:
    def test_means_and_bars_are_the_statistics(self, pages: dict[str, Page]) -> None:
        """PSNR of three clips at horizon 1 is 19, 20, 21: mean 20, and the interval that tables
        would show of them.
        """
        axes = pages["horizon-psnr"].figure.axes[0]
        line, bars = axes.lines[0], axes.collections[0]
        np.testing.assert_allclose(line.get_ydata(), 21.0 - np.arange(1, 7))
        (left, low), (_, high) = bars.get_segments()[0]
        expected = intervals.interval(np.array([19.0, 20.0, 21.0]), np.array(["a", "", ""]))
        np.testing.assert_allclose([low, high], [expected.low, expected.high])
        assert expected.low < 20 - 1 / np.sqrt(3)  # wider than one standard error
        lefts = [bars.get_segments()[0][0][0] for bars in axes.collections]
        assert sorted(set(lefts)) == lefts  # beside one another
        assert left == pytest.approx(2 - lefts[-1])

    @pytest.mark.parametrize(("count", "bands"), [(3, 3), (4, 0)])
    def test_few_lines_have_bands(self, count: int, bands: int) -> None:
        clips = ["a/0", "b/0", "c/0", "d/0"]
        values = np.random.default_rng(0).normal(20, 1, (4, 6))
        looks = style.line_styles([(str(number), "") for number in range(count)])
        drawn = [
            curves.Curve.of(str(n), values + n, clips, (0, 100), line)
            for n, line in enumerate(looks)
        ]
        labels = curves.AxisLabels("PSNR", "dB", higher_is_better=True, step_s=0.1)
        axes = curves.draw(drawn, labels, style.Heading("a", "b"))[0].axes[0]
        assert sum(isinstance(each, PolyCollection) for each in axes.collections) == bands
        assert len(axes.collections) == count

    def test_samples_give_a_mean_and_a_best_line(self, pages: dict[str, Page]) -> None:
        """Samples 0, 1, 2 score 0, 1, 2 dB more: their mean is 1 dB above a single guess, the best
        2 dB.
        """
        lines = pages["horizon-psnr"].figure.axes[0].lines
        single, mean, best = (np.asarray(lines[i].get_ydata()) for i in (0, 2, 3))
        np.testing.assert_allclose(mean - single, 1.0)
        np.testing.assert_allclose(best - single, 2.0)

    def test_the_best_of_k_has_a_line_for_every_cell_with_samples(
        self, pages: dict[str, Page]
    ) -> None:
        """The first sample has 21 - step, 17.5 dB on average; the others 1 and 2 dB more: of pairs
        (1 + 2 + 2) / 3.
        """
        axes = pages["samples-psnr"].figure.axes[0]
        line = axes.lines[0]
        np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3])
        np.testing.assert_allclose(line.get_ydata(), 17.5 + np.array([1.0, 5 / 3, 2.0]))
        assert axes.get_xlabel() == "samples to choose from"
        assert "over clips, bands: 95 % intervals" in texts(pages["samples-psnr"].figure)
        assert "gt" not in texts(pages["samples-psnr"].figure).split()

    def test_no_coverage_is_the_best(self, tmp_path: Path) -> None:
        """Of shares .2 and .6 a line of their mean alone, and no figure of the best of k."""
        results = Results(tmp_path)
        write_protocol(
            results, ["chance"], "x", metrics={"coverage": {**FACTS["psnr"], "unit": ""}}
        )
        found = [
            ("x", sample, step, "coverage", share)
            for sample, share in enumerate((0.2, 0.6))
            for step in (1, 2)
        ]
        write_row(results, "chance", found, num_samples=2)
        (page,) = plots.figures(results)
        (line,) = page.figure.axes[0].lines
        np.testing.assert_allclose(line.get_ydata(), [0.4, 0.4])
        assert "95 %" not in page.caption  # of one clip

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

    def test_many_rows_share_out_over_pages_with_the_same_axes(self) -> None:
        steps = np.arange(1.0, 4)
        styles = style.line_styles([(f"method {i}", "") for i in range(25)])
        rows = [
            curves.Curve(f"method {i}", i - steps, i - steps - 1, i - steps + 1, 2, line)
            for i, line in enumerate(styles)
        ]
        with matplotlib.style.context(style.SHEET):
            figures = curves.draw(
                rows, curves.AxisLabels("PSNR", "dB", True, None), style.Heading("PSNR", "")
            )
        assert len(figures) == 3
        assert len({figure.axes[0].get_ylim() for figure in figures}) == 1
        shown = [
            [i for i in range(25) if f"method {i}" in texts(figure).split("\n")]
            for figure in figures
        ]
        assert list(itertools.chain(*shown)) == list(range(25))
        assert max(map(len, shown)) <= 12
        assert "(2 of 3)" in texts(figures[1])
        assert "grey: other pages" in texts(figures[1])

    def test_a_forecast_beside_true_poses_stays_on_the_axis(self) -> None:
        """Errors of 20 m at the end beside 2 m and none: the axis ends 5 % of its range above the
        largest.
        """
        steps = np.arange(1.0, 3)
        styles = style.line_styles([("forecast", ""), ("planar", ""), ("truth", "")])
        rows = [
            curves.Curve(label, steps * end / 2, steps * end / 2, steps * end / 2, 2, line)
            for (label, end), line in zip(
                [("forecast", 20), ("planar", 2), ("truth", 0)], styles, strict=True
            )
        ]
        (error,) = curves.draw(
            rows, curves.AxisLabels("x", "m", higher_is_better=False, step_s=0.1), HEADING
        )
        assert error.axes[0].get_ylim() == pytest.approx((0.0, 21.0))


def test_labels_of_wide_frames_keep_to_their_rows() -> None:
    frame = np.zeros((64, 208, 3), np.uint8)
    truth = strips.Truth(frame, frame[None], [1], np.array([0.1]))
    rows = [
        strips.Row("vo+prior-refined + ground-far-plane", "PSNR 20 dB", frame[None])
        for _ in range(2)
    ]
    figure = strips.draw(truth, rows, HEADING)[0]
    figure.canvas.draw()
    (axes,) = figure.axes
    sheet = axes.images[0].get_window_extent()
    for number, label in enumerate(
        [text for text in axes.texts if text.get_text().startswith("vo+prior")], 1
    ):
        extent, pitch = (
            label.get_window_extent(),
            (64 + 208 // 40) * sheet.height / (3 * 64 + 2 * (208 // 40)),
        )
        assert sheet.y1 - (number + 1) * pitch < extent.y0
        assert extent.y1 < sheet.y1 - number * pitch + 1


@pytest.mark.parametrize(("width", "count", "has_room"), [(None, 5, True), (3.3, 3, False)])
def test_no_words_of_a_strip_lie_upon_others(
    width: float | None, count: int, has_room: bool
) -> None:
    """A label of two lines and seven notes: 75 points, in images of 82; on a narrow page of 49."""
    frame = np.zeros((64, 64, 3), np.uint8)
    frames = np.stack([frame] * count)
    truth = strips.Truth(frame, frames, range(1, count + 1), np.arange(1.0, count + 1))
    rows = [
        strips.Row("vo+prior-refined + ground-far-plane", "\n".join(["PSNR 20 dB"] * 7), frames)
        for _ in range(3)
    ]
    assert strips.has_room(truth, rows, width) == has_room
    rows = [replace(row, note=row.note if has_room else "") for row in rows]
    with matplotlib.style.context(style.SHEET):
        figure = strips.draw(truth, rows, HEADING, width)[0]
        plots.Layout(width_in=width).apply(figure)
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
        """Red above green; the last observed frame is the first image of the file."""
        frame = np.zeros((300, 300, 3), np.uint8)
        frame[:150, :, 0], frame[150:, :, 1] = 255, 255
        truth = strips.Truth(frame, frame[None], [1], np.array([0.1]))
        page = Page(
            "x",
            "strip",
            "c",
            "",
            strips.draw(truth, [strips.Row("m", "", frame[None])], HEADING)[0],
            ("png",),
        )
        image = np.asarray(Image.open(io.BytesIO(plots.rendered(page, "png"))).convert("RGB"))
        red, green = ((image == colour).all(axis=2) for colour in ([255, 0, 0], [0, 255, 0]))
        assert (
            red.sum() == green.sum() == 3 * 150 * 300
        )  # truth twice, the method once, pixel for pixel
        assert np.argwhere(red)[0, 0] < np.argwhere(green)[0, 0]

    def test_very_large_frames_are_shrunk_to_print(self) -> None:
        frame = np.zeros((400, 1200, 3), np.uint8)
        truth = strips.Truth(frame, frame[None], [1], np.array([0.1]))
        figure = strips.draw(truth, [strips.Row("m", "", frame[None])], HEADING)[0]
        assert figure.dpi == 300
        np.testing.assert_allclose(
            figure.get_size_inches()[0], 0.6 * (2 * 1200 + 30) / 400
        )  # as high as two lines
        upright = np.zeros((1200, 1200, 3), np.uint8)
        truth = strips.Truth(upright, upright[None], [1], np.array([0.1]))
        figure = strips.draw(truth, [strips.Row("m", "", upright[None])], HEADING)[0]
        np.testing.assert_allclose(figure.get_size_inches()[0], 1.14 * (2 * 1200 + 30) / 1200)

    def test_rows_are_named_and_scored(self, pages: dict[str, Page]) -> None:
        """Sample 0 of the first clip: the mean of 19 .. 14 dB is 16.5 dB."""
        words = texts(pages[f"strip-{CLIP}"].figure)
        for word in (
            "ground truth",
            "last observed\nframe",
            "frame +5\n(0.5 s)",
            "gt + far",
            "PSNR 16.5 dB",
        ):
            assert word in words
        assert "sample 1 of 3" in words

    def test_what_is_no_score_is_no_note(self, folder: Path) -> None:
        material = Material.read(Results(folder))
        (cell,) = (cell for cell in material.cells if cell.name == "kalman--far")
        assert kept_clips.notes(material, cell, KEPT, 3) == ["sample 1 of 3", "PSNR 16.5 dB"]
        undirected = {"metrics": {"psnr": {**FACTS["psnr"], "higher_is_better": None}}}
        assert kept_clips.notes(replace(material, protocol=undirected), cell, KEPT, 3) == [
            "sample 1 of 3"
        ]

    def test_numbers_are_explained_where_there_is_room_for_them(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        material = Material.read(Results(folder))
        shown = texts(kept_clips.pages(material, 1, KEPT, plots.Layout())[0].figure)
        monkeypatch.setattr(strips, "has_room", lambda truth, rows, width_in: False)
        left_out = texts(kept_clips.pages(material, 1, KEPT, plots.Layout())[0].figure)
        assert "the small numbers are means over the 6 frames" in shown
        assert "small numbers" not in left_out
        assert "dB" not in left_out
        assert "of several samples the first" in left_out

    def test_only_inpainted_pixels_are_tinted(self) -> None:
        frames = np.full((1, 2, 2, 3), 100, np.uint8)
        covered = np.array([[[True, False], [True, True]]])
        tinted = strips.mark_inpainted(strips.Row("x", "", frames, covered)).frames
        np.testing.assert_array_equal(tinted[covered], 100)
        np.testing.assert_array_equal(
            tinted[~covered], [(0.35 * 100 + 0.65 * strips.INPAINTED).astype(int)]
        )

    def test_more_than_ten_methods_take_two_pages(self) -> None:
        frame = np.zeros((2, 2, 3), np.uint8)
        truth = strips.Truth(frame, frame[None], [1], np.array([0.1]))
        assert (
            len(
                strips.draw(
                    truth, [strips.Row(f"m{i}", "", frame[None]) for i in range(11)], HEADING
                )
            )
            == 2
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
        legend = axes.get_legend()
        assert legend is not None
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
        assert drawn == ["strip", "invented"]


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

    def test_titles_go_and_letters_keep_their_size(
        self, narrow: dict[str, Page], pages: dict[str, Page]
    ) -> None:
        assert "over horizon" in texts(pages["horizon-translation-error"].figure)
        words = texts(narrow["horizon"].figure)
        assert "over horizon" not in words
        assert "mean of 3 clips" not in words
        legend = narrow["horizon"].figure.axes[0].get_legend()
        assert legend is not None
        assert {text.get_fontsize() for text in legend.get_texts()} == {7.5}

    def test_fewer_images_stand_side_by_side(self) -> None:
        """Images of 0.8 inches: four in 3.3 inches, one of which is the last observed frame."""
        assert plots.Layout(width_in=3.3).most_tiles == 4
        assert plots.Layout().most_tiles is None

    @pytest.mark.parametrize(
        ("text", "inches"), [("3.3in", 3.3), ("84mm", 3.307), ("240pt", 3.321), ("3.5", 3.5)]
    )
    def test_lengths(self, text: str, inches: float) -> None:
        assert width_in(text) == pytest.approx(inches, abs=1e-3)

    @pytest.mark.parametrize("text", ["full", "3.3 feet", "1in", ".", "-4in"])
    def test_what_is_no_length_or_too_small(self, text: str) -> None:
        with pytest.raises(BadData, match="--width"):
            width_in(text)

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
    def test_no_two_lines_look_alike(self) -> None:
        plain = style.line_styles([(f"m{i}", "") for i in range(60)])
        crossed = style.line_styles(
            [(f"s{i}", f"r{j}") for i, j in itertools.product(range(9), range(20))]
        )
        assert len(set(plain)) == 60
        assert len(set(crossed)) == 180

    def test_colour_says_the_pose_source_and_dash_the_renderer(self) -> None:
        a_r, a_q, b_r, b_q = style.line_styles([("a", "r"), ("a", "q"), ("b", "r"), ("b", "q")])
        assert a_r.colour == a_q.colour != b_r.colour == b_q.colour
        assert a_r.dash == b_r.dash != a_q.dash == b_q.dash

    @given(st.integers(0, 200), st.integers(1, 20))
    def test_pages_share_all_rows_evenly(self, count: int, most: int) -> None:
        pages = style.pages(count, most, style.Heading("Paths", ""))
        shared = [range(count)[rows] for rows, _ in pages]
        assert [i for page in shared for i in page] == list(range(count))
        titles = [f"Paths ({n} of {len(pages)})" for n in range(1, len(pages) + 1)]
        assert [heading.title for _, heading in pages] == (titles if len(pages) > 1 else ["Paths"])
        assert max(map(len, shared)) - min(map(len, shared)) <= 1
        assert max(map(len, shared)) <= most

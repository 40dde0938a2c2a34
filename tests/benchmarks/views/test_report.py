"""The report is one page that needs nothing else, says what the rows say, and shows every name as
it is.
"""

import base64
import html
import io
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from geovp_benchmarks import report
from geovp_benchmarks.plots import Options
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.report import browser, films, findings
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from tests.benchmarks.made import write_protocol, write_row
from tests.benchmarks.views.conftest import FACTS


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    report.write(Results(folder), Options())
    return (folder / "report.html").read_text(encoding="utf-8")


class Reader(HTMLParser):
    """Collects elements with their attributes, and which were left open."""

    def __init__(self) -> None:
        """Nothing read yet."""
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in ("img", "meta", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    return reader


def seen(page: str) -> str:
    """The text that a reader sees."""
    return html.unescape(
        re.sub(r"<[^>]*>", "", page.partition("</style>")[2].partition("<script>")[0])
    )


def test_it_is_well_formed_and_all_is_in_it(page: str) -> None:
    reader = read(page)
    assert reader.open == []
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert {tag for tag, _ in reader.elements}.isdisjoint({"link", "iframe", "object"})
    assert [tag for tag, _ in reader.elements].count("script") == 1
    sources = [attributes["src"] or "" for tag, attributes in reader.elements if tag == "img"]
    assert [source.partition(";")[0].removeprefix("data:") for source in sources] == [
        *["image/svg+xml"] * 2,  # psnr and translation error over the horizon
        "image/svg+xml",  # psnr over covered pixels
        "image/webp",  # the ground truth
        *["image/webp", "image/png"] * 3,  # methods with a renderer, and what each inpainted
        "image/webp",  # a copy of the last frame
        "image/svg+xml",  # paths
    ]
    assert not re.search(r"url\(|@import", page)


def test_every_number_of_the_main_table_is_there(page: str) -> None:
    """PSNR 20 + clip - step: over three clips and six steps 17.5 dB, and of the best of three
    samples 19.5 dB.
    """
    low, high = (float(end) for end in re.findall(r"17.50 \[([\d.]+), ([\d.]+)\]", seen(page))[0])
    half = 4.303 / 3**0.5  # Student's t with two degrees of freedom; clips are 1 dB apart
    assert (low, high) == pytest.approx((17.5 - half, 17.5 + half), abs=0.4)
    assert re.search(r'<td>19.50<span class="error"> \[', page)
    assert "PSNR (dB) ↑" in seen(page)
    assert "unavailable" in seen(page)


def test_names_and_reasons_are_shown_and_never_run(page: str) -> None:
    text = seen(page)
    for shown in (
        "toy & matrix",
        "toy <val>",
        "ValueError: <b>bold</b>",
        "<script>alert(1)</script>",
        "<i>odd</i>",
    ):
        assert shown in text
    for raw in ("<script>alert", "<i>odd", "<b>bold", "<x>", "<val>"):
        assert raw not in page
    assert "a/b[0:9) <x> & $y" in text


class TestFilms:
    def test_a_film_holds_the_last_observed_and_all_future_frames(self, page: str) -> None:
        """The first row is 0 + step grey, after the last observed frame, which is 202."""
        films = re.findall(
            r'<figure class="film" data-name="([^"]*)" data-frames="(\d+)"( data-method="[^"]*")? ',
            page,
        )
        assert [(name, count) for name, count, _ in films] == [
            (name, "7")
            for name in ("ground truth", "gt + far", "_vo + far", "kalman + far", "copy-last")
        ]
        assert [bool(row) for *_, row in films] == [
            False,
            True,
            True,
            True,
            True,
        ]  # the truth is never filtered out
        content = re.findall(r'data:image/webp;base64,([^"]+)', page)[1]
        image = np.asarray(Image.open(io.BytesIO(base64.b64decode(content))).convert("RGB"), int)
        assert image.shape == (16, 7 * 16, 3)
        np.testing.assert_allclose(image[8, 8::16, 0], [202, 1, 2, 3, 4, 5, 6], atol=3)

    def test_inpainted_pixels_are_marked_and_others_let_through(self) -> None:
        covered = np.ones((2, 16, 16), bool)
        covered[1, :, :4] = False
        frames = np.zeros((2, 16, 16, 3), np.uint8)
        film = films.encode("a", [], frames, covered, films.Format(1, 16, 10**6))
        image = np.asarray(Image.open(io.BytesIO(film.mask)).convert("RGBA"))
        np.testing.assert_array_equal(image[..., 3] > 0, np.concatenate(~covered, axis=1))
        np.testing.assert_array_equal(image[0, 16], [214, 39, 160, 255])

    def test_many_films_have_fewer_and_smaller_frames(self) -> None:
        """36 clips of 7 methods and the truth are 288 films of 22,569 bytes; at 0.6 bits per pixel,
        11 of 21 frames are 165 wide: 11 * 165 * 165 * 0.6 / 8 = 22,461. All 21 would be 119 wide.
        """
        assert films.Format.of(288, 21, 1.0) == films.Format(2, 165, 22_569)
        assert films.Format.of(32, 21, 1.0) == films.Format(1, 208, 203_125)
        assert films.Format.of(1, 201, 1.0).width_px * 201 <= 16383  # a WebP image is no wider
        frames = np.arange(21, dtype=np.uint8)[:, None, None, None] * np.ones((16, 16, 3), np.uint8)
        film = films.encode("a", [], frames * 10, None, films.Format(2, 8, 10**6))
        image = np.asarray(Image.open(io.BytesIO(film.image)).convert("RGB"), int)
        assert image.shape == (8, 11 * 8, 3)
        np.testing.assert_allclose(image[4, 4::8, 0], 20 * np.arange(11), atol=3)

    def test_films_of_many_details_have_less_quality(self) -> None:
        noise = np.random.default_rng(0).integers(0, 256, (4, 64, 64, 3), dtype=np.uint8)
        large, small = (
            len(films.encode("a", [], noise, None, films.Format(1, 64, max_bytes)).image)
            for max_bytes in (10**6, 1)
        )
        assert large > 1.1 * small


class TestClips:
    def test_all_are_listed_worst_first_and_kept_ones_have_films(self, folder: Path) -> None:
        """PSNR rises from clip to clip; the first is kept."""
        results = Results(folder)
        material = Material(results, Options())
        found = findings.find(tables.build(results)[0], None, results.protocol(), "copy-last")
        shown = browser.build(material, found)
        assert [(clip.name, clip.score) for clip in shown.clips] == [
            ("a/b[0:9) <x> & $y", pytest.approx(17.5)),
            ("b", pytest.approx(18.5)),
            ("c", pytest.approx(19.5)),
        ]
        assert [len(clip.films) for clip in shown.clips] == [5, 0, 0]
        assert [clip.name for clip in shown.worst] == ["a/b[0:9) <x> & $y"]
        assert shown.orders == "kalman + far"
        assert shown.table[0][0] == "clip"

    def test_numbers_of_each_clip(self, page: str) -> None:
        """PSNR is 20 + clip - step, 16.5 on average in the first clip; kalman has 3 samples."""
        first, *others = re.findall('<dl class="numbers">(.*?)</dl>', page)
        numbers = re.findall("<dt>(.*?)</dt><dd>(.*?)</dd>", first)
        assert ("gt + far: PSNR (dB)", "16.5") in numbers
        assert ("kalman + far: PSNR (dB)", "17.5") in numbers
        assert not {"clip", "labels"} & set(dict(numbers))
        assert len(others) == 2

    def test_keys_and_methods_on_request(self, page: str) -> None:
        reader = read(page)
        identities = {attributes.get("id") for _, attributes in reader.elements}
        assert {"all", "worst", "previous", "next", "best", "play"} <= identities
        assert "data-more" not in page.partition("<body")[2].partition("<script")[0]  # 4 methods


def test_methods_beyond_six_are_shown_on_request(tmp_path: Path) -> None:
    results = Results(tmp_path)
    names = [f"m{number}" for number in range(8)]
    lines = {
        name: [(clip, 0, 1, "psnr", 20.0 + number) for clip in "abc"]
        for number, name in enumerate(names)
    }
    sizes = {"num_future": 1, "size_px": [16, 16]}
    write_protocol(results, names, "abc", metrics={"psnr": FACTS["psnr"]}, **sizes)
    for name in names:
        write_row(results, name, lines[name])
    report.write(Results(tmp_path), Options())
    elements = read((tmp_path / "report.html").read_text(encoding="utf-8")).elements
    rows = [
        attributes for tag, attributes in elements if tag == "tr" and "data-method" in attributes
    ]
    more = {row["data-method"] for row in rows if "data-more" in row}
    assert more == {"m0", "m1"}  # the worst two of eight


def test_the_findings_are_the_numbers(page: str, folder: Path) -> None:
    """Kalman has no privileged input, and samples 0, 1, 2 have 0, 1, 2 dB more than copy-last."""
    opening = page.partition('<div class="findings">')[2]
    without, privileged, gain = map(html.unescape, re.findall("<p>(.*?)</p>", opening)[:3])
    assert without.startswith(
        "Without ground truth, kalman + far, mean of 3 is best: PSNR 18.50 dB ["
    )
    assert privileged.startswith(
        "With ground truth (true past poses), gt + far is best: PSNR 17.50 dB ["
    )
    assert (
        "kalman + far, mean of 3 changes PSNR by +1.00 dB [+1.00,\N{NO-BREAK SPACE}+1.00]" in gain
    )
    assert "3 effective clips or drives are too few" in gain
    results = Results(folder)
    found = findings.find(tables.build(results)[0], None, results.protocol(), "absent")
    assert found.gain is None


def test_without_ground_truth_nothing_is_said_of_it(tmp_path: Path, folder: Path) -> None:
    report.write(Results(shutil.copytree(folder, tmp_path / "copy")).select("copy-last"), Options())
    text = seen((tmp_path / "copy/report.html").read_text(encoding="utf-8"))
    assert "With ground truth" not in text
    assert "Letters:" not in text


def test_a_run_that_has_only_begun_has_a_report(tmp_path: Path, folder: Path) -> None:
    protocol = Results(folder).protocol()
    Results(tmp_path).write_protocol({**protocol, "methods": []})
    report.write(Results(tmp_path), Options())
    text = seen((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "3 clips of toy <val>, split val" in text
    assert "Over the horizon" not in text

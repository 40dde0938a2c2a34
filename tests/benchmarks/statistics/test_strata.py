"""Results divided by what the clips are like: every clip in one stratum, each with a table and
figures of its own.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from geovp_benchmarks import plots
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics import strata
from geovp_classic.errors import BadData
from tests.benchmarks.conftest import Command
from tests.benchmarks.made import STILL, content, go, write_protocol, write_row

FACTS: dict[str, dict[str, float]] = {
    "a": {"yaw_deg": 0.4, "speed_m_s": 4.9, "step_m": 0.49},
    "b": {"yaw_deg": 5.0, "speed_m_s": 5.0, "step_m": 0.5},
    "c": {"yaw_deg": 4.9, "speed_m_s": 30.0, "step_m": 3.0},
    "d": {"yaw_deg": 31.0},
    "e": {},
}
COVERED = {"a": 0.9, "b": 0.8, "c": 0.7, "d": 0.95, "e": 0.99}
UNITS = {"psnr": ("dB", True), "coverage": ("", None)}


def fill(root: Path, facts: Mapping[str, Mapping[str, float | str]]) -> Results:
    """PSNR is 10, 11, ... by clip and falls by 1 from the first step to the second; `half` has only
    the first clip.
    """
    results, clips = Results(root), list(facts)
    metrics = {
        name: {
            "role": "frame",
            "unit": unit,
            "higher_is_better": up,
            "unavailable": None,
            "asked": {"name": "psnr"},
        }
        for name, (unit, up) in UNITS.items()
    }
    write_protocol(
        results, ["s--r", "half"], clips, metrics=metrics, num_past=3, num_future=2, size_px=[8, 8]
    )
    for name, count in (("s--r", len(clips)), ("half", 1)):
        rows = [
            (clip, 0, step, metric, value)
            for number, clip in enumerate(clips[:count])
            for step in (1, 2)
            for metric, value in (("psnr", 11.0 + number - step), ("coverage", COVERED[clip]))
        ]
        own = {clip: facts[clip] for clip in clips[:count]}
        write_row(results, name, rows, own, renderer="r", status="done" if count > 1 else "partial")
    return results


def clips_by_label(results: Results, by: str) -> dict[str, str]:
    return {
        subset.label: "".join(sorted(subset.protocol()["clips"]))
        for subset in strata.divide(results, by)
    }


@pytest.fixture
def results(tmp_path: Path) -> Results:
    return fill(tmp_path, FACTS)


@pytest.mark.parametrize(
    ("by", "expected"),
    [
        (
            "turning",
            {
                "turn below 5 degrees": "ac",
                "turn 5 degrees or more": "bd",
                "turn unknown": "e",
            },
        ),
        (
            "speed",
            {
                "speed below 5 m/s": "a",
                "speed 5 to 10 m/s": "b",
                "speed 10 m/s or more": "c",
                "speed unknown": "de",
            },
        ),
        (
            "step",
            {
                "step of two frames below 0.5 m": "a",
                "step of two frames 0.5 to 1 m": "b",
                "step of two frames 1 m or more": "c",
            },
        ),
        # thirds of .7 .8 .9 .95 .99: the bounds are at places 4 / 3 and 8 / 3 of 0..4
        (
            "seen",
            {
                "fraction of pixels seen before below 0.833, as s + r covers it": "bc",
                "fraction of pixels seen before 0.833 to 0.933, as s + r covers it": "a",
                "fraction of pixels seen before 0.933 or more, as s + r covers it": "de",
            },
        ),
    ],
)
def test_every_clip_is_in_the_stratum_of_its_facts(
    results: Results, by: str, expected: dict[str, str]
) -> None:
    divided = clips_by_label(results, by)
    assert expected.items() <= divided.items()
    assert "".join(sorted("".join(divided.values()))) == "abcde"


def test_exact_depth_is_believed_before_a_methods_coverage(tmp_path: Path) -> None:
    facts = {name: {"seen": share} for name, share in zip("abc", (0.5, 0.6, 0.7), strict=True)}
    results = fill(tmp_path, facts)
    assert strata.divide(results, "seen")[0].label == "fraction of pixels seen before below 0.567"


def test_texts_of_the_data_set_divide_clips(tmp_path: Path) -> None:
    """Of two attributes called moving, the text of the data set counts."""
    texts: dict[str, dict[str, float | str]] = {
        "a": {"kind": "drone", "moving": "none"},
        "b": {"kind": "phone, indoors", "moving": "none"},
        "c": {"kind": "drone"},
    }
    results = fill(tmp_path, texts)
    for by, expected in (
        ("kind", {"kind: drone": "ac", "kind: phone, indoors": "b"}),
        ("moving", {"moving: none": "ab", "moving: unknown": "c"}),
    ):
        assert clips_by_label(results, by) == expected
    with pytest.raises(BadData, match="did you mean 'kind'"):
        strata.divide(results, "kid")


def test_figures_of_strata_share_their_axes_and_leave_the_others(results: Results) -> None:
    list(plots.write_all(results, plots.Options()))
    before = {path.name for path in results.plots.iterdir()}
    by_turning = plots.Options(by="turning")
    pages = [page for page, _ in plots.write_all(results, by_turning) if page.subject == "psnr"]
    assert [page.name for page in pages] == [f"strata-turning-{n}-psnr" for n in (1, 2, 3)]
    assert len({page.figure.axes[0].get_ylim() for page in pages}) == 1
    after = {path.name for path in results.plots.iterdir()}
    assert before < after
    list(plots.write_all(results, plots.Options()))
    assert {path.name for path in results.plots.iterdir()} == after


@pytest.mark.usefixtures("unrendered")
def test_a_report_has_a_table_per_stratum(results: Results, command: Command) -> None:
    facts = {"split_hash": "s", "versions": {}, "stride": 1}
    results.write_protocol({**results.protocol(), **facts})
    assert command("report", results.root, "--by", "turning").code == 0
    page = results.report.read_text()
    tables = re.findall(r"<h3>demo, ([^<]*)</h3>(.*?)</table>", page, re.DOTALL)
    means = {title: re.findall(r"<td>(\d+\.\d+)<", table)[0] for title, table in tables}
    assert means == {
        "turn below 5 degrees (n = 2): whole frames and poses": "10.50",
        "turn 5 degrees or more (n = 2): whole frames and poses": "11.50",
        "turn unknown (n = 1): whole frames and poses": "13.50",
    }


@pytest.mark.usefixtures("toys")
def test_a_run_stores_the_facts_of_its_clips(tmp_path: Path) -> None:
    go(tmp_path / "out", content({"clips": 3, "with_depths": True}, predictors=STILL), keep="1")
    stored = Results(tmp_path / "out").clip_facts()
    assert list(stored) == ["road/000", "road/001", "road/002"]
    facts = dict(stored["road/001"])  # 1 m in .1 s, straight on; a wall that moves along
    assert facts.pop("seen") + facts.pop("disoccluded") <= 1
    assert facts == pytest.approx(
        {"interval_s": 0.1, "yaw_deg": 0.0, "speed_m_s": 10.0, "step_m": 1.0}
    )

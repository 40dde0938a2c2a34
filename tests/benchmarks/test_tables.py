"""What a reader of a table must be able to see."""

import csv
from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import formats, tables
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import write_protocol, write_row

METRICS = {
    "psnr": {
        "role": "frame",
        "unit": "dB",
        "higher_is_better": True,
        "unavailable": None,
        "definition": "per frame",
    },
    "lpips": {"role": "frame", "unavailable": "lpips_alex is not here: fetch it"},
    "translation-error": {
        "role": "trajectory",
        "unit": "m",
        "higher_is_better": False,
        "unavailable": None,
    },
    "coverage": {
        "role": "frame",
        "unit": "",
        "higher_is_better": None,
        "unavailable": None,
        "definition": "share",
    },
}


def write(
    results: Results, name: str, values: dict[tuple[str, int, str], float | None], **record: Any
) -> None:
    """A method with values at one step by clip, sample and metric."""
    write_row(
        results,
        name,
        [(clip, sample, 1, metric, v) for (clip, sample, metric), v in values.items()],
        **record,
    )


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """Two clips; `sharp` is better in PSNR, `still` in the error; one method of each other status."""
    results = Results(tmp_path)
    road = {"name": "road", "split": "test"}
    write_protocol(
        results,
        ["a--sharp", "still", "half", "broken", "apart"],
        "xy",
        metrics=METRICS,
        dataset=road,
    )
    sharp = {("x", 0, "psnr"): 20.0, ("y", 0, "psnr"): 24.0}
    sharp |= {(clip, 0, "translation-error"): 3.0 for clip in "xy"}
    apart = {
        ("x", 0, "psnr@covered"): 25.0,
        ("y", 0, "psnr@covered"): None,
        ("x", 0, "coverage"): 0.5,
    }
    write(results, "a--sharp", {**sharp, **apart}, privileged_inputs=["PAST_POSES", "FUTURE_POSES"])
    write(
        results,
        "still",
        {("x", 0, "psnr"): 10.0, ("y", 0, "psnr"): 12.0, ("x", 0, "translation-error"): 1.0},
    )
    write(results, "half", {("x", 0, "psnr"): 90.0}, status="partial")
    write(results, "broken", {}, status="failed", reason="the road ended")
    write(results, "apart", {}, status="skipped", reason="give the odometry a scale")
    return results


def lines(results: Results, number: int = 0) -> list[str]:
    return formats.markdown(tables.build(results, "standard-error")[number]).splitlines()


def row_of(text: list[str], name: str) -> list[str]:
    line = next(line for line in text if line.startswith(f"| {name}"))
    return [entry.strip() for entry in line.strip("|").split("|")]


def test_means_with_their_standard_errors_as_the_thesis_has_them(results: Results) -> None:
    text = lines(results)
    # 20 and 24: mean 22, s = 2.828, / sqrt(2) = 2
    assert row_of(text, "a + sharp")[2:] == ["22.00 ± 2.00", "unavailable", "3.000 ± 0.000"]
    assert row_of(text, "still")[2:] == ["11.00 ± 1.00", "unavailable", "1.000 (n=1)"]


def test_an_unfinished_row_is_shown_but_does_not_compete(results: Results) -> None:
    text = lines(results)
    assert row_of(text, "half")[1:3] == ["1", "90.00"]
    assert any(line.startswith("- half: partial, 1 of 2 clips: run again") for line in text)


def test_sets_of_pixels_have_their_own_table(results: Results) -> None:
    text = lines(results, 1)
    assert row_of(text, "method")[2:] == ["all pixels (dB) ↑", "covered pixels (dB) ↑", "coverage"]
    assert row_of(text, "a + sharp")[3:] == ["25.00 (n=1)", "0.500 (n=1)"]
    assert row_of(text, "still")[3:] == ["-", "-"]


def test_latex_escapes_and_emphasises(results: Results) -> None:
    write(
        results, "still", {("x", 0, "psnr"): 30.0, ("y", 0, "psnr"): 30.0}, label="100%_still & co"
    )
    text = formats.latex(tables.build(results, "standard-error")[0])
    assert r"100\%\_still \& co & 2 & 30.00 $\pm$ 0.00" in text
    assert r"a + sharp$^{\mathrm{pf}}$ & 2 & 22.00 $\pm$ 2.00" in text
    assert r"method & clips & \shortstack[r]{PSNR (dB) $\uparrow$} & " in text
    assert r"\shortstack[r]{translation\\error (m) $\downarrow$} \\" in text


def test_csv_has_every_digit(results: Results) -> None:
    write(results, "still", {("x", 0, "psnr"): 1.0, ("y", 0, "psnr"): 0.1})
    table = list(csv.DictReader(formats.comma_separated(tables.build(results)[0]).splitlines()))
    assert table[1]["method"] == "still"
    assert float(table[1]["psnr"]) == 0.55
    assert float(table[1]["psnr_standard_error"]) == pytest.approx(0.45)
    assert (table[1]["psnr_clips"], table[1]["lpips"], table[1]["lpips_clips"]) == ("2", "", "0")
    assert table[0]["privileged_inputs"] == "pf"


@pytest.fixture
def sampled(tmp_path: Path) -> Results:
    """Two clips, three samples: sample 1 is best in PSNR, sample 2 in the error."""
    results = Results(tmp_path / "sampled")
    write_protocol(results, ["chance", "still"], "xy", metrics=METRICS)
    psnr = {
        (clip, sample, "psnr"): value
        for clip in "xy"
        for sample, value in enumerate((10.0, 13.0, 11.0))
    }
    metres = {
        (clip, sample, "translation-error"): value
        for clip in "xy"
        for sample, value in enumerate((4.0, 3.0, 1.0))
    }
    write(results, "chance", {**psnr, **metres}, num_samples=3)
    write(results, "still", {("x", 0, "psnr"): 11.5, ("y", 0, "psnr"): 11.5})
    return results


def test_samples_give_a_mean_and_a_best(sampled: Results) -> None:
    chosen = [row.is_oracle_selected for row in tables.build(sampled)[0].rows]
    assert chosen == [False, True, False]
    text = lines(sampled)
    assert row_of(text, "chance, mean of 3")[2:] == ["11.33 ± 0.00", "unavailable", "2.667 ± 0.000"]
    assert row_of(text, "chance, best of 3")[2:] == [
        "13.00 ± 0.00",
        "unavailable",
        "1.000 ± 0.000",
    ]


def test_steps_have_a_column_each(results: Results, tmp_path: Path, refused: Says) -> None:
    lines = [("x", 0, step, "psnr", 10.0 * step) for step in (1, 2, 3)]
    write_row(results, "still", lines)
    (table,) = tables.build(results.select("still"), metrics=["psnr"], steps=[1, 3])
    (method,) = table.rows
    assert [column.heading for column in table.columns] == [
        "PSNR, step 1 (dB) ↑",
        "PSNR, step 3 (dB) ↑",
    ]
    assert [method.scores[column.key].mean for column in table.columns] == [
        11.0,
        30.0,
    ]  # y has 12 at step 1
    assert "give steps from 1 to 20" in refused("table", tmp_path, "--steps", "21")

    # Differences of steps: 10 more than `still` at step 1, 30 more at step 3.
    write_row(results, "apart", [(*line[:4], 2 * line[4]) for line in lines])
    pair = results.select("apart", "still")
    differences = tables.against(pair, "still", metrics=["psnr"], steps=[1, 3])
    (method,) = differences.rows
    assert [score.values[0] for score in method.scores.values()] == [10.0, 30.0]


def test_a_clip_is_listed_with_what_explains_its_score(tmp_path: Path, printed: Says) -> None:
    """The words of a data set, the mask, and the fallback that shows the clip."""
    results = Results(tmp_path)
    write_protocol(results, ["geo"], ["s/0", "s/1"], metrics={"psnr": METRICS["psnr"]})
    facts: dict[str, dict[str, float | str]] = {
        "s/0": {"moving": "some", "masked": 0.125, "interval_s": 0.1},
        "s/1": {"moving": "none", "yaw_deg": 31.0},
    }
    shown_by = {"s/0": "geometry", "s/1": "last-frame"}
    rows = [("s/0", 0, 1, "psnr", 20.0), ("s/1", 0, 1, "psnr", 12.3456)]
    write_row(results, "geo", rows, facts, shown_by=shown_by)
    text = printed("table", tmp_path, "--per", "clip").splitlines()
    masked = "fraction of pixels fixed to the camera"
    assert row_of(text, "clip") == [
        *("clip", "geo: PSNR (dB)", "geo: shown by", "labels", "turn (degrees)", "moving", masked)
    ]
    labels = "shown by the last frame"
    assert row_of(text, "s/1") == ["s/1", "12.35", "the last frame", labels, "31", "none", "-"]
    assert [line[:5] for line in text if line.startswith("| s/")] == ["| s/1", "| s/0"]
    words = ["--per", "clip", "--format", "csv"]
    assert "\ns/1,12.3456,the last frame," in printed("table", tmp_path, *words)


def test_columns_that_repeat_another_or_have_no_score_are_left_out(tmp_path: Path) -> None:
    results = Results(tmp_path)
    error = METRICS["translation-error"]
    metrics = {"translation-error": error, "average-displacement": error}
    write_protocol(results, ["a"], "xy", metrics={**metrics, "psnr": METRICS["psnr"]})
    write(results, "a", {(clip, 0, key): 4e-8 for clip in "xy" for key in metrics})
    assert row_of(lines(results), "a")[2] == "4e-08 ± 0"
    assert [column.key for column in tables.build(results)[0].columns] == ["translation-error"]
    (asked,) = tables.build(results, metrics=[*metrics])
    assert len(asked.columns) == 2


def test_files_follow_the_scores(results: Results) -> None:
    """LaTeX is written again where the numbers changed."""
    for psnr in (30.0, 31.0):
        write(results, "still", {(clip, 0, "psnr"): psnr for clip in "xy"})
        formats.write_all(results, tables.build(results))
        for kind in ("md", "tex", "csv"):
            assert str(psnr) in (results.tables / f"scores.{kind}").read_text()

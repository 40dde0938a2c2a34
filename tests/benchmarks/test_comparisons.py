"""Which rows of a table are bold, and how rows are compared with one of them."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.tables import formats, tables
from geovp_benchmarks.tables.table_model import Column, Row, best
from geovp_classic.errors import BadData
from tests.benchmarks.made import write_protocol
from tests.benchmarks.test_tables import METRICS, lines, row_of, write

CLIPS = [f"{sequence}/{number:06d}" for sequence in ("03", "06") for number in range(15)]
PSNR = Column("psnr", "PSNR", higher_is_better=True, digits=".2f")
SCENES = np.random.default_rng(0).normal(20.0, 3.0, 30)  # how hard each clip is for everybody
OWN = np.random.default_rng(1).normal(0.0, 0.1, (4, 30))


def row(name: str, values: Any, marks: str = "p", *, by_truth: bool = False) -> Row:
    score = Intervals().interval(values, CLIPS)
    return Row(name, {"psnr": score}, marks, score.clips, by_truth)


def bold(*rows: Row) -> set[str]:
    return {name for name, _ in best(rows, [PSNR], CLIPS)}


def test_what_cannot_be_told_from_the_best_is_bold_and_what_always_loses_a_little_is_not() -> None:
    # Scenes differ by 3 dB, so that means have wide intervals; half a decibel on every clip is
    # certain nevertheless.
    first, equal = row("first", SCENES + OWN[0]), row("equal", SCENES + OWN[1])
    assert first.scores["psnr"].high - first.scores["psnr"].low > 1.5
    assert bold(first, equal, row("worse", SCENES - 0.5 + OWN[2])) == {"first", "equal"}


def test_rows_with_other_grants_or_chosen_by_the_truth_do_not_compete() -> None:
    seer, seers_twin = row("seer", SCENES + 5, "pf"), row("twin", SCENES + 4, "pf")
    lucky = row("best of 10", SCENES + 2, by_truth=True)
    assert bold(seer, seers_twin, lucky, row("a", SCENES), row("b", SCENES - 1)) == {"seer", "a"}


def test_a_row_with_more_inputs_is_not_bold_below_a_better_row_with_fewer() -> None:
    seer, plain = row("seer", SCENES - 1 + OWN[0], "pf"), row("plain", SCENES + OWN[1], "p")
    assert bold(seer, plain, row("worse", SCENES - 2 + OWN[2])) == {"plain"}


def test_a_positive_error_is_not_bold_below_an_exact_one_whatever_its_interval_holds() -> None:
    column = Column("psnr", "translation error", higher_is_better=False, digits=".3f")
    error = np.zeros(30)
    error[7] = 2.7  # .09 m on average, with an interval that reaches zero
    rows = [row("exact", np.zeros(30)), row("off", error), row("worse", SCENES)]
    assert rows[1].scores["psnr"].low <= 0
    assert {name for name, _ in best(rows, [column], CLIPS)} == {"exact"}


def test_an_unfinished_row_and_one_without_rivals_are_not_bold() -> None:
    half = SCENES + 9
    half[:10] = np.nan
    assert bold(row("half", half), row("a", SCENES)) == set()


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """`good` has 1 dB more than `base` on every clip, `same` is base with noise, `short` lacks the
    hardest half.
    """
    results = Results(tmp_path)
    hard = np.argsort(SCENES)[:15]
    short = {clip: SCENES[n] + 0.5 for n, clip in enumerate(CLIPS) if n not in hard}
    rows = {
        "base": dict(zip(CLIPS, SCENES, strict=True)),
        "good": dict(zip(CLIPS, SCENES + 1 + OWN[3], strict=True)),
        "same": dict(zip(CLIPS, SCENES + OWN[0], strict=True)),
        "short": short,
    }
    write_protocol(results, rows, CLIPS, metrics=METRICS)
    for name, values in rows.items():
        write(results, name, {(clip, 0, "psnr"): float(value) for clip, value in values.items()})
    return results


def test_differences_are_paired_and_marked_when_they_are_certain(results: Results) -> None:
    table = tables.against(results, "base")
    by_name = {one.label: one for one in table.rows}
    good, same = by_name["good"].scores["psnr"], by_name["same"].scores["psnr"]
    assert good.mean == pytest.approx(1 + OWN[3].mean())
    assert 0.9 < good.low < good.high < 1.1
    assert same.low < 0.1
    assert same.high > -0.1
    assert ("good", "psnr") in table.marked
    assert ("same", "psnr") not in table.marked
    text = formats.markdown(table).splitlines()
    assert row_of(text, "good")[2].startswith("+1.0")
    assert "*" in row_of(text, "good")[2]
    assert "*" not in row_of(text, "same")[2]


def test_notes_explain_what_a_table_has_and_zero_has_no_minus_sign(tmp_path: Path) -> None:
    """Two clips have neither intervals nor bold numbers; -0.004 dB is +0.00 in a table."""
    results = Results(tmp_path)
    write_protocol(results, ["base", "same"], "xy", metrics=METRICS)
    for name, psnr in (("base", 20.0), ("same", 19.996)):
        write(results, name, {(clip, 0, "psnr"): psnr for clip in "xy"})
    text = formats.markdown(tables.build(results)[0])
    assert "A clip's value is the mean over its steps." in text
    assert not re.search(r"^- (\[low|.*±|Bold)", text, re.MULTILINE)
    differences = formats.markdown(tables.against(results, "base", "standard-error"))
    assert row_of(differences.splitlines(), "same")[2] == "+0.00 ± 0.00"


def test_a_row_with_fewer_clips_is_compared_on_common_ones(results: Results) -> None:
    # On its own easy clips `short` has far more than the base has on all; clip by clip it has half
    # a decibel.
    short = next(one for one in tables.against(results, "base").rows if one.label == "short")
    assert short.num_clips == 15
    assert short.scores["psnr"].mean == pytest.approx(0.5)
    assert row_of(lines(results), "short")[1].startswith("15")


def test_tables_say_what_the_clips_are_worth(results: Results) -> None:
    """Neighbours of a smooth curve are alike."""
    smooth = {(clip, 0, "psnr"): 20 + np.sin(n / 5) for n, clip in enumerate(CLIPS)}
    write(results, "base", smooth)
    clips, worth = row_of(lines(results), "base")[1].rstrip(")").split(" (")
    assert clips == "30"
    assert int(worth) < 10


def test_differences_of_chosen_methods(results: Results) -> None:
    table = tables.against(results.select("good", "good"), "base", metrics=("psnr",))
    assert [row.label for row in table.rows] == ["good"]
    with pytest.raises(BadData, match="no method is called 'bse'"):
        tables.against(results.select("good"), "bse")


def test_errors_are_not_tested_against_a_method_without_any(results: Results) -> None:
    for name, error in (("base", 0.0), ("good", 0.1)):
        write(results, name, {(clip, 0, "translation-error"): error for clip in CLIPS})
    table = tables.against(results.select("good"), "base")
    interval = table.rows[0].scores["translation-error"]
    assert (interval.low, interval.high) == (pytest.approx(0.1), pytest.approx(0.1))
    assert not table.marked
    assert any(note.startswith("base has no translation error") for note in table.notes)

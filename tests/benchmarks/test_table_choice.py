"""Rows and columns of a table as asked for, and LaTeX that a journal takes."""

import shutil
import subprocess
from pathlib import Path

import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from geovp_classic.errors import BadData
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import write_protocol
from tests.benchmarks.test_tables import METRICS, write

ODD = r"50%_a & b {x} <script> $5 #1 ~^ \ [z]"


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """Six clips; an oracle beside two rows without truth, one of which has two samples."""
    results = Results(tmp_path / "r")
    clips = [f"s/{number}" for number in range(6)]
    metrics = {**METRICS, "lpips": {**METRICS["lpips"], "unit": "", "higher_is_better": False}}
    metrics["translation-error"] = {**METRICS["translation-error"], "bounds": [0.0, None]}
    write_protocol(results, ["oracle", "plain", "odd"], clips, metrics=metrics)
    for name, psnr, samples in (("oracle", 30.0, 1), ("plain", 20.0, 1), ("odd", 10.0, 2)):
        values = {}
        for number, clip in enumerate(clips):
            for sample in range(samples):
                values[clip, sample, "psnr"] = psnr + number % 2
                values[clip, sample, "translation-error"] = 100.0 if number == 5 else 0.1
                values[clip, sample, "coverage"] = 0.9
        label = ODD if name == "odd" else name
        privileged_inputs = ["FUTURE_POSES"] if name == "oracle" else []
        write(
            results,
            name,
            values,
            label=label,
            privileged_inputs=privileged_inputs,
            num_samples=samples,
        )
    return results


def test_a_method_stands_for_all_rows_of_its_samples(results: Results) -> None:
    assert len(tables.build(results.select(ODD))[0].rows) == 2


def test_differences_of_chosen_rows(results: Results) -> None:
    table = tables.against(results.select("plain"), "oracle", metrics=("psnr",))
    assert [row.label for row in table.rows] == ["plain"]
    assert table.rows[0].scores["psnr"].mean == -10.0
    with pytest.raises(BadData, match="no method is called 'orcle'"):
        tables.against(results.select("plain"), "orcle")


def test_errors_are_not_tested_against_a_method_without_any(results: Results) -> None:
    clips = results.protocol()["clips"]
    write(results, "oracle", {(clip, 0, "translation-error"): 0.0 for clip in clips})
    table = tables.against(results, "oracle")
    interval = table.rows[0].scores["translation-error"]
    assert (interval.low, interval.high > 0) == (0.0, True)
    assert not table.marked
    assert table.notes[-1].startswith("oracle has no translation error")


class TestCompiled:
    """What an engine makes of it; the printed document is looked at word by word."""

    @pytest.fixture
    def compile(self, results: Results, tmp_path: Path, printed: Says) -> Says:
        engine = next(filter(None, map(shutil.which, ("tectonic", "pdflatex", "latex"))), None)
        if engine is None:
            pytest.skip(
                "no LaTeX engine (tectonic, pdflatex or latex) is installed: the tables were "
                "not compiled"
            )

        def compiled(*given: str) -> str:
            body = f"See \\ref{{tab:main}}.\n{printed('table', results.root, '--format', 'tex', *given)}"
            head = r"\documentclass{article}\usepackage{booktabs,graphicx}\begin{document}"
            (tmp_path / "t.tex").write_text(f"{head}\n{body}\\end{{document}}\n")
            quiet = (
                ["--keep-logs"] if Path(engine).stem == "tectonic" else ["-interaction=nonstopmode"]
            )
            for _ in range(2):  # references are known the second time
                done = subprocess.run(
                    [engine, *quiet, "t.tex"], cwd=tmp_path, capture_output=True, timeout=300
                )
            assert done.returncode == 0, done.stdout[-2000:]
            return (tmp_path / "t.log").read_text(errors="replace")

        return compiled

    @pytest.mark.parametrize(
        "given",
        [
            ["--metrics", "psnr", "coverage"],
            [
                "--metrics",
                "psnr",
                "lpips",
                "translation-error",
                "coverage",
                "--spread",
                "standard-error",
            ],
            ["--caption", r"Scores of $n = 6$ clips, \textbf{best}.", "--against", "plain"],
            [],
        ],
    )
    def test_nothing_is_too_wide_and_the_label_is_known(
        self, compile: Says, given: list[str]
    ) -> None:
        log = compile("--label", "tab:main", *given)
        for complaint in (
            "Overfull",
            "undefined",
            "multiply defined",
            "Float too large",
            "LaTeX Error",
        ):
            assert complaint not in log
        assert "Output written" in log or "tectonic" in log

"""Methods with several seeds: grouped by name, compared seed with seed and clip with clip."""

from pathlib import Path

import pytest

from geovp_benchmarks.results.store import Results
from studies import main, training_seeds
from tests.benchmarks.made import content, go, values

METRIC = "toy-difference"


@pytest.fixture
def results(toys: Path, tmp_path: Path) -> Results:
    """Five clips by two methods, one with two seeds and one with three, and a row without a seed."""
    rows = {f"base-{seed}": {"name": "toy-noise", "seed": seed} for seed in range(2)}
    rows |= {f"other-{seed}": {"name": "toy-noise", "seed": 10 + seed} for seed in range(3)}
    go(tmp_path / "out", content(predictors={"still": "toy-still", **rows}))
    return Results(tmp_path / "out")


def test_a_line_has_the_means_and_the_paired_differences(results: Results) -> None:
    head, base, other = training_seeds.table(results, "base", METRIC)
    means = {
        name: sum(found := values(results.root, name, METRIC)) / len(found)
        for name in ("base-0", "base-1", "other-0", "other-1", "other-2")
    }
    assert head[3] == "difference from base"
    assert base == [
        "base",
        f"{(means['base-0'] + means['base-1']) / 2:.3f}",
        f"{means['base-0']:.3f} {means['base-1']:.3f}",
        "",
        "",
    ]
    assert other[2].split() == [f"{means[f'other-{seed}']:.3f}" for seed in range(3)]
    offs = [
        means[f"other-{seed}"] - means[f"base-{seed}"] for seed in range(2)
    ]  # of the seeds that both have
    assert other[3].startswith(f"{sum(offs) / 2:+.3f} [")
    assert other[4] == " ".join(f"{off:+.3f}" for off in offs)


def test_the_command_prints_a_table_a_metric_or_one_sentence(
    results: Results, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["training-seeds", str(results.root), "base", "--metrics"]
    assert main([*words, METRIC]) == 0
    assert "difference from base" in capsys.readouterr().out
    assert main(["training-seeds", str(results.root), "bas", "--metrics", METRIC]) == 2
    assert "has no methods bas-SEED: methods with seeds are base, other" in capsys.readouterr().err
    assert main([*words, "nothing"]) == 2
    assert "has no metric 'nothing', only" in capsys.readouterr().err

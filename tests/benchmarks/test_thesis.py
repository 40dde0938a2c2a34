"""The thesis's table: its names, its order, its numbers apart from ours."""

from pathlib import Path

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import formats, published
from tests.benchmarks.made import write_protocol, write_row


def test_the_best_of_several_samples_does_not_compete_with_single_predictions(
    tmp_path: Path,
) -> None:
    """Sixteen clips; the best of four samples has 15 dB, a single one 14.5, which is
    the best of its kind; a method without rivals is not bold.
    """
    results = Results(tmp_path / "thesis")
    facts = {"role": "frame", "unavailable": None, "definition": "per frame"}
    methods, clips = (
        {"copy-last": (1, 14.5), "svg-100": (4, 12.0), "svg-1": (1, 12.0)},
        "abcdefghijklmnop",
    )
    metrics = {"psnr": {**facts, "higher_is_better": True}}
    write_protocol(results, list(methods), clips, metrics=metrics)
    for name, (samples, psnr) in methods.items():
        lines = [
            (clip, sample, 1, "psnr", psnr + sample + 0.01 * (-1) ** offset)
            for offset, clip in enumerate(clips)
            for sample in range(samples)
        ]
        write_row(results, name, lines, num_samples=samples)
    ours, theirs = published.build(results, "thesis")
    rows = {method.label: method for method in ours.rows}
    assert rows["SVG - 4 Samples"].is_oracle_selected
    assert not rows["SVG - 1 Sample"].is_oracle_selected
    assert {label for label, _ in ours.marked} == {"copy-last"}
    assert "**13.504** ± 0.070" in formats.markdown(theirs)
    assert r"SRVP - 100 Samples & - & \textbf{13.504} $\pm$ 0.070" in formats.latex(theirs)
